"""Small bodies for tests, and a slow recursion that knows nothing of the kernels.

The recursion multiplies 4 x 4 matrices for one frame and takes complex numbers, so that its
derivatives by the complex step are exact to rounding (Squire & Trapp 1998).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from scaling_service.model.body import (
    BodyModel,
    Coordinate,
    Joint,
    Law,
    Marker,
    Segment,
    Shape,
    Term,
    Vector,
)

Array = NDArray[np.float64]
_STEP = 1e-30


def unit(rng: np.random.Generator) -> Vector:
    """A random direction."""
    x, y, z = (v := rng.normal(size=3)) / np.linalg.norm(v)
    return (float(x), float(y), float(z))


def random_tree(rng: np.random.Generator, n_segments: int, markers_each: int = 3) -> BodyModel:
    """A random tree of revolute and prismatic joints about arbitrary axes, between constant moves."""
    segments, coordinates = [], []
    for k in range(n_segments):
        parent = "ground" if k == 0 else f"s{rng.integers(k)}"
        joints = [Joint("translation", unit(rng), Law.constant(rng.uniform(-0.4, 0.4)))]
        for j in range(rng.integers(1, 4)):
            kind = "rotation" if rng.random() < 0.7 else "translation"
            name = f"q{k}{j}"
            joints.append(Joint("rotation", unit(rng), Law.constant(rng.uniform(-1.0, 1.0))))
            joints.append(Joint(kind, unit(rng), Law.of(name)))
            coordinates.append(Coordinate(name=name, kind=kind))
        segments.append(Segment(name=f"s{k}", parent=parent, joint_name=f"j{k}", joints=tuple(joints)))
    markers = [
        Marker.at(f"m{k}{i}", f"s{k}", tuple(rng.uniform(-0.2, 0.2, 3).tolist()))
        for k in range(n_segments)
        for i in range(markers_each)
    ]
    return BodyModel(
        name="random", segments=tuple(segments), coordinates=tuple(coordinates), markers=tuple(markers)
    )


def spline(rng: np.random.Generator, low: float, high: float, size: float) -> Shape:
    """A smooth random curve of one coordinate."""
    knots = np.linspace(low, high, 6)
    curve = CubicSpline(knots, rng.uniform(-size, size, 6), bc_type="natural")
    return Shape(tuple(knots.tolist()), tuple(tuple(piece) for piece in curve.c.T.tolist()))


def free_root(prefix: str = "root") -> tuple[tuple[Joint, ...], tuple[Coordinate, ...]]:
    """Three translations and three rotations from ground."""
    axes: tuple[Vector, ...] = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
    order = [("translation", k) for k in (0, 1, 2)] + [("rotation", k) for k in (1, 0, 2)]
    names = [f"{prefix}_{kind[0]}{'xyz'[k]}" for kind, k in order]
    joints = tuple(Joint(kind, axes[k], Law.of(n)) for (kind, k), n in zip(order, names, strict=True))
    coordinates = tuple(Coordinate(name=n, kind=kind) for (kind, _), n in zip(order, names, strict=True))
    return joints, coordinates


def leg(rng: np.random.Generator, *, coupled: bool = True, markers_each: int = 4) -> BodyModel:
    """Pelvis with a free root, a ball hip and a hinge knee that may glide along splines of its angle."""
    root, coordinates = free_root()
    hip = (*_centre((-0.05, -0.08, 0.09), "pelvis"), *_turns(("hip_z", "hip_x", "hip_y"), "zxy"))
    knee = (*_centre((0.0, -0.43, 0.0), "femur"), *_turns(("knee",), "z"))
    if coupled:
        glides = tuple(
            Joint("translation", axis, Law((Term(1.0, None, "knee", spline(rng, -2.0, 0.2, 0.02)),)), "femur")
            for axis in ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0))
        )
        knee = (*knee[:3], *glides, *knee[3:])
    segments = (
        Segment(name="pelvis", parent="ground", joint_name="root", joints=root),
        Segment(name="femur", parent="pelvis", joint_name="hip", joints=hip),
        Segment(name="tibia", parent="femur", joint_name="knee", joints=knee),
    )
    markers = tuple(
        Marker.at(f"{name}{k}", name, tuple((rng.uniform(-0.1, 0.1, 3) + middle).tolist()))
        for name, middle in (("pelvis", (0, 0, 0)), ("femur", (0, -0.3, 0)), ("tibia", (0, -0.3, 0)))
        for k in range(markers_each)
    )
    own = tuple(Coordinate(name=n) for n in ("hip_z", "hip_x", "hip_y", "knee"))
    return BodyModel(name="leg", segments=segments, coordinates=(*coordinates, *own), markers=markers)


def _centre(at: Sequence[float], parent: str) -> tuple[Joint, ...]:
    return tuple(
        Joint("translation", tuple(axis.tolist()), Law.constant(value), parent)
        for axis, value in zip(np.eye(3), at, strict=True)
    )


def _turns(names: Sequence[str], letters: str) -> tuple[Joint, ...]:
    return tuple(
        Joint("rotation", tuple(np.eye(3)["xyz".index(letter)].tolist()), Law.of(name))
        for name, letter in zip(names, letters, strict=True)
    )


def leg_motion(rng: np.random.Generator, n_frames: int) -> Array:
    """Smooth, rich motion of :func:`leg`, (n_frames, 10)."""
    t = np.linspace(0.0, 1.0, n_frames)[:, None]
    centre = np.array([0.0, 0.9, 0.0, 0.1, 0.05, 0.1, 0.4, 0.0, 0.0, -0.8])
    size = np.array([0.3, 0.05, 0.1, 0.4, 0.2, 0.2, 0.7, 0.4, 0.4, 0.7])
    phase, cycles = rng.uniform(0, 6.28, 10), rng.uniform(1.0, 3.0, 10)
    motion: Array = centre + size * np.sin(6.28 * cycles * t + phase)
    return motion


# --- the slow recursion -------------------------------------------------------------------------


def slow_markers(model: BodyModel, values: Mapping[str, complex]) -> NDArray[np.complex128]:
    """Marker positions of one frame, (n_markers, 3); ``values`` names coordinates and parameters."""
    frames: dict[str, NDArray[np.complex128]] = {"ground": np.eye(4, dtype=complex)}
    for segment in model.segments:
        pose = frames[segment.parent]
        for joint in segment.joints:
            pose = pose @ _matrix(joint, _value(joint.law, values))
        frames[segment.name] = pose
    return np.array(
        [
            (frames[m.segment] @ np.array([*(_value(law, values) for law in m.laws), 1.0]))[:3]
            for m in model.markers
        ]
    )


def _matrix(joint: Joint, value: complex) -> NDArray[np.complex128]:
    x, y, z = joint.axis
    result = np.eye(4, dtype=complex)
    if joint.kind == "translation":
        result[:3, 3] = np.array(joint.axis) * value
        return result
    c, s = np.cos(value), np.sin(value)
    result[:3, :3] = [
        [c + x * x * (1 - c), x * y * (1 - c) - z * s, x * z * (1 - c) + y * s],
        [y * x * (1 - c) + z * s, c + y * y * (1 - c), y * z * (1 - c) - x * s],
        [z * x * (1 - c) - y * s, z * y * (1 - c) + x * s, c + z * z * (1 - c)],
    ]
    return result


def _value(law: Law, values: Mapping[str, complex]) -> complex:
    total: complex = 0.0
    for term in law.terms:
        value: complex = term.gain
        if term.parameter is not None:
            value *= values[term.parameter]
        if term.coordinate is not None:
            x = values[term.coordinate]
            value *= x if term.shape is None else _shape(term.shape, x)
        total += value
    return total


def _shape(shape: Shape, x: complex) -> complex:
    breaks, at = shape.breaks, complex(x)
    piece = 0
    while piece < len(breaks) - 2 and at.real >= breaks[piece + 1]:
        piece += 1
    edge = min(max(at.real, breaks[0]), breaks[-1])
    polynomial = np.polynomial.Polynomial(shape.coefficients[piece][::-1])
    if edge == at.real:
        return complex(polynomial(at - breaks[piece]))
    local = edge - breaks[piece]
    return complex(polynomial(local) + polynomial.deriv()(local) * (at - edge))


def slow_batch(model: BodyModel, q: Array, p: Array) -> Array:
    """Positions of all frames, (n_frames, n_markers, 3), one after the other."""
    return np.array([slow_markers(model, named(model, q, p, k)).real for k in range(len(q))])


def named(model: BodyModel, q: Array, p: Array, frame: int) -> dict[str, complex]:
    """Everything of one frame by name."""
    return dict(zip(model.coordinate_names, q[frame].tolist(), strict=True)) | {
        item.name: float(v) for item, v in zip(model.parameters, p, strict=True)
    }


def slow_jacobian(model: BodyModel, q: Array, p: Array, names: Sequence[str]) -> Array:
    """Derivatives by the complex step, (n_frames, n_markers, 3, n_names)."""
    result = np.empty((len(q), len(model.markers), 3, len(names)))
    for frame in range(len(q)):
        values = named(model, q, p, frame)
        for column, name in enumerate(names):
            moved = values | {name: values[name] + 1j * _STEP}
            result[frame, :, :, column] = slow_markers(model, moved).imag / _STEP
    return result


def all_names(model: BodyModel) -> tuple[str, ...]:
    """Coordinates, then parameters: the order in which the kernels number variables."""
    return (*model.coordinate_names, *(item.name for item in model.parameters))
