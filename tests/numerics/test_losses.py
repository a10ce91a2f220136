"""Losses: what a distance costs and what weight it keeps."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from scaling_service.numerics.least_squares.problem import SQUARED, Huber, Loss

LOSSES = [SQUARED, Huber(0.01)]


@pytest.mark.parametrize("loss", LOSSES, ids=lambda loss: type(loss).__name__)
@given(distance=st.floats(1e-4, 1.0))
def test_the_weight_is_the_derivative_of_the_cost(loss: Loss, distance: float) -> None:
    squared = distance**2
    if abs(distance - 0.01) < 1e-5:
        return  # Huber's second derivative jumps there
    step = 1e-5 * squared
    cost = loss.cost(np.array([squared - step, squared + step]))
    assert (cost[1] - cost[0]) / (2 * step) == pytest.approx(loss.weight(np.array([squared]))[0], rel=1e-5)


@pytest.mark.parametrize("loss", LOSSES, ids=lambda loss: type(loss).__name__)
def test_near_zero_every_loss_is_the_square(loss: Loss) -> None:
    squared = np.array([0.0, 1e-10, 1e-9])
    np.testing.assert_allclose(loss.cost(squared), squared, rtol=1e-4)
    np.testing.assert_allclose(loss.weight(squared), 1.0, rtol=1e-4)


@given(distances=st.lists(st.floats(0.0, 10.0), min_size=2, max_size=5).map(sorted))
def test_a_robust_loss_grows_but_trusts_ever_less(distances: list[float]) -> None:
    loss = Huber(0.01)
    squared = np.array(distances) ** 2
    assert (np.diff(loss.cost(squared)) >= 0.0).all()
    assert (np.diff(loss.weight(squared)) <= 0.0).all()
    assert (loss.cost(squared) <= squared * (1 + 1e-12)).all()


def test_huber_is_continuous_at_its_scale_and_linear_beyond() -> None:
    loss = Huber(0.02)
    np.testing.assert_allclose(loss.cost(np.array([0.02**2])), 0.02**2)
    far = loss.cost(np.array([0.1, 0.2, 0.3]) ** 2)
    assert far[1] - far[0] == pytest.approx(far[2] - far[1])
    assert far[1] - far[0] == pytest.approx(2 * 0.02 * 0.1)
