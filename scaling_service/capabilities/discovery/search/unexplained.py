"""Where simulation and measurement disagree, and what is left above the floor and matches no effect."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from scaling_service.capabilities.discovery.disturbances.disturbance import Disturbance
from scaling_service.capabilities.discovery.evidence.fit import Fit
from scaling_service.capabilities.discovery.evidence.markers import MARKERS
from scaling_service.capabilities.discovery.evidence.noise_floors import Floors, NoiseFloor
from scaling_service.capabilities.discovery.evidence.observation import Observation, Tally
from scaling_service.capabilities.discovery.evidence.statistics import adjust_holm, assess_above_zero
from scaling_service.capabilities.discovery.evidence.wrench import OBSERVATIONS, WRENCH
from scaling_service.capabilities.discovery.search.findings import (
    Disagreement,
    Observable,
    Unexplained,
    classify_place,
)
from scaling_service.model.forces import GroundForces
from scaling_service.model.trial import Trial
from scaling_service.numerics.multibody.laws import Array
from scaling_service.recording.faults import PAIR

_FEWEST_NUMBERS = 3  # blocks; chosen: a spread needs three
_TO_SD = 1.4826  # a normal distribution's standard deviation over its median distance from its median
_HEAVY = 3  # degrees of freedom; chosen: noise with tails as heavy keeps to the level over all places


def locate_disagreements(fit: Fit, floors: Floors) -> tuple[Disagreement, ...]:
    """All places, those that stand highest above their floors first; the p-values pay for their number."""
    rows = list_places(fit, floors)
    p = adjust_holm(np.array([assess_above_floor(tally, k) for _, tally, k in rows]))
    excess = np.array([_compute_excess(tally, k) for _, tally, k in rows])
    share = excess / max(float(excess.sum()), 1e-300)
    found = [_place(fit, *row, float(share[i]), float(p[i])) for i, row in enumerate(rows)]
    return tuple(sorted(found, key=lambda d: -d.share))


def list_places(fit: Fit, floors: Floors) -> list[tuple[Observation[Any], Tally, int]]:
    """Every place of every observation in all trials, by its number in a tally."""
    tallies = [(o, o.tally(fit, None, floors[o.name].noise)) for o in OBSERVATIONS]
    return [(o, tally, k) for o, tally in tallies if tally is not None for k in range(len(tally.places))]


def by_trial(tally: Tally, k: int) -> Iterator[tuple[str, float, float]]:
    """Trials in which a place is seen, with its RMS and its floor."""
    for trial in dict.fromkeys(tally.trials):
        here = np.array([t == trial for t in tally.trials])
        frames = float(tally.frames[here, k].sum())
        if frames:
            yield trial, *(float(x[here, k].sum() / frames) ** 0.5 for x in (tally.square, tally.floor))


def _compute_excess(tally: Tally, k: int) -> float:
    """Whitened square above the floor."""
    floor = float(tally.floor[:, k].sum())
    frames = float(tally.frames[:, k].sum())
    return frames * max(float(tally.square[:, k].sum()) / max(floor, 1e-300) - 1.0, 0.0)


def assess_above_floor(tally: Tally, k: int, trial: str | None = None) -> float:
    """How likely a place stands so far above its floor by chance: on the whole, or in any one block."""
    used = (tally.frames[:, k] > 0) & np.array([trial in {None, name} for name in tally.trials])
    if used.sum() < _FEWEST_NUMBERS:
        return 1.0
    height = np.log(tally.square[used, k] / np.maximum(tally.floor[used, k], 1e-300) + 1e-12)
    return min(1.0, 2.0 * min(assess_above_zero(height), in_one_block(height)))


def in_one_block(height: Array) -> float:
    """Of the highest of them over what most of them are, paying for their number.

    A label that is wrong for half a second spreads the heights so much that their mean tells nothing.
    """
    usual = float(np.median(height))
    spread = _TO_SD * float(np.median(np.abs(height - usual)))
    if spread == 0.0:
        return 1.0
    above = (float(height.max()) - usual) / spread
    return min(1.0, len(height) * float(scipy.stats.t.sf(above, _HEAVY)))


def _place(
    fit: Fit, observation: Observation[Any], tally: Tally, k: int, share: float, p: float
) -> Disagreement:
    name, total = tally.places[k], float(tally.frames[:, k].sum())
    return Disagreement(
        where=name,
        observable=classify_place(name),
        rms=float((tally.square[:, k].sum() / total) ** 0.5),
        floor=float((tally.floor[:, k].sum() / total) ** 0.5),
        share=share,
        p=p,
        trials={trial: rms for trial, rms, _ in by_trial(tally, k)},
        when=_describe_time(tally, k),
        along=_name_coordinate(fit, observation, name),
    )


def _describe_time(tally: Tally, k: int) -> str:
    mean = np.divide(
        tally.square[:, k], tally.frames[:, k], out=np.zeros(len(tally.frames)), where=tally.frames[:, k] > 0
    )
    worst = int(np.argmax(mean))
    return f"{tally.trials[worst]}, from {tally.starts[worst]:.2f} s"


def _name_coordinate(fit: Fit, observation: Observation[Any], name: str) -> str:
    """The coordinate, or its rate, that the residual follows best."""
    coordinates = fit.model.coordinates
    best = (fit.settings.correlated_share, "")
    residual, motion = [], []
    for item, values, every in observation.series(fit, name):
        if np.isfinite(values).any():
            q = every[:, : len(coordinates)]
            rate = np.gradient(q, item.times, axis=0)
            residual.append(values)
            motion.append(np.stack([q, rate, np.gradient(rate, item.times, axis=0)], axis=2))
    if not residual:
        return ""
    y, x = np.concatenate(residual), np.concatenate(motion)
    known = np.isfinite(y).all(axis=1)
    y, x = y[known] - y[known].mean(axis=0), x[known] - x[known].mean(axis=0)
    total = float((y**2).sum())
    for c, coordinate in enumerate(coordinates):
        for kind, word in enumerate(("", "the rate of ", "the acceleration of ")):
            size = float((x[:, c, kind] ** 2).sum())
            if size > 0.0 and total > 0.0:
                explained = float(((x[:, c, kind] @ y) ** 2).sum()) / size / total
                if explained > best[0]:
                    best = explained, f"{word}{coordinate.name} ({100.0 * explained:.0f} % of it)"
    return best[1]


_LOADED_N = 20.0  # chosen: above any plate's noise, below any foot's weight
_FEWEST = 16  # frames; chosen: fewer describe nothing


@dataclass(frozen=True, slots=True, eq=False)
class _Function:
    name: str
    values: Array


def describe_unexplained(
    fit: Fit, floors: Floors, disturbance: Disturbance | None = None
) -> tuple[Unexplained, ...]:
    """Places where the search leaves what is no noise, the largest first.

    An unmodelled disturbance comes before all, and stands for every place of its observation. One of all
    markers moves the body against the plates, so it stands for the forces, too.
    """
    left = (*_list_repaired(fit), *_list_left(fit, floors))
    if disturbance is None:
        return left
    if disturbance.where == ("markers",):
        return (_describe_disturbance(fit, disturbance),)
    others = [u for u in left if (u.observable != "marker") != (disturbance.seen_in == "wrench")]
    return _describe_disturbance(fit, disturbance), *others


def _describe_disturbance(fit: Fit, disturbance: Disturbance) -> Unexplained:
    """A disturbance with what its places show, over what the instrument would."""
    observation = next(o for o in OBSERVATIONS if o.name == disturbance.seen_in)
    tally = observation.tally(fit, None)
    assert tally is not None
    shown = [k for k, place in enumerate(tally.places) if place in disturbance.where]
    rows = shown or list(range(len(tally.places)))
    frames = max(float(tally.frames[:, rows].sum()), 1.0)
    rms, floor = ((float(x[:, rows].sum()) / frames) ** 0.5 for x in (tally.square, tally.floor))
    observable: Observable = "marker" if observation is MARKERS else "force"
    return Unexplained(
        where=disturbance.where,
        observable=observable,
        law=disturbance.law,
        rms=max(rms, disturbance.rms),
        floor=floor,
    )


def _list_repaired(fit: Fit) -> Iterator[Unexplained]:
    """Faults taken out of the recordings before the search, each where it was largest."""
    yield from _list_largest(fit, MARKERS, ("merged", "jitter"), [item.trial for item in fit.tracked])
    yield from _list_largest(fit, WRENCH, ("spikes",), [item.contacts.ground for item in fit.wrenches])


def _list_largest(
    fit: Fit, observation: Observation[Any], kinds: Sequence[str], sources: Sequence[Trial | GroundForces]
) -> Iterator[Unexplained]:
    found: dict[str, Unexplained] = {}
    tally = observation.tally(fit, None) if sources else None
    for source, repair in ((one, r) for one in sources for r in one.repairs if r.what in kinds):
        where = tuple(repair.where.split(PAIR if observation is MARKERS else None))
        if tally is None or where[-1] not in tally.places:
            continue
        k, frames = tally.places.index(where[-1]), len(source.times)
        rms = repair.off * (repair.frames / frames) ** 0.5
        floor = float(tally.floor[:, k].sum() / max(tally.frames[:, k].sum(), 1)) ** 0.5
        law = f"{repair.where} {repair.detail}, in {repair.frames} of {frames} frames of {source.name}"
        usual = found.get(repair.where)
        if rms > fit.settings.unexplained_ratio * floor and (usual is None or rms > usual.rms):
            found[repair.where] = Unexplained(
                where=where, observable=classify_place(where[-1]), law=law, rms=rms, floor=floor
            )
    yield from found.values()


def _list_left(fit: Fit, floors: Floors) -> tuple[Unexplained, ...]:
    """Places that the movement or the time still predicts, and places that stand above their noise.

    Whatever its course, what no noise of the instruments makes has a cause.
    """
    rows = list_places(fit, floors)
    strength = [_measure_strength(fit, floors[o.name], k) for o, _, k in rows]
    pairs = zip(_assess_chances(strength), rows, strict=True)
    p = np.array([min(1.0, 2.0 * min(q, _assess_level(fit, *row[1:]))) for q, row in pairs])
    for one in OBSERVATIONS:  # a component does not pay for the many markers
        here = [row[0] is one for row in rows]
        p[here] = np.minimum(1.0, len(OBSERVATIONS) * adjust_holm(p[here]))
    found = []
    for (observation, tally, k), chance in zip(rows, p.tolist(), strict=True):
        if chance <= fit.settings.unexplained_level and tally.frames[:, k].any():
            _, rms, floor = max(by_trial(tally, k), key=lambda one: one[1] / max(one[2], 1e-300))
            if rms > fit.settings.unexplained_ratio * floor:
                place = tally.places[k]
                law = _describe_law(fit, observation, place)
                found.append(
                    Unexplained(
                        where=(place,), observable=classify_place(place), law=law, rms=rms, floor=floor
                    )
                )
    return tuple(sorted(found, key=lambda u: -u.rms / u.floor))


def _assess_level(fit: Fit, tally: Tally, k: int) -> float:
    """How likely noise alone stands so high in one or all of the trials in which the cameras' noise shows."""
    telling = {item.name for item in fit.tracked if item.shows_noise}
    high = [
        trial
        for trial, rms, floor in by_trial(tally, k)
        if trial in telling and rms > fit.settings.unexplained_ratio * floor
    ]
    chances = [assess_above_floor(tally, k, trial) for trial in high]
    in_one = len(telling) * min(chances, default=1.0)
    return min(1.0, 2.0 * min(in_one, _assess_size(tally, k, telling))) if high else 1.0


