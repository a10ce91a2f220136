"""Who is compared under what: only subjects that have all methods of a comparison; the rest are named."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Panel:
    """Methods, and the subjects that have a value under each of them.

    Parameters
    ----------
    methods, subjects : tuples of str
    excluded : mapping
        Every other subject to what it lacks, plain English.
    """

    methods: tuple[str, ...]
    subjects: tuple[str, ...]
    excluded: Mapping[str, str]


def panels(available: Mapping[str, Collection[str]], methods: Sequence[str]) -> tuple[Panel, ...]:
    """The comparisons that a cohort allows, those of most methods first.

    Every set of two or more methods that some subject has is one comparison, over all subjects that have
    at least these. A few subjects with images then give the image-based comparison, and count with the
    others in the marker-based one.

    Parameters
    ----------
    available : mapping
        Subject to the methods under which it has a value.
    methods : sequence of str
        Those of interest, in the order to show.

    Returns
    -------
    tuple of Panel
        Sets of one method only where there is nothing else; empty where nobody has a value.

    Examples
    --------
    >>> both = panels({"A": ["MB", "MB_am", "EB"], "B": ["MB", "MB_am"]}, ["MB", "MB_am", "EB"])
    >>> [(p.methods, p.subjects, dict(p.excluded)) for p in both]
    [(('MB', 'MB_am', 'EB'), ('A',), {'B': 'no EB'}), (('MB', 'MB_am'), ('A', 'B'), {})]
    """
    sets = {tuple(m for m in methods if m in has) for has in available.values()} - {()}
    most = max(map(len, sets), default=0)
    chosen = [found for found in sets if len(found) >= min(2, most)]
    order = sorted(chosen, key=lambda found: (-len(found), [list(methods).index(m) for m in found]))
    return tuple(_panel(available, found) for found in order)


def _panel(available: Mapping[str, Collection[str]], methods: tuple[str, ...]) -> Panel:
    lacks = {s: [m for m in methods if m not in has] for s, has in available.items()}
    return Panel(
        methods,
        tuple(s for s, missing in lacks.items() if not missing),
        {
            s: f"no {', '.join(missing)}" if len(missing) < len(methods) else "no value"
            for s, missing in lacks.items()
            if missing
        },
    )
