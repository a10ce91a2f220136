"""Where, when and along with what simulation and measurement disagree."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import scipy

from scaling_service.capabilities.discovery.evidence.fitting import Account
from scaling_service.capabilities.discovery.evidence.weighed import COMPONENTS
from scaling_service.capabilities.discovery.search.findings import Disagreement, Observable
from scaling_service.capabilities.discovery.search.tallies import Floors, Tally, marker_tally, wrench_tally
from scaling_service.numerics.multibody.laws import Array

_FEWEST = 3  # stretches; chosen: a spread is told from three
_TO_SD = 1.4826  # a normal distribution's standard deviation over its median distance from its median
_HEAVY = 3  # degrees of freedom; chosen: noise with tails as heavy keeps to the level over all places
_FOLLOWS = 0.3  # share of a residual's variance that a coordinate explains, from which it is told (chosen)


def disagreements(account: Account, stretch_s: float, floors: Floors) -> tuple[Disagreement, ...]:
    """All places, those that stand highest above their floors first.

    The p-values pay for the number of places (Holm 1979, Scand J Stat 6:65).
    """
    tallies = [tally(account, None, stretch_s, floors) for tally in (marker_tally, wrench_tally)]
    rows = [(tally, k) for tally in tallies if tally is not None for k in range(len(tally.places))]
    p = holm(np.array([_p(tally, k) for tally, k in rows]))
    excess = np.array([_excess(tally, k) for tally, k in rows])
    share = excess / max(float(excess.sum()), 1e-300)
    found = [_place(account, tally, k, float(share[i]), float(p[i])) for i, (tally, k) in enumerate(rows)]
    return tuple(sorted(found, key=lambda d: -d.share))


def _excess(tally: Tally, k: int) -> float:
    """Whitened square above the floor."""
    floor = float(tally.floor[:, k].sum())
    frames = float(tally.frames[:, k].sum())
    return frames * max(float(tally.square[:, k].sum()) / max(floor, 1e-300) - 1.0, 0.0)


def _p(tally: Tally, k: int) -> float:
    """How likely a place stands so far above its floor by chance: on the whole, or in any one stretch."""
    used = tally.frames[:, k] > 0
    if used.sum() < _FEWEST:
        return 1.0
    height = np.log(tally.square[used, k] / np.maximum(tally.floor[used, k], 1e-300) + 1e-12)
    return min(1.0, 2.0 * min(_on_the_whole(height), in_one_stretch(height)))


def _on_the_whole(height: Array) -> float:
    """Of the mean over stretches of log squares over floors, shape (n_stretches,)."""
    spread = float(height.std(ddof=1))
    if spread == 0.0:
        return 1.0
    return float(scipy.stats.t.sf(height.mean() / (spread / np.sqrt(len(height))), len(height) - 1))


def in_one_stretch(height: Array) -> float:
    """Of the highest of them over what most of them are, paying for their number.

    A label that is wrong for half a second spreads the heights so much that their mean tells nothing.
    """
    usual = float(np.median(height))
    spread = _TO_SD * float(np.median(np.abs(height - usual)))
    if spread == 0.0:
        return 1.0
    above = (float(height.max()) - usual) / spread
    return min(1.0, len(height) * float(scipy.stats.t.sf(above, _HEAVY)))


def holm(p: Array) -> Array:
    """P-values that pay for their number."""
    order, count = np.argsort(p), len(p)
    stepped = np.maximum.accumulate((count - np.arange(count)) * p[order])
    result = np.empty(count)
    result[order] = np.minimum(stepped, 1.0)
    return result


def _place(account: Account, tally: Tally, k: int, share: float, p: float) -> Disagreement:
    name = tally.places[k]
    observable = observable_of(name)
    trials = {}
    for trial in dict.fromkeys(tally.trials):
        here = np.array([t == trial for t in tally.trials])
        frames = float(tally.frames[here, k].sum())
        if frames:
            trials[trial] = float((tally.square[here, k].sum() / frames) ** 0.5)
    total = float(tally.frames[:, k].sum())
    return Disagreement(
        name,
        observable,
        float((tally.square[:, k].sum() / total) ** 0.5),
        float((tally.floor[:, k].sum() / total) ** 0.5),
        share,
        p,
        trials,
        _when(tally, k),
        _along(account, name, observable),
    )


def observable_of(place: str) -> Observable:
    """What kind of place a name is."""
    if place not in COMPONENTS:
        return "marker"
    return "force" if place.startswith("f") else "moment"


def _when(tally: Tally, k: int) -> str:
    mean = np.divide(
        tally.square[:, k], tally.frames[:, k], out=np.zeros(len(tally.frames)), where=tally.frames[:, k] > 0
    )
    worst = int(np.argmax(mean))
    return f"{tally.trials[worst]}, from {tally.starts[worst]:.2f} s"


def _along(account: Account, name: str, observable: Observable) -> str:
    """The coordinate, or its rate, that the residual follows best."""
    model, best = account.model, (_FOLLOWS, "")
    residual, motion = [], []
    for values, q, times in _series(account, name, observable):
        if np.isfinite(values).any():
            rate = np.gradient(q, times, axis=0)
            residual.append(values)
            motion.append(np.stack([q, rate, np.gradient(rate, times, axis=0)], axis=2))
    if not residual:
        return ""
    y, x = np.concatenate(residual), np.concatenate(motion)
    known = np.isfinite(y).all(axis=1)
    y, x = y[known] - y[known].mean(axis=0), x[known] - x[known].mean(axis=0)
    total = float((y**2).sum())
    for c, coordinate in enumerate(model.coordinates):
        for kind, word in enumerate(("", "the rate of ", "the acceleration of ")):
            size = float((x[:, c, kind] ** 2).sum())
            if size > 0.0 and total > 0.0:
                explained = float(((x[:, c, kind] @ y) ** 2).sum()) / size / total
                if explained > best[0]:
                    best = explained, f"{word}{coordinate.name} ({100.0 * explained:.0f} % of it)"
    return best[1]


def _series(account: Account, name: str, observable: Observable) -> Iterator[tuple[Array, Array, Array]]:
    """Of every trial: residuals of a place (n, 1 or 3), coordinates (n, n_coordinates), times (n,)."""
    if observable == "marker":
        for item in account.watched:
            if name in item.markers:
                q = item.q[:, : len(account.model.coordinates)]
                yield item.residuals[:, item.markers.index(name)], q, item.trial.times
        return
    for weighed in account.weighed:
        values = np.where(weighed.usable[:, None], weighed.gap[:, [COMPONENTS.index(name)]], np.nan)
        yield values, weighed.rated.q[:, : len(account.model.coordinates)], weighed.times
