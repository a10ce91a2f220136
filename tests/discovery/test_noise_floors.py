"""Floors are the noise that was put in, whatever its memory, and no fault of a marker lifts them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

from scaling_service.capabilities.discovery.evidence.fit import Fit, SearchContext, fit_recordings
from scaling_service.capabilities.discovery.evidence.markers import MARKERS
from scaling_service.capabilities.discovery.evidence.noise_floors import measure_noise_floors
from scaling_service.capabilities.discovery.observations.tracked import estimate_marker_noise
from scaling_service.capabilities.discovery.observations.wrench import ContactAssignment, WrenchFit
from scaling_service.capabilities.discovery.search.unexplained import describe_unexplained
from scaling_service.model.trial import Trial
from scaling_service.numerics.multibody.laws import Array
from tests.discovery.hidden import person, recorded
from tests.jobs.test_discover_forces import ground_of

NOISE_M = 1e-3


def tracked(change: Callable[[Trial, np.random.Generator], Array]) -> Fit:
    """The person, seen by perfect cameras, with something added to the markers."""
    rng, clean = np.random.default_rng(3), recorded(person(), person().model, noise_m=0.0)
    seen = [replace(r, trial=replace(r.trial, markers=r.trial.markers + change(r.trial, rng))) for r in clean]
    return fit_recordings(SearchContext(model=person().model, recordings=seen))


def noise(trial: Trial, rng: np.random.Generator, memory: float = 0.0, share: float = 1.0) -> Array:
    """Of :data:`NOISE_M`: a share of its variance first-order autoregressive, the rest white."""
    slow, white = rng.normal(size=(2, len(trial.times) + 200, *trial.markers.shape[1:]))
    slow = lfilter([np.sqrt(1.0 - memory**2)], [1.0, -memory], slow, axis=0)
    return np.asarray(NOISE_M * (np.sqrt(share) * slow + np.sqrt(1.0 - share) * white)[200:])


def floor_and_left(fit: Fit) -> tuple[float, float]:
    """RMS of the markers' floor, and of what noise of that size leaves where the pose follows it, m."""
    floors = measure_noise_floors(fit, fit.scene.moving)
    tally = MARKERS.tally(fit, None, floors["markers"].noise)
    assert tally is not None
    freedom = sum(item.freedom for item in fit.tracked)
    frames = float(tally.frames.sum())
    return float(np.sqrt(tally.floor.sum() / frames)), NOISE_M * float(np.sqrt(freedom / frames))


@pytest.mark.parametrize(("memory", "share"), [(0.0, 1.0), (0.7, 1.0), (0.9, 1.0), (0.9, 0.5)])
def test_noise_that_lasts_is_measured_and_is_no_more(memory: float, share: float) -> None:
    fit = tracked(lambda trial, rng: noise(trial, rng, memory, share))
    found = np.median([item.lasting for item in fit.tracked], axis=0)
    assert found == pytest.approx([memory, share if memory else 0.0], abs=0.1)
    floor, left = floor_and_left(fit)
    assert floor == pytest.approx(left, rel=0.1)
    assert not describe_unexplained(fit, measure_noise_floors(fit, fit.scene.moving))


def test_slow_noise_is_not_cut_where_it_is_larger_by_chance() -> None:
    """In seconds there are few independent numbers of it, so places differ: a fixed bound cut 8 % off."""
    fit = tracked(lambda trial, rng: noise(trial, rng, memory=0.98, share=0.7))
    tally = MARKERS.tally(fit, None, measure_noise_floors(fit, fit.scene.moving)["markers"].noise)
    assert tally is not None
    assert np.sqrt(tally.square.sum() / tally.floor.sum()) == pytest.approx(1.0, abs=0.03)


def test_a_marker_that_flickers_is_unexplained_and_lifts_no_floor() -> None:
    def flickering(trial: Trial, rng: np.random.Generator) -> Array:
        added = noise(trial, rng)
        away = np.repeat(rng.random(len(trial.times) // 3 + 1) < 0.2, 3)[: len(trial.times)]
        added[away, trial.index("RFH")] += np.array([0.0, 0.02, 0.02])
        return added

    fit = tracked(flickering)
    floor, left = floor_and_left(fit)
    assert floor == pytest.approx(left, rel=0.1)
    found = describe_unexplained(fit, measure_noise_floors(fit, fit.scene.moving))
    assert found[0].where == ("RFH",)


def test_a_smoothed_marker_is_not_believed_to_have_no_noise() -> None:
    path = np.random.default_rng(0).normal(size=(500, 5, 3)) * NOISE_M
    path[:, 2] *= 0.01
    path[:, 3] *= 50.0
    np.testing.assert_allclose(estimate_marker_noise(path) / NOISE_M, [1.0, 1.0, 0.5, 2.0, 1.0], rtol=0.15)


def standing_on(plates: int, surfaces: Array) -> WrenchFit:
    """The person, seen by perfect cameras, with the same load on every plate."""
    recording = recorded(person(), person().model, noise_m=0.0)[0]
    n = len(recording.trial.times)
    ground = replace(ground_of([[300.0] * plates] * n), times=recording.trial.times, surfaces=surfaces)
    usable = np.ones(n, dtype=bool)
    given = replace(recording, contacts=ContactAssignment(ground, usable))
    return fit_recordings(SearchContext(model=person().model, recordings=[given])).wrenches[0]


def test_what_plates_forces_are_off_by_is_a_moment_about_the_trunk() -> None:
    """0.5 N and 0.2 N m of a second plate, as the comparison's filter leaves them, drawn and moved.

    What two plates leave beyond one is the second one's; what cameras do is in both. Drifting, each may have
    twice as much.
    """
    surfaces = np.array([[0.3, 0.0, 0.1], [-0.2, 0.0, -0.1]])
    item, one = standing_on(2, surfaces), standing_on(1, surfaces[:1])
    rng, n, draws = np.random.default_rng(0), len(item.times), 100
    square = np.zeros((6, 6))
    for _ in range(draws):
        own = item.filter(rng.normal(size=(n, 6)))
        own *= np.array([0.5] * 3 + [0.2] * 3) / own[item.usable].std()
        own[:, 3:] += np.cross(surfaces[1], own[:, :3])
        moved = item.move_moment(own)[item.usable]
        square += moved.T @ moved / len(moved) / draws
    size = np.sqrt(np.diag(square))
    np.testing.assert_allclose(
        (item.covariance - one.covariance) / np.outer(size, size), square / np.outer(size, size), atol=0.05
    )
    drift = [i.drifting_floor**2 - i.floor**2 for i in (item, one)]
    np.testing.assert_allclose(drift[0] - drift[1], (2.0**2 - 1.0) * size**2, rtol=0.08)
