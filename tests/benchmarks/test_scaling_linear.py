"""Inverse kinematics of long recordings: time grows with the frames, memory hardly at all.

Run with ``pytest -m benchmark -s tests/benchmarks``. Each length runs in its own process, whose peak
memory is compared with what it held before the solve (peaks while the motion was made count too, so
the increase is an upper bound). The error reached stands beside.
"""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

LENGTHS = (1_000, 10_000, 100_000)
GIB = 2**30

WORKER = """
import json, resource, sys, time
import numpy as np
from scaling_service.estimation.inverse_kinematics import inverse_kinematics
from scaling_service.kernels.tree import marker_positions
from scaling_service.models.builtin import builtin
from scaling_service.models.compile import compile_model, default_coordinates, parameter_values
from scaling_service.models.trial import Trial

def peak():
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024

def resident():
    with open("/proc/self/statm") as status:
        return int(status.read().split()[1]) * resource.getpagesize()

n = int(sys.argv[1])
model = builtin("lower_limb_14dof")
model = model.with_markers(tuple(m for m in model.markers if m.weight > 0.0))
t = np.arange(n)[:, None] / 100.0
q = default_coordinates(model, n)
rng = np.random.default_rng(0)
q += 0.3 * np.sin(2 * np.pi * rng.uniform(0.2, 0.9, q.shape[1]) * t + rng.uniform(0, 6.28, q.shape[1]))
q[:, [model.coordinate_names.index(f"knee_angle_{s}") for s in "rl"]] += 0.5
markers = marker_positions(compile_model(model), q, parameter_values(model))
markers += rng.normal(0.0, 0.001, markers.shape)
trial = Trial("long", t[:, 0], model.marker_names, markers, 100.0)
inverse_kinematics(model, trial.frames(slice(0, 100)))
before, start = resident(), time.perf_counter()
found = inverse_kinematics(model, trial)
wall = time.perf_counter() - start
angles = [k for k, c in enumerate(model.coordinates) if c.kind == "rotation"]
rms = float(np.degrees(np.sqrt(((found.q - q)[:, angles] ** 2).mean())))
more = max(peak() - before, 0)
print(json.dumps({"frames": n, "us_per_frame": 1e6 * wall / n, "bytes": more, "rms_deg": rms}))
"""


def measured(frames: int) -> dict[str, float]:
    root = Path(__file__).resolve().parents[2]
    done = subprocess.run(
        [sys.executable, "-c", WORKER, str(frames)],
        cwd=root,
        capture_output=True,
        text=True,
        timeout=600,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    result: dict[str, float] = json.loads(done.stdout)
    return result


@pytest.mark.benchmark
@pytest.mark.skipif(not Path("/proc/self/statm").exists(), reason="memory is read from /proc")
def test_time_per_frame_is_constant_and_memory_bounded() -> None:
    runs = [measured(frames) for frames in LENGTHS]
    for run in runs:
        sys.stdout.write(
            f"\n{run['frames']:>7.0f} frames: {run['us_per_frame']:6.1f} us each, "
            f"{run['bytes'] / 2**20:6.1f} MiB more, angles within {run['rms_deg']:.3f} deg RMS of 1 mm noise"
        )
    assert all(run["rms_deg"] < 1.0 for run in runs)
    assert runs[-1]["us_per_frame"] < 1.5 * runs[0]["us_per_frame"]
    assert runs[-1]["us_per_frame"] < 1.5 * runs[1]["us_per_frame"]
    assert runs[-1]["bytes"] <= GIB
