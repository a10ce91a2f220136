"""Distances of a person over the model's, and their errors.

Errors of landmarks, of constructed joint centres and of widths are carried to every distance that rests on
them: the recording's posture is built again with each of these moved by its standard deviation, all at once
as if they were frames. Distances that share a marker thus share its error.
"""

from __future__ import annotations

import dataclasses
from collections import abc
from types import MappingProxyType

import numpy as np

from scaling_service.capabilities.scaling.sizes import measurements as sizes_measurements
from scaling_service.capabilities.scaling.sizes.points import PersonPoints, name_points
from scaling_service.core.arrays import Array
from scaling_service.model.anatomy import centres as anatomy_centres

_UNKNOWN_SD = 0.05
"""Chosen: relative, of a distance whose ends no single frame shows with all that they rest on."""

Input = tuple[str, int]
"""What an error belongs to: a landmark, centre or size, and its axis."""


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class Ratios:
    """Logarithms of a person's distances over the model's.

    ``measurements`` (SegmentMeasurement, length n): what each distance measures.
    ``logs``: (n,).
    ``covariance``: (n, n).
    """

    measurements: tuple[sizes_measurements.SegmentMeasurement, ...]
    logs: Array
    covariance: Array

    def average(self) -> Ratios:
        """One ratio for each measurement, the plain mean of its distances' (Puchaud 2019, 2.2.2)."""
        each = tuple(dict.fromkeys(self.measurements))
        member = np.array([[m is one for m in self.measurements] for one in each], dtype=float)
        share = member / member.sum(axis=1, keepdims=True)
        weights = share * np.exp(self.logs)
        weights /= weights.sum(axis=1, keepdims=True)
        return Ratios(each, np.log(share @ np.exp(self.logs)), weights @ self.covariance @ weights.T)


def measure_ratios(
    people: abc.Sequence[PersonPoints],
    model: anatomy_centres.Points,
    segments: abc.Sequence[str],
    *,
    besides: bool = True,
    doubtful: abc.Mapping[str, float] = MappingProxyType({}),
) -> Ratios:
    """Every distance that can be taken, each on the first recording that shows it (a plain mean: on one).

    ``people``: the recordings, the best first.
    ``model``: the model's points, one frame.
    ``segments``: the model's; measurements of others are left out.
    ``besides``: whether to take what only a weighted estimate can use.
    ``doubtful``: joint to the standard deviation of the middle of its landmarks on the model, along the leg.
    """
    taken: list[tuple[sizes_measurements.SegmentMeasurement, sizes_measurements.Pair, PersonPoints]] = []
    for measurement in sizes_measurements.list_measurements(segments):
        done: set[sizes_measurements.Pair] = set()
        for person in people:
            pairs = sizes_measurements.list_available(measurement, person.points, model, besides=besides)
            taken += [(measurement, pair, person) for pair in pairs if pair not in done]
            done.update(pairs)
            if done and not besides:
                break
    errors = {
        key: _Propagated.propagate(person)
        for key, person in {id(person): person for _, _, person in taken}.items()
    }
    inputs = sorted({key for found in errors.values() for key in found.inputs})
    column = {key: k for k, key in enumerate(inputs)}
    logs, spread = np.empty(len(taken)), np.zeros((len(taken), len(inputs) + len(doubtful)))
    moved = []
    for joint, sd in doubtful.items():
        # The model's points with a joint higher up the leg, however it is found
        up = np.array([0.0, sd, 0.0])
        moved.append({name: at + up if name.startswith(joint) else at for name, at in model.items()})
    own = np.empty(len(taken))
    for row, (measurement, pair, person) in enumerate(taken):
        seen = sizes_measurements.measure_distances(pair, person.points)
        ours = float(sizes_measurements.measure_distances(pair, model)[0])
        logs[row] = np.log(np.nanmean(seen) / ours)
        found = errors[id(person)]
        shifts = found.of_distance(pair)
        moving = 0.0 if person.standing else float(np.nanstd(seen) / np.nanmean(seen))
        own[row] = (measurement.shape_m / ours) ** 2 + moving**2
        spread[row, len(inputs) :] = [
            np.log(ours / sizes_measurements.measure_distances(pair, points)[0]) for points in moved
        ]
        if np.isfinite(shifts).all():
            spread[row, [column[key] for key in found.inputs]] = shifts
        else:
            own[row] += _UNKNOWN_SD**2
    return Ratios(tuple(m for m, _, _ in taken), logs, spread @ spread.T + np.diag(own))


