"""Sizes of a person of whom there are rotations alone: by stature, sex, and a system's joint centres."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

import numpy as np

from scaling_service.capabilities.scaling.sizes import sizing
from scaling_service.capabilities.scaling.sizes.ratios import Ratios
from scaling_service.core.names import say_names
from scaling_service.model.anatomy.rotations import read_rotation_table
from scaling_service.model.body import Vector
from scaling_service.model.subject import Session

_LEAST_M = 0.05  # chosen: centres that lie nearer are seen from the side, in one plane

_BETWEEN: Mapping[str, tuple[tuple[str, str], ...]] = MappingProxyType(
    {
        f"{dimension}_{side}": (
            (f"{side}_{own}", f"{side}_{next_}"),
            (f"{side.upper()}{one}", f"{side.upper()}{other}"),
        )
        for side in "rl"
        for dimension, own, next_, one, other in (
            ("femur", "thigh", "shank", "Hip", "Knee"),
            ("shank", "shank", "foot", "Knee", "Ankle"),
            ("upper_arm", "uarm", "larm", "Shoulder", "Elbow"),
            ("forearm", "larm", "hand", "Elbow", "Wrist"),
        )
    }
    | {"inter_hip": (("l_thigh", "r_thigh"), ("LHip", "RHip"))}
)
"""Dimension to what it lies between: origins of a markerless system's segments, key points of video."""


def size_without_markers(session: Session) -> sizing.Sizing:
    """Factors of each segment where no recording has a marker: as of persons of this stature and sex.

    And by how far apart a markerless system has the joint centres, where the recordings are such a system's.
    """
    subject, model = session.subject, session.model
    # A person's dimensions by joint centres that a system without markers tells, m, as far as it does
    found: dict[str, list[float]] = {}
    for trial in (session.static, *session.dynamic, *session.rotations):
        if trial is None:
            continue
        places = {label: trial.position(label) for label in trial.labels}
        held = trial.rotations
        if held is not None and held.origins is not None:
            plain = [label.rpartition(":")[2].lower().partition("_4x4")[0] for label in held.labels]
            places |= {name: held.origins[:, k] for k, name in enumerate(plain)}
        for dimension, pairs in _BETWEEN.items():
            for one, other in pairs:
                if {one, other} <= places.keys():
                    found.setdefault(dimension, []).append(
                        sizing.measure_distance(places[one], places[other])
                    )
    means = {name: float(np.mean(np.array(values)[np.isfinite(values)])) for name, values in found.items()}
    lengths = {name: value for name, value in means.items() if value > _LEAST_M}
    sd = float(np.sqrt(2.0) * read_rotation_table().centre)
    prior = sizing.expect_dimensions(subject).condition({name: (at, sd) for name, at in lengths.items()})
    nothing = Ratios((), np.zeros(0), np.zeros((0, 0)))
    sizes = sizing.estimate_sizes(model, nothing, prior)
    factors: dict[str, Vector] = {name: (size.factor,) * 3 for name, size in sizes.items()}
    for segment, (factor, *_) in factors.items():
        sizing.check_factor(factor, segment)
    known = [
        f"{name} {value}" for name, value in (("sex", subject.sex), ("stature", subject.height_m)) if value
    ]
    like = " and ".join(known) or "nothing known"
    beside = f", and by joint centres without markers ({say_names(lengths)})" if lengths else ""
    deviations = sizing.format_percent([size.sd for size in sizes.values()])
    note = f"MB: no markers: sized as persons of {like} are{beside} (standard deviation {deviations})"
    return sizing.Sizing(factors=factors, sizes=sizes, centres={}, people=(), notes=(note,))
