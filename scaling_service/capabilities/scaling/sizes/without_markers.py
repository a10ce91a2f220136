"""Sizes of a person of whom there are rotations alone: by stature, sex, and a system's joint centres."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import MappingProxyType

import numpy as np

from scaling_service.capabilities.scaling.sizes.ratios import Ratios
from scaling_service.capabilities.scaling.sizes.sizing import (
    Sizing,
    check_factor,
    estimate_sizes,
    expect_dimensions,
    format_percent,
    measure_distance,
)
from scaling_service.core.errors import TrialUnusable
from scaling_service.core.text import list_few
from scaling_service.model.anatomy.rotations import read_rotation_table
from scaling_service.model.body import Vector
from scaling_service.model.subject import Session
from scaling_service.model.trial import Trial

_BETWEEN: Mapping[str, tuple[str, str]] = MappingProxyType(
    {
        **{f"femur_{s}": (f"{s}_thigh", f"{s}_shank") for s in "rl"},
        **{f"shank_{s}": (f"{s}_shank", f"{s}_foot") for s in "rl"},
        **{f"upper_arm_{s}": (f"{s}_uarm", f"{s}_larm") for s in "rl"},
        **{f"forearm_{s}": (f"{s}_larm", f"{s}_hand") for s in "rl"},
        "inter_hip": ("l_thigh", "r_thigh"),
    }
)
"""Dimension to the segments of a markerless system between whose origins, proximal joint centres, it lies."""


def has_rotations_alone(session: Session) -> bool:
    """Whether no recording of a session has a marker, and some have rotations."""
    return bool(session.rotations) and session.static is None and not session.dynamic


def refuse_without_markers(methods: Sequence[str]) -> None:
    """Refuse methods that are fitted to markers (TrialUnusable)."""
    for method in methods:
        if method != "MB":
            raise TrialUnusable(
                f"{method} is fitted to markers, and the recordings hold rotations alone",
                field="method",
                remedy="Choose MB, which then sizes the model by sex, stature and a markerless system's "
                "joint centres; or name a standing trial with markers under `trials:`",
            )


def size_without_markers(session: Session) -> Sizing:
    """Factors of each segment where no recording has a marker: as of persons of this stature and sex.

    And by how far apart a markerless system has the joint centres, where the recordings are such a system's.
    """
    subject, model = session.subject, session.model
    lengths = _measure_between_origins(session.rotations)
    sd = float(np.sqrt(2.0) * read_rotation_table().centre)
    prior = expect_dimensions(subject).condition({name: (at, sd) for name, at in lengths.items()})
    nothing = Ratios((), np.zeros(0), np.zeros((0, 0)))
    sizes = estimate_sizes(model, nothing, prior)
    factors: dict[str, Vector] = {name: (size.factor,) * 3 for name, size in sizes.items()}
    for segment, (factor, *_) in factors.items():
        check_factor(factor, segment)
    known = [
        f"{name} {value}" for name, value in (("sex", subject.sex), ("stature", subject.height_m)) if value
    ]
    like = " and ".join(known) or "nothing known"
    beside = f", and by joint centres of the markerless system ({list_few(list(lengths))})" if lengths else ""
    deviations = format_percent([size.sd for size in sizes.values()])
    note = f"MB: no markers: sized as persons of {like} are{beside} (standard deviation {deviations})"
    return Sizing(factors=factors, sizes=sizes, centres={}, people=(), notes=(note,))


def _measure_between_origins(trials: Sequence[Trial]) -> dict[str, float]:
    """A person's dimensions by the origins of a markerless system's segments, m, as far as they are told."""
    found: dict[str, list[float]] = {}
    for trial in trials:
        held = trial.rotations
        if held is None or held.origins is None:
            continue
        row = {
            label.rpartition(":")[2].lower().partition("_4x4")[0]: k for k, label in enumerate(held.labels)
        }
        for dimension, (one, other) in _BETWEEN.items():
            if {one, other} <= row.keys():
                apart = measure_distance(held.origins[:, row[one]], held.origins[:, row[other]])
                found.setdefault(dimension, []).append(apart)
    means = {name: float(np.mean(np.array(values)[np.isfinite(values)])) for name, values in found.items()}
    return {name: value for name, value in means.items() if np.isfinite(value)}
