"""Muller's uncertainty of a real squat: samples against linear propagation, residuals like the paper's."""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest

from scaling_service.capabilities.dynamics.uncertainty.total import LoadedMotion, propagate
from scaling_service.capabilities.motion.inverse_kinematics import inverse_kinematics
from scaling_service.files.forces import read_forces
from scaling_service.files.osim.models import read_osim
from scaling_service.files.trc import read_trc
from scaling_service.recording.plates import synchronise
from scaling_service.recording.plates_feet import assign_foot_loads, assign_plates
from scaling_service.studies.muller2017.monte_carlo import UncertaintySettings, propagate_by_samples

FRAMES = 300


@pytest.mark.skipif(find_spec("opensim") is None, reason="the opensim library is not installed")
def test_a_real_squat(shared_data: Path) -> None:
    folder = shared_data / "opencap_squat"
    model = read_osim(folder / "manually_scaled.osim", None)
    trial = read_trc(folder / "squats1.trc").frames(slice(200, 200 + FRAMES))
    motion = inverse_kinematics(model, trial)
    feet = {
        f"calcn_{side}": np.stack([trial.position(f"{letter}_{label}") for label in ("calc", "toe")], axis=1)
        for side, letter in (("r", "r"), ("l", "L"))
    }
    forces = synchronise(read_forces(folder / "squats1_grf.mot"), motion.times, cutoff_hz=5.0)
    loads = assign_foot_loads(forces, assign_plates(forces, feet), {foot: foot for foot in feet})
    recording = LoadedMotion(model=model, motion=motion, loads=loads, height_m=1.68)
    found = propagate(recording)
    sampled = propagate_by_samples(recording, UncertaintySettings(samples=60, motions=120))
    np.testing.assert_allclose(found.slopes_per_cm, sampled.slopes_per_cm, rtol=0.25)
    assert (found.r2 >= 0.96).all()
    assert (found.plate < 1e-2 * found.kinematic).all()
    # the paper: 2 % of weight, 1.3 % of weight times stature, and the uncertainty far above
    assert found.dr[:3].mean() < 0.05
    assert (found.total > found.dr).all()