def _assess_size(tally: Tally, k: int, trials: Collection[str]) -> float:
    """How likely noise alone is so large in some trials, if each block has but one independent number of it.

    The floor is taken to be known from as many. What comes and goes differs so much from block to block that
    nothing else shows it.
    """
    here = np.array([name in trials for name in tally.trials]) & (tally.frames[:, k] > 0)
    ratio = float(tally.square[here, k].sum() / max(tally.floor[here, k].sum(), 1e-300))
    return float(scipy.stats.f.sf(ratio, here.sum(), here.sum()))


def _measure_strength(fit: Fit, floor: NoiseFloor, k: int) -> list[Array]:
    """Of every trial, block by block: what prediction takes off a place, over what it leaves."""
    found = []
    for item in fit.tracked:
        if item.name in floor.explained and np.isfinite(floor.noise[item.name][k]):
            parts = [floor.explained[item.name][rows, k] for rows in item.blocks(fit.settings.block_s)]
            sums = np.array([part.mean() for part in parts if part.any()])
            if len(sums):
                found.append(sums / max(float(floor.noise[item.name][k]), 1e-300))
    return found


def _assess_chances(strength: list[list[Array]]) -> Array:
    """How likely chance lets places be predicted so well in any of their trials.

    Most places are predicted no better than chance does, so the median spread of all blocks is chance's.
    Its tails are taken to be heavy (Student's t of three degrees of freedom).
    """
    every = np.concatenate([part for trials in strength for part in trials] or [np.zeros(1)])
    spread = 1.4826 * float(np.median(np.abs(every - min(float(np.median(every)), 0.0)))) + 1e-12
    found = []
    for trials in strength:
        z = [float(part.sum() / (spread * np.sqrt(len(part)))) for part in trials]
        found.append(min(1.0, len(z) * float(scipy.stats.t.sf(max(z), 3))) if z else 1.0)
    return np.array(found)


