"""Labels that no marker of the model took: the segment that each one sits on, as far as that shows."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from scaling_service.capabilities.intake.document import ExtraMarker, MarkerProof
from scaling_service.model.anatomy.marker_sets import tracking_segments
from scaling_service.model.anatomy.markers import looks_computed, strip_prefix
from scaling_service.model.body import BodyModel
from scaling_service.model.trial import Trial, is_unlabelled
from scaling_service.numerics.least_squares.masks import ever
from scaling_service.numerics.least_squares.masks import seen as seen_in

RIGID_MM, STANDS_OUT = 5.0, 0.6
"""Chosen: distances between markers of one thigh change by less, and by less than this share of what they
change to the next segment's markers; else nothing is said."""

FEWEST = 3
"""Markers that a segment must have: a shank's marker keeps its distance from both epicondyles, too."""

_SAID = (("femur", re.compile(r"THI")), ("tibia", re.compile(r"TIB|SHK|SHANK|LEG")))
"""Words in labels of tracking markers that no marker set knows, and where those sit."""


def extra_markers(
    markers: Sequence[MarkerProof], unused: Sequence[str], trials: Mapping[str, Trial], model: BodyModel
) -> list[ExtraMarker]:
    """The segment of each further label: as its set or name says, else the one it keeps its distances to.

    ``markers``: with the labels that were proposed. ``unused``: labels that no marker took; points that
    software computed are left out. ``trials``: name to recording, m.
    """
    known = tracking_segments(unused, model)
    carried: dict[str, list[str]] = {}
    for entry in markers:
        if entry.label is not None:
            carried.setdefault(entry.segment, []).append(entry.label)
    return [
        _entry(label, known.get(label), carried, trials)
        for label in unused
        if not looks_computed(label) and not is_unlabelled(label)
    ]


def with_extra_markers(
    proposed: Mapping[str, Any], model: BodyModel, unused: Sequence[str], trials: Mapping[str, Trial]
) -> dict[str, Any]:
    """A subject document with the tracking markers that its marker set knows, where it names none itself.

    Only labels that are seen while standing, which places them, and in a movement, which they then follow.

    ``unused``: labels that no marker of the model took. ``trials``: file to recording.
    """
    static = trials.get(str(proposed["trials"].get("static")))
    if proposed.get("extra_markers") or static is None:
        return dict(proposed)
    standing = _labels_seen([static])
    moving = _labels_seen([t for file, t in trials.items() if t is not static and _is_named(file, proposed)])
    known = tracking_segments([label for label in unused if label in standing & moving], model)
    found = {strip_prefix(label): segment for label, segment in known.items()}
    return {**proposed, **({"extra_markers": found} if found else {})}


def _is_named(file: str, proposed: Mapping[str, Any]) -> bool:
    return any(file in proposed["trials"].get(role, ()) for role in ("calibration", "evaluation"))


def _labels_seen(trials: Sequence[Trial]) -> set[str]:
    """The labels that are seen in some frame of any of these recordings."""
    return {t.labels[k] for t in trials for k in np.flatnonzero(ever(seen_in(t.markers)))}


def _entry(
    label: str, known: str | None, carried: Mapping[str, Sequence[str]], trials: Mapping[str, Trial]
) -> ExtraMarker:
    spreads = {name: _spread_mm(label, others, trials) for name, others in carried.items()}
    segment = known or said_of(label)
    if segment not in spreads and known is None:
        segment = _clear({name: s for name, s in spreads.items() if len(carried[name]) >= FEWEST})
    spread = float("inf") if segment is None else spreads.get(segment, float("inf"))
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
