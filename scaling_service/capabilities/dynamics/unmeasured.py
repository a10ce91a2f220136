"""Stretches in which something that no plate measures bears the person, or in which nothing does.

The vertical momentum balance tells how much of the weight the plates lack; the feet and the pelvis tell why.
"""

from __future__ import annotations

from collections import abc
from dataclasses import dataclass
from typing import Literal

import numpy as np
import scipy
from numpy.typing import NDArray

from scaling_service.capabilities.dynamics import weight as weights
from scaling_service.capabilities.kinetics import inverse_dynamics
from scaling_service.capabilities.motion.inverse_kinematics import inverse_kinematics
from scaling_service.core.arrays import Array
from scaling_service.core.names import say_foot
from scaling_service.model import compile as compiling
from scaling_service.model.body import BodyModel
from scaling_service.model.forces import SegmentLoads
from scaling_service.model.inertia import compile_mechanism
from scaling_service.model.trial import Trial
from scaling_service.numerics.multibody.tree import pose_links
from scaling_service.numerics.signals.filters import find_runs
from scaling_service.numerics.wrench import GRAVITY
from scaling_service.recording import plates_feet

LACKING = 0.2
"""Share of the weight that must be missing (chosen: filtered markers leave less than a tenth of it)."""

LASTING_S = 0.25
"""For at least so long (chosen: what landings shake out of the balance is shorter)."""

FALLING, FLIGHT_S = 0.25, 0.06
"""Share of the weight below which what the plates bear and what the motion needs are called flight, and for
how long (chosen: a filter of 5 Hz rounds off the ends of a flight of 0.2 s so far)."""

LOW = 0.75
"""Height of the pelvis above the lowest joint, of that when upright, below which somebody sits (chosen: a
seat at the knee's height is 0.55 to 0.65)."""

_MOST = 0.5  # share of a stretch that decides what a foot does in it (chosen)
_BASE = (0.8, 1.25)  # bounds of borne over needed weight where nothing is missing (chosen: no mass errs more)

