"""Inverse kinematics of long recordings: time grows with the frames, memory hardly at all.

Run with ``pytest -m benchmark -s tests/benchmarks``. Each length runs in its own process, whose peak
memory is compared with what it held before the solve (peaks while the motion was made count too, so
the increase is an upper bound). The error reached stands beside.
"""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from tests.peers.worker import ask

LENGTHS = (1_000, 10_000, 100_000)
GIB = 2**30


@pytest.mark.benchmark
@pytest.mark.skipif(not Path("/proc/self/statm").exists(), reason="memory is read from /proc")
def test_time_per_frame_is_constant_and_memory_bounded() -> None:
    runs = [ask("tests.benchmarks.length_worker", {"frames": frames}) for frames in LENGTHS]
    for run in runs:
        sys.stdout.write(
            f"\n{run['frames']:>7.0f} frames: {run['us_per_frame']:6.1f} us each, "
            f"{run['bytes'] / 2**20:6.1f} MiB more, angles within {run['rms_deg']:.3f} deg RMS of 1 mm noise"
        )
    assert all(run["rms_deg"] < 1.0 for run in runs)
    assert runs[-1]["us_per_frame"] < 1.5 * runs[0]["us_per_frame"]
    assert runs[-1]["us_per_frame"] < 1.5 * runs[1]["us_per_frame"]
    assert runs[-1]["bytes"] <= GIB
