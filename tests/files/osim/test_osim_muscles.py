"""Lengths and moment arms of muscles beside OpenSim's own muscle analysis, on real models."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from scaling_service.capabilities.motion.saving import write_motion
from scaling_service.files.osim.models import read_osim
from scaling_service.files.osim.muscles import measure_muscles
from scaling_service.model.body import BodyModel
from scaling_service.model.results import Motion

N_FRAMES = 21
ATOL = np.r_[1e-5, np.full(N_FRAMES - 1, 1e-6)]
"""m. OpenSim's tool assembles its first pose anew, which moves angles by some 1e-5 rad."""

MODELS = {
    "Rajagopal": ("rajagopal_walk/Rajagopal2016.osim", ("hip_flexion_r", "knee_angle_r", "ankle_angle_l")),
    "gait2354": ("gait2354/gait2354_simbody.osim", ("hip_flexion_l", "knee_angle_r", "ankle_angle_r")),
}


def swinging(model: BodyModel, n_frames: int) -> Motion:
    """All joints swing within their ranges, each at its own pace; thighs and knees by up to 50 degrees."""
    times = np.linspace(0.0, 1.0, n_frames)
    q = np.tile([c.default for c in model.coordinates], (n_frames, 1))
    for k, coordinate in enumerate(model.coordinates):
        if coordinate.kind == "rotation" and not coordinate.locked:
            low, high = max(coordinate.lower, -0.6), min(coordinate.upper, 0.9)
            q[:, k] = low + (high - low) * (0.5 - 0.5 * np.cos((2.0 + k % 3) * times))
    return Motion(
        trial="swing",
        times=times,
        coordinates=model.coordinate_names,
        q=q,
        markers=(),
        residuals=np.zeros((n_frames, 0, 3)),
        estimated=model.coordinate_names,
    )


@pytest.mark.parametrize("which", ["gait2354", pytest.param("Rajagopal", marks=pytest.mark.costly)])
def test_muscles_are_as_in_opensims_own_analysis(
    which: str, shared_data: Path, tmp_path: Path, oracle
) -> None:
    file, coordinates = MODELS[which]
    model = read_osim(shared_data / file)
    motion = swinging(model, N_FRAMES)
    found = measure_muscles((shared_data / file).read_text(encoding="utf-8"), model, motion.q)
    write_motion(tmp_path / "swing.mot", motion, model)
    theirs = oracle(
        {
            "operation": "muscle_analysis",
            "file": str(shared_data / file),
            "motion": str(tmp_path / "swing.mot"),
            "coordinates": list(coordinates),
            "folder": str(tmp_path),
        }
    )
    for muscle, lengths in zip(found.muscles, found.lengths.T, strict=True):
        assert (np.abs(lengths - theirs["length"][muscle]) < ATOL).all(), muscle
        for name in coordinates:
            arms = found.arms.get((muscle, name), np.zeros(N_FRAMES))
            assert (np.abs(arms - theirs[name][muscle]) < ATOL).all(), (muscle, name)


def test_frames_without_a_pose_have_no_muscles(shared_data: Path) -> None:
    file = shared_data / MODELS["gait2354"][0]
    model = read_osim(file)
    motion = swinging(model, 3)
    motion.q[1, 0] = np.nan
    found = measure_muscles(file.read_text(encoding="utf-8"), model, motion.q)
    assert np.isnan(found.lengths[1]).all()
    assert np.isfinite(found.lengths[[0, 2]]).all()
    assert all(np.isnan(arm[1]) and np.isfinite(arm[0]) for arm in found.arms.values())