Kind = Literal["flight", "chair", "missing_plate", "step", "contact"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Unmeasured:
    """One stretch."""

    kind: Kind
    start_s: float
    end_s: float
    share: float  # of the weight that the plates lack, its median
    foot: str = ""  # that stands where no plate measures

    @property
    def sentence(self) -> str:
        """What it is, when, and how much.

        Examples
        --------
        >>> Unmeasured(kind="chair", start_s=0.1, end_s=1.25, share=0.6).sentence
        'from 0.10 to 1.25 s the plates lack 60 % of the weight: the pelvis is low, as on a chair'
        """
        span = f"from {self.start_s:.2f} to {self.end_s:.2f} s"
        if self.kind == "flight":
            return f"{span} in flight: the plates bear nothing, and the motion needs nothing"
        why = {
            "chair": "the pelvis is low, as on a chair",
            "missing_plate": f"the {say_foot(self.foot)} stands where none measures; a plate is missing",
            "step": "both feet are off the floor, as on a step or a box",
            "contact": "a hand on something, a frame or another person bears it",
        }[self.kind]
        return f"{span} the plates lack {self.share:.0%} of the weight: {why}".replace("%", " %", 1)


def find_unmeasured(
    dynamics: inverse_dynamics.InverseDynamics, contacts: plates_feet.FootContacts, model: BodyModel
) -> tuple[Unmeasured, ...]:
    """Stretches of one recording in which the plates do not bear what the motion needs, and flight.

    A step before the first plate or after the last is as usual and not among them.
    """
    times, known = dynamics.motion.times, dynamics.known
    step = float(np.median(np.diff(times))) if len(times) > 1 else 0.0
    borne = np.where(known, dynamics.external[:, 1], 0.0)
    needed = np.where(known, dynamics.external[:, 1] + dynamics.residual[:, 1], 0.0)
    weight = -GRAVITY[1] * dynamics.mass
    # What the plates bear of what is needed where nothing is missing: as the best of the blocks of time.
    sums = np.array(
        [(borne[r].sum(), needed[r].sum()) for r in weights.split_into_blocks(known, times, weights.BLOCK_S)]
    )
    sums = sums[sums[:, 1] > 0.0] if len(sums) else sums.reshape(0, 2)
    best = weights.compute_quantiles(sums[:, 0] / sums[:, 1], sums[:, 1], (0.84,))[0] if len(sums) else 1.0
    base = float(np.clip(best, *_BASE))
    lack = needed / weight - borne / (base * weight)
    flying = known & (borne < FALLING * weight) & (needed < FALLING * weight)
    found = [
        Unmeasured(kind="flight", start_s=float(times[a]), end_s=float(times[b - 1]), share=0.0)
        for a, b in _list_runs(flying, step, FLIGHT_S)
    ]
    # Height of the root above the lowest joint, over that in the default pose, (n,).
    mechanism, p = compile_mechanism(model), compiling.list_parameter_values(model)

    def measure_height(q: Array) -> Array:
        up = pose_links(mechanism.tree, q, p).origins[:, 1]
        return np.asarray(up[0] - up.min(axis=0))

    height = np.asarray(
        measure_height(dynamics.motion.rates.q) / measure_height(compiling.repeat_default_pose(model, 1).T)
    )
    bears = np.stack([(contacts.foot == k).any(axis=1) for k in range(len(contacts.feet))], axis=1)
    beside = contacts.on_floor & ~bears
    for a, b in _list_runs(known & ~flying & (lack > LACKING), step, LASTING_S):
        rows = slice(a, b)
        kind, foot = _find_reason(beside, bears, contacts, rows)
        if kind is None and np.nanmedian(height[rows]) < LOW:
            kind = "chair"
        elif kind is None:
            kind = "contact" if contacts.on_floor[rows].any(axis=1).mean() > _MOST else "step"
        if kind != "beside":
            found.append(
                Unmeasured(
                    kind=kind,
                    start_s=float(times[a]),
                    end_s=float(times[b - 1]),
                    share=float(np.median(lack[rows])),
                    foot=foot,
                )
            )
    return tuple(sorted(found, key=lambda one: one.start_s))


def describe_unmeasured(
    model: BodyModel, trial: Trial, loads: SegmentLoads, contacts: plates_feet.FootContacts, cutoff_hz: float
) -> tuple[str, ...]:
    """The same in sentences, of a recording that was not tracked yet; the model has mass."""
    dynamics = inverse_dynamics.solve_inverse_dynamics(
        model, inverse_kinematics(model, trial), loads, cutoff_hz=cutoff_hz
    )
    return tuple(f"{trial.name} {one.sentence}" for one in find_unmeasured(dynamics, contacts, model))


def find_unmeasured_frames(found: abc.Iterable[Unmeasured], times: Array) -> NDArray[np.bool_]:
    """Frames (n,) whose forces are not all measured; flight is measured."""
    inside = [(times >= one.start_s) & (times <= one.end_s) for one in found if one.kind != "flight"]
    return np.asarray(np.any([np.zeros(len(times), dtype=bool), *inside], axis=0))


def _list_runs(flags: NDArray[np.bool_], step: float, least_s: float) -> abc.Iterator[tuple[int, int]]:
    """Runs of flags that last, brief gaps closed."""
    reach = max(1, round(FLIGHT_S / step)) if step else 1
    closed = scipy.ndimage.binary_closing(np.pad(flags, reach), np.ones(reach + 1))[reach:-reach]
    yield from ((a, b) for a, b in find_runs(closed).tolist() if (b - a) * step >= least_s)


def _find_reason(
    beside: NDArray[np.bool_], bears: NDArray[np.bool_], contacts: plates_feet.FootContacts, rows: slice
) -> tuple[Kind | Literal["beside"] | None, str]:
    """Whether and which foot stands where no plate measures, and whether that is more than a walk's end."""
    for k, foot in enumerate(contacts.feet):
        if beside[rows, k].mean() > _MOST:
            loaded = (contacts.foot != plates_feet.NOBODY).any(axis=1)
            between = loaded[: rows.start].any() and loaded[rows.stop :].any()
            lost = between or (not bears[:, k].any() and bears.any())
            return ("missing_plate" if lost else "beside"), foot
    return None, ""
