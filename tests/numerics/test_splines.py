"""Splines of joint angles: exact derivatives, and the banded normal equations against dense ones."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.interpolate import BSpline

from scaling_service.numerics.signals.splines import (
    DEGREE,
    ORDER,
    Quadratic,
    SplineBasis,
    Unknowns,
    add_to_blocks,
    add_to_rows,
    pack_band,
    solve_band,
)

RNG = np.random.default_rng(5)
TIMES = np.arange(160) / 100.0


def test_velocities_and_accelerations_are_exact_derivatives() -> None:
    basis = SplineBasis(TIMES, 0.1)
    coefficients = RNG.normal(size=(basis.n_coefficients, 3))
    value, first, second = basis.evaluate(coefficients)
    for column in range(3):
        spline = BSpline(basis.knots, coefficients[:, column], DEGREE)
        for order, found in enumerate((value, first, second)):
            expected = spline(TIMES, nu=order)
            assert np.abs(found[:, column] - expected).max() <= 1e-8 * np.abs(expected).max()


def test_polynomials_of_the_degree_are_their_own_splines() -> None:
    basis = SplineBasis(TIMES, 0.1)
    polynomial = np.polynomial.Polynomial(RNG.normal(size=DEGREE + 1))
    found = basis.evaluate(basis.fit(polynomial(TIMES)[:, None]))
    for order, values in enumerate(found):
        np.testing.assert_allclose(
            values[:, 0], polynomial.deriv(order)(TIMES) if order else polynomial(TIMES), atol=1e-5
        )


def test_unknown_samples_count_for_nothing() -> None:
    basis = SplineBasis(TIMES, 0.1)
    signal = np.column_stack([np.sin(3 * TIMES), np.cos(2 * TIMES)])
    gappy = signal.copy()
    gappy[40:60, 0] = np.nan
    found = basis.evaluate(basis.fit(gappy))[0]
    known = np.isfinite(gappy[:, 0])
    assert np.abs(found[known, 0] - signal[known, 0]).max() < 1e-4
    np.testing.assert_allclose(found[:, 1], basis.evaluate(basis.fit(signal))[0][:, 1], atol=1e-12)


def test_too_few_times_are_refused() -> None:
    with pytest.raises(ValueError, match="increasing times"):
        SplineBasis(TIMES[: ORDER - 1], 0.1)


def _dense_rows(basis: SplineBasis) -> np.ndarray:
    """Values and derivatives of every basis function at every time, (n, 3, n_coefficients)."""
    return np.stack([basis.evaluate(np.eye(basis.n_coefficients))[k] for k in range(3)], axis=1)


def test_bands_hold_the_dense_normal_matrix_and_its_solution() -> None:
    basis, m, k = SplineBasis(TIMES, 0.13), 3, 2
    n, count = len(TIMES), basis.n_coefficients
    jacobian = RNG.normal(size=(n, 4, 3, m))
    curvature = np.einsum("nric,nrjd->nijcd", jacobian, jacobian)
    slope, coupling = RNG.normal(size=(n, 3, m)), RNG.normal(size=(n, 3, m, k))
    blocks, gradient = np.zeros((ORDER, count, m, m)), np.zeros((count, m))
    border = np.zeros((count, m, k))
    for rows in (slice(0, 70), slice(70, n)):
        add_to_blocks(basis, rows, blocks, curvature[rows])
        add_to_rows(basis, rows, gradient, slope[rows])
        add_to_rows(basis, rows, border, coupling[rows])
    design = _dense_rows(basis)
    dense = np.einsum("nia,nijcd,njb->acbd", design, curvature, design).reshape(count * m, -1)
    np.testing.assert_allclose(
        gradient, np.einsum("nia,nic->ac", design, slope), atol=1e-9 * np.abs(dense).max()
    )
    np.testing.assert_allclose(border, np.einsum("nia,nick->ack", design, coupling), rtol=1e-9, atol=1e-8)
    corner = 1e3 * np.eye(k)
    quadratic = Quadratic(
        value=2.0,
        gradient=gradient,
        blocks=blocks,
        shared_gradient=RNG.normal(size=k),
        border=border,
        corner=corner,
    )
    step = RNG.normal(size=(count, m))
    np.testing.assert_allclose(quadratic.times(step).ravel(), dense @ step.ravel(), rtol=1e-9, atol=1e-6)
    x = RNG.normal(size=k)
    whole = np.block([[dense, border.reshape(-1, k)], [border.reshape(-1, k).T, corner]])
    both = np.concatenate([step.ravel(), x])
    linear = np.concatenate([gradient.ravel(), quadratic.shared_gradient])
    assert quadratic.at(Unknowns(step, x)) == pytest.approx(2.0 + 2 * linear @ both + both @ whole @ both)
    held = RNG.random(count * m) < 0.2
    found = solve_band(pack_band(blocks), gradient.reshape(-1, 1), held)[:, 0]
    free = ~held
    expected = np.linalg.solve(dense[np.ix_(free, free)], gradient.ravel()[free])
    assert (found[held] == 0).all()
    np.testing.assert_allclose(found[free], expected, rtol=1e-6, atol=1e-12)
