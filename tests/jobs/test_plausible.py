"""What is doubtful is said with its numbers; what is usual is not."""

from __future__ import annotations

import numpy as np
import pytest

from scaling_service.capabilities.motion.kinematic_error import KinematicError
from scaling_service.capabilities.scaling.comparison.geometry import list_doubts


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
    assert said.startswith(f"femur_r of {320 * height_m:.0f} mm (MB_lam) is unusual")
    assert list_doubts({}, {"MB": usual | {"femur_r": 3.0}}, None) == ()
