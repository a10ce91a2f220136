"""Inverse kinematics against OpenSim's own, on real recordings, in both directions.

Given OpenSim's model, markers and weights, ours ends no worse than OpenSim; and a model scaled here
and written for OpenSim leaves the same marker errors in OpenSim's inverse kinematics.
"""

from __future__ import annotations

from collections.abc import Mapping
from importlib.util import find_spec
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest

from scaling_service.capabilities.motion.inverse_kinematics import inverse_kinematics
from scaling_service.capabilities.scaling.result import Results
from scaling_service.capabilities.scaling.run import scale
from scaling_service.capabilities.scaling.saving import save
from scaling_service.files.osim.models import read_osim
from scaling_service.files.trc import read_trc, write_trc
from scaling_service.model.results import Motion
from tests.jobs.laboratory import write_subject
from tests.jobs.recorded import squatter_document, walker_document
from tests.peers.opensim_ik import OpenSimIk, run_opensim_ik
from tests.peers.scaled_models import scaled_gait2354, scaled_rajagopal

pytestmark = pytest.mark.skipif(find_spec("opensim") is None, reason="the opensim library is not installed")

NO_WORSE = 0.1e-3
"""m, of the root mean square: room for OpenSim's couplings, which it holds as constraints and may leave by
its tolerance, and for the ranges of joints that hold here what markers hardly show."""
SAME = 0.1e-3
"""m; OpenSim at an accuracy of 1e-7, positions in the file rounded to 10 nm."""
ROUNDED = 0.5e-3  # s: times stand in some files to the millisecond; we put them back on the clock
FRAMES = 60
FEW = 15  # frames: OpenSim takes its time at that accuracy


def ours(model: Path, recording: Path, weights: Mapping[str, float] | None, frames: int | None) -> Motion:
    return inverse_kinematics(read_osim(model), read_trc(recording).frames(slice(0, frames)), weights=weights)


def assert_no_worse(
    model: Path, recording: Path, tasks: Mapping[str, float] | None, frames: int | None
) -> None:
    motion = ours(model, recording, tasks, frames)
    weights = {m.name: m.weight for m in read_osim(model).markers} | dict(tasks or {})
    used = {name: weights[name] for name in motion.markers}
    first, last = float(motion.times[0]), float(motion.times[-1])
    peer = run_opensim_ik(model, recording, used, time_range=(first, last))
    assert set(peer.markers) == set(motion.markers)
    np.testing.assert_allclose(peer.times, motion.times, rtol=0, atol=ROUNDED)
    weights = np.array(list(used.values()))
    seen = np.where(np.isfinite(motion.distances), weights, 0.0).sum()
    error = np.sqrt(np.nansum(weights * motion.distances**2) / seen)
    assert error <= np.sqrt(peer.weighted_squared_errors.sum() / seen) + NO_WORSE


def read_tasks(setup: Path) -> dict[str, float]:
    """Weights of the markers that an OpenSim set-up uses."""
    tasks = ElementTree.parse(setup).iter("IKMarkerTask")
    used = [task for task in tasks if (task.findtext("apply") or "true").strip() in ("true", "1")]
    return {task.get("name", ""): float(task.findtext("weight") or 1.0) for task in used}


def test_gait2354_walking_is_followed_no_worse(shared_data: Path, tmp_path: Path) -> None:
    folder = shared_data / "gait2354"
    tasks = read_tasks(folder / "subject01_Setup_IK.xml")
    assert_no_worse(scaled_gait2354(shared_data, tmp_path), folder / "subject01_walk1.trc", tasks, None)


@pytest.mark.costly
def test_rajagopal_walking_is_followed_no_worse(shared_data: Path, tmp_path: Path) -> None:
    folder = shared_data / "rajagopal_walk"
    tasks = read_tasks(folder / "ik_setup_walk.xml")
    model = scaled_rajagopal(shared_data, tmp_path)
    assert_no_worse(model, folder / "motion_capture_walk.trc", tasks, FRAMES)


@pytest.mark.costly
def test_squats_are_followed_no_worse(shared_data: Path) -> None:
    folder = shared_data / "opencap_squat"
    assert_no_worse(folder / "manually_scaled.osim", folder / "squats1.trc", None, FRAMES)


def scaled_here(folder: Path, content: dict[str, Any]) -> Results:
    """A subject file on disk, scaled and saved as a user would."""
    results = scale(write_subject(folder, content), "MB_am")
    save(results, folder / "out")
    return results


def assert_opensim_agrees(results: Results, folder: Path) -> OpenSimIk:
    """OpenSim, given the model and the recording that were written, leaves every marker where we do."""
    recording = results.session.calibration[0].frames(slice(0, FEW))
    write_trc(folder / "seen.trc", recording)
    motion = inverse_kinematics(results.scalings["MB_am"].calibration.model, recording)
    written = folder / "out" / "MB_am" / "model.osim"
    weights = {m.name: m.weight for m in read_osim(written).markers}
    used = {name: weights.get(name, 1.0) for name in motion.markers}
    peer = run_opensim_ik(written, folder / "seen.trc", used, accuracy=1e-7)
    column = [motion.markers.index(name) for name in peer.markers]
    assert len(column) == len(motion.markers)
    difference = np.abs(np.sqrt(peer.squared_errors) - motion.distances[:, column])
    assert np.nanmax(difference) < SAME
    return peer


def test_a_builtin_model_scaled_here_behaves_alike_in_opensim(shared_data: Path, tmp_path: Path) -> None:
    peer = assert_opensim_agrees(scaled_here(tmp_path, walker_document(shared_data)), tmp_path)
    assert len(peer.markers) >= 10


@pytest.mark.costly
def test_an_opensim_model_scaled_here_behaves_alike_in_opensim(shared_data: Path, tmp_path: Path) -> None:
    peer = assert_opensim_agrees(scaled_here(tmp_path, squatter_document(shared_data)), tmp_path)
    assert len(peer.markers) >= 30
