"""Virtual persons as a clinic marks them: lateral markers, one sacral marker, wands, widths by caliper.

Bones are those of the virtual cohort. On top of the placement errors of markers come what regressions and
constructions leave between persons: where the hips lie in the pelvis, the shape of the pelvis, joint centres
beside the middle of their landmarks.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from scaling_service.core.streams import stream
from scaling_service.model.anatomy.centres import (
    CALIPER_SD_M,
    JOINT_SD_M,
    REGRESSION_SD_M,
    look_up_landmark_sd,
)
from scaling_service.model.body import BodyModel, Law, Marker
from scaling_service.model.builtin import load_builtin
from scaling_service.model.compile import compile_model, list_parameter_values
from scaling_service.model.subject import Session, Subject
from scaling_service.model.trial import Trial
from scaling_service.numerics.multibody.tree import pose_markers
from scaling_service.virtual.subject import VirtualSettings, make_virtual_subject

RADIUS_M = 0.007
STANDING = VirtualSettings(
    placement=0.0, artefact=0.0, functional_s=0.1, static_s=0.2, strides=0.3, gait_trials=0
)
PELVIS_SHAPE_M = 0.012  # of inter-ASIS width and pelvic depth at one size, as the measurements assume


@dataclass(frozen=True)
class Patient:
    """A session with one standing trial, the true body, and the true joint centres standing, (3,), m."""

    session: Session
    truth: BodyModel
    centres: dict[str, np.ndarray]


def patient(seed: int) -> Patient:
    who = make_virtual_subject(seed, STANDING)
    rng = stream(seed, "conventional")
    markers = {m.name: m for m in who.model.markers}
    shift = {name: np.zeros(3) for name in markers}
    _shape(rng, shift)
    sizes = {"marker_diameter": 2.0 * RADIUS_M}
    for side in "rl":
        for joint, outer, inner in (("knee", "LFE", "MFE"), ("ankle", "LM", "MM")):
            ends = [np.array(markers[f"{side.upper()}{n}"].nominal) for n in (outer, inner)]
            width = float(np.linalg.norm(ends[0] - ends[1])) - 2.0 * RADIUS_M
            sizes[f"{joint}_width_{side}"] = width + CALIPER_SD_M * rng.normal()
    placed = [
        _moved(m, shift[m.name] + look_up_landmark_sd(m.name) * rng.normal(size=3))
        for m in who.model.markers
        if m.weight > 0.0 and m.name[1:] in ("ASIS", "LFE", "FH", "LM")
    ]
    back = np.mean([np.array(markers[n].nominal) + shift[n] for n in ("RPSIS", "LPSIS")], axis=0)
    placed.append(Marker.at("SACR", "pelvis", tuple(back + look_up_landmark_sd("SACR") * rng.normal(size=3))))
    for side in "RL":
        for name, segment, outer, inner in (("THI", "femur", "LFE", "MFE"), ("TIB", "tibia", "LM", "MM")):
            across = np.subtract(markers[side + outer].nominal, markers[side + inner].nominal)
            across[1] = 0.0  # a wand is held in the plane of the joint below
            local = 0.1 * across / np.linalg.norm(across) + [0.0, -0.2, 0.0] + 0.005 * rng.normal(size=3)
            placed.append(Marker.at(side + name, f"{segment}_{side.lower()}", tuple(local)))
    q = who.motions["static"]
    recorded = _positions(who.model.with_markers(tuple(placed)), q)
    recorded = recorded + 2e-4 * rng.normal(size=recorded.shape)
    static = Trial(
        name="static",
        times=np.arange(len(q)) / 100.0,
        labels=tuple(m.name for m in placed),
        markers=recorded,
        rate_hz=100.0,
    )
    subject = Subject(
        id=str(seed),
        model="lower_limb_14dof",
        sex=who.sex,
        height_m=who.height_m,
        mass_kg=who.mass_kg,
        sizes_m=sizes,
        extra_markers={
            f"{s}{n}": f"{b}_{s.lower()}" for s in "RL" for n, b in (("THI", "femur"), ("TIB", "tibia"))
        },
    )
    session = Session(
        subject=subject, model=load_builtin("lower_limb_14dof"), static=static, calibration=(), evaluation=()
    )
    return Patient(session, who.model, _centres(who.model, q))


def _shape(rng: np.random.Generator, shift: dict[str, np.ndarray]) -> None:
    """How this person's landmarks lie otherwise about the joints than the generic model's, scaled, m."""
    hips = np.array(REGRESSION_SD_M["harrington2007_single"]) * rng.normal(size=3)
    width, depth = PELVIS_SHAPE_M * rng.normal(size=2)
    hips += [
        0.24 * depth,
        0.30 * width,
        0.0,
    ]  # the scatter is about what Harrington 2007 predicts of this pelvis
    for side, outward in (("R", 1.0), ("L", -1.0)):
        shift[f"{side}ASIS"] += hips + np.array([0.0, 0.0, 0.5 * outward * width])
        shift[f"{side}PSIS"] += hips - np.array([depth, 0.0, 0.0])
        for joint in (("LFE", "MFE"), ("LM", "MM")):
            beside = JOINT_SD_M * rng.normal(size=3)
            for name in joint:
                shift[side + name] += beside


def _moved(marker: Marker, by: np.ndarray) -> Marker:
    x, y, z = (law + Law.constant(float(v)) for law, v in zip(marker.laws, by, strict=True))
    return replace(marker, laws=(x, y, z))


def _positions(model: BodyModel, q: np.ndarray) -> np.ndarray:
    return pose_markers(compile_model(model), q, list_parameter_values(model))


def _centres(model: BodyModel, q: np.ndarray) -> dict[str, np.ndarray]:
    ankles = {side: model.marker(f"{side.upper()}AJC").nominal for side in "rl"}
    points = [
        Marker.at(f"{joint}_{side}", f"{segment}_{side}", at)
        for side in "rl"
        for joint, segment, at in (
            ("hip", "femur", (0.0, 0.0, 0.0)),
            ("knee", "tibia", (0.0, 0.0, 0.0)),
            ("ankle", "tibia", ankles[side]),
        )
    ]
    found = _positions(model.with_markers(tuple(points)), q).mean(axis=0)
    return {point.name: at for point, at in zip(points, found, strict=True)}
