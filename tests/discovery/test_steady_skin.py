"""Skin brought to rest, where it carries all the markers of a segment."""

from __future__ import annotations

from functools import cache

import numpy as np
from scipy.interpolate import make_interp_spline
from scipy.signal import lsim

from scaling_service.capabilities.discovery.laws.candidates import Estimate
from scaling_service.capabilities.discovery.laws.steady_skin import find_oscillating_markers, track_steady
from scaling_service.capabilities.discovery.observations.tracked import TrackedTrial
from scaling_service.model.trial import Trial
from scaling_service.numerics.multibody.laws import Array
from tests.discovery.hidden import choice, person

THIGH = ("LLFE", "LMFE")
FREQUENCY_HZ, DAMPING = 4.5, 0.1


def lagging(times: Array, path: Array) -> Array:
    """How far a spring and damper lag behind a path (n, 3) that shakes them, by scipy's own integration.

    They are first where a steady shaking would hold them.
    """
    shaking = make_interp_spline(times, path, k=5).derivative(2)(times)
    w = 2.0 * np.pi * FREQUENCY_HZ
    system = ([[0.0, 1.0], [-w * w, -2.0 * DAMPING * w]], [[0.0], [-1.0]], [[1.0, 0.0]], [[0.0]])
    first = -shaking[0] / w**2
    return np.stack([lsim(system, shaking[:, k], times, [first[k], 0.0])[1] for k in range(3)], axis=1)


@cache
def walk() -> TrackedTrial:
    """A walk without anything wrong, as it was."""
    return TrackedTrial.of(person().model, person().trials["gait_1"], "fit")


def knee(item: TrackedTrial) -> Array:
    """The bone under the thigh's markers, (n, 2, 3), m, ground."""
    return item.places[:, [item.markers.index(name) for name in THIGH]]


def shaken() -> Trial:
    """The same with skin that swings under them."""
    trial, bones = walk().trial, knee(walk())
    markers = trial.markers.copy()
    for k, name in enumerate(THIGH):
        markers[:, trial.index(name)] += lagging(trial.times, bones[:, k])
    return trial.with_markers(markers)


def swing(share: float) -> Estimate:
    """What is there, or more or less of it."""
    found = next(c for c in choice() if c.where == THIGH and c.oscillation == (FREQUENCY_HZ, DAMPING))
    return Estimate(found, np.array([share]))


def away(item: TrackedTrial) -> float:
    """How far the thigh is from where it was, RMS, m."""
    return float(np.sqrt(np.mean((knee(item) - knee(walk())) ** 2)))


def test_the_motion_is_found_under_skin_that_carries_it() -> None:
    trial, rounds = shaken(), []

    def follow(changed: Trial, near: TrackedTrial) -> TrackedTrial:
        rounds.append(changed)
        return TrackedTrial.of(person().model, changed, "fit", near)

    begun = TrackedTrial.of(person().model, trial, "fit")
    found = track_steady(trial, begun, [swing(1.0)], follow)
    assert away(begun) > 0.003
    assert away(found) < 0.0002
    assert len(rounds) < 10


def test_only_the_markers_whose_skin_swings_are_moved() -> None:
    trial, moved = shaken(), []

    def follow(changed: Trial, near: TrackedTrial) -> TrackedTrial:
        moved.append(np.abs(changed.markers - trial.markers).max(axis=(0, 2)))
        return near

    track_steady(trial, walk(), [swing(0.5)], follow)
    still = [k for k, name in enumerate(trial.labels) if name not in THIGH]
    assert find_oscillating_markers(trial, [swing(0.5)]) == tuple(sorted(THIGH, key=trial.index))
    assert all(np.nanmax(each[still]) == 0.0 for each in moved)
    assert float(np.min(moved[0][[trial.index(name) for name in THIGH]])) > 0.001


def test_a_recording_without_the_marker_is_followed_as_it_is() -> None:
    trial = shaken().select([label for label in shaken().labels if label not in THIGH])
    item = TrackedTrial.of(person().model, trial, "fit")
    followed: list[Trial] = []

    def follow(changed: Trial, near: TrackedTrial) -> TrackedTrial:
        followed.append(changed)
        return near

    assert find_oscillating_markers(trial, [swing(1.0)]) == ()
    assert track_steady(trial, item, [swing(1.0)], follow) is item
    assert followed == [trial]
