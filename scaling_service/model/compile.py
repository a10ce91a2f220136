"""From names to arrays: a body model becomes a tree for the kernels.

Constant moves are merged on the way: a turn about an arbitrary axis becomes a turn about a
coordinate axis between constant rotations, and constant rotations are pushed through shifts, so
that few of them remain.
"""

from __future__ import annotations

from collections import abc
from dataclasses import replace
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from scaling_service.core.arrays import Array
from scaling_service.model import body
from scaling_service.numerics.multibody import laws as multibody_laws
from scaling_service.numerics.multibody import rigid, surfaces, tree
from scaling_service.numerics.multibody.closure import Closure

_KEPT = 32  # trees; chosen: the models of one person by all methods, with the markers of a few recordings

_AXES = np.eye(3)
_STILL = "fixed to the ground"
_WELDED = np.array([[1.0, 0.0], [0.0, 1.0], [0.0, 0.0]])
"""Two axes of a welded frame, whose tips must meet, too (m; chosen: an error of 1 rad counts as 1 m)."""


class _Index:
    """Numbers for names, and for every distinct factor."""

    def __init__(self, model: body.BodyModel) -> None:
        self.coordinates = {name: k for k, name in enumerate(model.coordinate_names)}
        self.parameters = {p.name: k for k, p in enumerate(model.parameters)}
        self._factors: dict[tuple[tuple[str, ...], body.Shape | body.Surface | None], int] = {}
        self.factors: list[multibody_laws.Factor] = []

    def factor(self, term: body.Term) -> int:
        """The number of a term's factor; locked coordinates stay coordinates."""
        if not term.coordinates:
            return multibody_laws.NONE
        key = (term.coordinates, term.surface or term.shape)
        if key not in self._factors:
            self._factors[key] = len(self.factors)
            shape: multibody_laws.Piecewise | surfaces.Surface | None = None
            if term.surface is not None:
                shape = _to_arrays(term.surface)
            elif term.shape is not None:
                shape = to_piecewise(term.shape)
            self.factors.append(
                multibody_laws.Factor(tuple(self.coordinates[name] for name in term.coordinates), shape)
            )
        return self._factors[key]

    def terms(self, law: body.Law, direction: Array) -> tuple[float, tuple[multibody_laws.TermArrays, ...]]:
        """The constant and the varying terms of a law that acts along ``direction``."""
        varying = []
        for term in law.terms:
            parameter = self.parameters[term.parameter] if term.parameter is not None else multibody_laws.NONE
            factor = self.factor(term)
            if parameter != multibody_laws.NONE or factor != multibody_laws.NONE:
                varying.append(multibody_laws.TermArrays(term.gain * direction, parameter, factor))
        return law.constant_part, tuple(varying)


def to_piecewise(shape: body.Shape) -> multibody_laws.Piecewise:
    """A shape as arrays."""
    degree = max(len(piece) for piece in shape.coefficients)
    rows = np.zeros((degree, len(shape.coefficients)))
    for k, piece in enumerate(shape.coefficients):
        rows[degree - len(piece) :, k] = piece
    return multibody_laws.Piecewise(np.array(shape.breaks), rows)


def _to_arrays(surface: body.Surface) -> surfaces.Surface:
    return surfaces.Surface(surface.kind, surface.numbers)


def evaluate_law(law: body.Law, values: abc.Mapping[str, Any]) -> Any:
    """A law's value; ``values`` holds coordinates and parameters by name, numbers or arrays."""
    total: Any = 0.0
    for term in law.terms:
        factor = 1.0 if term.parameter is None else values[term.parameter]
        if term.surface is not None:
            x = np.array(
                np.broadcast_arrays(*(values[name] for name in term.surface.coordinates)), dtype=float
            )
            found = _to_arrays(term.surface).evaluate(x.reshape(len(x), -1))[0]
            factor = factor * found.reshape(x.shape[1:])
        elif term.coordinate is not None:
            x = values[term.coordinate]
            factor = factor * (x if term.shape is None else evaluate_shape(term.shape, x))
        total = total + term.gain * factor
    return total


def evaluate_law_at(law: body.Law, x: Array) -> Array:
    """A law of one coordinate at all its values, (n_frames,).

    ValueError where it holds a parameter.
    """
    return np.asarray(np.zeros_like(x) + evaluate_law(law, dict.fromkeys(_find_leaders(law), x)))


def differentiate_law_at(law: body.Law, x: Array) -> Array:
    """The slope of a law of one coordinate at all its values, (n_frames,); ValueError as above."""
    _find_leaders(law)
    slopes = np.zeros_like(x)
    for term in law.terms:
        if term.coordinate is not None:
            slopes += term.gain * (1.0 if term.shape is None else to_piecewise(term.shape).evaluate(x)[1])
    return slopes


def _find_leaders(law: body.Law) -> set[str]:
    if any(term.parameter is not None for term in law.terms):
        raise ValueError("a coordinate follows another one only")
    return law.coordinates


