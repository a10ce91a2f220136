"""Where, when and along with what simulation and measurement disagree."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import scipy

from scaling_service.capabilities.discovery.evidence.fit import Fit
from scaling_service.capabilities.discovery.evidence.noise_floors import Floors
from scaling_service.capabilities.discovery.evidence.observation import Observation, Tally
from scaling_service.capabilities.discovery.evidence.statistics import adjust_holm, assess_above_zero
from scaling_service.capabilities.discovery.evidence.wrench import OBSERVATIONS
from scaling_service.capabilities.discovery.search.findings import Disagreement, classify_place
from scaling_service.numerics.multibody.laws import Array

_FEWEST = 3  # blocks; chosen: a spread needs three
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
    if used.sum() < _FEWEST:
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
