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

ATOL = 1e-4  # m, of every frame's root mean square

GAIT2354 = {"model": "gait2354_simbody.osim", "marker_set": "gait2354_Scale_MarkerSet.xml"}
"""Its ankle and subtalar joint are not clamped, and of this person's markers one sits on each foot."""


@pytest.mark.parametrize(
    ("method", "model", "n_frames"),
    [("MB_lam", {}, 12), ("EB_am", {}, 12), ("EB", GAIT2354, None)],
    ids=["MB_lam-rajagopal", "EB_am-rajagopal", "EB-gait2354"],
)
def test_opensim_follows_the_markers_as_closely(
    method: str,
    model: dict[str, str],
    n_frames: int | None,
    shared_data: Path,
    tmp_path: Path,
    oracle: Callable[[dict[str, Any]], dict[str, Any]],
) -> None:
    document = imaged_walker_document(shared_data)
    document |= {field: str(shared_data / "gait2354" / file) for field, file in model.items()}
    (tmp_path / "subject.json").write_text(json.dumps(document), encoding="utf-8")
    results = compare(tmp_path / "subject.json", (method,))
    found, (trial,) = results.scalings[method], results.session.evaluation
    motion, fitted = found.motions[trial.name], found.calibration.model
    (tmp_path / "model.osim").write_text(render_scaled(found.calibration, results.session), encoding="utf-8")
    write_trc(tmp_path / "walk.trc", trial.selected(motion.markers).frames(slice(n_frames)))
    theirs = oracle(
        {
            "operation": "marker_errors",
            "file": str(tmp_path / "model.osim"),
            "markers": str(tmp_path / "walk.trc"),
            "weights": {m: fitted.marker(m).weight for m in motion.markers},
            "folder": str(tmp_path),
        }
    )
    ours = np.sqrt(np.nanmean(motion.distances[:n_frames] ** 2, axis=1))
    np.testing.assert_allclose(theirs["rms"], ours, rtol=0, atol=ATOL)
