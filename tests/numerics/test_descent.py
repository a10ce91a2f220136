"""The iteration: rows do not disturb each other; damping, acceptance and ends are as told."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
import pytest
from numpy.typing import NDArray

from scaling_service.numerics.least_squares.descent import Damping, Descent, Rows, Settings, descend
from tests.numerics.bodies import Array

RULE = Damping(ease=0.1, tighten=10.0, failed=1e-3, lost=1e8)
SETTINGS = Settings(max_steps=200, damping=1e-3, rule=RULE, left=1e-14, left_over=1e-28)


@dataclass(eq=False)
class Valleys:
    """Rosenbrock's valleys ``(a (y - x^2))^2 + (1 - x)^2``, one of another steepness in every row."""

    steep: Array
    dampings: list[Array] = field(default_factory=list)
    measured: list[int] = field(default_factory=list)

    def measure(self, x: Array) -> tuple[Array, Array, None]:
        self.measured.append(len(x))
        return x, np.square(self.residuals(x)).sum(axis=1), None

    def residuals(self, x: Array) -> Array:
        return np.stack([self.steep * (x[:, 1] - x[:, 0] ** 2), 1.0 - x[:, 0]], axis=1)

    def step(self, x: Array, _: None, rows: Rows) -> tuple[Array, Array]:
        self.dampings.append(rows.damping)
        jacobian = np.zeros((len(x), 2, 2))
        jacobian[:, 0, 0], jacobian[:, 0, 1] = -2.0 * self.steep * x[:, 0], self.steep
        jacobian[:, 1, 0] = -1.0
        normal = jacobian.transpose(0, 2, 1) @ jacobian
        slope = -np.einsum("nij,ni->nj", jacobian, self.residuals(x))
        np.einsum("nii->ni", normal)[...] *= 1.0 + rows.damping[:, None]
        step = np.linalg.solve(normal, slope[:, :, None])[:, :, 0]
        after = self.residuals(x) + np.einsum("nij,nj->ni", jacobian, step)
        return x + step, rows.cost - np.square(after).sum(axis=1)

    def take(self, rows: NDArray[np.intp]) -> Valleys:
        return Valleys(self.steep[rows], self.dampings, self.measured)


STEEP = np.array([1.0, 3.0, 10.0, 30.0])
START = np.array([[-1.2, 1.0], [0.5, 2.0], [-2.0, -1.0], [3.0, 0.0]])


@pytest.mark.parametrize("halvings", [0, 1, 4])
@pytest.mark.parametrize("by_gain", [False, True])
@pytest.mark.parametrize("extrapolate", [False, True])
def test_every_row_comes_to_its_minimum(halvings: int, by_gain: bool, extrapolate: bool) -> None:
    how = replace(SETTINGS, halvings=halvings, rule=replace(RULE, by_gain=by_gain), extrapolate=extrapolate)
    found = descend(Valleys(STEEP), START, how)
    assert found.converged.all()
    np.testing.assert_allclose(found.x, 1.0, atol=1e-6)
    np.testing.assert_allclose(found.cost, 0.0, atol=1e-12)


def test_rows_end_by_themselves_and_where_they_do_alone() -> None:
    task = Valleys(STEEP)
    together = descend(task, START, SETTINGS)
    assert len(set(together.steps.tolist())) > 1
    assert task.measured == sorted(task.measured, reverse=True), "rows that have converged are not measured"
    for k in range(4):
        alone = descend(Valleys(STEEP[k : k + 1]), START[k : k + 1], SETTINGS)
        np.testing.assert_array_equal(alone.x[0], together.x[k])
        assert alone.steps[0] == together.steps[k]


def test_the_cost_never_rises_and_a_failure_tightens_the_damping() -> None:
    task, told = Valleys(STEEP[3:]), list[tuple[int, float]]()
    found = descend(task, START[3:], SETTINGS, progress=lambda number, cost: told.append((number, cost)))
    costs = [cost for _, cost in told]
    assert costs == sorted(costs, reverse=True)
    changes = np.diff(np.log10(np.concatenate(task.dampings)))
    assert (np.isclose(changes, -1.0) | (changes >= 1.0 - 1e-9)).all()
    failures = int((changes > 0.0).sum())
    assert 0 < failures == found.steps[0] - 1 - len(told), "what is told of are the other steps"


def run(steps: int, **how: bool) -> Descent:
    return descend(Valleys(STEEP), START, replace(SETTINGS, max_steps=steps, **how))


def test_who_runs_out_of_steps_has_not_converged_and_its_last_step_is_checked_or_left_out() -> None:
    for checked, moves in ((False, 0), (True, 1)):
        found = run(1, checked=checked)
        assert not found.converged.any()
        moved = (found.x != START).any(axis=1)
        assert moved.any() == bool(moves)
        np.testing.assert_array_equal(found.cost, Valleys(STEEP).measure(found.x)[1])
    np.testing.assert_array_equal(run(0).x, START)


def test_a_quorum_ends_it() -> None:
    whole, half = (
        descend(Valleys(STEEP), START, SETTINGS),
        descend(Valleys(STEEP), START, replace(SETTINGS, quorum=0.5)),
    )
    assert half.converged.sum() == 2
    np.testing.assert_array_equal(half.x[half.converged], whole.x[half.converged])
    assert half.steps.max() < whole.steps.max()


def test_a_row_that_nothing_helps_is_given_up_where_it_was() -> None:
    class Wall(Valleys):
        def measure(self, x: Array) -> tuple[Array, Array, None]:
            costs = super().measure(x)[1]
            return x, np.where((x == START).all(axis=1), costs, np.nan), None

    found = descend(Wall(STEEP), START, SETTINGS)
    np.testing.assert_array_equal(found.x, START)
    assert np.isfinite(found.cost).all()


def test_rows_judged_alike_do_not_chase_a_share_of_next_to_nothing() -> None:
    class Raised(Valleys):
        """The first row's cost has a floor of one."""

        def measure(self, x: Array) -> tuple[Array, Array, None]:
            return x, super().measure(x)[1] + (self.steep == STEEP[0]), None

    how = replace(SETTINGS, left=1e-4, left_over=0.0)
    alike, each = (descend(Raised(STEEP), START, replace(how, alike=by)) for by in (True, False))
    assert (alike.steps <= each.steps).all()
    assert (alike.steps[1:] < each.steps[1:]).all()
