"""Dynamics of subject files: real recordings, and a person of known inertia."""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from scaling_service.capabilities.dynamics.result import DynamicsResults
from scaling_service.capabilities.dynamics.run import dynamics
from scaling_service.capabilities.dynamics.saving import save_dynamics
from scaling_service.capabilities.dynamics.settings import DynamicsSettings
from scaling_service.capabilities.dynamics.start import prepare
from scaling_service.capabilities.kinetics.forces import prepare_forces
from scaling_service.capabilities.shared.settings import UNSMOOTHED
from scaling_service.capabilities.subject.loading import open_subject
from scaling_service.core.errors import TrialUnusable
from scaling_service.files.osim.models import read_osim
from scaling_service.model.builtin import load_builtin
from scaling_service.model.forces import GroundForces
from scaling_service.model.inertia import gather_inertias, sum_mass, with_inertias
from scaling_service.model.trial import Repair
from scaling_service.recording.orientation import Orientation
from scaling_service.virtual.plates import record_on_plates
from tests.calibration.forced import other_person
from tests.jobs.force_laboratory import document, force_laboratory, write_subject
from tests.jobs.recorded import walker_document

UP = np.array([[0.0, 1.0, 0.0]])
AS_GIVEN = DynamicsSettings(start="none")
OPENSIM = pytest.mark.skipif(find_spec("opensim") is None, reason="the opensim library is not installed")


def subject_of(folder: Path, **content: Any) -> Path:
    return write_subject(folder, content)


@OPENSIM
def test_a_squat_leaves_the_residual_that_opensim_leaves(shared_data: Path, tmp_path: Path) -> None:
    """OpenSim's inverse kinematics and dynamics on it, filtered at 6 Hz, leave 11, 26 and 4 N (RMS)."""
    data = shared_data / "opencap_squat"
    file = subject_of(
        tmp_path,
        subject={"id": "squat", "height_m": 1.68},
        model=str(data / "manually_scaled.osim"),
        trials={"calibration": [str(data / "squats1.trc")]},
        forces={"squats1.trc": str(data / "squats1_grf.mot")},
    )
    found = dynamics(file, DynamicsSettings(start="none", cutoff_hz=6.0))
    squat = found.trials["squats1"]
    # Rounded to 1 N, and the markers followed by another program with other weights.
    np.testing.assert_allclose(squat.residuals.rms[:3], [11, 26, 4], rtol=0, atol=2.0)
    assert found.prepared.inertia == "model"
    assert sum_mass(found.prepared.model) == pytest.approx(62.6, abs=0.01)
    contacts = [repair.detail for repair in squat.forces.contacts.repairs if repair.what == "plate_foot"]
    assert {detail.partition(" from ")[0] for detail in contacts} == {
        f"bears the {s} foot" for s in ("right", "left")
    }


@OPENSIM
def test_an_opensim_model_takes_the_identified_inertia(shared_data: Path, tmp_path: Path) -> None:
    data = shared_data / "gait2354"
    file = subject_of(
        tmp_path,
        subject={"id": "gait", "height_m": 1.803},
        model=str(data / "gait2354_simbody.osim"),
        marker_set=str(data / "gait2354_Scale_MarkerSet.xml"),
        trials={"calibration": [str(data / "subject01_walk1.trc")]},
        forces={"subject01_walk1.trc": str(data / "subject01_walk1_grf.mot")},
    )
    chosen = DynamicsSettings(
        start="none", cutoff_hz=6.0, identify=True, free_mass=True, despite_verdict=True
    )
    found = dynamics(file, chosen)
    assert found.inertial is not None
    save_dynamics(found, tmp_path / "out", report=False)
    written = gather_inertias(read_osim(tmp_path / "out" / "model.osim"))
    expected = gather_inertias(found.inertial.model)
    np.testing.assert_allclose(written.mass, expected.mass, atol=1e-9)
    np.testing.assert_allclose(written.com, expected.com, atol=1e-9)
    np.testing.assert_allclose(written.tensor, expected.tensor, atol=1e-9)


@OPENSIM
def test_walking_over_plates_and_beside_them(shared_data: Path, tmp_path: Path) -> None:
    """The second left step lies beside the plates: its frames do not count."""
    data = shared_data / "rajagopal_walk"
    file = subject_of(
        tmp_path,
        subject={"id": "walk", "height_m": 1.829, "mass_kg": 85.07},
        model=str(data / "Rajagopal2016.osim"),
        marker_set=str(data / "markerset_walk_preScale.xml"),
        scale_setup=str(data / "scale_setup_walk_scaleOnly.xml"),
        trials={
            "static": str(data / "static_walk_1.trc"),
            "evaluation": [str(data / "motion_capture_walk.trc")],
        },
        forces={"motion_capture_walk.trc": str(data / "grf_walk.mot")},
    )
    found = dynamics(file, DynamicsSettings(start="MB"))
    walk = found.trials["motion_capture_walk"]
    assert 0.25 < walk.residuals.left_out / len(walk.frames) < 0.45
    assert (walk.residuals.dr[:3] < 0.05).all()
    assert (walk.residuals.dr[3:] < 0.02).all()
    assert any("stands beside the plates" in said for said in walk.warnings)