def _describe_law(fit: Fit, observation: Observation[Any], place: str) -> str:
    """A sparse sum of simple functions along the residual's main direction, in words."""
    gathered = _gather_residuals(fit, observation, place)
    if gathered is None:
        return "too short to say"
    residual, functions = gathered
    direction = np.linalg.svd(residual, full_matrices=False)[2][0]
    direction = direction * np.sign(direction[np.argmax(np.abs(direction))])
    y = residual @ direction
    halves = np.asarray(np.arange(len(y)) * 8 // len(y) % 2 == 0)
    taken: list[int] = []
    best = 0.0
    for _ in range(fit.settings.law_terms):
        scores = [_measure_explained(y, functions, [*taken, k], halves) for k in range(len(functions))]
        k = int(np.argmax(scores))
        if scores[k] < best + fit.settings.law_gain:
            break
        taken.append(k)
        best = scores[k]
    towards = ", ".join(f"{v:.2f}" for v in direction) if len(direction) == 3 else ""
    along = f" along ({towards}) in ground axes" if towards else ""
    if not taken:
        return f"no simple law{along}"
    size = np.linalg.lstsq(np.stack([functions[k].values for k in taken], axis=1), y, rcond=None)[0]
    factor, unit = _UNITS[classify_place(place)]
    terms = " + ".join(
        f"{s * factor:.3g} {unit}" + (f" x {functions[k].name}" if functions[k].name != "1" else "")
        for s, k in zip(size, taken, strict=True)
    )
    return f"{terms}{along} ({100.0 * best:.0f} % of it)".replace("+ -", "- ")


_UNITS: Mapping[Observable, tuple[float, str]] = {
    "marker": (1e3, "mm"),
    "force": (1.0, "N"),
    "moment": (1.0, "N m"),
}


def _measure_explained(
    y: Array, functions: list[_Function], chosen: list[int], halves: NDArray[np.bool_]
) -> float:
    """Share of the squares that a sum explains where it was not fitted."""
    x = np.stack([functions[k].values for k in chosen], axis=1)
    left = 0.0
    for known in (halves, ~halves):
        size = np.linalg.lstsq(x[known], y[known], rcond=None)[0]
        left += float(((y[~known] - x[~known] @ size) ** 2).sum())
    return 1.0 - left / max(float((y**2).sum()), 1e-300)


def _gather_residuals(
    fit: Fit, observation: Observation[Any], place: str
) -> tuple[Array, list[_Function]] | None:
    """Residuals (n, 1 or 3) of a place, and functions of the movement and time at the same frames."""
    residual, q, speed, pull, clock, load = [], [], [], [], [], []
    forces = {item.name: item for item in fit.wrenches}
    for item, values, _ in observation.series(fit, place):
        times, other = item.times, forces.get(item.name)
        smooth, first, second = item.smooth_rates()
        known = np.isfinite(values).all(axis=1)
        residual.append(values[known])
        q.append(smooth[known])
        speed.append(first[known])
        pull.append(second[known])
        clock.append(times[known] - times[0])
        load.append(other.measured[known, 1] if other is not None else np.zeros(int(known.sum())))
    if not residual or sum(map(len, residual)) < _FEWEST:
        return None
    time, vertical = np.concatenate(clock), np.concatenate(load)
    functions = [_Function("1", np.ones(len(time))), _Function("time (s)", time)]
    functions += [_Function(f"(time after {t:.2f} s)", (time > t).astype(float)) for t in _choose_steps(time)]
    if vertical.any():
        functions.append(_Function("the vertical force (N)", vertical))
        functions.append(_Function("contact", (vertical > _LOADED_N).astype(float)))
    courses = (("{}", q, 1), ("{}^2", q, 2), ("rate of {}", speed, 1), ("acceleration of {}", pull, 1))
    for word, parts, power in courses:
        values = np.concatenate(parts)
        names = enumerate(fit.model.coordinate_names)
        functions += [_Function(word.format(n), values[:, k] ** power) for k, n in names]
    return np.concatenate(residual), [f for f in functions if f.values.any()]


def _choose_steps(time: Array) -> Array:
    """Times at which something may have changed for good."""
    return np.linspace(time.min(), time.max(), 11)[1:-1]
