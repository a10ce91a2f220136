"""The residual indicator against Muller's formula, and the gates on residuals that are known."""

from __future__ import annotations

import numpy as np
import pytest

from scaling_service.capabilities.kinetics.inverse_dynamics import (
    InverseDynamics,
    RatedMotion,
    compute_residual_indicator,
    evaluate_residuals,
)
from scaling_service.core.errors import InputError, TrialUnusable


def known(residual: np.ndarray, external: float = 800.0) -> InverseDynamics:
    n = len(residual)
    net = np.zeros((n, 6))
    net[:, 1] = external
    empty = np.zeros((n, 1))
    centre = np.tile([0.0, 1.0, 0.0], (n, 1))
    motion = RatedMotion(np.arange(n) / 100, empty, empty, empty)
    return InverseDynamics(
        trial="walk",
        coordinates=("a",),
        motion=motion,
        forces=empty,
        residual=residual,
        root=0 * centre,
        centre_of_mass=centre,
        external=net,
        mass=80.0,
    )


def test_the_indicator_is_equation_7() -> None:
    rng = np.random.default_rng(0)
    residual = rng.normal(size=(50, 6))
    expected = [
        np.sqrt(sum(f * f for f in residual[:, k]) / 50) / (80 * 9.80665) / (1 if k < 3 else 1.8)
        for k in range(6)
    ]
    np.testing.assert_allclose(compute_residual_indicator(residual, 80.0, 1.8), expected, rtol=1e-12)


def test_samples_are_judged_together_as_one_by_one_and_missing_frames_left_out() -> None:
    rng = np.random.default_rng(1)
    residual = rng.normal(size=(4, 30, 6))
    residual[2, 7, 3] = np.nan
    together = compute_residual_indicator(residual, 70.0, 1.7)
    alone = compute_residual_indicator(np.delete(residual[2], 7, axis=0), 70.0, 1.7)
    np.testing.assert_allclose(together[2], alone, rtol=1e-12)
    assert np.isnan(compute_residual_indicator(np.full((3, 6), np.nan), 70.0, 1.7)).all()


def test_gates_compare_with_the_net_external_force() -> None:
    residual = np.zeros((10, 6))
    residual[:, 0] = 20.0
    residual[0, 0] = 50.0  # peak over 5 % of 800 N, RMS below
    residual[:, 4] = 7.0  # below 1 % of 800 N at 1 m
    gates = {(g.name, g.source): g for g in evaluate_residuals(known(residual), 1.8).gates}
    assert gates["peak force", "Hicks 2015"].limit == pytest.approx(40.0)
    assert not gates["peak force", "Hicks 2015"].passed
    assert gates["RMS force", "Hicks 2015"].passed
    assert gates["peak moment", "Hicks 2015"].limit == pytest.approx(8.0)
    assert gates["peak moment", "Hicks 2015"].passed
    assert gates["RMS force", "OpenSim checklist"].value == pytest.approx(np.sqrt((50**2 + 9 * 400) / 10))
    assert not gates["RMS force", "OpenSim checklist"].passed


def test_frames_are_counted_and_none_is_an_error() -> None:
    residual = np.ones((10, 6))
    residual[3] = np.nan
    some = np.arange(10) < 5
    found = evaluate_residuals(known(residual), 1.8, frames=some)
    assert (found.frames, found.left_out) == (4, 6)
    np.testing.assert_allclose(found.rms, 1.0)
    with pytest.raises(TrialUnusable, match="no frame has both a motion and all its forces"):
        evaluate_residuals(known(residual), 1.8, frames=~some & some)


@pytest.mark.parametrize(("mass", "height"), [(0.0, 1.8), (-3.0, 1.8), (70.0, 180.0), (70.0, 0.0)])
def test_a_mass_or_height_that_is_no_persons_is_refused(mass: float, height: float) -> None:
    with pytest.raises(InputError, match=r"subject\.(mass_kg|height_m)"):
        compute_residual_indicator(np.ones((3, 6)), mass, height)
