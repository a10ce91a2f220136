"""A position far from the body is no position of a marker on it."""

from __future__ import annotations

import numpy as np
import pytest

from scaling_service.model.trial import Trial
from scaling_service.recording.plausibility import remove_strays


def _body(frames: int = 50, markers: int = 8) -> Trial:
    positions = np.random.default_rng(0).uniform(-0.5, 0.5, (1, markers, 3))
    walk = np.stack((np.linspace(0, 30, frames), np.zeros(frames), np.zeros(frames)), axis=1)[:, None]
    return Trial(
        name="walk",
        times=np.arange(frames) / 100,
        labels=tuple(f"M{k}" for k in range(markers)),
        markers=positions + walk,
        rate_hz=100.0,
    )


@pytest.mark.parametrize("unit", [1.0, 1e3])
def test_a_stray_is_taken_out_and_noted_in_any_unit(unit: float) -> None:
    markers = unit * _body().markers
    markers[10:13, 2] += 50.0 * unit
    cleaned = remove_strays(_body().with_markers(markers))
    assert np.flatnonzero(np.isnan(cleaned.markers).any(axis=(1, 2))).tolist() == [10, 11, 12]
    assert np.isnan(cleaned.markers[10:13, 2]).all()
    assert [(r.what, r.where, r.frames) for r in cleaned.repairs] == [("stray", "M2", 3)]


def test_a_marker_that_is_always_far_away_is_no_part_of_the_body() -> None:
    markers = _body().markers.copy()
    markers[:, 5] += 500.0
    cleaned = remove_strays(_body().with_markers(markers))
    assert np.isnan(cleaned.markers).all(axis=(0, 2)).tolist() == [False] * 5 + [True] + [False] * 2


def test_a_walk_through_a_long_room_has_none_and_stays_the_same() -> None:
    trial = _body()
    assert remove_strays(trial) is trial


def test_gaps_and_too_few_markers_are_left_alone() -> None:
    markers = _body().markers.copy()
    markers[:, 3:] = np.nan
    markers[4, 0] += 1e5
    trial = _body().with_markers(markers)
    assert remove_strays(trial) is trial
