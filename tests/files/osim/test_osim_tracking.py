"""OpenSim's inverse kinematics with an exported model leaves no smaller marker errors than ours."""

from __future__ import annotations

import json
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest

from scaling_service.capabilities.scaling.run import compare, render_scaled
from scaling_service.files.trc import write_trc
from tests.jobs.recorded import imaged_walker_document
from tests.peers.opensim_ik import run_opensim_ik

pytestmark = pytest.mark.skipif(find_spec("opensim") is None, reason="the opensim library is not installed")

ATOL = 1e-4  # m, of every frame's root mean square
HELD = 5e-4  # m, of a frame in which one marker hardly shows a foot, which its joints' ranges hold here
SAME_MINIMUM = 0.1  # sine of half the difference of any angle, 11 degrees: whole turns do not count

GAIT2354 = {"model": "gait2354_simbody.osim", "marker_set": "gait2354_Scale_MarkerSet.xml"}
"""Its ankle and subtalar joint are not clamped, and of this person's markers one sits on each foot, so
that two poses of the foot follow it almost alike."""


@pytest.mark.parametrize(
    ("method", "model", "n_frames"),
    [
        pytest.param("MB_lam", {}, 12, marks=pytest.mark.costly),
        pytest.param("EB_am", {}, 12, marks=pytest.mark.costly),
        pytest.param("EB", GAIT2354, 40, marks=pytest.mark.costly),
    ],
    ids=["MB_lam-rajagopal", "EB_am-rajagopal", "EB-gait2354"],
)
def test_opensim_follows_the_markers_as_closely(
    method: str,
    model: dict[str, str],
    n_frames: int,
    shared_data: Path,
    tmp_path: Path,
) -> None:
    document = imaged_walker_document(shared_data)
    document |= {field: str(shared_data / "gait2354" / file) for field, file in model.items()}
    (tmp_path / "subject.json").write_text(json.dumps(document), encoding="utf-8")
    results = compare(tmp_path / "subject.json", (method,))
    found, (trial,) = results.scalings[method], results.session.evaluation
    motion, fitted = found.motions[trial.name], found.calibration.model
    (text,) = render_scaled([found.calibration], results.session)
    (tmp_path / "model.osim").write_text(str(text), encoding="utf-8")
    write_trc(tmp_path / "walk.trc", trial.select(motion.markers).frames(slice(n_frames)))
    weights = {m: fitted.marker(m).weight for m in motion.markers}
    peer = run_opensim_ik(tmp_path / "model.osim", tmp_path / "walk.trc", weights, accuracy=1e-9)
    seen = [motion.markers.index(name) for name in peer.markers]
    ours = np.sqrt(np.nanmean(motion.distances[:n_frames, seen] ** 2, axis=1))
    theirs = np.sqrt(np.nanmean(peer.squared_errors, axis=1))
    off = ours - theirs
    most = HELD if model else ATOL
    assert np.sqrt(np.mean(ours**2)) < np.sqrt(np.mean(theirs**2)) + ATOL  # ours is never worse
    assert off.max() < most
    angles = {name: peer.q[:, peer.coordinates.index(name)] for name in motion.estimated}
    apart = [np.abs(np.sin(0.5 * (motion.column(name)[:n_frames] - q))) for name, q in angles.items()]
    same = np.max(apart, axis=0) < SAME_MINIMUM if model else np.ones(len(off), dtype=bool)
    assert same.any()
    assert np.abs(off[same]).max() < most  # and the same where OpenSim ends in the same minimum
