"""A laboratory that shakes: cameras that all move together against the plates.

The pose follows what all markers do, so nothing shows among the markers. But then the whole body seems to be
thrown about, and what its mass would need acts at its centre of mass, in any direction, wherever that is: no
point of a segment stays there. It comes and goes fast: a lasting force at the centre of mass is a weight.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from scaling_service.capabilities.discovery.disturbances.disturbance import Disturbance, DisturbanceLaw
from scaling_service.capabilities.discovery.evidence.fit import Fit
from scaling_service.capabilities.discovery.evidence.statistics import p_above_zero
from scaling_service.capabilities.discovery.laws.contacts import Spell, fitted_point
from scaling_service.capabilities.discovery.observations.wrench import WrenchFit
from scaling_service.numerics.multibody.laws import Array
from scaling_service.numerics.multibody.rigid import skew
from scaling_service.numerics.signals.filters import butterworth

_UNIT = np.eye(3)
_FAST_HZ = 2.0  # chosen: above the pace of steps, below what shakes a mount


@dataclass(frozen=True, slots=True, eq=False)
class _Shaken:
    """One trial with a force of any course at the centre of mass; whitened squares of frames that count."""

    gains: Array  # (n_blocks,): what the fast part of the force takes off
    chance: Array  # (n_blocks,): what as many other directions would
    left: float  # by all of the force
    acceleration: Array  # (n, 3), m/s2: of the room

    @classmethod
    def of(cls, item: WrenchFit, block_s: float) -> _Shaken:
        """The force that leaves least in each frame."""
        arms = np.concatenate([np.broadcast_to(_UNIT, (len(item.times), 3, 3)), _moments(item)], axis=1)
        arms, gap = arms / item.floor[:, None], item.residuals / item.floor
        across = arms.transpose(0, 2, 1)
        force = np.linalg.solve(across @ arms, across @ gap[:, :, None])[:, :, 0]
        slow = butterworth(force, rate_hz=1.0 / item.step, cutoff_hz=_FAST_HZ, order=4).values
        left, fast = (
            np.square(gap - (arms @ f[:, :, None])[:, :, 0]).sum(axis=1) for f in (force, force - slow)
        )
        square = np.square(gap).sum(axis=1)
        parts = [np.flatnonzero(item.usable[rows]) + rows.start for rows in item.blocks(block_s)]
        gains = [float((square - fast)[part].sum()) for part in parts if len(part)]
        chance = [float(fast[part].sum()) for part in parts if len(part)]  # 3 of 6 numbers are left
        used = item.usable
        return cls(
            np.array(gains), np.array(chance), float(left[used].sum()), (force - slow)[used] / item.mass
        )


def _moments(item: WrenchFit) -> Array:
    """Moments about :attr:`WrenchFit.about` of unit forces at the centre of mass, (n, 3, 3)."""
    return skew(item.centre_of_mass - item.about)


def shaken_room(fit: Fit) -> Iterator[Disturbance]:
    """A fast force at the centre of mass, unless one at a point of some segment leaves less."""
    usable = [item for item in fit.wrenches if item.usable.any()]
    items = [item for item in usable if item.role == "fit"]
    if not items:
        return
    spells = [Spell(item, np.flatnonzero(item.usable)) for item in items]
    found = [_Shaken.of(item, fit.settings.block_s) for item in items]
    held = [_Shaken.of(item, fit.settings.block_s) for item in usable if item.role == "held_out"]
    left = sum(each.left for each in found)
    if all(left < fitted_point(spells, segment.name).left for segment in fit.scene.heavy):
        rms = np.sqrt(np.square(np.concatenate([each.acceleration for each in found])).sum(axis=1).mean())
        law = f"all markers shake together against the plates, by accelerations of {rms:.2g} m/s2 (RMS)"
        gain = sum(float(each.gains.sum() - 2.0 * each.chance.sum()) for each in found)
        p = _by_chance(found)
        yield Disturbance(("markers",), law, gain, p, _by_chance(held) if held else p, "wrench")


def _by_chance(trials: Sequence[_Shaken]) -> float:
    """How likely other directions take off as much."""
    gains, chance = (
        np.concatenate(parts) for parts in zip(*((t.gains, t.chance) for t in trials), strict=True)
    )
    return p_above_zero(np.log(np.maximum(gains, 1e-300) / np.maximum(chance, 1e-300)))


LAWS = (DisturbanceLaw(search=shaken_room),)
