"""Factors along the axes of a segment: known ones are read back, and the fit may change them."""

from __future__ import annotations

import json
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest

from scaling_service.capabilities.scaling.methods.marker_based import scale_linearly
from scaling_service.capabilities.scaling.methods.table import calibrate
from scaling_service.capabilities.scaling.run import scale
from scaling_service.capabilities.scaling.saving import save
from scaling_service.capabilities.scaling.sizes.measurements import open_axes, read_fitted_factor
from scaling_service.capabilities.shared.settings import CalibrationSettings, Settings
from scaling_service.capabilities.subject.loading import load, read_files
from scaling_service.capabilities.subject.reading import load_subject
from scaling_service.core.errors import SubjectInvalid
from scaling_service.model.anatomy.frames import build_pelvis_frame
from scaling_service.model.anatomy.hip_centre import predict_hip_centres
from scaling_service.model.anatomy.lengths import find_joint_centres
from scaling_service.model.builtin import load_builtin
from scaling_service.model.results import Calibration
from scaling_service.model.subject import ScaleSetup
from tests.calibration.people import Person, person
from tests.jobs.laboratory import write_subject

OPEN = CalibrationSettings(scaling="per-axis", sizes="measured")
WIDE = {"pelvis": (0.92, 1.0, 1.12), "femur_r": (1.02, 1.06, 0.98), "tibia_l": (1.03, 0.97, 1.09)}


@pytest.fixture(scope="module")
def broad() -> Person:
    return person(31, factors=WIDE)


def test_known_factors_are_read_back(broad: Person) -> None:
    found = scale_linearly(broad.session, OPEN).scale_factors
    assert found["pelvis"][0] == pytest.approx(0.92, rel=1e-9)
    assert found["pelvis"][2] == pytest.approx(1.12, rel=1e-9)
    assert found["femur_r"][2] == pytest.approx(0.98, rel=1e-9)
    # Malleoli lie 15 deg out of the breadth, so their distance is not all breadth.
    assert found["tibia_l"][1:] == pytest.approx((0.97, 1.09), rel=0.01)
    for segment in ("femur_r", "tibia_l"):
        x, y, z = found[segment]
        assert x == pytest.approx(0.5 * (y + z), rel=1e-12)


def test_the_pelvis_is_as_high_as_the_regression_says(broad: Person) -> None:
    at = broad.session.static.position
    markers = [at(n) for n in ("RASIS", "LASIS", "RPSIS", "LPSIS")]
    hips = predict_hip_centres(*markers)
    below = -0.5 * (hips.right[:, 1].mean() + hips.left[:, 1].mean())
    assert scale_linearly(broad.session, OPEN).scale_factors["pelvis"][1] == pytest.approx(
        below / 0.0831, rel=1e-9
    )


def test_one_factor_is_the_default_and_a_uniform_person_hardly_differs() -> None:
    session = person(
        32, factors=dict.fromkeys(load_builtin("lower_limb_14dof").segment_names, (1.1,) * 3)
    ).session
    assert all(
        len(set(f)) == 1 for f in scale_linearly(session, CalibrationSettings()).scale_factors.values()
    )
    for segment, factors in scale_linearly(session, OPEN).scale_factors.items():
        assert factors == pytest.approx((1.1,) * 3, rel=0.02), (
            segment
        )  # 7 of the regression's 83 mm do not grow


def test_a_breadth_that_no_marker_shows_follows_the_length(broad: Person) -> None:
    labels = [n for n in broad.session.static.labels if n != "RMFE"]
    one = replace(
        broad.session,
        static=broad.session.static.select([n for n in labels if n != "LPSIS"]),
        calibration=tuple(t.select(labels) for t in broad.session.calibration),
    )
    found = scale_linearly(one, OPEN)
    assert len(set(found.scale_factors["femur_r"])) == 1
    assert any("right femur: breadth not measured (RLFE, RMFE)" in w for w in found.warnings)


def test_a_pelvis_without_hips_keeps_its_mean_height() -> None:
    points = {n: np.zeros((1, 3)) for n in ("RASIS", "LASIS")}
    points = {n: p + np.array([0.0, 0.0, 0.1 if n[0] == "R" else -0.1]) for n, p in points.items()}
    factors, notes = open_axes({"pelvis": (1.3,) * 3}, [points], points)
    assert factors["pelvis"] == pytest.approx((1.3, 1.3, 1.0))
    assert notes == ("MB: pelvis: depth and height not measured: as its mean factor",)