def evaluate_shape(shape: body.Shape, x: ArrayLike) -> Array:
    """A piecewise polynomial, continued with its end slopes outside its breaks."""
    return to_piecewise(shape).evaluate(np.asarray(x, dtype=float))[0]


def compile_model(model: body.BodyModel, markers: abc.Sequence[str] | None = None) -> tree.Tree:
    """Compile a model, with some or all of its markers in the order given.

    Segments that carry none of the markers are left out, for nothing seen depends on them. A model
    gives the same tree again, so that what it works out once serves every recording.

    Raises KeyError: a marker that the model does not have.
    """
    return compile_points(model, model.markers if markers is None else [model.marker(m) for m in markers])


def compile_points(model: body.BodyModel, points: abc.Sequence[body.Marker]) -> tree.Tree:
    """The same with any points in place of the model's markers."""
    return _compile_cached(body.Same(model), tuple(points))


@lru_cache(maxsize=_KEPT)
def _compile_cached(same: body.Same, chosen: tuple[body.Marker, ...]) -> tree.Tree:
    model = same.model
    index = _Index(model)
    wanted = {m.segment for m in chosen}
    needed = set(wanted)
    for segment in reversed(model.segments):
        if segment.name in needed:
            needed.add(segment.parent)
    kept = [s for s in model.segments if s.name in needed]
    number = {segment.name: k for k, segment in enumerate(kept)}
    links = tuple(
        multibody_laws.Link(
            multibody_laws.NONE if s.parent == body.GROUND else number[s.parent], _list_moves(s.joints, index)
        )
        for s in kept
    )
    local = np.array([m.nominal for m in chosen]).reshape(-1, 3)
    terms = tuple(item for k, m in enumerate(chosen) for item in _list_marker_terms(k, m, index))
    on = np.array([number[m.segment] for m in chosen], dtype=np.intp)
    return tree.Tree(
        links=links,
        factors=tuple(index.factors),
        n_coordinates=len(model.coordinates),
        n_parameters=len(model.parameters),
        marker_link=on,
        marker_local=local,
        marker_terms=terms,
        placed=np.array([not m.is_direction for m in chosen], dtype=float)
        if any(m.is_direction for m in chosen)
        else None,
    )


def compile_constraints(model: body.BodyModel) -> Closure | None:
    """What poses of a model must obey beside its joints; None if there is nothing."""
    if not model.constraints:
        return None
    return _compile_constraints(body.Same(model))


@lru_cache(maxsize=_KEPT)
def _compile_constraints(same: body.Same) -> Closure:
    model = same.model
    points: list[body.Marker] = []
    meeting, apart, level = (
        list[tuple[int, int]](),
        list[tuple[int, int, float]](),
        list[tuple[int, int, int]](),
    )

    def add(segment: str, laws: tuple[body.Law, body.Law, body.Law]) -> int:
        where = segment if segment != body.GROUND else _STILL
        points.append(body.Marker(name=f"end {len(points)}", segment=where, laws=laws))
        return len(points) - 1

    for item in model.constraints:
        if item.kind == "law":
            meeting.append(
                (
                    add(body.GROUND, (item.law, body.Law(), body.Law())),
                    add(body.GROUND, (body.Law(), body.Law(), body.Law())),
                )
            )
            continue
        first, second = (add(end.segment, end.laws) for end in item.ends)
        if item.kind == "distance":
            apart.append((first, second, item.distance))
        elif item.kind == "line":
            start = item.ends[0]
            # Two unit vectors across a line, (2, 3)
            across = np.linalg.svd(np.array([item.direction]))[2][1:]
            level += [(second, first, add(start.segment, _move(start, tip))) for tip in across]
        else:
            meeting.append((first, second))
        if item.kind == "weld":
            turns = [rigid.convert_vector_to_rotation(np.array(turn)) for turn in item.turns]
            for axis in _WELDED.T:
                tips = zip(item.ends, turns, strict=True)
                a, b = (add(end.segment, _move(end, turn @ axis)) for end, turn in tips)
                meeting.append((a, b))
    still = body.Segment(name=_STILL, parent=body.GROUND, joint_name=_STILL, joints=())
    whole = replace(model, segments=(still, *model.segments), markers=tuple(points), constraints=())
    return Closure(
        tree=compile_model(whole),
        meeting=np.array(meeting, dtype=np.intp).reshape(-1, 2),
        apart=np.array([pair[:2] for pair in apart], dtype=np.intp).reshape(-1, 2),
        distances=np.array([distance for *_, distance in apart]),
        level=np.array(level, dtype=np.intp).reshape(-1, 3),
    )


def _move(end: body.Marker, by: Array) -> tuple[body.Law, body.Law, body.Law]:
    x, y, z = (law + body.Law.constant(float(shift)) for law, shift in zip(end.laws, by, strict=True))
    return x, y, z