def test_plates_of_c3d_files_under_a_built_in_body(shared_data: Path, tmp_path: Path) -> None:
    """Both trials show that the plates bear some 4 kg more than the stated 63 kg."""
    content = walker_document(shared_data) | {"model": "full_body_35dof"}
    for key in ("bones", "image_markers", "extra_markers"):
        content.pop(key, None)
    content["subject"] |= {"sex": "F", "height_m": 1.62, "mass_kg": 63.0}
    chosen = DynamicsSettings(start="MB", identify=True, free_mass=True, despite_verdict=True)
    found = dynamics(write_subject(tmp_path, content), chosen)
    assert found.prepared.inertia == "dumas2007"
    assert sum_mass(found.prepared.model) == pytest.approx(63.0, abs=1e-6)
    for trial in found.trials.values():
        assert 0.05 < trial.residuals.dr[1] < 0.10
        assert trial.forces.source.suffix == ".c3d"
    assert found.inertial is not None
    assert found.inertial.relative_error(held_out=True) < 0.8
    assert 65.0 < sum_mass(found.inertial.model) < 69.0


@pytest.fixture(scope="module")
def stranger(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, np.ndarray]:
    """A person who is 5 kg heavier in the trunk than the model says."""
    inertias = gather_inertias(load_builtin("full_body_35dof"))
    mass = inertias.mass.copy()
    mass[load_builtin("full_body_35dof").segment_names.index("torso")] += 5.0
    person = with_inertias(
        load_builtin("full_body_35dof"), type(inertias)(mass, inertias.com, inertias.tensor)
    )
    folder = tmp_path_factory.mktemp("stranger")
    return force_laboratory(folder, truth=person, noise_m=2e-4), mass


def identified(file: Path, **more: bool) -> DynamicsResults:
    return dynamics(file, DynamicsSettings(start="none", identify=True, **more))


def test_a_heavy_trunk_is_found_where_the_verdict_allows_it(stranger: tuple[Path, np.ndarray]) -> None:
    file, mass = stranger
    found = identified(file, free_mass=True)
    assert found.trials["sway"].uncertainty.calibration_supported[1]
    assert found.inertial is not None
    assert {fit.trial: fit.held_out for fit in found.inertial.fits} == {"sway": False, "swing": True}
    assert found.inertial.relative_error(held_out=True) < 0.5
    assert sum_mass(found.inertial.model) == pytest.approx(mass.sum(), abs=1.0)


def test_a_scaled_model_takes_the_inertia_of_a_table(tmp_path: Path) -> None:
    file = force_laboratory(tmp_path, truth=other_person(1)[0])
    content = document(trials={"static": "sway.trc", "calibration": ["sway.trc"]})
    content["forces"].pop("swing.trc")
    chosen = DynamicsSettings(start="MB", inertia="deleva1996")
    prepared = prepare(open_subject(write_subject(file.parent, content), UNSMOOTHED), chosen)
    assert (prepared.start, prepared.inertia) == ("MB", "deleva1996")
    assert prepared.calibration is not None
    assert sum_mass(prepared.model) == pytest.approx(content["subject"]["mass_kg"], abs=1e-6)


def test_plates_of_a_file_with_a_wrong_unit_are_not_used() -> None:
    """The corners of the plates have the unit of the markers, which was found to be wrong."""
    person = record_on_plates()
    repaired = person.trial.with_markers(
        person.trial.markers,
        Repair("unit", person.trial.name, "positions said to be in m are in mm", frames=250),
    )
    plate = np.zeros((len(person.trial.times), 1, 3))
    forces = GroundForces(
        name="sway",
        times=person.trial.times,
        plates=("plate_1",),
        force=plate,
        moment=plate,
        surfaces=np.zeros((1, 3)),
        normals=UP,
    )
    axes = Orientation(np.eye(3))
    with pytest.raises(TrialUnusable, match="places of its plates are not sure") as caught:
        prepare_forces(Path("sway.c3d"), forces, repaired, {}, axes, cutoff_hz=5.0)
    assert (caught.value.file, caught.value.field) == ("sway.c3d", "POINT:UNITS")


def test_choices_that_there_are_not() -> None:
    with pytest.raises(ValueError, match="there is no method 'MBB'"):
        DynamicsSettings(start="MBB")
    with pytest.raises(ValueError, match="there is no inertial table 'dumas'"):
        DynamicsSettings(inertia="dumas")
