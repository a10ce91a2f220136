"""Joint values from coordinates and parameters."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.interpolate import CubicSpline, PPoly

from scaling_service.numerics.multibody.laws import NONE, Factor, Piecewise, TermArrays, Values, group_shapes


def curve(seed: int) -> PPoly:
    rng = np.random.default_rng(seed)
    return CubicSpline(np.sort(rng.uniform(-2.0, 2.0, 6)), rng.normal(size=6))


@given(seed=st.integers(0, 50), share=st.floats(0.0, 1.0))
def test_a_piecewise_polynomial_equals_scipys_inside_its_breaks(seed: int, share: float) -> None:
    oracle = curve(seed)
    x = np.array([oracle.x[0] + share * (oracle.x[-1] - oracle.x[0])])
    value, slope = Piecewise(oracle.x, oracle.c).evaluate(x)
    scale = 1.0 + np.abs(oracle.c).max()
    np.testing.assert_allclose(value, oracle(x), atol=1e-12 * scale)
    np.testing.assert_allclose(slope, oracle(x, 1), atol=1e-10 * scale)


@given(seed=st.integers(0, 50), beyond=st.floats(0.0, 10.0))
def test_it_continues_along_its_tangent_outside(seed: int, beyond: float) -> None:
    oracle = curve(seed)
    for end, side in ((oracle.x[0], -1.0), (oracle.x[-1], 1.0)):
        value, slope = Piecewise(oracle.x, oracle.c).evaluate(np.array([end + side * beyond]))
        scale = 1.0 + np.abs(oracle.c).max()
        tangent = float(oracle(end, 1))
        assert slope[0] == pytest.approx(tangent, abs=1e-9 * scale)
        assert value[0] == pytest.approx(float(oracle(end)) + tangent * side * beyond, abs=1e-8 * scale)


def test_a_law_sums_its_terms() -> None:
    q = np.array([[0.5, -1.0], [3.0, 4.0]])
    square = Piecewise(np.array([-5.0, 5.0]), np.array([[1.0], [-10.0], [25.0]]))  # (x + 5 - 5)^2
    factors = (Factor((0,)), Factor((0,), square), Factor((1,)))
    values = Values.of(factors, group_shapes(factors), q, np.array([2.0, 10.0]))
    terms = (
        TermArrays(np.array([1.5]), NONE, 0),
        TermArrays(np.array([1.0]), 0, 1),
        TermArrays(np.array([0.1]), 1, 2),
        TermArrays(np.array([7.0]), 0, NONE),
    )
    expected = 0.25 + 1.5 * q[0] + 2.0 * q[0] ** 2 + 0.1 * 10.0 * q[1] + 14.0
    found = 0.25 + sum(float(term.gain[0]) * values.scalar(term) for term in terms)
    np.testing.assert_allclose(found, expected, rtol=1e-14)
    np.testing.assert_allclose(values.by_coordinate(terms[1]), 2.0 * 2.0 * q[0], rtol=1e-14)
    np.testing.assert_allclose(values.by_parameter(terms[2]), q[1], rtol=1e-14)
