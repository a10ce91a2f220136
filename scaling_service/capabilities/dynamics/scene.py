"""Residual wrenches over time, as binary tables with a document."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from scaling_service.capabilities.dynamics.run import DynamicsResults
from scaling_service.capabilities.playback.document import ResidualScene, ResidualTrial
from scaling_service.capabilities.playback.scene import FOLDER
from scaling_service.documents.writing import write_json
from scaling_service.files.table_files import ArrayFiles

FILE_NAME = f"{FOLDER}/residuals.json"


def write_residuals(results: DynamicsResults, outputs: Path) -> ResidualScene:
    """Write ``scene/residuals.json`` with its tables.

    ``outputs``: the folder of the job's files.
    """
    files = ArrayFiles(outputs, FOLDER)
    found = {}
    for name, trial in results.trials.items():
        times = trial.dynamics.motion.times
        values = np.where(trial.frames[:, None], trial.dynamics.residual, np.nan)
        found[name] = ResidualTrial(
            start_s=float(times[0]),
            rate_hz=round(1.0 / float(np.median(np.diff(times))), 6),
            residual=files.write(f"{name}.residual", values, "N, N m"),
        )
    document = ResidualScene(trials=found)
    write_json(outputs / FILE_NAME, document)
    return document
