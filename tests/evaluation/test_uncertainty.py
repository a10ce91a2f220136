"""Muller's uncertainty in closed form against samples drawn as the paper draws them, and the verdict."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from scaling_service.capabilities.dynamics.uncertainty.linear import (
    UNIFORM_RANGE,
    fit_slopes_through_zero,
)
from scaling_service.capabilities.dynamics.uncertainty.markers import choose_frames, propagate_marker_errors
from scaling_service.capabilities.dynamics.uncertainty.plates import PlateNoise
from scaling_service.capabilities.dynamics.uncertainty.reference import Reference
from scaling_service.capabilities.dynamics.uncertainty.total import (
    describe_verdict,
    is_inertia_dominant,
    propagate,
)
from scaling_service.core.errors import InputError
from scaling_service.studies.muller2017.monte_carlo import (
    MotionDatabase,
    SampledUncertainty,
    UncertaintySettings,
    draw_levels,
    propagate_by_samples,
)
from tests.evaluation.uncertain import recording

FEW = UncertaintySettings(samples=40, motions=200, seed=3)


@pytest.fixture(scope="module")
def found() -> SampledUncertainty:
    return propagate_by_samples(recording(), FEW)


def test_the_closed_form_gives_what_is_sampled(found: SampledUncertainty) -> None:
    linear = propagate(recording())
    # 40 draws per level: a standard deviation is known to 11 %, a slope over five levels to some 6 %
    np.testing.assert_allclose(linear.slopes_per_cm, found.slopes_per_cm, rtol=0.2)
    np.testing.assert_allclose(linear.plate, found.plate, rtol=0.4)  # three standard errors of 40 draws
    assert linear.reconstruction_error_m == pytest.approx(found.reconstruction_error_m)
    np.testing.assert_allclose(linear.dr, found.dr)
    assert linear.frames == found.frames
    np.testing.assert_allclose(linear.total, linear.kinematic + linear.plate, rtol=1e-12)


def test_the_sum_of_equation_12_and_its_lines(found: SampledUncertainty) -> None:
    centimetres = 100 * found.reconstruction_error_m
    np.testing.assert_allclose(found.total, centimetres * found.slopes_per_cm + found.plate, rtol=1e-12)
    assert (found.r2 >= 0.96).all()
    assert (found.r2_centred <= found.r2).all()
    assert (found.plate < 1e-3 * found.kinematic).all()
    added = np.array([level.added_m for level in found.levels])
    np.testing.assert_allclose(added, np.array([0.2, 0.4, 0.6, 0.8, 1.0]) * found.reconstruction_error_m)
    np.testing.assert_array_equal(found.calibration_supported, found.dr > found.total)


def test_plates_shift_the_mean_residual_by_the_root_of_the_frames() -> None:
    """A residual that is nearly constant: its RMS varies by the noise's sigma over the root of n."""
    given = recording()
    push = given.loads.force.copy()
    push[..., 0] += 200.0
    noise = PlateNoise(share=0.0, least_n=30.0, centre_m=0.0)
    pushed = replace(given, loads=replace(given.loads, force=push))
    found = propagate(pushed, plates=noise)
    reference = Reference.of(pushed)
    loaded = (given.loads.force[reference.used, :, 1] > 20.0).sum()
    sigma = 10.0 * np.sqrt(loaded) / reference.used.sum() / reference.scale[0]
    assert found.plate[0] == pytest.approx(3 * sigma, rel=0.05)


def test_plates_noise_is_what_is_sampled() -> None:
    """Of forces and of pressure, also where the noise is as large as the residual."""
    noise = PlateNoise(share=0.02, least_n=20.0, centre_m=0.02)
    settings = replace(FEW, samples=1000, motions=4, levels=(0.5, 1.0), plates=noise)
    closed = propagate(recording(), plates=noise).plate
    # 1,000 draws: a standard deviation is known to 2.2 %
    np.testing.assert_allclose(closed, propagate_by_samples(recording(), settings).plate, rtol=0.08)


def test_a_level_is_uniform_and_its_dispersion_a_range() -> None:
    """An indicator that is the error itself is dispersed by the level's own width."""
    errors = np.linspace(0.01, 0.021, 5000)
    database = MotionDatabase(
        error_m=0.01,
        dr=np.zeros(6),
        sizes=errors,
        errors_m=errors,
        indicators=np.tile(errors[:, None], (1, 6)),
    )
    levels = draw_levels(database, (0.5, 1.0), 4000, 0)
    for level, width in zip(levels, (0.005, 0.01), strict=True):
        np.testing.assert_allclose(level.dispersion, width, rtol=0.03)
    assert pytest.approx(np.sqrt(12)) == UNIFORM_RANGE


