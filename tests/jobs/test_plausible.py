"""What is doubtful is said with its numbers; what is usual is not."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from scaling_service.capabilities.motion.kinematic_error import KinematicError
from scaling_service.capabilities.scaling.comparison.geometry import list_doubts
from scaling_service.capabilities.scaling.run import compare
from tests.jobs.laboratory import laboratory


def _error(mean: float) -> KinematicError:
    return KinematicError(
        mean=mean,
        sd=0.0,
        rms=mean,
        max=mean,
        per_marker={},
        anatomical_mean=float("nan"),
        tracking_mean=float("nan"),
        n_frames=10,
    )


def test_a_trial_that_no_method_follows_is_reported() -> None:
    errors = {
        "MB": {"a": _error(0.150), "b": _error(0.060)},
        "MB_am": {"a": _error(0.142), "b": _error(0.010)},
    }
    (said,) = list_doubts(errors, {}, None)
    assert "'a' better than 142 mm" in said


@pytest.mark.parametrize("height_m", [1.2, 1.7, 2.0])
def test_lengths_are_judged_by_stature(height_m: float) -> None:
    usual = {"femur_r": 0.2454 * height_m, "shank_r": 0.2356 * height_m, "inter_hip": 0.3, "hand_r": 1.0}
    spread = np.array([0.85, 1.15])
    for factor in spread:
        assert list_doubts({}, {"MB": {n: factor * x for n, x in usual.items()}}, height_m) == ()
    (said,) = list_doubts({}, {"MB": usual, "MB_lam": usual | {"femur_r": 0.32 * height_m}}, height_m)
    assert said.startswith(f"right femur of {320 * height_m:.0f} mm (MB_lam) is unusual")
    assert list_doubts({}, {"MB": usual | {"femur_r": 3.0}}, None) == ()


@pytest.mark.parametrize(("height_m", "strength"), [(1.70, "leaning"), (1.95, "undecided")])
def test_a_verdict_does_not_trust_what_was_doubted(tmp_path: Path, height_m: float, strength: str) -> None:
    """What is warned of a recording and what is concluded from it are one sentence, not two."""
    stated = {"id": "S01", "sex": "F", "height_m": height_m, "mass_kg": 62.0}
    results = compare(laboratory(tmp_path, subject=stated), ["MAP"])
    assert results.verdict.strength == strength
    doubts = {str(note) for note in results.session.notes if note.code == "scale"}
    assert bool(doubts) == (strength == "undecided")
    assert {f"{doubt}." for doubt in doubts} <= set(results.verdict.why)
