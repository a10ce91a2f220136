"""People made from the built-in model: their size, axes and markers are known, nothing disturbs them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from scaling_service.model.body import BodyModel, Vector
from scaling_service.model.builtin import load_builtin
from scaling_service.model.compile import compile_model, list_parameter_values, repeat_default_pose
from scaling_service.model.parameters import compute_axis, fold, free_axis, free_marker
from scaling_service.model.poses import pose_neutral_frames, pose_neutral_markers
from scaling_service.model.scaling import scale_model
from scaling_service.model.subject import Session, Subject
from scaling_service.model.trial import ImageEvidence, Trial
from scaling_service.numerics.multibody.tree import pose_markers

RATE_HZ = 100.0
KNEES = ("knee_r", "knee_l")


@dataclass(frozen=True)
class Person:
    """A true model and the session that a laboratory would record of it."""

    truth: BodyModel
    session: Session


def trial(model: BodyModel, name: str, q: np.ndarray, noise_m: float, rng: np.random.Generator) -> Trial:
    """The markers of a model over coordinates (n_frames, n_coordinates)."""
    names = [m.name for m in model.markers if m.weight > 0]
    tree = compile_model(model, names)
    markers = pose_markers(tree, q, list_parameter_values(model))
    markers = markers + rng.normal(0.0, noise_m, markers.shape)
    return Trial(
        name=name, times=np.arange(len(q)) / RATE_HZ, labels=tuple(names), markers=markers, rate_hz=RATE_HZ
    )


def movement(model: BodyModel, n_frames: int, rng: np.random.Generator) -> np.ndarray:
    """Smooth motion of every joint through a good part of its range, (n_frames, n_coordinates)."""
    times = np.arange(n_frames) / RATE_HZ
    q = repeat_default_pose(model, n_frames)
    for k, coordinate in enumerate(model.coordinates):
        size, middle = (0.2, 0.0) if coordinate.name.startswith("pelvis") else (0.35, 0.1)
        if coordinate.name.startswith("knee"):
            size, middle = 0.8, 0.9
        rate = rng.uniform(0.2, 0.9)
        q[:, k] += middle + size * np.sin(2 * np.pi * (rate * times + rng.uniform()))
    return q


def person(
    seed: int,
    *,
    factors: dict[str, Vector] | None = None,
    tilts_deg: dict[str, Vector] | None = None,
    shift_m: float = 0.0,
    noise_m: float = 0.0,
    seconds: float = 12.0,
    model: str = "lower_limb_14dof",
) -> Person:
    """A person of a built-in leg model: scaled, with turned knee axes and shifted markers."""
    rng = np.random.default_rng(seed)
    generic = load_builtin(model)
    truth = scale_model(generic, factors or {})
    values: dict[str, float] = {}
    for joint, (x, y, *_) in (tilts_deg or {}).items():
        truth = free_axis(truth, joint, 1.0, 1.0)
        values |= {f"axis.{joint}.x": np.deg2rad(x), f"axis.{joint}.y": np.deg2rad(y)}
    for marker in truth.markers if shift_m else ():
        if marker.weight > 0:
            truth = free_marker(truth, marker.name, "xyz", 0.05)
            values |= {f"marker.{marker.name}.{a}": rng.normal(0.0, shift_m) for a in "xyz"}
    truth = fold(truth, values)
    standing = trial(truth, "static", repeat_default_pose(truth, 50), noise_m, rng)
    frames = int(seconds * RATE_HZ)
    moving = [trial(truth, n, movement(truth, frames, rng), noise_m, rng) for n in ("hips", "walk")]
    session = Session(
        subject=Subject(id="P", model=generic.name),
        model=generic,
        static=standing,
        calibration=(moving[0],),
        evaluation=(moving[1],),
    )
    return Person(truth, session)


LYING = {"knee_angle_r": 0.12, "knee_angle_l": 0.05, "hip_rotation_r": 0.2, "hip_adduction_l": -0.1}


def imaged(
    who: Person,
    tilts_deg: dict[str, Vector],
    sides: str = "rl",
    *,
    markers: bool = True,
    epicondyles: bool = True,
) -> ImageEvidence:
    """What an image would show of the person lying, in a frame of its own."""
    turn, shift = Rotation.from_rotvec([0.4, -1.3, 2.0]).as_matrix(), np.array([0.3, -0.2, 1.1])

    def there(point: np.ndarray) -> tuple[float, float, float]:
        x, y, z = turn @ point + shift
        return (float(x), float(y), float(z))

    frames = pose_neutral_frames(who.truth, LYING)
    placed = pose_neutral_markers(who.truth, LYING)
    centres, axes, landmarks = {}, {}, {}
    for side in sides:
        centres[f"hip_{side}"] = there(frames[f"femur_{side}"][1])
        centres[f"knee_{side}"] = there(frames[f"tibia_{side}"][1])
        foot = frames.get(f"calcn_{side}")
        centres[f"ankle_{side}"] = there(placed[f"{side.upper()}AJC"] if foot is None else foot[1])
        thigh = frames[f"femur_{side}"][0]
        x, y = np.radians(tilts_deg[f"knee_{side}"][:2])
        dx, dy, dz = turn @ thigh @ compute_axis((x, y))
        axes[f"knee_{side}"] = (-float(dx), -float(dy), -float(dz))  # whichever way round
        if epicondyles:
            outward = np.array([0.0, 0.0, 0.04 if side == "r" else -0.04])
            knee = frames[f"tibia_{side}"][1]
            landmarks[f"{side.upper()}LFE"] = there(knee + thigh @ outward)
            landmarks[f"{side.upper()}MFE"] = there(knee - thigh @ outward)
    segments = {m.name: m.segment for m in who.truth.markers if m.weight > 0}
    seen = {
        name: (segment, there(placed[name]))
        for name, segment in segments.items()
        if markers and (segment == "pelvis" or segment[-1] in sides)
    }
    if not markers:
        landmarks |= {name: there(placed[name]) for name in ("RASIS", "LASIS", "RPSIS", "LPSIS")}
    return ImageEvidence(centres=centres, axes=axes, landmarks=landmarks, markers=seen, source="made")
