"""The bank as files: nothing tells what is hidden, the same case is the same, readers read it."""

from __future__ import annotations

import json
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
import yaml

from scaling_service.documents.subject import SubjectDocument
from scaling_service.files.c3d import read_c3d
from scaling_service.files.forces import read_forces
from scaling_service.files.trc import read_trc
from scaling_service.recording.plates import compute_ground_forces
from tests.blind.cases import MOVEMENTS, PAIRS, SIZES, Case, checks, fast, full, real_angles
from tests.blind.clutter import NONE
from tests.blind.effects import EFFECTS
from tests.blind.make import main
from tests.blind.making import drawn, make, recorded
from tests.blind.real.angles import real_motion
from tests.blind.real.hiding import CASES as REAL
from tests.blind.real.make import case_id, make_real
from tests.blind.strangers import STRANGERS

CATALOGUE = [
    "marker_offset",
    "marker_swap",
    "soft_tissue_artefact",
    "skin_wobble",
    "segment_length",
    "joint_centre_offset",
    "joint_axis_tilt",
    "missing_dof",
    "coupled_motion",
    "capture_scale",
    "force_delay",
    "plate_position",
    "plate_bias",
    "plate_gain",
    "plate_rotation",
    "segment_mass",
    "segment_com",
    "carried_load",
    "external_contact",
    "wobbling_mass",
    "gravity_tilt",
]
"""Of the design, section 6."""


