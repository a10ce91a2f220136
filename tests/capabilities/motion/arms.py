"""An arm whose shoulder is three turns about given axes and whose elbow bends one way only."""

from __future__ import annotations

import numpy as np

from scaling_service.core.arrays import Array
from scaling_service.model.body import GROUND, BodyModel, Coordinate, Joint, Law, Marker, Segment
from scaling_service.model.compile import compile_model, list_parameter_values, repeat_default_pose
from scaling_service.model.trial import Trial
from scaling_service.numerics.multibody.tree import pose_markers

X, Y, Z = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)
ROOT = ("tx", "ty", "tz", "tilt", "list", "turn")
SHOULDER = ("flexion", "adduction", "rotation")


def arm(axes: tuple[tuple[float, float, float], ...] = (Z, X, Y), *, limited: bool = True) -> BodyModel:
    """Thorax, humerus and forearm; the elbow stands at its limit by default, as those of most models do."""
    half = 0.5 * np.pi

    def angle(name: str, low: float, high: float) -> Coordinate:
        return (
            Coordinate(name=name, lower=low, upper=high, clamped=True) if limited else Coordinate(name=name)
        )

    return BodyModel(
        name="arm",
        segments=(
            Segment(
                name="thorax",
                parent=GROUND,
                joint_name="ground",
                joints=tuple(
                    Joint(kind, axis, Law.of(name))
                    for name, kind, axis in zip(
                        ROOT, ("translation",) * 3 + ("rotation",) * 3, (X, Y, Z, Z, X, Y), strict=True
                    )
                ),
            ),
            Segment(
                name="humerus",
                parent="thorax",
                joint_name="shoulder",
                joints=(
                    Joint("translation", Y, Law.constant(0.15)),
                    Joint("translation", Z, Law.constant(0.17)),
                    *(Joint("rotation", a, Law.of(n)) for a, n in zip(axes, SHOULDER, strict=True)),
                ),
            ),
            Segment(
                name="forearm",
                parent="humerus",
                joint_name="elbow",
                joints=(
                    Joint("translation", Y, Law.constant(-0.29)),
                    Joint("rotation", Z, Law.of("elbow")),
                    Joint("rotation", Y, Law.of("pronation")),
                ),
            ),
        ),
        coordinates=(
            *(
                Coordinate(name=n, kind="translation" if n[0] == "t" and len(n) == 2 else "rotation")
                for n in ROOT
            ),
            angle("flexion", -half, np.pi),
            angle("adduction", -np.pi, half),
            angle("rotation", -half, half),
            angle("elbow", 0.0, 2.6),
            angle("pronation", -half, half),
        ),
        markers=tuple(
            Marker.at(name, segment, at)
            for name, segment, at in (
                ("C7", "thorax", (-0.08, 0.2, 0.0)),
                ("CLAV", "thorax", (0.08, 0.12, 0.0)),
                ("STRN", "thorax", (0.11, -0.05, 0.0)),
                ("T10", "thorax", (-0.1, -0.05, 0.0)),
                ("UPA", "humerus", (0.03, -0.15, 0.04)),
                ("ELB", "humerus", (0.0, -0.29, 0.04)),
                ("WRA", "forearm", (0.0, -0.25, 0.03)),
                ("WRB", "forearm", (0.0, -0.25, -0.03)),
            )
        ),
    )


def swing(model: BodyModel, middle: dict[str, float], size: float, n: int = 150, seed: int = 0) -> Array:
    """Smooth motion about a pose, (n, n_coordinates), rad or m, at 100 Hz."""
    rng = np.random.default_rng(seed)
    times = np.arange(n)[:, None] / 100.0
    width = np.array([size if c.kind == "rotation" else 0.05 for c in model.coordinates])
    phase, speed = rng.uniform(0.0, 6.28, len(width)), rng.uniform(0.4, 0.8, len(width))
    q = repeat_default_pose(model, n) + width * np.sin(2.0 * np.pi * speed * times + phase)
    for name, value in middle.items():
        q[:, model.coordinate_names.index(name)] += value
    lower, upper = (np.array([getattr(c, end) for c in model.coordinates]) for end in ("lower", "upper"))
    return np.clip(q, lower, upper)


def record(model: BodyModel, q: Array, skin_m: float, seed: int = 0, without: tuple[str, ...] = ()) -> Trial:
    """Markers of a motion, each displaced in the laboratory by a slow course of its own."""
    rng = np.random.default_rng(seed)
    names = tuple(n for n in model.marker_names if n not in without)
    times = np.arange(len(q)) / 100.0
    placed = pose_markers(compile_model(model, names), q, list_parameter_values(model))
    course = np.sin(2.0 * np.pi * 0.5 * times[:, None, None] + rng.uniform(0.0, 6.28, placed.shape[1:]))
    placed += skin_m * (rng.normal(size=placed.shape[1:]) + course)
    return Trial(name="arm", times=times, labels=names, markers=placed, rate_hz=100.0)
