"""Damped Gauss-Newton (Levenberg-Marquardt) on many least squares at once.

A *row* is a least-squares problem that shares nothing with the other rows: a frame where the model is known,
or all frames with what they share. What differs between fits is how a row is linearised and how the linear
problem is solved: by sweeps over the tree, by dense blocks, with a border of shared numbers. That is a
:class:`Task`. Damping, acceptance, convergence and giving up are here, row by row, without a loop over rows.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Protocol, Self, TypeVar

import numpy as np
from numpy.typing import NDArray

from scaling_service.core.arrays import Array, Mask

NEAR = 0.3  # share of the cost that a step may promise for the next one to start near the minimum
_ROUNDING = 1e-14  # share of the cost by which it may rise and count as not risen

At = TypeVar("At")


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class Damping:
    """How the damping of a row, a share of its curvature, follows from whether its steps helped."""

    ease: float  # times the damping after a step that lowered the cost
    tighten: float  # times the damping after one that did not
    least: float = 0.0
    failed: float = 0.0  # least damping that is tightened
    lost: float  # damping from which on rounding, not the model, decides: the row ends
    # Whether steps that keep little of their promise ease it less, and each failure in a row tightens it more
    # (Nielsen 1999)
    by_gain: bool = False

    def adapt(self, damping: Array, failures: NDArray[np.intp], kept: Array | float = 1.0) -> Array:
        """The damping (n,) of the next step, after so many failures in a row.

        ``kept`` (n,): the share of its promise that the step kept.
        """
        ease: float | Array = self.ease
        tighten: float | Array = self.tighten
        if self.by_gain:
            ease = np.asarray(np.maximum(self.ease, 1.0 - (2.0 * np.minimum(kept, 1.5) - 1.0) ** 3))
            tighten = np.asarray(self.tighten**failures)
        eased = np.maximum(damping * ease, self.least)
        if not failures.any():
            return eased
        tightened = np.minimum(np.maximum(damping, self.failed) * tighten, self.lost)
        return np.asarray(np.where(failures > 0, tightened, eased))


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class Settings:
    """When to stop, and how strongly to damp."""

    max_steps: int
    damping: float  # of the first step
    rule: Damping
    # A row ends with a step that leaves no more than this share of its cost to be gained, or this much. It
    # leaves as much as it promises; or, extrapolated, ``promise * rate / (1 - rate)``, as if steps went on to
    # promise less at the same rate.
    left: float
    left_over: float = 0.0
    extrapolate: bool = False
    alike: bool = False  # whether the share is of all rows' mean cost: a row may cost next to nothing
    # Whether only checked steps are taken: not the one with which a row ends, too small to matter, but the
    # last one of a row that runs out of steps
    checked: bool = False
    step_tolerance: float = 0.0  # or when no unknown moves by more than this
    halvings: int = 0  # times that a step which raised the cost is halved before it is given up
    quorum: float = 1.0  # share of the rows that must have converged; the others may then stay behind


@dataclasses.dataclass(slots=True, eq=False, kw_only=True)
class Rows:
    """What is known of the rows that still go on, each (n,)."""

    cost: Array
    damping: Array
    promised: Array  # the decrease that the step before promised
    near: Mask  # whether that was little, and neither it nor the one before raised the cost
    failures: NDArray[np.intp]  # steps in a row that were given up

    def take(self, rows: NDArray[np.intp]) -> Self:
        """Only these rows."""
        return type(self)(**{f.name: getattr(self, f.name)[rows] for f in dataclasses.fields(self)})


class Task(Protocol[At]):
    """Some rows: how to measure what they cost, and to solve their linear problems."""

    def measure(self, x: Array) -> tuple[Array, Array, At]:
        """Unknowns (n, k), as they are or better; their costs (n,); and what a step from there can use."""

    def step(self, x: Array, at: At, rows: Rows) -> tuple[Array, Array]:
        """Where a damped step leads, (n, k), and by how much it promises to lower the costs, (n,)."""

    def take(self, rows: NDArray[np.intp]) -> Self:
        """The same of some rows."""


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class Descent:
    """Unknowns (n, k), cost by row (n,), and how each row ended."""

    x: Array
    cost: Array
    steps: NDArray[np.intp]
    converged: Mask


def descend(
    task: Task[At],
    x: Array,
    settings: Settings,
    *,
    close: bool = False,
    progress: Callable[[int, float], None] | None = None,
) -> Descent:
    """Lower the cost of every row until it has converged; rows leave as they do.

    ``x``: (n, k).
    ``close``: whether the start is near the minimum already.
    ``progress``: called with the step's number and the cost of the rows that still go on, when it fell.
    """
    n, going = len(x), np.arange(len(x))
    x, cost, at = task.measure(x)
    found, ended = x.copy(), cost.copy()
    steps, converged = np.zeros(n, dtype=np.intp), np.zeros(n, dtype=bool)
    rows = Rows(
        cost=cost,
        damping=np.full(n, settings.damping),
        promised=np.full(n, np.inf if close else 0.0),
        near=np.full(n, close),
        failures=np.zeros(n, dtype=np.intp),
    )
    number = 0
    for number in range(1, settings.max_steps + 1):
        trial, promised = task.step(x, at, rows)
        whole = np.full(len(going), ended.mean()) if settings.alike else rows.cost
        done = _find_done(rows, settings, promised, whole)
        done |= np.abs(trial - x).max(axis=1, initial=0.0) <= settings.step_tolerance
        known: At | None = at
        if done.any():
            # A row that just failed stays where it is.
            taken = done & (rows.failures == 0) & (not settings.checked)
            found[going] = np.where(taken[:, None], trial, x)
            ended[going] = np.where(taken, rows.cost - promised, rows.cost)
            steps[going], converged[going] = number, done
            left, known = np.flatnonzero(~done), None
            going, x, trial, promised = going[left], x[left], trial[left], promised[left]
            task, rows = task.take(left), rows.take(left)
        over = number == settings.max_steps and not settings.checked
        if over or len(going) <= (1.0 - settings.quorum) * n:
            break
        rows.near = (promised < NEAR * rows.cost) & (rows.failures == 0)
        rows.promised = promised
        x, at = _advance(task, x, trial, rows, settings, known)
        ended[going] = rows.cost
        if progress is not None and not rows.failures.all():
            progress(number, float(rows.cost.sum()))
    found[going], steps[going] = x, number
    return Descent(found, ended, steps, converged)


def _find_done(rows: Rows, settings: Settings, promised: Array, whole: Array) -> Mask:
    """Which rows end with a step of some promise, (n,).

    ``whole`` (n,): the costs of which enough is a share.
    """
    enough = settings.left * whole + settings.left_over
    if settings.extrapolate:
        before = np.minimum(np.where(rows.failures > 0, 0.0, rows.promised), rows.cost)
        done = promised**2 <= enough * np.maximum(before - promised, promised)
    else:
        done = promised <= enough
    return np.asarray(done | (rows.damping >= settings.rule.lost))


def _advance(
    task: Task[At], x: Array, trial: Array, rows: Rows, settings: Settings, known: At | None
) -> tuple[Array, At]:
    """The unknowns after a step, drawn back where it raised the cost, and what measuring them found.

    ``known``: what measuring them before the step found, if no row has left since.
    """
    trial, cost, at = task.measure(trial)
    for share in (*[0.5] * settings.halvings, 0.0):
        worse = ~(cost <= rows.cost * (1.0 + _ROUNDING))
        if not worse.any():
            break
        if not share and known is not None and worse.all():
            trial, cost, at = x, rows.cost, known
            break
        trial = np.where(worse[:, None], x + share * (trial - x) if share else x, trial)
        trial, cost, at = task.measure(trial)
    rows.failures = np.where(worse, rows.failures + 1, 0)
    kept = (rows.cost - cost) / np.where(rows.promised > 0.0, rows.promised, np.inf)
    rows.cost, rows.damping = cost, settings.rule.adapt(rows.damping, rows.failures, kept)
    rows.near &= ~worse
    return trial, at
