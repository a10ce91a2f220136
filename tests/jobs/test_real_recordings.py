"""Subject files on real recordings: C3D with other names and TRC with an OpenSim model."""

from __future__ import annotations

import json
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest

from scaling_service.capabilities.scaling.result import Results
from scaling_service.capabilities.scaling.run import compare, scale
from scaling_service.capabilities.scaling.saving import save
from scaling_service.files.osim.models import read_osim
from tests.jobs.laboratory import write_subject
from tests.jobs.recorded import squatter_document, walker_document

SANE = 15e-3
"""m; chosen: twice the 6.5 mm of Puchaud 2019 (table 5, MB_a,m*) plus room for other bodies and markers."""


@pytest.fixture(scope="module")
def walker(shared_data: Path, tmp_path_factory: pytest.TempPathFactory) -> Results:
    return compare(write_subject(tmp_path_factory.mktemp("walker"), walker_document(shared_data)))


def test_a_walker_is_followed_on_a_trial_that_was_not_fitted(walker: Results) -> None:
    errors = {method: scaling.errors["Walking01"].mean for method, scaling in walker.scalings.items()}
    assert errors["MB_am"] < errors["MB"] < SANE


def test_the_laboratorys_names_and_the_extra_markers_are_used(walker: Results) -> None:
    assert walker.loaded.markers_used["RLFE"] == ("RKNE",)
    assert walker.loaded.markers_used["RMFE"] == ("RMFC",)  # in the static trial only
    motion = walker.scalings["MB_am"].motions["Walking01"]
    assert {"RLFE", "RTHI", "RTUB"} <= set(motion.markers)
    assert "RMFE" not in motion.markers


@pytest.mark.skipif(find_spec("opensim") is None, reason="the opensim library is not installed")
def test_an_opensim_model_is_scaled_and_loads_again(shared_data: Path, tmp_path: Path) -> None:
    results = scale(write_subject(tmp_path, squatter_document(shared_data)), "MB_am")
    save(results, tmp_path / "out")
    written = json.loads((tmp_path / "out" / "MB_am" / "scaling.json").read_text(encoding="utf-8"))
    assert all(error["mean"] < 1e3 * SANE for error in written["kinematic_error_mm"].values())
    model = read_osim(tmp_path / "out" / "MB_am" / "model.osim")
    assert sum(segment.mass for segment in model.segments) == pytest.approx(62.6)
    assert model.coordinate_names == results.session.model.coordinate_names


@pytest.mark.skipif(find_spec("opensim") is None, reason="the opensim library is not installed")
@pytest.mark.parametrize(
    "static", ["static_walk_1.trc", pytest.param("static_walk_2.trc", marks=pytest.mark.costly)]
)
def test_arms_that_stand_bent_are_placed_bent(static: str, shared_data: Path, tmp_path: Path) -> None:
    """No landmark of these arms lies below the elbow: the model's own wrist markers show the bend."""
    folder = shared_data / "rajagopal_walk"
    document = {
        "subject": {"id": "walker"},
        "model": str(folder / "Rajagopal2016.osim"),
        "marker_set": str(folder / "markerset_walk_preScale.xml"),
        "trials": {
            "static": str(folder / static),
            "calibration": [str(folder / "motion_capture_walk.trc")],
        },
    }
    error = scale(write_subject(tmp_path, document), "MB").scalings["MB"].errors["motion_capture_walk"]
    assert error.mean < 25e-3  # chosen: 19 and 22 mm; 42 and 46 with the arms placed straight
    assert max(error.per_marker[f"{side}.Wrist"] for side in "RL") < 60e-3


GENERIC = {
    "Rajagopal": ("rajagopal_walk/Rajagopal2016.osim", None),
    "OpenCap": ("opencap_squat/unscaled_generic.osim", None),
    "gait2354": ("gait2354/gait2354_simbody.osim", "gait2354/gait2354_Scale_MarkerSet.xml"),
}


@pytest.mark.skipif(find_spec("opensim") is None, reason="the opensim library is not installed")
@pytest.mark.parametrize(
    "name",
    ["Rajagopal", *(pytest.param(name, marks=pytest.mark.costly) for name in ("OpenCap", "gait2354"))],
)
def test_lengths_by_markers_hold_those_of_the_image(name: str, shared_data: Path, tmp_path: Path) -> None:
    """These models have landmarks elsewhere about their joints than this person has, by up to 2 cm."""
    model, markers = GENERIC[name]
    document = walker_document(shared_data) | {"model": str(shared_data / model), "extra_markers": {}}
    if markers is not None:
        document["marker_set"] = str(shared_data / markers)
    save(scale(write_subject(tmp_path, document), "MB"), tmp_path / "out", report=False)
    written = json.loads((tmp_path / "out" / "MB" / "scaling.json").read_text(encoding="utf-8"))
    expert = json.loads((shared_data / "jia_mri" / "reference_joints.json").read_text())["manual"]
    hip, knee, ankle = (np.array(expert[f"{joint}_r"]["centre_mm"]) for joint in ("hip", "knee", "ankle"))
    for segment, truth in (("femur_r", hip - knee), ("shank_r", knee - ankle)):
        sd = written["length_estimates"][segment]["sd_mm"]
        off = written["segment_lengths_mm"][segment] - np.linalg.norm(truth)
        assert abs(off) < 3.0 * sd < 45.0, (segment, off, sd)
