"""A comparison counts every subject under every method: what is missing is named, never passed over."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from scaling_service.core.arrays import Array
from scaling_service.core.errors import InputError


class ValueMissing(InputError):
    """A value that a comparison needs is absent or not a finite number."""


class ComparisonImpossible(InputError):
    """What was given is too little, or too unlike, to be compared."""


def require_complete(
    values: ArrayLike, subjects: Sequence[str], methods: Sequence[str], *, quantity: str, dimensions: int
) -> Array:
    """A complete table of finite numbers as a read-only copy.

    ``values``: (n_subjects, n_methods) or (n_subjects, n_methods, n_nodes).
    ``subjects``, ``methods``: the names of the first two axes.
    ``quantity``: what is compared; it heads the message of an error.
    ``dimensions``: 2 for scalars, 3 for curves.
    Raises ComparisonImpossible: a name given twice, fewer than two subjects or methods, or a shape that does
        not fit the names.
    Raises ValueMissing: a value that is not finite; subject and method are named, and the node of a curve.
    """
    table = np.array(values, dtype=np.float64)
    for kind, names in (("subject", subjects), ("method", methods)):
        twice = sorted({name for name in names if list(names).count(name) > 1})
        if twice:
            raise ComparisonImpossible(
                f"two {kind}s are called '{twice[0]}'", field=quantity, remedy="Give each its own name"
            )
        if len(names) < 2:
            raise ComparisonImpossible(
                f"a comparison needs at least two {kind}s, and there is {len(names)}",
                field=quantity,
                remedy=f"Add a {kind}",
            )
    if table.ndim != dimensions or table.shape[:2] != (len(subjects), len(methods)) or table.size == 0:
        raise ComparisonImpossible(
            f"values of shape {table.shape} do not fit {len(subjects)} subjects and {len(methods)} methods",
            field=quantity,
            remedy="Give one row per subject and one column per method",
        )
    gaps = np.argwhere(~np.isfinite(table))
    if len(gaps):
        first = gaps[0]
        place = f"subject '{subjects[first[0]]}', method '{methods[first[1]]}'"
        if table.ndim == 3:
            place += f", node {first[2]} of {table.shape[2]}"
        others = f", and {len(gaps) - 1} more" if len(gaps) > 1 else ""
        raise ValueMissing(
            f"no finite value at {place}{others}",
            field=quantity,
            remedy="Compute it, or leave the subject or the method out of the comparison",
        )
    table.setflags(write=False)
    return table


def report_absent(subject: str, method: str, quantity: str) -> ValueMissing:
    """The error for a subject that has nothing at all under a method."""
    return ValueMissing(
        f"subject '{subject}' has no value for method '{method}'",
        field=quantity,
        remedy="Compute it, or leave the subject or the method out of the comparison",
    )


@dataclass(frozen=True, slots=True)
class Panel:
    """Methods, and the subjects that have a value under each of them.

    ``excluded``: every other subject to what it lacks, plain English.
    """

    methods: tuple[str, ...]
    subjects: tuple[str, ...]
    excluded: Mapping[str, str]


def list_panels(available: Mapping[str, Collection[str]], methods: Sequence[str]) -> tuple[Panel, ...]:
    """The comparisons that a cohort allows, those of most methods first.

    Every set of two or more methods that some subject has is one comparison, over all subjects that have
    at least these. A few subjects with images then give the image-based comparison, and count with the
    others in the marker-based one.

    ``available``: subject to the methods under which it has a value.
    ``methods``: those of interest, in the order to show.
    Sets of one method are there only where there is nothing else; empty where nobody has a value.

    Examples
    --------
    >>> both = list_panels({"A": ["MB", "MB_am", "EB"], "B": ["MB", "MB_am"]}, ["MB", "MB_am", "EB"])
    >>> [(p.methods, p.subjects, dict(p.excluded)) for p in both]
    [(('MB', 'MB_am', 'EB'), ('A',), {'B': 'no EB'}), (('MB', 'MB_am'), ('A', 'B'), {})]
    """
    sets = {tuple(m for m in methods if m in has) for has in available.values()} - {()}
    most = max(map(len, sets), default=0)
    chosen = [found for found in sets if len(found) >= min(2, most)]
    order = sorted(chosen, key=lambda found: (-len(found), [list(methods).index(m) for m in found]))
    panels = []
    for found in order:
        lacks = {s: [m for m in found if m not in has] for s, has in available.items()}
        panels.append(
            Panel(
                found,
                tuple(s for s, missing in lacks.items() if not missing),
                {
                    s: f"no {', '.join(missing)}" if len(missing) < len(found) else "no value"
                    for s, missing in lacks.items()
                    if missing
                },
            )
        )
    return tuple(panels)