def estimate_centre_sds(person: PersonPoints) -> dict[str, Array]:
    """Standard deviation of each joint centre along x, y, z of the pelvis (else of ground), (3,), m."""
    propagated = _Propagated.propagate(person)
    return {
        name: np.sqrt((propagated.of_point(name) ** 2).sum(axis=0))
        for name in person.centres
        if name in propagated.points
    }


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class _Propagated:
    """A posture built again with each input one standard deviation up (even rows) and down (odd rows)."""

    inputs: tuple[Input, ...]
    points: anatomy_centres.Points
    axes: Array

    @classmethod
    def propagate(cls, person: PersonPoints) -> _Propagated:
        still = _choose_posture(person)
        pelvis = anatomy_centres.read_pelvis({name: at[None] for name, at in still.items()})
        axes = np.eye(3) if pelvis is None else pelvis.frame.rotation[0]
        axes = axes if np.isfinite(axes).all() else np.eye(3)
        sizes = person.sizes
        inputs: list[Input] = [(name, axis) for name in still for axis in range(3)]
        inputs += [(name, axis) for name in person.centres for axis in range(3)]
        inputs += [(f"{name} width", 0) for name in sizes.widths]
        row = {key: 2 * k for k, key in enumerate(inputs)}
        n = 2 * len(inputs)

        def move(name: str, sds: abc.Sequence[float], turned: Array) -> Array:
            shift = np.zeros((n, 3))
            for axis, sd in enumerate(sds):
                shift[row[name, axis]] += sd * turned[:, axis]
                shift[row[name, axis] + 1] -= sd * turned[:, axis]
            return shift

        def resize(name: str, value: anatomy_centres.Size, sd: float) -> Array:
            sizes_of = np.full(n, value)
            sizes_of[row[name, 0]] += sd
            sizes_of[row[name, 0] + 1] -= sd
            return sizes_of

        landmarks = {
            name: at
            + move(name, [person.scale * sd for sd in anatomy_centres.look_up_landmark_sd(name)], axes)
            for name, at in still.items()
        }
        errors = {name: move(name, centre.sd, np.eye(3)) for name, centre in person.centres.items()}
        widths = {k: (resize(f"{k} width", value, sd), sd) for k, (value, sd) in sizes.widths.items()}
        centres = anatomy_centres.construct_centres(
            landmarks,
            dataclasses.replace(sizes, widths=widths),
            person.regression,
            hips={name: np.broadcast_to(at, (n, 3)) for name, at in _find_hips(person).items()},
            errors=errors,
        )
        return cls(tuple(inputs), name_points(landmarks, centres), axes)

    def of_distance(self, pair: sizes_measurements.Pair) -> Array:
        """How much each input moves the logarithm of a distance, (n_inputs,)."""
        logs = np.log(sizes_measurements.measure_distances(pair, self.points))
        return np.asarray(0.5 * (logs[0::2] - logs[1::2]))

    def of_point(self, name: str) -> Array:
        """How much each input moves a point, along the axes, (n_inputs, 3), m."""
        at = self.points[name]
        return np.asarray(0.5 * (at[0::2] - at[1::2]) @ self.axes)


def _choose_posture(person: PersonPoints) -> dict[str, Array]:
    """One place of each landmark, (3,), m: the mean of standing, else the frame that shows most of them."""
    if person.standing:
        known = {n: at for n, at in person.landmarks.items() if np.isfinite(at).all(axis=1).any()}
        return {name: np.nanmean(at, axis=0) for name, at in known.items()}
    frame = _find_fullest(person)
    still = {name: at[frame] for name, at in person.landmarks.items()}
    return {name: at for name, at in still.items() if np.isfinite(at).all()}


def _find_fullest(person: PersonPoints) -> int:
    shown = np.stack([np.isfinite(at).all(axis=1) for at in person.points.values()])
    return int(np.argmax(shown.sum(axis=0)))


def _find_hips(person: PersonPoints) -> abc.Mapping[str, Array]:
    if person.standing:
        return {name: np.nanmean(at, axis=0) for name, at in person.hips.items()}
    frame = _find_fullest(person)
    return {name: at[frame] for name, at in person.hips.items()}
