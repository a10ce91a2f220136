"""Knees with more freedom through calibration, comparison and files."""

from __future__ import annotations

import json
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest

from scaling_service.capabilities.motion.inverse_kinematics import inverse_kinematics
from scaling_service.capabilities.scaling.methods.table import METHODS, calibrate
from scaling_service.capabilities.scaling.result import Results
from scaling_service.capabilities.scaling.run import compare
from scaling_service.capabilities.scaling.saving import save
from scaling_service.capabilities.shared.settings import CalibrationSettings, Settings
from scaling_service.core.errors import SubjectInvalid
from scaling_service.files.osim.models import read_osim
from scaling_service.files.sto import read_sto
from scaling_service.model.builtin import load_builtin
from scaling_service.model.compile import repeat_default_pose
from scaling_service.model.parameters import KneeKind, with_knee
from scaling_service.model.subject import Session, Subject
from scaling_service.recording.settings import ProcessingSettings
from tests.calibration.people import imaged, movement, person, trial
from tests.jobs.laboratory import laboratory

ADDED = ("knee_adduction", "knee_rotation")
SPHERICAL = CalibrationSettings(knee="spherical")


def loose(seed: int, kind: KneeKind = "spherical", seconds: float = 5.0) -> Session:
    """A person whose knees turn in three ways, recorded without any fault."""
    rng = np.random.default_rng(seed)
    generic = load_builtin("lower_limb_14dof")
    truth = with_knee(generic, kind)
    trials = {}
    for name in ("hips", "walk"):
        q = repeat_default_pose(truth, int(100 * seconds))
        plain = movement(generic, len(q), rng)
        for k, coordinate in enumerate(truth.coordinate_names):
            if coordinate in generic.coordinate_names:
                q[:, k] = plain[:, generic.coordinate_names.index(coordinate)]
            else:
                q[:, k] = 0.12 * np.sin(np.linspace(0.0, rng.uniform(10.0, 30.0), len(q)))
        trials[name] = trial(truth, name, q, 0.0, rng)
    standing = trial(truth, "static", repeat_default_pose(truth, 20), 0.0, rng)
    moving = [trials[name] for name in ("hips", "walk")]
    return Session(
        subject=Subject(id="P", model=generic.name),
        model=generic,
        static=standing,
        calibration=(moving[0],),
        evaluation=(moving[1],),
    )


@pytest.mark.parametrize("method", sorted(METHODS))
@pytest.mark.parametrize("kind", ["universal", "spherical"])
def test_every_method_takes_the_knee_that_was_chosen(method: str, kind: KneeKind) -> None:
    known = person(41, shift_m=0.005, noise_m=0.001, seconds=3.0)
    images = imaged(known, dict.fromkeys(("knee_r", "knee_l"), (0.0, 0.0, 0.0)))
    found = calibrate(replace(known.session, images=images), method, CalibrationSettings(knee=kind))
    expected = with_knee(known.session.model, kind)
    assert found.model.coordinate_names == expected.coordinate_names
    assert found.generic == expected
    axes = [p.name for p in found.parameters if p.group == "axis"]
    fitted = METHODS[method].needs is not None and method != "EB"
    assert bool(axes) == (fitted and kind == "universal")  # a ball has no axis to be found
    assert bool(found.axis_tilts) == (bool(axes) or method in ("EB", "EB_am", "MAP"))  # an image shows axes


def test_a_loose_knee_is_followed_and_a_hinge_cannot() -> None:
    session = loose(42)
    errors = {}
    for kind in ("hinge", "spherical"):
        found = calibrate(session, "MB", CalibrationSettings(knee=kind))
        motion = inverse_kinematics(found.model, session.evaluation[0])
        errors[kind] = float(np.nanmean(motion.distances))
    assert errors["spherical"] < 0.25 * errors["hinge"]


def test_known_knee_angles_come_back() -> None:
    session = loose(43)
    model = with_knee(session.model, "spherical")
    motion = inverse_kinematics(model, session.evaluation[0])
    assert float(motion.distances.max()) < 1e-7
    turned = motion.q[:, motion.coordinates.index("knee_rotation_l")]
    assert np.abs(turned).max() == pytest.approx(0.12, abs=2e-3)
    assert set(motion.estimated) == set(model.coordinate_names)


def test_an_opensim_model_keeps_its_knee() -> None:
    session = person(44, seconds=1.0).session
    session = replace(session, subject=replace(session.subject, model="/somewhere/generic.osim"))
    with pytest.raises(SubjectInvalid, match="keeps its own knee"):
        calibrate(session, "MB", SPHERICAL)


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> tuple[Results, Path]:
    folder = tmp_path_factory.mktemp("knees")
    settings = Settings(calibration=SPHERICAL, processing=ProcessingSettings(smoothing="none"))
    results = compare(laboratory(folder), ("MB", "MB_am"), settings)
    save(results, folder / "out")
    return results, folder / "out"


def test_the_motion_files_hold_the_new_angles(written: tuple[Results, Path]) -> None:
    results, out = written
    table = read_sto(out / "MB_am" / "walk_ik.mot")
    for name in (f"{a}_{s}" for a in ADDED for s in "rl"):
        motion = results.scalings["MB_am"].motions["walk"]
        ours = motion.q[:, motion.coordinates.index(name)]
        np.testing.assert_allclose(table.column(name), np.degrees(ours), atol=1e-5)
    settings = json.loads((out / "comparison.json").read_text(encoding="utf-8"))["settings"]
    assert settings["calibration"]["knee"] == "spherical"


@pytest.mark.skipif(find_spec("opensim") is None, reason="the opensim library is not installed")
def test_opensim_reads_the_new_knees(written: tuple[Results, Path]) -> None:
    results, out = written
    model = read_osim(out / "MB_am" / "model.osim")
    assert set(model.coordinate_names) == set(results.scalings["MB_am"].calibration.model.coordinate_names)
