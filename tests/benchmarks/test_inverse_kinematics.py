"""Inverse kinematics and calibration against their peers: time beside the error reached.

Run with ``pytest -m benchmark -s tests/benchmarks``. One thread everywhere, CPU time of each process, all
in one run. Ours is a whole call with nothing kept from the one before (the least of several, for other
programs only add to it). OpenSim is timed in its solver's loop over the frames, without loading, set-up
and first assembly, and beside it as its tool, with its set-up's coordinate tasks where it has any; ours
has none, so the loop, without them, is the like for like.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from scaling_service.formats.osim import read_ik_tasks, read_osim
from scaling_service.formats.trc import read_trc
from tests.peers.nimble_ik import interpreter, run_nimble_ik
from tests.peers.opensim_ik import run_opensim_ik, time_opensim_ik_tool
from tests.peers.opensim_scale import run_opensim_scale

NO_WORSE = 1.001
CALIBRATION_S = 0.5

WORKER = """
import json, sys, time
import numpy as np
from pathlib import Path
from scaling_service.estimation.inverse_kinematics import inverse_kinematics
from scaling_service.formats.osim import read_osim
from scaling_service.formats.trc import read_trc

request = json.loads(sys.stdin.read())
model, trial = read_osim(Path(request["model"])), read_trc(Path(request["trc"]))
best = float("inf")
for _ in range(request["repeats"]):
    start = time.process_time()
    motion = inverse_kinematics(model, trial, weights=request["weights"])
    best = min(best, time.process_time() - start)
squared = motion.distances**2
weights = np.array([request["weights"][name] for name in motion.markers])
print(json.dumps({
    "us": 1e6 * best / trial.n_frames,
    "frames": trial.n_frames,
    "markers": len(motion.markers),
    "coordinates": len(motion.estimated),
    "rms_mm": 1e3 * float(np.sqrt(np.nanmean(squared))),
    "weighted": float(np.nansum(weights * squared)),
}))
"""

CALIBRATION_WORKER = """
import json, sys, time
from scaling_service.calibration.methods import calibrate
from scaling_service.calibration.settings import PAPER
from scaling_service.studies.virtual_subject import demo_session

session, _ = demo_session(0)
known = {"MB": calibrate(session, "MB")}
found = {}
for method in ("MB_am", "MB_lam"):
    best = float("inf")
    for _ in range(5):
        start = time.process_time()
        result = calibrate(session, method, PAPER, known)
        best = min(best, time.process_time() - start)
    found[method] = {
        "s": best, "steps": result.iterations, "parameters": len(result.parameters), "frames": PAPER.n_frames,
        "cost": result.cost,
    }
