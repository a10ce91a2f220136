"""The command `ik` on a recording of 100,000 frames: CPU time and memory of the whole process.

Run with ``pytest -m benchmark -s tests/benchmarks``. Reading the TRC and writing both motions included.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from scaling_service.files.sto import read_sto
from scaling_service.files.trc import write_trc
from tests.capabilities.recorded import recorded

pytestmark = pytest.mark.benchmark

FRAMES = 100_000
MOST_CPU_S, MOST_MIB = 12.0, 1024.0

_MEASURED = """
import json, resource, sys
from scaling_service.cli import main
assert main(sys.argv[1:]) == 0
used = resource.getrusage(resource.RUSAGE_SELF)
print(json.dumps({"cpu_s": used.ru_utime + used.ru_stime, "mib": used.ru_maxrss / 1024}))
"""


def test_a_hundred_thousand_frames(tmp_path: Path) -> None:
    made = recorded("lower_limb_14dof", FRAMES, 0)
    write_trc(tmp_path / "walk.trc", made.trial)
    given = ["ik", "lower_limb_14dof", "walk.trc", "--out", "out", "--smooth-hz", "0"]
    command = [sys.executable, "-c", _MEASURED, *given]
    environment = os.environ | {"OMP_NUM_THREADS": "1"}
    done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=True)
    used = json.loads(done.stdout.splitlines()[-1])
    motion, spread = (read_sto(tmp_path / f"out/walk_{kind}.mot") for kind in ("ik", "ik_sd"))
    knee = motion.column("knee_angle_r") - np.degrees(
        made.q[:, made.model.coordinate_names.index("knee_angle_r")]
    )
    covered = np.mean(np.abs(knee) < 1.96 * spread.column("knee_angle_r"))
    sys.stdout.write(f"\n{FRAMES} frames: {used['cpu_s']:.1f} s of CPU, {used['mib']:.0f} MiB; ")
    sys.stdout.write(f"knee {np.std(knee):.2f} deg off, {100 * covered:.1f} % within 95 % intervals\n")
    assert covered > 0.93  # the bands hold skin, of which this recording has none
    assert used["cpu_s"] < MOST_CPU_S
    assert used["mib"] < MOST_MIB
