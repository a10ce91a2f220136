"""From a subject file to results, against the library's own parts and a known person."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from scaling_service.capabilities.motion.inverse_kinematics import inverse_kinematics
from scaling_service.capabilities.motion.kinematic_error import kinematic_error
from scaling_service.capabilities.scaling.methods.table import METHODS, calibrate
from scaling_service.capabilities.scaling.result import Results
from scaling_service.capabilities.scaling.run import compare, scale
from scaling_service.capabilities.shared.settings import Settings
from scaling_service.capabilities.subject.reading import load_subject
from scaling_service.core.errors import InputError, SubjectInvalid
from scaling_service.model.body import BodyModel
from scaling_service.model.builtin import load_builtin, load_generic_person
from tests.jobs.conftest import UNSMOOTHED
from tests.jobs.laboratory import document, laboratory, write_subject


def mass(model: BodyModel) -> float:
    return sum(segment.mass for segment in model.segments)


def test_all_methods_in_order_and_every_movement(results: Results) -> None:
    assert list(results.scalings) == [name for name in METHODS if not METHODS[name].needs_images]
    for scaling in results.scalings.values():
        assert list(scaling.errors) == list(scaling.motions) == ["hips", "walk"]


def test_results_are_those_of_the_parts(results: Results) -> None:
    session = results.session
    calibration = calibrate(session, "MB_am", results.settings.calibration)
    motion = inverse_kinematics(calibration.model, session.evaluation[0])
    ours = results.scalings["MB_am"]
    np.testing.assert_allclose(ours.motions["walk"].q, motion.q, rtol=0, atol=1e-9)
    assert ours.errors["walk"].mean == pytest.approx(
        kinematic_error(motion, calibration.model).mean, rel=1e-9
    )


def test_fitting_follows_the_movement_better(results: Results) -> None:
    errors = {method: scaling.errors["hips"].mean for method, scaling in results.scalings.items()}
    assert errors["MB_am"] < errors["MB"]
    assert errors["MB_am"] < 5e-4  # m: nothing but scaled segments and shifted markers is in these recordings


def test_one_method_alone_gives_the_same(results: Results, subject_file: Path) -> None:
    alone = scale(subject_file, "MB_lam", UNSMOOTHED)
    assert list(alone.scalings) == ["MB_lam"]
    assert (
        alone.scalings["MB_lam"].calibration.scale_factors
        == results.scalings["MB_lam"].calibration.scale_factors
    )


def test_a_loaded_subject_is_as_good_as_its_file(results: Results, subject_file: Path) -> None:
    other = scale(load_subject(subject_file), "MB", UNSMOOTHED)
    assert other.scalings["MB"].errors["walk"].mean == results.scalings["MB"].errors["walk"].mean
    assert other.subject_file is None


def test_a_built_in_model_takes_its_share_of_the_mass(results: Results) -> None:
    generic = load_builtin("lower_limb_14dof")
    share = mass(generic) / load_generic_person("lower_limb_14dof").mass_kg
    for scaling in results.scalings.values():
        assert mass(scaling.calibration.model) == pytest.approx(62.0 * share)


def test_without_a_mass_the_generic_one_stays(tmp_path: Path) -> None:
    file = laboratory(tmp_path, subject={"id": "S01"})
    model = scale(file, "MB").scalings["MB"].calibration.model
    assert mass(model) == pytest.approx(mass(load_builtin("lower_limb_14dof")))


def test_methods_that_the_recordings_do_not_allow_are_left_out(tmp_path: Path) -> None:
    laboratory(tmp_path)
    file = write_subject(tmp_path, document(trials={"static": "standing.trc", "evaluation": ["walk.trc"]}))
    results = compare(file)
    assert list(results.scalings) == ["MB", "MAP"]
    assert any("MB_am" in warning for warning in results.warnings)
    with pytest.raises(InputError) as caught:
        scale(file, "MB_am")
    assert caught.value.file == str(file)
    assert caught.value.field == "trials.calibration"


def test_an_unknown_method_is_refused_before_anything_is_read(tmp_path: Path) -> None:
    with pytest.raises(SubjectInvalid, match="no method 'MBam'") as caught:
        scale(tmp_path / "absent.yaml", "MBam")
    assert "MB_am" in (caught.value.remedy or "")


def test_recordings_without_the_models_markers_name_the_subject_file(tmp_path: Path) -> None:
    file = laboratory(tmp_path, model="squat_4dof")
    with pytest.raises(InputError) as caught:
        scale(file, "MB")
    assert caught.value.file is not None
    assert caught.value.remedy


def test_progress_only_grows_and_ends_at_one(subject_file: Path) -> None:
    shares: list[float] = []
    compare(subject_file, ("MB", "MB_am"), progress=lambda _, share: shares.append(share))
    assert shares == sorted(shares)
    assert shares[0] == 0.0
    assert shares[-1] == 1.0


def test_settings_are_resolved_for_the_record() -> None:
    resolved = Settings(up="+z").resolved()
    assert resolved["up"] == "+z"
    assert resolved["calibration"]["n_frames"] == 100
    assert resolved["processing"]["smoothing"] == "automatic"
    assert "seed" not in resolved