print(json.dumps(found))
"""


def answer(worker: str, request: Mapping[str, Any] | None = None) -> Any:
    """What a worker prints, run on one thread."""
    done = subprocess.run(
        [sys.executable, "-c", worker],
        input=json.dumps(request or {}),
        cwd=Path(__file__).resolve().parents[2],
        env={**os.environ, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"},
        capture_output=True,
        text=True,
        timeout=600,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


@dataclass(frozen=True)
class Case:
    """A model, a recording and the tasks of its set-up; at least how many times faster ours must be."""

    name: str
    model: Path
    recording: Path
    markers: Mapping[str, float]
    coordinates: Mapping[str, float]
    at_least: float

    @property
    def weights(self) -> dict[str, float]:
        """A weight for every marker of the model, zero for those without a task."""
        return {m.name: self.markers.get(m.name, 0.0) for m in read_osim(self.model).markers}


def cases(data: Path, scratch: Path) -> list[Case]:
    gait, walk, squat = data / "gait2354", data / "rajagopal_walk", data / "opencap_squat"
    models = [scratch / name for name in ("gait.osim", "sizes.osim", "walk.osim")]
    run_opensim_scale(
        gait / "subject01_Setup_Scale.xml",
        gait / "gait2354_simbody.osim",
        gait / "subject01_static.trc",
        marker_set=gait / "gait2354_Scale_MarkerSet.xml",
        output=models[0],
    )
    run_opensim_scale(
        walk / "scale_setup_walk_scaleOnly.xml",
        walk / "Rajagopal2016.osim",
        walk / "static_walk_1.trc",
        marker_set=walk / "markerset_walk_preScale.xml",
        output=models[1],
    )
    run_opensim_scale(walk / "scale_setup_walk.xml", models[1], walk / "static_walk_2.trc", output=models[2])
    hand_scaled = squat / "manually_scaled.osim"
    every = {m.name: m.weight for m in read_osim(hand_scaled).markers}
    tasks, walk_tasks = (
        read_ik_tasks(gait / "subject01_Setup_IK.xml"),
        read_ik_tasks(walk / "ik_setup_walk.xml"),
    )
    return [
        # Few frames of a small model: most of our time goes into calls, hardly any into arithmetic.
        Case("gait2354", models[0], gait / "subject01_walk1.trc", *tasks, at_least=20.0),
        Case("rajagopal_walk", models[2], walk / "motion_capture_walk.trc", *walk_tasks, at_least=180.0),
        Case("opencap_squat", hand_scaled, squat / "squats1.trc", every, {}, at_least=200.0),
    ]


@pytest.mark.benchmark
@pytest.mark.skipif(find_spec("opensim") is None, reason="the opensim library is not installed")
def test_inverse_kinematics_beside_opensim(shared_data: Path, tmp_path: Path) -> None:
    rows, faults = [], []
    for case in cases(shared_data, tmp_path):
        times = read_trc(case.recording).times
        span = (float(times[0]), float(times[-1]))
        ours = answer(
            WORKER,
            {"model": str(case.model), "trc": str(case.recording), "weights": case.weights, "repeats": 15},
        )
        peer = run_opensim_ik(case.model, case.recording, case.markers, time_range=span)
        tool = time_opensim_ik_tool(
            case.model, case.recording, case.markers, case.coordinates, time_range=span
        )
        theirs = float(peer.weighted_squared_errors.sum())
        loop = 1e3 * float(peer.cpu_s.mean())
        ratio = 1e3 * loop / ours["us"]
        rows.append(
            f"{case.name:<15}{ours['frames']:>7}{ours['markers']:>8}{ours['coordinates']:>7}"
            f"{ours['us']:>9.1f}{ours['rms_mm']:>8.2f}{ours['weighted']:>10.4f}"
            f"{loop:>10.2f}{1e3 * float(np.sqrt(np.nanmean(peer.squared_errors))):>8.2f}{theirs:>10.4f}"
            f"{ratio:>8.0f}{1e3 * tool:>10.2f}{1e6 * tool / ours['us']:>8.0f}"
        )
        assert ours["markers"] == len(peer.markers)
        if not ours["weighted"] <= NO_WORSE * theirs:
            faults.append(f"{case.name}: error {ours['weighted']:.5g} against {theirs:.5g}")
        if not ratio >= case.at_least:
            faults.append(f"{case.name}: {ratio:.0f} times faster, not {case.at_least:.0f}")
    head = (
        "\n" + " " * 37 + "ours" + " " * 23 + "OpenSim's solver" + " " * 19 + "its tool\n"
        f"{'':<15}{'frames':>7}{'markers':>8}{'coord.':>7}{'us/fr.':>9}{'RMS mm':>8}{'w. m2':>10}"
        f"{'ms/frame':>10}{'RMS mm':>8}{'w. m2':>10}{'ratio':>8}{'ms/frame':>10}{'ratio':>8}\n"
    )
    sys.stdout.write(head + "\n".join(rows) + "\n")
    assert not faults, faults


@pytest.mark.benchmark
@pytest.mark.skipif(find_spec("opensim") is None, reason="the opensim library is not installed")
@pytest.mark.skipif(interpreter() is None, reason="SCALING_SERVICE_NIMBLE names no interpreter")
def test_inverse_kinematics_beside_nimblephysics(shared_data: Path, tmp_path: Path) -> None:
    python = interpreter()
    assert python is not None
    case = cases(shared_data, tmp_path)[1]
    trial = read_trc(case.recording)
    seen = {name: weight for name, weight in case.markers.items() if name in trial.labels}
    ours = answer(
        WORKER, {"model": str(case.model), "trc": str(case.recording), "weights": case.weights, "repeats": 15}
    )
    peer = run_nimble_ik(python, case.model, trial.labels, trial.markers, seen)
    weights = np.array([seen[name] for name in peer.markers])
    theirs = float(np.nansum(weights * peer.squared_errors))
    ratio = 1e6 * float(peer.cpu_s.mean()) / ours["us"]
    sys.stdout.write(
        f"\n{case.name}: ours {ours['us']:.1f} us per frame, weighted error {ours['weighted']:.4f} m2; "
        f"nimblephysics {1e3 * peer.cpu_s.mean():.2f} ms per frame, {theirs:.4f} m2; ratio {ratio:.0f}\n"
    )
    assert len(peer.markers) == ours["markers"]
    assert ratio >= 30.0


@pytest.mark.benchmark
def test_calibration_takes_less_than_half_a_second() -> None:
    found = answer(CALIBRATION_WORKER)
    for method, row in found.items():
        sys.stdout.write(
            f"\n{method}: {row['s']:.3f} s CPU, {row['frames']} frames, {row['parameters']} parameters, "
            f"{row['steps']} steps, cumulative error {row['cost']:.5f} m2"
        )
    assert all(row["s"] <= CALIBRATION_S for row in found.values())
