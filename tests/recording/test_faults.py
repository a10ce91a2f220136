"""Faults of cameras and plates, made by hand in readings that have none."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from scaling_service.core.arrays import Array
from scaling_service.model.forces import GroundForces
from scaling_service.model.trial import Trial
from scaling_service.numerics.signals.filters import filter_butterworth
from scaling_service.recording.faults import (
    leave_out_saturated,
    note_dead_channels,
    note_shaking,
    note_uneven,
    remove_jitter,
    remove_spikes,
    repair_markers,
    separate_merged,
)

RNG = np.random.default_rng(0)


def trial(frames: int = 200) -> Trial:
    """Four markers that swing together, the last two 30 mm apart."""
    t = np.arange(frames) / 100
    body = np.array([[0.0, 0.0, 0.0], [0.2, 0.1, 0.0], [0.1, 0.4, 0.1], [0.1, 0.4, 0.13]])
    way = 0.3 * np.stack([np.sin(3 * t), np.cos(2 * t), t], axis=1)
    noise = 1e-3 * RNG.normal(size=(frames, 4, 3))
    return Trial(
        name="swing", times=t, labels=("A", "B", "C", "D"), markers=body + way[:, None] + noise, rate_hz=100.0
    )


def test_two_markers_seen_as_one_are_not_seen_while_they_are() -> None:
    whole = trial()
    markers = whole.markers.copy()
    markers[:40, :2] = markers[:40, :2].mean(axis=1, keepdims=True)
    markers[120:125, 1] = markers[120:125, 0]
    found = separate_merged(whole.with_markers(markers))
    gone = np.isnan(found.markers).all(axis=2)
    assert np.flatnonzero(gone[:, 0]).tolist() == [*range(40), *range(120, 125)]
    np.testing.assert_array_equal(gone[:, 0], gone[:, 1])
    assert not gone[:, 2:].any()
    assert [(r.what, r.where, r.frames) for r in found.repairs] == [("merged", "A, B", 45)]
    assert found.repairs[0].off == pytest.approx(0.5 * np.hypot(0.2, 0.1), abs=2e-3)


def test_neighbours_and_one_marker_under_two_labels_are_left_alone() -> None:
    whole = trial()
    assert separate_merged(whole) is whole
    twice = replace(
        whole,
        labels=(*whole.labels, "A2"),
        markers=np.concatenate([whole.markers, whole.markers[:, :1]], axis=1),
    )
    assert separate_merged(twice) is twice


def test_a_marker_that_jumps_about_is_not_seen_while_it_does() -> None:
    still = body()
    assert remove_jitter(still) is still
    markers = still.markers.copy()
    markers[100:160, 4] += 0.015 * RNG.normal(size=(60, 3))
    found = remove_jitter(still.with_markers(markers))
    (note,) = found.repairs
    assert (note.what, note.where) == ("jitter", "M4")
    gone = np.isnan(found.markers).any(axis=2)
    assert gone[105:155, 4].mean() > 0.95
    assert not gone[:95].any()
    assert not gone[165:].any()
    every = still.markers.copy()
    every[100:160] += 0.015 * RNG.normal(size=every[100:160].shape)
    assert not remove_jitter(still.with_markers(every)).repairs


def body(seconds: float = 4.0) -> Trial:
    """Twelve markers from head to foot that squat once a second, the lower the less, with 1 mm of noise."""
    t = np.arange(0.0, seconds, 0.01)
    height = np.repeat(np.linspace(0.05, 1.6, 6), 2)
    place = np.stack([0.1 * np.sin(5 * height), height, np.tile([-0.1, 0.1], 6)], axis=1)
    depth = 0.1 * (1 - np.cos(2 * np.pi * t)) * np.exp(0.2 * np.sin(2 * np.pi * t))
    markers = place - depth[:, None, None] * height[:, None] * [0.2, 1.0, 0.0]
    markers = markers + 1e-3 * RNG.normal(size=markers.shape)
    return Trial(
        name="squat", times=t, labels=tuple(f"M{k}" for k in range(12)), markers=markers, rate_hz=100.0
    )


@pytest.mark.parametrize("tilting", [False, True])
def test_cameras_that_shake_move_all_markers_together(tilting: bool) -> None:
    still = body()
    assert note_shaking(still) is still
    wave = 2e-3 * np.sin(2 * np.pi * 9.0 * still.times)[:, None, None] * np.array([0.6, 0.0, 0.8])
    shaken = still.markers + wave * (still.markers[:, :, 1:2] if tilting else 1.0)
    (note,) = note_shaking(still.with_markers(shaken)).repairs
    assert (note.what, note.where) == ("shaking", "all markers")
    assert "at 9.0 Hz by " in note.detail
    alone = still.markers.copy()
    alone[:, 3] += 5.0 * wave[:, 0]
    assert not note_shaking(still.with_markers(alone)).repairs


@pytest.mark.parametrize("rate", [5.0, 10.0, 30.0])
def test_recordings_of_few_frames_a_second_are_left_alone(rate: float) -> None:
    slow = replace(body(), times=body().times * 100.0 / rate, rate_hz=rate)
    assert repair_markers(slow) is slow


@pytest.mark.parametrize("lost", ["shown again", "missing"])
def test_pictures_that_are_shown_again_or_missing_are_no_movement(lost: str) -> None:
    sound = body(4.0)
    walking = sound.with_markers(sound.markers + 1.3 * sound.times[:, None, None] * np.array([1.0, 0.0, 0.0]))
    assert note_uneven(walking) is walking
    frames = np.arange(len(walking.times))
    if lost == "missing":
        frames = np.minimum(frames + 2 * (frames >= 200), frames[-1])
    else:
        frames[200:203] = 199
    (note,) = note_uneven(walking.with_markers(walking.markers[frames])).repairs
    assert (note.what, note.where, note.frames) == ("uneven", "all markers", 1)
    assert note.off == pytest.approx(0.026 if lost == "missing" else 0.039, rel=0.1)


def test_movement_up_to_six_hertz_is_no_shaking() -> None:
    still = body(8.0)
    sway = filter_butterworth(
        RNG.normal(size=(len(still.times), 3)), rate_hz=100.0, cutoff_hz=6.0, order=8
    ).values
    moved = still.with_markers(still.markers + 0.05 * sway[:, None])
    assert note_shaking(moved) is moved


def walked(rate: float = 1000.0) -> GroundForces:
    """Two stances of 0.7 s with two peaks each, one on each plate, with an impact at its start."""
    t = np.arange(int(2 * rate)) / rate
    force = np.zeros((len(t), 2, 3))
    for k, start in enumerate((0.2, 0.9)):
        phase = np.clip((t - start) / 0.7, 0.0, 1.0)
        impact = 250.0 * np.exp(-(((t - start - 0.02) / 0.006) ** 2)) * (t > start)
        force[:, k, 1] = 700 * np.sin(np.pi * phase) + 150 * np.sin(3 * np.pi * phase) + impact
        force[:, k, 0] = -120 * np.sin(2 * np.pi * phase)
        force[:, k, 2] = 40 * np.sin(np.pi * phase) + 20 * np.sin(3 * np.pi * phase)
    force += RNG.normal(size=force.shape)
    up, names = np.tile([0.0, 1.0, 0.0], (2, 1)), ("plate_1", "plate_2")
    moment = np.cross([0.1, 0.0, 0.2], force)
    return GroundForces(
        name="walk", times=t, plates=names, force=force, moment=moment, surfaces=np.zeros((2, 3)), normals=up
    )


@pytest.mark.parametrize("rate", [100.0, 1000.0])
def test_a_walk_with_impacts_has_no_fault(rate: float) -> None:
    sound = walked(rate)
    assert remove_spikes(sound) is sound
    assert not note_dead_channels(sound).repairs
    assert not leave_out_saturated(sound).repairs


@pytest.mark.parametrize("rate", [100.0, 1000.0])
def test_spikes_are_interpolated(rate: float) -> None:
    sound = walked(rate)
    force = sound.force.copy()
    hit = (np.array([0.45, 0.55, 0.70, 1.9]) * rate).astype(int)
    force[hit, 0, 1] += [200.0, -180.0, 300.0, 150.0]
    found = remove_spikes(replace(sound, force=force, moment=np.cross([0.1, 0.0, 0.2], force)))
    assert [(r.what, r.where, r.frames) for r in found.repairs] == [("spikes", "plate_1 fy", len(hit))]
    np.testing.assert_allclose(found.force, sound.force, atol=12.0)
    np.testing.assert_allclose(found.moment, sound.moment, atol=2.0)
    assert found.repairs[0].off == pytest.approx(np.sqrt(np.mean([200**2, 180**2, 300**2, 150**2])), rel=0.05)


def test_a_channel_is_dead_where_another_plate_s_is_not() -> None:
    sound = walked()
    force = sound.force.copy()
    force[:, 1, 2] = RNG.normal(size=len(force))
    (note,) = note_dead_channels(replace(sound, force=force)).repairs
    assert (note.what, note.where) == ("dead_channel", "plate_2 fz")
    force[:, :, 2] = 0.0  # a movement in a plane, or a plate that has no such channel
    assert not note_dead_channels(replace(sound, force=force)).repairs


@pytest.mark.parametrize("share", [0.95, 0.8])
@pytest.mark.parametrize("rate", [100.0, 1000.0])
def test_what_a_plate_bears_at_its_limit_is_not_known(rate: float, share: float) -> None:
    sound = walked(rate)
    clipped = _clipped(sound, share)
    found = leave_out_saturated(clipped)
    (note,) = found.repairs
    cut = sound.pressing[:, 0] > (share + 0.01) * sound.pressing[:, 0].max()
    assert cut.any()
    assert not found.known[cut, 0].any()
    assert found.known[:, 1].all()
    assert found.known[sound.pressing[:, 0] < (share - 0.01) * sound.pressing[:, 0].max(), 0].all()
    assert (note.what, note.where) == ("saturated", "plate_1 fy")
    assert f"{clipped.force[:, 0, 1].max():.0f}"[:2] in note.detail


def _clipped(forces: GroundForces, share: float) -> GroundForces:
    force = forces.force.copy()
    limit = share * force[:, 0, 1].max()
    noise = RNG.normal(size=len(force))
    force[:, 0, 1] = np.where(force[:, 0, 1] > limit, limit + noise, force[:, 0, 1])
    return replace(forces, force=force)


def test_who_stands_still_and_steps_off_saturates_nothing() -> None:
    t: Array = np.arange(4000) / 1000
    sway = 300 + 0.5 * np.sin(2 * np.pi * 0.4 * t) + 0.3 * np.sin(2 * np.pi * 1.1 * t)
    force = np.zeros((len(t), 1, 3))
    force[:, 0, 1] = sway * np.clip((3.5 - t) / 0.4, 0.0, 1.0) + 0.1 * RNG.normal(size=len(t))
    still = GroundForces(
        name="still",
        times=t,
        plates=("plate_1",),
        force=force,
        moment=np.zeros_like(force),
        surfaces=np.zeros((1, 3)),
        normals=np.array([[0.0, 1.0, 0.0]]),
    )
    assert not leave_out_saturated(still).repairs


def test_who_stands_on_one_leg_and_leans_on_something_for_a_while_saturates_nothing() -> None:
    """As an engine makes it: no sway, only noise."""
    t: Array = np.arange(5000) / 1000
    leaning = np.sin(np.pi * np.clip((t - 1.0) / 2.0, 0.0, 1.0)) ** 2
    force = np.zeros((len(t), 1, 3))
    force[:, 0, 1] = 475.0 * (1.0 - 0.2 * leaning) + RNG.normal(size=len(t))
    stood = GroundForces(
        name="hips",
        times=t,
        plates=("plate_1",),
        force=force,
        moment=np.zeros_like(force),
        surfaces=np.zeros((1, 3)),
        normals=np.array([[0.0, 1.0, 0.0]]),
    )
    assert not leave_out_saturated(stood).repairs