def _list_marker_terms(row: int, marker: body.Marker, index: _Index) -> list[tree.MarkerTerm]:
    """Terms along different axes that follow one factor with known gains are one term."""
    known: dict[int, multibody_laws.TermArrays] = {}
    free: list[multibody_laws.TermArrays] = []
    for axis, law in zip(_AXES, marker.laws, strict=True):
        for term in index.terms(law, axis)[1]:
            if term.parameter != multibody_laws.NONE:
                free.append(term)
            elif (same := known.get(term.factor)) is not None:
                known[term.factor] = replace(same, gain=same.gain + term.gain)
            else:
                known[term.factor] = term
    return [tree.MarkerTerm(row, term) for term in (*known.values(), *free)]


def _list_moves(joints: abc.Sequence[body.Joint], index: _Index) -> tuple[multibody_laws.Move, ...]:
    moves: list[multibody_laws.Move] = []
    pending = _AXES  # a constant rotation not yet written down
    for joint in joints:
        axis = np.asarray(joint.axis, dtype=float)
        if joint.kind == "translation":
            direction = pending @ axis
            constant, terms = index.terms(joint.law, direction)
            constant = constant * direction
            if moves and isinstance(last := moves[-1], multibody_laws.Shift):
                moves[-1] = multibody_laws.Shift(last.constant + constant, last.terms + terms)
            elif terms or constant.any():
                moves.append(multibody_laws.Shift(constant, terms))
            continue
        constant, terms = index.terms(joint.law, np.ones(1))
        if not terms:
            pending = pending @ rigid.rotate_about(axis, constant)
            continue
        aligned, number, sign = _to_coordinate_axis(pending @ axis)
        if aligned is not None:
            moves.append(multibody_laws.Fixed(aligned))
            pending = aligned.T @ pending
        moves.append(
            multibody_laws.Turn(
                number,
                sign * constant,
                tuple(multibody_laws.TermArrays(sign * t.gain, t.parameter, t.factor) for t in terms),
            )
        )
    if np.abs(pending - _AXES).max() > 1e-15:
        moves.append(multibody_laws.Fixed(pending))
    return tuple(moves)


def _to_coordinate_axis(axis: Array) -> tuple[Array | None, int, float]:
    """A rotation whose z axis is ``axis`` (None if it is a coordinate axis already), and which one."""
    number = int(np.argmax(np.abs(axis)))
    if abs(axis[number]) > 1.0 - 1e-15:
        return None, number, float(np.sign(axis[number]))
    helper = _AXES[int(np.argmin(np.abs(axis)))]
    x = np.cross(helper, axis)
    x /= np.linalg.norm(x)
    return np.column_stack([x, np.cross(axis, x), axis]), 2, 1.0


def list_parameter_values(model: body.BodyModel) -> Array:
    """The model's parameters, shape (n_parameters,)."""
    return np.array([p.value for p in model.parameters], dtype=float)


def repeat_default_pose(model: body.BodyModel, n_frames: int) -> Array:
    """The model's default pose repeated, shape (n_frames, n_coordinates), rad or m."""
    return np.tile([c.default for c in model.coordinates], (n_frames, 1)).astype(float)


def list_coordinate_bounds(model: body.BodyModel) -> tuple[Array, Array]:
    """Lower and upper bounds, each (n_coordinates,); infinite where a coordinate is not clamped."""
    lower = [c.lower if c.clamped else -np.inf for c in model.coordinates]
    upper = [c.upper if c.clamped else np.inf for c in model.coordinates]
    return np.array(lower), np.array(upper)


def list_kept_ranges(model: body.BodyModel) -> dict[str, tuple[float, float]]:
    """Coordinates that the model keeps within a range, to its two ends, degrees or m."""
    lower, upper = (ends.tolist() for ends in list_coordinate_bounds(model))
    units = [180.0 / np.pi if c.kind == "rotation" else 1.0 for c in model.coordinates]
    return {
        c.name: (unit * low, unit * high)
        for c, unit, low, high in zip(model.coordinates, units, lower, upper, strict=True)
        if not c.locked and np.isfinite((low, high)).all()
    }


def list_coordinate_ranges(model: body.BodyModel) -> tuple[Array, Array]:
    """The ranges that the model declares, clamped or not, each (n_coordinates,).

    Infinite where a range is empty or does not hold the default.
    """
    sound = [c.lower < c.upper and c.lower <= c.default <= c.upper for c in model.coordinates]
    lower = [c.lower if ok else -np.inf for c, ok in zip(model.coordinates, sound, strict=True)]
    upper = [c.upper if ok else np.inf for c, ok in zip(model.coordinates, sound, strict=True)]
    return np.array(lower), np.array(upper)


def free_coordinates(model: body.BodyModel) -> NDArray[np.bool_]:
    """Which coordinates are estimated, shape (n_coordinates,)."""
    return np.array([not c.locked for c in model.coordinates])
