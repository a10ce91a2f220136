"""Gait Variable and Profile Scores: closed forms, what is missing, and the reference's own numbers."""

from __future__ import annotations

import numpy as np
import pytest

from scaling_service.capabilities.scaling.clinical_gait import (
    VARIABLES,
    compute_gait_profile,
    compute_gait_variable_score,
    compute_typical_score,
    read_schwartz2008,
)
from scaling_service.core.errors import InputError

REFERENCE = read_schwartz2008()
PERCENT = np.linspace(0.0, 100.0, 101)


def shifted(offsets: dict[str, float]) -> dict[str, np.ndarray]:
    """Three cycles of 101 nodes that are the reference's mean and a constant."""
    found = {}
    for name, offset in offsets.items():
        mean = np.interp(PERCENT, PERCENT[::2], REFERENCE.bands[name].mean)
        found[name] = np.repeat(mean[None] + offset, 3, axis=0)
    return found


def test_a_curve_off_by_a_constant_scores_the_constant() -> None:
    offsets = {name: 0.01 * (k + 1) * (-1) ** k for k, name in enumerate(VARIABLES)}
    profile = compute_gait_profile({"r": shifted(offsets), "l": shifted(offsets)}, REFERENCE)
    for name, offset in offsets.items():
        assert profile.variable_scores["r"][name] == pytest.approx(abs(offset))
    assert profile.side_scores["l"] == pytest.approx(0.01 * np.sqrt(np.mean(np.arange(1.0, 10.0) ** 2)))


def test_the_pelvis_counts_once_and_as_on_the_left() -> None:
    left = dict.fromkeys(VARIABLES, 0.1)
    right = {name: 0.9 if name.startswith("pelvis") else 0.2 for name in VARIABLES}
    profile = compute_gait_profile({"r": shifted(right), "l": shifted(left)}, REFERENCE)
    assert profile.score == pytest.approx(np.sqrt((9 * 0.1**2 + 6 * 0.2**2) / 15))
    assert profile.side_scores["r"] == pytest.approx(np.sqrt((3 * 0.9**2 + 6 * 0.2**2) / 9))


def test_a_swing_about_the_reference_scores_its_rms_and_cycles_are_averaged() -> None:
    mean = np.zeros(51)
    sine = np.sin(np.linspace(0.0, 2.0 * np.pi, 51))
    rms = np.sqrt(np.mean(sine**2))
    assert compute_gait_variable_score(
        np.stack([sine, 3.0 * sine, np.full(51, np.nan)]), mean
    ) == pytest.approx(2.0 * rms)


def test_without_all_nine_there_are_variable_scores_only() -> None:
    most = dict.fromkeys(VARIABLES[:-1], 0.1)
    profile = compute_gait_profile(
        {"r": shifted(most), "l": shifted(dict.fromkeys(VARIABLES, 0.1))}, REFERENCE
    )
    assert set(profile.variable_scores["r"]) == set(most)
    assert set(profile.side_scores) == {"l"}
    assert profile.score is None
    assert compute_gait_profile({}, REFERENCE).score is None


def test_nodes_that_do_not_meet_are_refused() -> None:
    with pytest.raises(InputError, match="76 nodes"):
        compute_gait_variable_score(np.zeros((1, 76)), np.zeros(51))


def test_the_reference_is_that_of_the_paper() -> None:
    """Free speed at 0 and 70 % of the cycle, and the mean scatter, as the source tabulates them."""
    for name, start, late, sd in (
        ("hip_flexion", 35.8, 17.9, 6.1),
        ("knee_flexion", 5.6, 58.2, 6.3),
        ("ankle_dorsiflexion", -2.1, -11.2, 5.3),
        ("pelvis_obliquity_up", 0.8, -3.4, 2.1),
    ):
        band = REFERENCE.bands[name]
        assert np.degrees(band.mean[[0, 35]]) == pytest.approx([start, late], abs=0.051)
        assert np.degrees(band.sd.mean()) == pytest.approx(sd, abs=0.051)
    assert {band.mean.shape for band in REFERENCE.bands.values()} == {(51,)}
    assert np.degrees(compute_typical_score(REFERENCE)) == pytest.approx(
        np.degrees(np.sqrt(np.mean([np.mean(REFERENCE.bands[n].sd ** 2) for n in VARIABLES])))
    )
