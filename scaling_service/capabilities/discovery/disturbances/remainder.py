"""What is left above the floor and matches no effect: where, and the simplest law that describes it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from scaling_service.capabilities.discovery.evidence.fitting import Account
from scaling_service.capabilities.discovery.evidence.locating import holm, observable_of
from scaling_service.capabilities.discovery.evidence.predictable import marker_names
from scaling_service.capabilities.discovery.evidence.score import stretches_of
from scaling_service.capabilities.discovery.evidence.weighed import COMPONENTS
from scaling_service.capabilities.discovery.search.findings import Foreign, Unexplained
from scaling_service.capabilities.discovery.search.tallies import Floors, Tally, marker_tally, wrench_tally
from scaling_service.numerics.multibody.laws import Array
from scaling_service.numerics.signals.filters import butterworth

LEVEL = 0.05
"""Family-wise, over all places."""

STANDS_OUT = 1.25
"""RMS over floor from which what is left is worth a word (chosen: a third of its squares is predicted)."""

_TERMS = 3  # chosen: a law of more is no longer simple
_WORTH = 0.05  # of the variance: what a further term must explain, on the half that did not fit it (chosen)
_CUTOFF_HZ = 6.0


@dataclass(frozen=True, slots=True, eq=False)
class _Function:
    name: str
    values: Array


def unexplained(
    account: Account, stretch_s: float, floors: Floors, odd_law: Foreign | None = None
) -> tuple[Unexplained, ...]:
    """Places of which the movement or the time still predicts much, the largest first.

    A foreign law comes before all, and stands for every place among the markers, or in the wrench.
    """
    left = _predicted(account, stretch_s, floors)
    if odd_law is None:
        return left
    others = [u for u in left if (u.observable != "marker") != odd_law.of_forces]
    return _told(account, stretch_s, odd_law), *others


def _told(account: Account, stretch_s: float, odd_law: Foreign) -> Unexplained:
    """A foreign law with what its places show, over what the instrument would."""
    tallied = wrench_tally if odd_law.of_forces else marker_tally
    tally = tallied(account, None, stretch_s)
    assert tally is not None
    shown = [k for k, place in enumerate(tally.places) if place in odd_law.where]
    rows = shown or list(range(len(tally.places)))
    frames = max(float(tally.frames[:, rows].sum()), 1.0)
    rms, floor = ((float(x[:, rows].sum()) / frames) ** 0.5 for x in (tally.square, tally.floor))
    return Unexplained(odd_law.where, "force" if odd_law.of_forces else "marker", odd_law.law, rms, floor)


def _predicted(account: Account, stretch_s: float, floors: Floors) -> tuple[Unexplained, ...]:
    tallies = [tally(account, None, stretch_s, floors) for tally in (marker_tally, wrench_tally)]
    rows = [(tally, k) for tally in tallies if tally is not None for k in range(len(tally.places))]
    strength = [_strength(account, tally.places[k], floors, stretch_s) for tally, k in rows]
    p = holm(_chances(strength))
    found = []
    for (tally, k), chance in zip(rows, p.tolist(), strict=True):
        frames = float(tally.frames[:, k].sum())
        if frames and chance <= LEVEL:
            rms, floor = _worst_trial(tally, k)
            if rms > STANDS_OUT * floor:
                place = tally.places[k]
                found.append(Unexplained((place,), observable_of(place), _law(account, place), rms, floor))
    return tuple(sorted(found, key=lambda u: -u.rms / u.floor))


def _worst_trial(tally: Tally, k: int) -> tuple[float, float]:
    """RMS and floor of a place in the trial in which they differ most."""
    found = []
    for trial in dict.fromkeys(tally.trials):
        here = np.array([t == trial for t in tally.trials])
        frames = float(tally.frames[here, k].sum())
        if frames:
            rms, floor = ((float(x[here, k].sum()) / frames) ** 0.5 for x in (tally.square, tally.floor))
            found.append((rms / max(floor, 1e-300), rms, floor))
    return max(found)[1:]


def _strength(account: Account, place: str, floors: Floors, stretch_s: float) -> list[Array]:
    """Of every trial, stretch by stretch: what prediction takes off, over what it leaves."""
    wrench = place in COMPONENTS
    taken = floors.explained_wrenches if wrench else floors.explained_markers
    left = floors.wrenches if wrench else floors.markers
    k = COMPONENTS.index(place) if wrench else marker_names(account).index(place)
    found = []
    for item in account.watched:
        if item.name in taken and np.isfinite(left[item.name][k]):
            parts = [taken[item.name][rows, k] for rows in stretches_of(item, stretch_s)]
            sums = np.array([part.mean() for part in parts if part.any()])
            if len(sums):
                found.append(sums / max(float(left[item.name][k]), 1e-300))
    return found


def _chances(strength: list[list[Array]]) -> Array:
    """How likely chance lets places be predicted so well in any of their trials.

    Most places are predicted no better than chance does, so the median spread of all stretches is chance's.
    Its tails are taken to be heavy (Student's t of three degrees of freedom).
    """
    every = np.concatenate([part for trials in strength for part in trials] or [np.zeros(1)])
    spread = 1.4826 * float(np.median(np.abs(every - min(float(np.median(every)), 0.0)))) + 1e-12
    found = []
    for trials in strength:
        z = [float(part.sum() / (spread * np.sqrt(len(part)))) for part in trials]
        found.append(min(1.0, len(z) * float(scipy.stats.t.sf(max(z), 3))) if z else 1.0)
    return np.array(found)


def _law(account: Account, place: str) -> str:
    """A sparse sum of simple functions along the residual's main direction, in words."""
    gathered = _gathered(account, place)
    if gathered is None:
        return "too short to say"
    residual, functions, unit = gathered
    direction = np.linalg.svd(residual, full_matrices=False)[2][0]
    direction = direction * np.sign(direction[np.argmax(np.abs(direction))])
    y = residual @ direction
    halves = np.asarray(np.arange(len(y)) * 8 // len(y) % 2 == 0)
    taken: list[int] = []
    best = 0.0
    for _ in range(_TERMS):
        scores = [_explained(y, functions, [*taken, k], halves) for k in range(len(functions))]
        k = int(np.argmax(scores))
        if scores[k] < best + _WORTH:
            break
        taken.append(k)
        best = scores[k]
    towards = ", ".join(f"{v:.2f}" for v in direction) if len(direction) == 3 else ""
    along = f" along ({towards}) in ground axes" if towards else ""
    if not taken:
        return f"no simple law{along}"
    size = np.linalg.lstsq(np.stack([functions[k].values for k in taken], axis=1), y, rcond=None)[0]
    terms = " + ".join(
        f"{s * unit[0]:.3g} {unit[1]}" + (f" x {functions[k].name}" if functions[k].name != "1" else "")
        for s, k in zip(size, taken, strict=True)
    )
    return f"{terms}{along} ({100.0 * best:.0f} % of it)".replace("+ -", "- ")


def _explained(y: Array, functions: list[_Function], chosen: list[int], halves: NDArray[np.bool_]) -> float:
    """Share of the squares that a sum explains where it was not fitted."""
    x = np.stack([functions[k].values for k in chosen], axis=1)
    left = 0.0
    for known in (halves, ~halves):
        size = np.linalg.lstsq(x[known], y[known], rcond=None)[0]
        left += float(((y[~known] - x[~known] @ size) ** 2).sum())
    return 1.0 - left / max(float((y**2).sum()), 1e-300)


def _gathered(account: Account, place: str) -> tuple[Array, list[_Function], tuple[float, str]] | None:
    """Residuals (n, 1 or 3), functions of the movement at the same frames, and the unit to tell them in."""
    residual, q, speed, pull, clock, load = [], [], [], [], [], []
    forces = {item.name: item for item in account.weighed}
    for item in account.watched:
        other = forces.get(item.name)
        if place in COMPONENTS:
            if other is None:
                continue
            values = np.where(other.usable[:, None], other.gap[:, [COMPONENTS.index(place)]], np.nan)
        elif place in item.markers:
            values = item.residuals[:, item.markers.index(place)]
        else:
            continue
        times = item.trial.times
        rate = 1.0 / float(np.median(np.diff(times)))
        smooth = butterworth(item.q, rate_hz=rate, cutoff_hz=min(_CUTOFF_HZ, 0.4 * rate), order=4).values
        first = np.gradient(smooth, times, axis=0)
        known = np.isfinite(values).all(axis=1)
        residual.append(values[known])
        q.append(smooth[known])
        speed.append(first[known])
        pull.append(np.gradient(first, times, axis=0)[known])
        clock.append(times[known] - times[0])
        load.append(other.measured[known, 1] if other is not None else np.zeros(int(known.sum())))
    if not residual or sum(map(len, residual)) < 16:
        return None
    names = account.model.coordinate_names
    functions = [_Function("1", np.ones(sum(map(len, residual))))]
    time = np.concatenate(clock)
    functions += [_Function("time (s)", time)]
    functions += [_Function(f"(time after {t:.2f} s)", (time > t).astype(float)) for t in _steps(time)]
    vertical = np.concatenate(load)
    if vertical.any():
        functions += [
            _Function("the vertical force (N)", vertical),
            _Function("contact", (vertical > 20.0).astype(float)),
        ]
    for word, parts, power in (
        ("{}", q, 1),
        ("{}^2", q, 2),
        ("rate of {}", speed, 1),
        ("acceleration of {}", pull, 1),
    ):
        values = np.concatenate(parts)
        functions += [_Function(word.format(n), values[:, k] ** power) for k, n in enumerate(names)]
    functions = [f for f in functions if f.values.any()]
    unit = (1.0, "N" if place.startswith("f") else "N m") if place in COMPONENTS else (1e3, "mm")
    return np.concatenate(residual), functions, unit


def _steps(time: Array) -> Array:
    """Times at which something may have changed for good."""
    return np.linspace(time.min(), time.max(), 11)[1:-1]
