"""Cameras that misread, markers that drift, and what a marker that goes astray carries."""

from __future__ import annotations

import re
from collections.abc import Callable

import numpy as np
import pytest

from scaling_service.capabilities.discovery.evidence.fit import SearchTrial
from scaling_service.capabilities.discovery.search.discover import Discovery, discover
from scaling_service.core.arrays import Array
from scaling_service.model.trial import Trial
from tests.discovery.hidden import person, recorded

Misread = Callable[[Trial], Array]
"""Of a recording, the places (n, m, 3) that are read."""

HIGH_M = 1.0  # of the middle of the volume


def stretch(trial: Trial) -> Array:
    """Heights are read larger by 2 %."""
    return np.asarray(trial.markers * np.array([1.0, 1.02, 1.0]))


def bend(trial: Trial) -> Array:
    """A lens that pushes outwards by 30 mm at a metre."""
    away = trial.markers - np.array([0.0, HIGH_M, 0.0])
    return np.asarray(trial.markers + 0.03 * away * np.square(away).sum(axis=2, keepdims=True))


def read_rows(trial: Trial) -> Array:
    """What is higher is read later, by 20 ms a metre."""
    late = 0.02 * trial.markers[..., 1]
    read = np.empty_like(trial.markers)
    for k in range(trial.markers.shape[1]):
        for axis in range(3):
            read[:, k, axis] = np.interp(trial.times - late[:, k], trial.times, trial.markers[:, k, axis])
    return read


def breathe(trial: Trial) -> Array:
    """The volume swells and shrinks by 2 %, three times in two seconds."""
    return np.asarray(trial.markers * (1.0 + 0.02 * np.sin(3.0 * np.pi * trial.times))[:, None, None])


def search(misread: Misread) -> Discovery:
    recordings = [
        SearchTrial(one.trial.with_markers(misread(one.trial)), one.role)
        for one in recorded(person(), person().model)
    ]
    return discover(person().model, recordings)


@pytest.mark.parametrize(
    ("misread", "said"),
    [
        pytest.param(stretch, r"y is off by \+[12]\.\d% of y", marks=pytest.mark.costly),
        (bend, "as by a lens"),
        (read_rows, r"they come (1\d|2\d)\.\d ms later for each metre along y"),
        pytest.param(breathe, "size comes and goes", marks=pytest.mark.costly),
    ],
    ids=["stretched", "bent", "late", "wandering"],
)
def test_cameras_that_misread_are_unexplained_as_all_markers(misread: Misread, said: str) -> None:
    findings = search(misread)
    assert not findings.named
    (place,) = (u for u in findings.unexplained if u.where == ["markers"])
    assert place.law is not None
    assert re.search(said, place.law)


def test_a_marker_whose_place_drifts_has_no_size_that_could_be_named() -> None:
    def drift(trial: Trial) -> Array:
        markers = trial.markers.copy()
        markers[:, trial.index("RFH"), 1] += 0.01 + np.linspace(0.0, 0.03, len(markers))
        return markers

    findings = search(drift)
    assert not findings.named
    assert [u.where for u in findings.unexplained] == [["RFH"]]


@pytest.mark.costly  # its neighbours are rivals, recording by recording
def test_a_marker_that_comes_late_makes_no_neighbour_jump() -> None:
    def delay(trial: Trial) -> Array:
        markers = trial.markers.copy()
        for axis in range(3):
            path = markers[:, trial.index("RLM"), axis]
            path[:] = np.interp(trial.times - 0.06, trial.times, path)
        return markers

    findings = search(delay)
    assert not findings.named
    assert [u.where for u in findings.unexplained] == [["RLM"]]
    assert "jumps" not in (findings.unexplained[0].law or "")