@pytest.fixture(scope="module")
def bank(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A case of each layout; all kinds are written by the command only, for time."""
    folder = tmp_path_factory.mktemp("bank")
    for case in (
        Case("effect", ("marker_swap",), "large", "varied", False, 0),
        Case("effect", ("carried_load",), "large", "varied", True, 1),
        Case("effect", ("force_delay",), "small", "gait", True, 0, c3d=True),
        Case("null", ("heavy_tailed",), "none", "gait", False, 0),
        Case("pair", PAIRS[0], "large", "gait", False, 0),
        Case("stranger", ("lens_distortion",), "large", "gait", False, 0),
    ):
        make(case, folder / "subjects", folder / "labels")
    return folder


def test_every_kind_of_the_catalogue_is_in_the_bank() -> None:
    assert sorted(EFFECTS) == sorted(CATALOGUE)
    cases = full()
    counted = [(c.kinds[0], c.size, c.movement) for c in cases if c.group == "effect"]
    for kind in CATALOGUE:
        for size in SIZES:
            for movement in MOVEMENTS:
                assert counted.count((kind, size, movement)) == 10
    assert sum(c.group == "null" for c in cases) == 500
    assert len(STRANGERS) >= 6
    assert {c.kinds for c in cases if c.group == "pair"} == set(PAIRS)
    everything = [*cases, *fast(), *real_angles(), *checks()]
    assert len({c.id for c in everything}) == len(set(everything))


def test_nothing_in_a_subjects_folder_tells_what_is_hidden(bank: Path) -> None:
    words = [*CATALOGUE, *STRANGERS, "hidden", "effect", "stranger"]
    for folder in (bank / "subjects").iterdir():
        assert (bank / "labels" / f"{folder.name}.json").is_file()
        kinds = {file.suffix for file in folder.iterdir()}
        assert kinds <= {".yaml", ".osim", ".trc", ".mot", ".c3d"}
        for file in folder.iterdir():
            text = f"{file.name} {file.read_bytes().decode('latin-1')}".lower()
            found = [word for word in words if word in text]
            assert not found, (file, found)


def test_labels_hold_kind_place_parameters_and_size(bank: Path) -> None:
    for file in (bank / "labels").glob("*.json"):
        truth = json.loads(file.read_text())
        assert bool(truth["hidden"]) == (truth["group"] != "null")
        assert set(truth["kinds"]) >= {thing["kind"] for thing in truth["hidden"]}


@pytest.mark.parametrize("kind", [*CATALOGUE, *STRANGERS])
def test_every_kind_is_drawn_with_a_place_of_its_body(kind: str) -> None:
    forces = {**EFFECTS, **STRANGERS}[kind].needs == "forces"
    for seed in range(4):
        group = "effect" if kind in EFFECTS else "stranger"
        _, body, (thing,) = drawn(Case(group, (kind,), "middle", "gait", forces, seed))
        places = {*body.marker_names, "forces", "markers", "world", "plate_1", "plate_2"}
        places |= {s.name for s in body.segments} | {s.joint for s in body.segments}
        assert set(thing.where) <= places
        assert set(thing.driver) <= set(body.coordinates)
        assert thing.parameters
        assert all(np.isfinite(v) for v in thing.parameters.values())
        json.dumps(thing.label())


def test_subject_files_hold_out_a_trial_and_are_valid(bank: Path) -> None:
    for file in (bank / "subjects").glob("*/subject.yaml"):
        document = SubjectDocument.model_validate(yaml.safe_load(file.read_text()))
        assert len(document.trials.files) >= 3
        assert document.trials.evaluation
        for name in (*document.trials.files, *document.forces.values(), document.model):
            assert (file.parent / name).is_file()


def test_a_case_is_the_same_again_and_in_any_order(tmp_path: Path) -> None:
    cases = [
        Case("effect", (kind,), "middle", "gait", kind == "plate_gain", 4)
        for kind in ("skin_wobble", "plate_gain")
    ]
    for folder, order in (("a", cases), ("b", cases[::-1])):
        for case in order:
            make(case, tmp_path / folder / "subjects", tmp_path / folder / "labels")
    files = sorted(p.relative_to(tmp_path / "a") for p in (tmp_path / "a").rglob("*") if p.is_file())
    assert len(files) > 10
    for file in files:
        assert (tmp_path / "a" / file).read_bytes() == (tmp_path / "b" / file).read_bytes()


def test_the_command_goes_on_where_it_stopped(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    arguments = ["--out", str(tmp_path), "--check", "--workers", "1"]
    assert main(arguments) == 0
    first = capsys.readouterr().out
    dates = {file: file.stat().st_mtime_ns for file in tmp_path.rglob("*.trc")}
    next((tmp_path / "labels").iterdir()).unlink()
    assert main(arguments) == 0
    changed = {file.parent for file, date in dates.items() if file.stat().st_mtime_ns != date}
    assert len(changed) == 1
    assert "4 of 4 cases written" in first


def test_larger_sizes_are_larger_and_other_seeds_are_other_persons() -> None:
    small, large = (
        drawn(Case("effect", ("plate_gain",), size, "gait", True, 0))[2][0] for size in ("small", "large")
    )
    assert abs(large.parameters["factor"] - 1) > 2 * abs(small.parameters["factor"] - 1)
    heights = {drawn(Case("null", ("white",), "none", "gait", False, seed))[0].height_m for seed in range(5)}
    assert len(heights) == 5


def test_opposed_effects_share_a_place_and_pull_apart() -> None:
    case = Case("opposed", ("marker_offset", "soft_tissue_artefact"), "large", "gait", False, 1)
    offset, artefact = drawn(case)[2]
    assert offset.where == artefact.where
    a = [offset.parameters[f"{axis}_mm"] for axis in "xyz"]
    b = [artefact.parameters[f"{axis}_mm_per_deg"] for axis in "xyz"]
    assert np.dot(a, b) == pytest.approx(-np.linalg.norm(a) * np.linalg.norm(b))


def test_files_read_as_they_were_recorded(tmp_path: Path) -> None:
    case = Case("check", ("nothing",), "none", "gait", True, 0)
    _, body, hidden = drawn(case)
    recording = recorded(case, body, hidden, NONE)[0]
    subject = make(case, tmp_path / "subjects", tmp_path / "labels")
    trial = read_trc(subject.parent / "gait_1.trc")
    assert trial.labels == recording.labels
    np.testing.assert_allclose(trial.markers, recording.markers, atol=0.6e-6)  # m: micrometres in the file
    assert not trial.repairs
    forces = read_forces(subject.parent / "gait_1_forces.mot")
    assert recording.plates is not None
    loaded = recording.plates.loaded[..., None]
    np.testing.assert_allclose(forces.force, np.where(loaded, recording.plates.force, 0.0), atol=1e-3)
    np.testing.assert_allclose(forces.moment, np.where(loaded, recording.plates.moment, 0.0), atol=2e-3)


def test_c3d_files_hold_the_same_wrench(tmp_path: Path) -> None:
    case = Case("effect", ("plate_gain",), "large", "varied", True, 0, c3d=True)
    _, body, hidden = drawn(case)
    recording = recorded(case, body, hidden)[0]
    subject = make(case, tmp_path / "subjects", tmp_path / "labels")
    assert not list(subject.parent.glob("*.mot"))
    file = subject.parent / "squat_1.c3d"
    trial = read_c3d(file)
    forces = compute_ground_forces(trial.plates)
    assert set(trial.labels) == set(recording.labels)
    order = [trial.labels.index(label) for label in recording.labels]
    np.testing.assert_allclose(trial.markers[:, order], recording.markers, atol=1e-6)
    assert recording.plates is not None
    n = len(recording.plates.times)
    np.testing.assert_allclose(forces.force[:n], recording.plates.force, atol=1e-3)  # N: 32-bit numbers
    np.testing.assert_allclose(forces.moment[:n], recording.plates.moment, atol=1e-2)


def test_real_angles_are_those_of_walking(shared_data: Path) -> None:
    motion = real_motion(0, "gait_1", np.random.default_rng(0), 5.0)
    knee = np.rad2deg(motion.column("knee_angle_r"))
    assert knee.min() == pytest.approx(2.8, abs=3.0)  # the recording's own extremes: 2.8 and 68.8 degrees
    assert knee.max() == pytest.approx(68.8, abs=3.0)
    assert np.abs(motion.qdd).max() < 500  # rad/s^2: smooth where the stride begins again


def test_real_cases_change_what_they_say(shared_data: Path, tmp_path: Path) -> None:
    named = {case.name: case for case in REAL}
    subjects = {
        name: make_real(named[name], shared_data, tmp_path) for name in ("as_recorded", "plate_withheld")
    }
    with_both, with_one = (read_forces(s.parent / "squats_2_forces.mot") for s in subjects.values())
    assert (len(with_both.plates), len(with_one.plates)) == (2, 1)
    np.testing.assert_array_equal(with_one.force[:, 0], with_both.force[:, 0])
    truth = json.loads((tmp_path / "labels" / f"{case_id(named['plate_withheld'])}.json").read_text())
    assert truth["hidden"][0]["kind"] == "external_contact"


@pytest.mark.skipif(find_spec("opensim") is None, reason="the opensim library is not installed")
@pytest.mark.costly
def test_the_product_agrees_where_nothing_is_hidden(tmp_path: Path) -> None:
    """Two engines, one body: inverse kinematics and dynamics find nothing in a recording without noise."""
    subject = make(
        Case("check", ("nothing",), "none", "gait", True, 0), tmp_path / "subjects", tmp_path / "labels"
    )
    # 15 Hz, above the movement's own 6 Hz: a filter at 5 Hz would take 0.5 mm and 10 N with it.
    command = [
        "dynamics",
        str(subject),
        "--start",
        "none",
        "--cutoff-hz",
        "15",
        "--out",
        str(tmp_path / "out"),
    ]
    done = subprocess.run(
        [sys.executable, "-m", "scaling_service", *command], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    result = json.loads((tmp_path / "out" / "dynamics.json").read_text())
    for trial in result["trials"].values():
        assert trial["reconstruction_error_mm"] < 0.1
        force = [trial["residual_rms"][f"f{a}_N"] for a in "xyz"]
        moment = [trial["residual_rms"][f"m{a}_Nm"] for a in "xyz"]
        assert max(force) < 4.0  # N: half a percent of the weight
        assert max(moment) < 2.0  # N m
