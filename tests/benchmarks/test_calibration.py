"""Calibration of the virtual person of ``demo``: time beside the error reached.

Run with ``pytest -m benchmark -s tests/benchmarks``. One thread, CPU time, a process of its own.
"""

from __future__ import annotations

import sys

import pytest

from tests.peers.worker import ask

MOST_S = 0.5


@pytest.mark.benchmark
def test_calibration_takes_less_than_half_a_second() -> None:
    found = ask("tests.benchmarks.calibration_worker")
    for method, row in found.items():
        sys.stdout.write(
            f"\n{method}: {row['s']:.3f} s CPU, {row['frames']} frames, {row['parameters']} parameters, "
            f"{row['steps']} steps, cumulative error {row['cost']:.5f} m2"
        )
    assert all(row["s"] <= MOST_S for row in found.values())
