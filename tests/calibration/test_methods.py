"""Methods of scaling that other distributions add."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

MODULE = """
class Halved:
    title, needs = "half of everything", None
    needs_images = needs_movements = False

    def calibrate(self, session, start, settings, progress):
        return f"{session} halved"


METHOD = Halved()
"""

CODE = """
from scaling_service.capabilities.scaling.methods.table import METHODS, calibrate
print(*METHODS)
print(METHODS["MB"].title)
print(calibrate("a person", "half"))
"""


def test_a_method_comes_by_entry_point(tmp_path: Path) -> None:
    """It stands after ours, is done as they are, and takes no name of ours."""
    (tmp_path / "halving.py").write_text(MODULE, encoding="utf-8")
    info = tmp_path / "halving-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: halving\nVersion: 1.0\n", encoding="utf-8")
    points = "[scaling_service.methods]\nhalf = halving:METHOD\nMB = halving:METHOD\n"
    (info / "entry_points.txt").write_text(points, encoding="utf-8")
    paths = os.pathsep.join([str(tmp_path), *filter(None, sys.path)])
    done = subprocess.run(
        [sys.executable, "-c", CODE],
        capture_output=True,
        text=True,
        check=True,
        env={**os.environ, "PYTHONPATH": paths},
    )
    assert done.stdout.splitlines() == [
        "MB MB_lam MB_am EB EB_am MAP half",
        "segment sizes from marker distances",
        "a person halved",
    ]