def test_a_set_up_says_its_own_axes(broad: Person) -> None:
    setup = ScaleSetup(
        measurements=(),
        manual={},
        order=("measurements",),
        time_range=None,
        preserve_mass_distribution=True,
        mass_kg=None,
        placement=None,
    )
    with pytest.raises(SubjectInvalid, match="scale_setup"):
        scale_linearly(replace(broad.session, scale_setup=setup), OPEN)


def test_the_fit_finds_lengths_and_breadths_without_noise() -> None:
    factors = {"femur_r": (1.02, 1.06, 0.98), "tibia_r": (1.01, 0.97, 1.05), "pelvis": (1.0, 1.04, 1.0)}
    known = person(33, factors=factors)
    ones = dict.fromkeys(known.truth.segment_names, (1.0, 1.0, 1.0))
    start = Calibration(
        method="MB", model=known.session.model, generic=known.session.model, scale_factors=ones
    )
    found = calibrate(known.session, "MB_lam", OPEN, {"MB": start})
    assert found.cost < 1e-14
    sure = {p.name: p.value for p in found.parameters if p.identifiable and p.group == "length"}
    assert {"scale.femur_r.y", "scale.tibia_r.y"} <= set(sure)
    for name, value in sure.items():
        _, segment, axis = name.split(".")
        true = factors.get(segment, (1.0, 1.0, 1.0))["xyz".index(axis)]
        assert value == pytest.approx(true, abs=1e-5), name
    assert found.scale_factors["femur_r"][1] == pytest.approx(1.06, abs=1e-5)


def test_factors_of_a_fit() -> None:
    values = {"scale.a": 1.1, "scale.b.y": 1.2, "scale.b.z": 1.0}
    assert read_fitted_factor(values, "a") == (1.1, 1.1, 1.1)
    assert read_fitted_factor(values, "b") == pytest.approx((1.1, 1.2, 1.0))
    assert read_fitted_factor(values, "c") == (1.0, 1.0, 1.0)


def test_a_real_hip_lies_nearer_to_the_experts(shared_data: Path, tmp_path: Path) -> None:
    """A young patient's pelvis, deep for its breadth, with the hip centre from images."""
    folder = shared_data / "jia_mri"
    rows = (folder / "image_markers.csv").read_text(encoding="utf-8").splitlines()[1:]
    at = {row.split(",")[0]: np.array(row.split(",")[2:], dtype=float) / 1e3 for row in rows}
    frame = build_pelvis_frame(*(at[name] for name in ("RASI", "LASI", "RPSI", "LPSI")))
    expert = json.loads((folder / "reference_joints.json").read_text(encoding="utf-8"))["manual"]["hip_r"]
    true = frame.to_local(np.array(expert["centre_mm"]) / 1e3)[0]
    content = {
        "subject": {"id": "patient"},
        "model": "lower_limb_14dof",
        "trials": {"static": str(folder / "Static.c3d"), "calibration": [str(folder / "Walking02.c3d")]},
    }
    subject = load_subject(write_subject(tmp_path, content))
    session = load(subject, read_files(subject)).session
    off = {}
    for scaling in ("uniform", "per-axis"):
        model = calibrate(session, "MB", CalibrationSettings(scaling=scaling)).model
        off[scaling] = float(np.linalg.norm(np.subtract(find_joint_centres(model)["hip_r"][1], true)))
    assert off["per-axis"] < 0.75 * off["uniform"]
    assert off["per-axis"] < 0.0123 + 0.0059  # Harrington against CT (Mantovani 2016): mean and one SD


@pytest.mark.skipif(find_spec("opensim") is None, reason="the opensim library is not installed")
def test_an_opensim_model_is_written_with_its_axes(shared_data: Path, tmp_path: Path) -> None:
    folder = shared_data / "opencap_squat"
    content = {
        "subject": {"id": "squat"},
        "model": str(folder / "unscaled_generic.osim"),
        "trials": {
            "static": str(folder / "static1.trc"),
            "calibration": [str(folder / "squats1.trc")],
        },
    }
    results = scale(write_subject(tmp_path, content), "MB_lam", Settings(calibration=OPEN))
    save(results, tmp_path / "out")
    written = json.loads((tmp_path / "out" / "MB_lam" / "scaling.json").read_text(encoding="utf-8"))
    assert "model.osim" in written["files"]
    assert len(set(written["scale_factors"]["pelvis"])) == 3
    assert written["settings"]["calibration"]["scaling"] == "per-axis"
