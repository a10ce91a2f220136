"""Forces that are off by what the plates read: crosstalk, lag, a soft mat, a channel that is dead.

Any such fault is a linear function of the readings and their rates, and most are no effect of the catalogue.
So the whole wrench is predicted by them, block of time by block of time, each by the blocks between. A fault
that the catalogue has follows few numbers and explains as much; where none does, it is another one.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from scaling_service.capabilities.discovery.disturbances.disturbance import Disturbance, DisturbanceLaw
from scaling_service.capabilities.discovery.evidence.fit import Fit
from scaling_service.capabilities.discovery.evidence.markers import MARKERS
from scaling_service.capabilities.discovery.evidence.noise_floors import assign_folds, predict_between
from scaling_service.capabilities.discovery.evidence.statistics import assess_above_zero
from scaling_service.capabilities.discovery.observations.wrench import COMPONENTS, WrenchFit
from scaling_service.numerics.multibody.laws import Array

_PART = 0.25  # of what the largest component is off by, in floors, from which another is reported (chosen)
_ALIKE = 0.03  # of the largest direction of all readings, below which one is no other (chosen: of its noise)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class _Frames:
    """Frames of a trial that count."""

    readings: Array  # (n, m): of all plates, and their rates, as they are compared
    off: Array  # (n, 6): residuals, N and N m, the moment about the ground origin
    folds: Array  # (n,)
    blocks: tuple[NDArray[np.intp], ...]  # the numbers of the frames of each
    item: WrenchFit

    @classmethod
    def of(cls, item: WrenchFit, plates: Sequence[str], block_s: float) -> _Frames:
        """All that any plate reads."""
        used = item.usable
        read = np.concatenate([item.filter(item.plate(plate)) for plate in plates], axis=1)
        every = np.concatenate([read, np.gradient(read, item.times, axis=0)], axis=1)
        number = np.cumsum(used) - 1
        parts = [number[rows][used[rows]] for rows in item.blocks(block_s)]
        off = item.residuals.copy()
        off[:, 3:] += np.cross(item.about, off[:, :3])
        blocks = tuple(part for part in parts if len(part))
        return cls(
            readings=every[used],
            off=off[used],
            folds=assign_folds(item.tracked, block_s)[used],
            blocks=blocks,
            item=item,
        )

    def whiten(self, wrench: Array) -> Array:
        """A wrench about the ground origin in floors of the one about the trunk."""
        moment = wrench[:, 3:] - np.cross(self.item.about[self.item.usable], wrench[:, :3])
        return np.concatenate([wrench[:, :3], moment], axis=1) / self.item.floor

    def squares(self, guess: Array) -> Array:
        """Of each block and component without a guess of the wrench and with it, (n_blocks, 2, 6)."""
        both = np.stack([np.square(self.whiten(off)) for off in (self.off, self.off - guess)], axis=1)
        return np.array([both[part].sum(axis=0) for part in self.blocks])


def find_following_readings(fit: Fit) -> Iterator[Disturbance]:
    """The wrench as the plates' own readings predict it, where the motion is known down to its noise."""
    items = [item for item in fit.wrenches if item.usable.any()]
    fitting = [item for item in items if item.role == "fit"]
    if not fitting or not fit.scene.plates or not _is_motion_known(fit):
        return
    parts = [_Frames.of(item, fit.scene.plates, fit.settings.block_s) for item in items]
    known = [part for part in parts if part.item.role == "fit"]
    x, mean, scale = _standardise(np.concatenate([part.readings for part in known]))
    y = np.concatenate([part.off for part in known])
    guess = predict_between(x, y, np.concatenate([part.folds for part in known]))
    edges = np.cumsum([len(part.off) for part in known])[:-1]
    guesses = np.split(guess, edges)
    squares = np.concatenate([part.squares(one) for part, one in zip(known, guesses, strict=True)])
    p = held_out = _by_chance(squares)
    others = [part for part in parts if part.item.role == "held_out"]
    if others:
        law = np.linalg.lstsq(x, y, rcond=_ALIKE)[0]
        held = [part.squares(_evaluate_functions(part.readings, mean, scale) @ law) for part in others]
        held_out = _by_chance(np.concatenate(held))
        p = min(1.0, 2.0 * min(p, held_out))  # neither is a test of what fitted it
    of_each = (squares[:, 0] - squares[:, 1]).sum(axis=0)
    off = [name for name, gain in zip(COMPONENTS, of_each, strict=True) if gain > _PART * of_each.max()]
    said = f"{', '.join(off)} {'is' if len(off) == 1 else 'are'} off by what the plates themselves read"
    yield Disturbance(
        where=("forces", *off),
        law=said,
        expected=float(of_each.sum()),
        p=p,
        held_out=held_out,
        seen_in="wrench",
        flexible=True,
    )


def _by_chance(squares: Array) -> float:
    """How likely blocks as consistently disagree less by chance."""
    return assess_above_zero((squares[:, 0] - squares[:, 1]).sum(axis=1))


def _is_motion_known(fit: Fit) -> bool:
    """Whether the model follows the markers down to their noise."""
    tally = MARKERS.tally(fit, "fit")
    return (
        tally is not None
        and float(tally.square.sum() / tally.floor.sum()) < 1.0 + fit.settings.tracked_excess
    )


def _standardise(readings: Array) -> tuple[Array, Array, Array]:
    mean, scale = readings.mean(axis=0), readings.std(axis=0)
    scale[scale == 0.0] = 1.0
    return _evaluate_functions(readings, mean, scale), mean, scale


def _evaluate_functions(readings: Array, mean: Array, scale: Array) -> Array:
    return np.concatenate([np.ones((len(readings), 1)), (readings - mean) / scale], axis=1)


LAWS = (DisturbanceLaw(search=find_following_readings),)
