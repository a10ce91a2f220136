"""The pressure under a whole step is under its foot: what that says of where plates lie.

Over a whole step the mean centre of pressure, weighted by force, lies under the foot's centre of mass, as
people and activities differ. It needs no masses and no accelerations, so that it tells a plate's place where
the balance of momentum hardly does.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from scaling_service.capabilities.discovery.laws.loads import PlateFault
from scaling_service.capabilities.discovery.observations.wrench import Load, Step, WrenchFit
from scaling_service.core.arrays import Array

_FORWARD_M, _OF_STEP_M = 0.030, 0.008
"""Along the foot: of both feet in a recording alike, and of each step (measured, 34 steps of nine persons in
four laboratories: walks -5 to 40 mm, a squat -48; steps of a walk 8)."""

_OUTWARD_M, _OF_FOOT_M = 0.010, 0.004
"""Across it: of a person's feet, mirrored, and of each foot and each of its steps (the same steps: 0, 9, 13
and 16 mm by laboratory; feet of a person 4, steps of a foot 3)."""

_CUT_M = np.array([0.080, 0.006])
"""Further of a step that the recording cuts, along and across the foot: pressure goes from heel to toe, and
little sideways (the same laboratories' cut steps, against their whole ones)."""


@dataclass(frozen=True, slots=True, eq=False)
class Soles:
    """Steps as independent numbers of unit variance: what is off, (2 n_steps,), and what columns explain."""

    gap: Array
    columns: Array  # (2 n_steps, n_columns)


def tabulate_steps(fits: Sequence[WrenchFit], loads: Sequence[tuple[Load, tuple[str, ...]]]) -> Soles:
    """The steps of all recordings against loads, each in the recordings named, in all if none is."""
    steps = [(fit, step) for fit in fits for step in fit.contacts.steps]
    if not steps:
        return Soles(np.zeros(0), np.zeros((0, len(loads))))
    gap, columns = zip(*(_measure(fit, step, loads) for fit, step in steps), strict=True)
    white = np.linalg.inv(np.linalg.cholesky(_expect(steps)))
    return Soles(white @ np.concatenate(gap), white @ np.concatenate(columns))


def _measure(
    fit: WrenchFit, step: Step, loads: Sequence[tuple[Load, tuple[str, ...]]]
) -> tuple[Array, Array]:
    """How far forward and outward pressure lies of the foot, (2,), m, and what loads do to it, (2, n)."""
    rows = step.frames
    wrench = fit.plate(step.plate)[rows]
    weight = wrench[:, 1] / wrench[:, 1].sum()

    def locate(change: Array) -> Array:
        """Ground coordinates x and z of the mean pressure, per wrench (n, 6)."""
        return np.array([change[:, 5].sum(), -change[:, 3].sum()]) / float(wrench[:, 1].sum())

    masses = np.array([fit.model.segment(s).mass for s in step.segments])
    share = masses / masses.sum()
    start, middle = (
        np.einsum("n,nsa,s->a", weight, fit.centres(step.segments, along)[rows][..., ::2], share)
        for along in (0.0, 1.0)
    )
    pressure = locate(wrench)
    ahead = (middle - start) / np.linalg.norm(middle - start)
    axes = np.array([ahead, step.outward * np.array([-ahead[1], ahead[0]])])
    moved = np.zeros((2, len(loads)))
    for n, (load, trials) in enumerate(loads):
        here = not trials or fit.name in trials
        if here and isinstance(load, PlateFault) and load.plate == step.plate:
            change = load.column(fit)[rows]
            moved[:, n] = locate(change) - pressure * change[:, 1].sum() / wrench[:, 1].sum()
    return axes @ (pressure - middle), axes @ moved


def _expect(steps: Sequence[tuple[WrenchFit, Step]]) -> Array:
    """Covariance of the steps' numbers, (2 n_steps, 2 n_steps), m2."""
    trials = np.array([fit.name for fit, _ in steps])
    feet = np.array([step.segments[0] for _, step in steps])
    same_trial, same_foot = (x[:, None] == x[None, :] for x in (trials, feet))
    each = np.eye(len(steps))
    found = np.zeros((2 * len(steps), 2 * len(steps)))
    found[::2, ::2] = _FORWARD_M**2 * same_trial + _OF_STEP_M**2 * each
    found[1::2, 1::2] = _OUTWARD_M**2 + _OF_FOOT_M**2 * (same_foot + each)
    cut = np.array([not step.whole for _, step in steps], dtype=float)
    return np.asarray(found + np.diag(np.outer(cut, _CUT_M**2).ravel()))
