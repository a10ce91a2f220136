"""C3D files of trials, written through ezc3d."""

from __future__ import annotations

import os
import shutil
import tempfile
from pathlib import Path

import numpy as np

from scaling_service.core.errors import DependencyMissing
from scaling_service.files.tables import METRES
from scaling_service.model.trial import Trial


def write_c3d(path: str | os.PathLike[str], trial: Trial) -> None:
    """Write markers as C3D: mm, 32-bit floats, residual -1 where not seen.

    ``trial``: its clock must be regular; C3D holds a rate, not times. Raises DependencyMissing if ezc3d is
    not installed.
    """
    try:
        import ezc3d
    except ImportError:
        raise DependencyMissing(
            "writing C3D needs ezc3d", file=str(path), remedy="Install it: pip install ezc3d"
        ) from None
    n, m = trial.n_frames, len(trial.labels)
    seen = np.isfinite(trial.markers).all(-1).T
    points = np.ones((4, m, n))
    points[:3] = np.where(seen, np.moveaxis(trial.markers, -1, 0).swapaxes(1, 2) / METRES["mm"], 0.0)
    content = ezc3d.c3d()
    about = content["parameters"]["POINT"]
    about["UNITS"]["value"] = ["mm"]
    about["RATE"]["value"] = [trial.rate_hz]
    about["LABELS"]["value"] = list(trial.labels)
    content["data"]["points"] = points
    content["data"]["meta_points"]["residuals"] = np.where(seen, 0.0, -1.0)[None]
    content["data"]["meta_points"]["camera_masks"] = np.zeros((7, m, n), dtype=bool)
    # The library puts .c3d behind any other ending, also behind .C3D.
    with tempfile.TemporaryDirectory(prefix="c3d-") as scratch:
        whole = Path(scratch) / "written.c3d"
        content.write(str(whole))
        shutil.copyfile(whole, path)
