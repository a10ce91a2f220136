"""Labels that no marker of the model took: the segment that each one sits on, as far as that shows."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

import numpy as np

from scaling_service.anatomy.markers import looks_computed, strip_prefix
from scaling_service.models.trial import Trial
from scaling_service.schemas.proof import ExtraMarker, MarkerProof

RIGID_MM, STANDS_OUT = 5.0, 0.6
"""Chosen: distances between markers of one thigh change by less, and by less than this share of what they
change to the next segment's markers; else nothing is said."""

FEWEST = 3
"""Markers that a segment must have: a shank's marker keeps its distance from both epicondyles, too."""

_SAID = (("femur", re.compile(r"THI")), ("tibia", re.compile(r"TIB|TUB|SHN|SHK|SHANK|LEG")))
"""Words in usual labels of tracking markers, and where those sit."""


def extra_markers(
    markers: Sequence[MarkerProof], unused: Sequence[str], trials: Mapping[str, Trial]
) -> list[ExtraMarker]:
    """The segment of each further label: as its name says, else the one whose markers keep their distances.

    Parameters
    ----------
    markers : sequence of MarkerProof
        With the labels that were proposed.
    unused : sequence of str
        Labels that no marker took; points that software computed are left out.
    trials : mapping
        Name to recording, m.
    """
    carried: dict[str, list[str]] = {}
    for entry in markers:
        if entry.label is not None:
            carried.setdefault(entry.segment, []).append(entry.label)
    return [_entry(label, carried, trials) for label in unused if not looks_computed(label)]


def _entry(label: str, carried: Mapping[str, Sequence[str]], trials: Mapping[str, Trial]) -> ExtraMarker:
    spreads = {name: _spread_mm(label, others, trials) for name, others in carried.items()}
    segment = said_of(label)
    if segment not in spreads:
        segment = _clear({name: s for name, s in spreads.items() if len(carried[name]) >= FEWEST})
    spread = float("inf") if segment is None else spreads[segment]
    return ExtraMarker(
        label=label, segment=segment, spread_mm=round(spread, 1) if np.isfinite(spread) else None
    )


def said_of(label: str) -> str | None:
    """The segment that a label's words tell.

    Examples
    --------
    >>> said_of("RTHI"), said_of("S01:L_tib2"), said_of("C7")
    ('femur_r', 'tibia_l', None)
    """
    plain = strip_prefix(label).upper()
    segment = next((name for name, pattern in _SAID if pattern.search(plain)), None)
    return f"{segment}_{plain[0].lower()}" if segment is not None and plain[0] in "RL" else None


def _clear(spreads: Mapping[str, float]) -> str | None:
    """The segment that stands out by how little distances to it change."""
    order = sorted(spreads, key=lambda name: spreads[name])
    if not order or spreads[order[0]] >= RIGID_MM:
        return None
    stands_out = len(order) < 2 or spreads[order[0]] < STANDS_OUT * spreads[order[1]]
    return order[0] if stands_out else None


def _spread_mm(label: str, others: Sequence[str], trials: Mapping[str, Trial]) -> float:
    """Largest standard deviation of a label's distance to others over all recordings; infinite if unknown."""
    found = [0.0]
    seen = False
    for trial in (t for t in trials.values() if label in t.labels):
        for other in (o for o in others if o in trial.labels):
            distance = np.linalg.norm(trial.position(label) - trial.position(other), axis=1)
            known = distance[np.isfinite(distance)]
            if len(known) > 1:
                found.append(1e3 * float(known.std()))
                seen = True
    return max(found) if seen else float("inf")
