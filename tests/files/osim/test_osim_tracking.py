"""OpenSim's inverse kinematics with an exported model leaves the marker errors that ours does."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from scaling_service.capabilities.scaling.run import compare, render_scaled
from scaling_service.files.trc import write_trc
from tests.jobs.recorded import imaged_walker_document

N_FRAMES = 12
ATOL = 1e-4  # m, of every frame's root mean square


@pytest.mark.parametrize("method", ["MB_lam", "EB_am"])
def test_opensim_follows_the_markers_as_closely(
    method: str, shared_data: Path, tmp_path: Path, oracle: Callable[[dict[str, Any]], dict[str, Any]]
) -> None:
    document = imaged_walker_document(shared_data)
    (tmp_path / "subject.json").write_text(json.dumps(document), encoding="utf-8")
    results = compare(tmp_path / "subject.json", (method,))
    found, (trial,) = results.scalings[method], results.session.evaluation
    motion, model = found.motions[trial.name], found.calibration.model
    (tmp_path / "model.osim").write_text(render_scaled(found.calibration, results.session), encoding="utf-8")
    write_trc(tmp_path / "walk.trc", trial.selected(motion.markers).frames(slice(N_FRAMES)))
    theirs = oracle(
        {
            "operation": "marker_errors",
            "file": str(tmp_path / "model.osim"),
            "markers": str(tmp_path / "walk.trc"),
            "weights": {m: model.marker(m).weight for m in motion.markers},
            "folder": str(tmp_path),
        }
    )
    ours = np.sqrt(np.nanmean(motion.distances[:N_FRAMES] ** 2, axis=1))
    np.testing.assert_allclose(theirs["rms"], ours, rtol=0, atol=ATOL)
