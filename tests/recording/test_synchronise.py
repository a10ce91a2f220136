"""Forces on the markers' clock against signals that are known at every time."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from scaling_service.core.arrays import Array
from scaling_service.core.errors import InputError, TrialUnusable
from scaling_service.model.forces import GroundForces
from scaling_service.numerics.signals.filters import filter_butterworth
from scaling_service.recording.plates import synchronise


def made(times: Array) -> GroundForces:
    """Two plates with slow sines."""
    wave = 400 + 300 * np.sin(2 * np.pi * 1.3 * times)
    force = np.zeros((len(times), 2, 3))
    force[:, 0, 1], force[:, 1, 1] = wave, 800 - wave
    return GroundForces(
        name="made",
        times=times,
        plates=("plate_1", "plate_2"),
        force=force,
        moment=np.cross([0.1, 0.0, 0.2], force),
        surfaces=np.zeros((2, 3)),
        normals=np.tile([0.0, 1.0, 0.0], (2, 1)),
    )


def wave(times: Array) -> Array:
    return np.asarray(400 + 300 * np.sin(2 * np.pi * 1.3 * times))


def test_thousand_samples_become_a_hundred_frames() -> None:
    frames = np.arange(5, 195) / 100
    found = synchronise(made(np.arange(2000) / 1000), frames)
    np.testing.assert_allclose(found.force[:, 0, 1], wave(frames), atol=1e-9)
    found = synchronise(made(np.arange(2000) / 1000), frames, cutoff_hz=20.0)
    np.testing.assert_allclose(found.force[20:-20, 0, 1], wave(frames)[20:-20], atol=0.02)
    np.testing.assert_allclose(found.centre_of_pressure()[:, 0, [0, 2]], [[0.1, 0.2]] * 190, atol=1e-9)


def test_the_filter_is_that_of_the_motion() -> None:
    times = np.arange(300) / 100
    noisy = made(times)
    noise = np.random.default_rng(0).normal(size=noisy.force.shape)
    noisy = replace(noisy, force=noisy.force + noise)
    found = synchronise(noisy, times, cutoff_hz=6.0)
    same = filter_butterworth(noisy.force, rate_hz=100.0, cutoff_hz=6.0, order=4).values
    np.testing.assert_allclose(found.force, same, atol=1e-9)


def test_rounded_times_stand_for_a_regular_clock_and_others_are_interpolated() -> None:
    times = np.arange(600) / 600
    frames = np.arange(2, 58) / 60
    found = synchronise(replace(made(times), times=np.round(times, 4)), frames)
    np.testing.assert_allclose(found.force[:, 0, 1], wave(frames), atol=0.2)
    uneven = times + 0.4 / 600 * np.sin(np.arange(600.0))
    uneven[[0, -1]] = times[[0, -1]]
    found = synchronise(made(uneven), frames)
    np.testing.assert_allclose(found.force[:, 0, 1], wave(frames), atol=0.2)
    assert "clock" in [r.what for r in found.repairs]


@pytest.mark.parametrize("cutoff_hz", [None, 6.0])
def test_a_missing_sample_spoils_its_own_plate_and_time(cutoff_hz: float | None) -> None:
    forces = made(np.arange(2000) / 1000)
    force = forces.force.copy()
    force[1000, 0, 2] = np.nan
    frames = np.arange(200) / 100
    found = synchronise(replace(forces, force=force), frames, cutoff_hz=cutoff_hz)
    lost = np.isnan(found.force[:, 0]).any(axis=1)
    assert np.flatnonzero(lost).tolist() == [100]
    assert np.isfinite(found.force[:, 1]).all()


def test_frames_outside_the_forces_are_unknown_and_counted() -> None:
    found = synchronise(made(np.arange(1000) / 1000), np.arange(200) / 100)
    assert np.isnan(found.force[101:]).all()
    assert [r.frames for r in found.repairs if r.what == "not_recorded"] == [100]


def test_clocks_that_do_not_meet_and_cutoffs_that_do_not_suit_are_refused() -> None:
    with pytest.raises(
        TrialUnusable, match=r"forces from 0 to 0\.999 s and markers from 5 to 6 s do not overlap"
    ):
        synchronise(made(np.arange(1000) / 1000), np.linspace(5, 6, 100))
    with pytest.raises(InputError, match="60 Hz does not suit forces of 100 Hz"):
        synchronise(made(np.arange(100) / 100), np.arange(50) / 50, cutoff_hz=60.0)


def test_what_was_read_passes_the_same_filter() -> None:
    """Exports hold zeros where a plate is not loaded: a bias of readings alone stays one, filtered."""
    times = np.arange(2000) / 1000
    given = made(times)
    off = (times > 0.8) & (times < 1.3)
    given.force[off, 0], given.moment[off, 0] = 0.0, 0.0
    biased = replace(given, force=given.force + 30.0 * given.readings[..., None])
    frames = np.arange(5, 195) / 100
    true, found = (synchronise(g, frames, cutoff_hz=15.0) for g in (given, biased))
    assert true.read is not None
    np.testing.assert_allclose(found.force - true.force, 30.0 * true.read[..., None] + np.zeros(3), atol=1e-6)
    np.testing.assert_allclose(true.read[:, 1], 1.0, atol=1e-9)
    np.testing.assert_allclose(true.read[100:115, 0], 0.0, atol=1e-4)


def test_what_was_read_has_one_number_for_each_plate_and_time() -> None:
    given = made(np.arange(50) / 100)
    with pytest.raises(ValueError, match="read"):
        replace(given, read=np.ones(50))
