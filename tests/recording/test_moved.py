"""A marker that was knocked between recordings is told, and only there."""

from __future__ import annotations

import numpy as np
import pytest

from scaling_service.model.trial import Trial
from scaling_service.recording.plausibility import find_moved_markers

LABELS = ("HEE", "CPG", "LCA", "STL", "NAV")
FOOT = np.array([[0, 0, 0], [-70, 20, 10], [30, 5, 40], [35, 10, -30], [90, 40, -20]]) / 1000.0
KNOCKED = (30.0, 30.0, 20.0)


def recording(seed: int, moved_mm: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> Trial:
    """A foot that turns and travels, 1 mm of noise; its second marker moved."""
    rng = np.random.default_rng(seed)
    angle = np.linspace(0.0, 1.0, 60)
    turn = np.zeros((60, 3, 3))
    turn[:, 0, 0] = turn[:, 2, 2] = np.cos(angle)
    turn[:, 0, 2], turn[:, 2, 0], turn[:, 1, 1] = np.sin(angle), -np.sin(angle), 1.0
    place = FOOT.copy()
    place[1] += np.array(moved_mm) / 1000.0
    markers = np.einsum("nij,mj->nmi", turn, place) + rng.normal(0.0, 0.001, (60, 5, 3))
    return Trial(name=f"r{seed}", times=angle, labels=LABELS, markers=markers, rate_hz=60.0)


def found(*trials: Trial, labels: tuple[str, ...] = LABELS) -> list[tuple[str, str]]:
    return [(moved.trial, moved.label) for moved in find_moved_markers(trials, {"calcn_l": labels})]


def test_a_knocked_marker_is_found_in_its_recording_alone() -> None:
    assert found(recording(1), recording(2, KNOCKED), recording(3)) == [("r2", "CPG")]


def test_of_two_recordings_the_first_tells() -> None:
    trials = (recording(1), recording(2, KNOCKED))
    assert found(*trials) == [("r1", "CPG")]
    (moved,) = find_moved_markers(trials, {"calcn_l": LABELS})
    assert str(moved).startswith("CPG lies")
    assert "in r2" in str(moved)


@pytest.mark.parametrize("moved_mm", [(0.0, 0.0, 0.0), (0.0, 8.0, 0.0)])
def test_noise_and_skin_are_not_reported(moved_mm: tuple[float, float, float]) -> None:
    assert found(recording(1), recording(2, moved_mm), recording(3)) == []


def test_exchanged_labels_are_not_taken_for_moved_markers() -> None:
    wrong = recording(2)
    exchanged = wrong.markers[:, [1, 0, 2, 3, 4]]
    assert found(recording(1), wrong.with_markers(exchanged), recording(3)) == []


def test_three_markers_do_not_tell_which_of_them_moved() -> None:
    assert found(recording(1), recording(2, KNOCKED), labels=LABELS[:3]) == []