def test_slopes_are_least_squares_through_zero() -> None:
    rng = np.random.default_rng(0)
    x, y = np.arange(1.0, 6.0), rng.normal(size=(5, 6)) + 3
    slopes, r2, _ = fit_slopes_through_zero(x, y)
    for k in range(6):
        expected, left, _, _ = np.linalg.lstsq(x[:, None], y[:, k], rcond=None)
        assert slopes[k] == pytest.approx(expected[0])
        assert r2[k] == pytest.approx(1 - left[0] / (y[:, k] @ y[:, k]))


def test_markers_blame_inertia_where_its_variance_is_the_larger() -> None:
    rng = np.random.default_rng(0)
    measurement = rng.normal(size=(100_000, 2))
    inertial = rng.normal(size=(100_000, 2)) * [1.1, 0.9]
    dr = np.sqrt(((measurement + inertial) ** 2).mean(axis=0))
    assert is_inertia_dominant(dr, np.ones(2)).tolist() == [True, False]


def test_verdicts_say_what_stands_above() -> None:
    high, low = np.full(6, 0.1), np.full(6, 0.01)
    assert "cannot calibrate" in describe_verdict(low, high)
    assert "at hand are acceptable" in describe_verdict(low, high)
    assert "in every component the residual stands above" in describe_verdict(high, low)
    assert "at hand leave more" in describe_verdict(high, low)
    mixed = describe_verdict(np.array([0.1, 0.01, 0.01, 0.1, 0.01, 0.01]), np.full(6, 0.05))
    assert mixed.startswith("Only fx, mx can calibrate")


def test_markers_known_to_be_exact_bring_nothing_and_errors_scale() -> None:
    given = recording()
    names = given.motion.markers
    once = propagate_marker_errors(given, sd_m=dict.fromkeys(names, 0.001), shared=0.0)
    twice = propagate_marker_errors(given, sd_m=dict.fromkeys(names, 0.002), shared=0.0)
    np.testing.assert_allclose(twice.sd, 2 * once.sd, rtol=1e-9)
    alone = propagate_marker_errors(given, sd_m=dict.fromkeys(names, 0.0) | {"RLFE": 0.001}, shared=0.0)
    np.testing.assert_allclose(alone.shares[names.index("RLFE")], 1.0)


def test_markers_of_light_distal_segments_carry_least() -> None:
    """Muller et al. 2017 expect it (sec. 3.3): a hand's marker hardly matters, a trunk's does."""
    given = recording()
    names = list(given.motion.markers)
    found = propagate_marker_errors(given, sd_m=dict.fromkeys(names, 0.002), shared=0.0)
    horizontal = found.shares[:, [0, 2]].mean(axis=1)
    hands = [horizontal[names.index(n)] for n in ("RMH2", "RMH5", "LMH2", "LMH5")]
    trunk = [horizontal[names.index(n)] for n in ("C7", "T10", "CLAV", "STRN")]
    assert max(hands) < min(trunk)


def test_windows_are_taken_by_what_they_add() -> None:
    given = recording()
    noise = propagate_marker_errors(given)
    choice = choose_frames(given, noise, window_s=1.0, count=3)
    gains = [w.gain for w in choice.windows]
    assert gains == sorted(gains, reverse=True)
    everything = choose_frames(given, noise, window_s=1.0, count=100)
    assert everything.share == pytest.approx(1.0)
    assert 3 / 8 < choice.share < 1.0
    with pytest.raises(InputError, match="windows"):
        choose_frames(given, noise, window_s=0.01)


def test_nonsense_is_refused() -> None:
    with pytest.raises(InputError, match="samples"):
        UncertaintySettings(samples=1)
    with pytest.raises(InputError, match="levels"):
        UncertaintySettings(levels=(1.0, 0.5))
    with pytest.raises(InputError, match="two levels"):
        UncertaintySettings(levels=(1.0,))
    given = recording()
    exact = replace(given.motion, residuals=np.zeros_like(given.motion.residuals))
    still = replace(exact, q=np.repeat(exact.q[:1], len(exact.q), axis=0))
    with pytest.raises(InputError, match="without error"):
        propagate(replace(given, motion=still))
