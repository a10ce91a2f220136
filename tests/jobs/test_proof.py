"""A look at files before anything is computed, on recordings whose truth is known."""

from __future__ import annotations

import json
import shutil
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from scaling_service.capabilities.intake.result import ProofDocument
from scaling_service.capabilities.intake.roles import recognise_bone
from scaling_service.capabilities.intake.run import prove, prove_folder
from scaling_service.capabilities.scaling.run import scale
from scaling_service.capabilities.shared.settings import Settings
from scaling_service.capabilities.subject.reading import load_subject
from scaling_service.core.arrays import Array
from scaling_service.core.notes import LOOK
from scaling_service.documents.base import ArrayEntry
from scaling_service.files.recording import read_recording
from scaling_service.files.trc import write_trc
from scaling_service.model.builtin import load_builtin
from scaling_service.model.document import to_document
from scaling_service.recording.identity import identify
from scaling_service.recording.identity.body import StandingBody, propose_standing_bodies
from tests.jobs.force_laboratory import force_laboratory
from tests.jobs.laboratory import R_OURS_LAB, known_person, laboratory, write_recording

pytestmark = pytest.mark.usefixtures("known_bodies")

BARE = {"subject": {"id": "S01", "sex": "F", "height_m": 1.7, "mass_kg": 62.0}}
HOSTILE = "<img src=x onerror=alert(1)>"


def proof(folder: Path, document: Mapping[str, Any] = BARE, **options: Any) -> ProofDocument:
    return prove(folder, document, folder.parent / "out", skip=("S01.yaml",), **options)


def table(folder: Path, entry: ArrayEntry) -> Array:
    content = np.fromfile(folder.parent / "out" / entry.file, dtype="<f4").reshape(entry.shape)
    return content.astype(float)


@pytest.fixture
def lab(tmp_path: Path) -> Path:
    """Recordings of a known person, in a laboratory with z up who faces -y."""
    folder = tmp_path / "lab"
    folder.mkdir()
    laboratory(folder)
    return folder


def test_files_get_their_places_and_the_proposal_can_be_scaled(lab: Path) -> None:
    found = proof(lab)
    assert {f.name: f.role for f in found.files} == {
        "hips.trc": "trials.calibration",
        "standing.trc": "trials.static",
        "walk.trc": "trials.evaluation",
    }
    assert found.problems == []
    file = lab / "proposed.json"
    file.write_text(json.dumps(found.proposal), encoding="utf-8")
    assert scale(file, "MB").scalings["MB"].errors["walk"].mean < 0.02


def test_the_standing_person_is_identified_once(lab: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Though a label that drifts through the room leaves open whose it is."""
    for file in lab.glob("*.trc"):
        trial = read_recording(file).trial
        way = np.linspace(0.1, 1.0, trial.n_frames)[:, None, None]
        more = np.concatenate([trial.markers, trial.markers.mean(axis=1, keepdims=True) + way], axis=1)
        write_trc(file, replace(trial, labels=(*trial.labels, "ODD"), markers=more))
    seen: list[int] = []

    def count(points: Array, **known: Any) -> list[StandingBody]:
        seen.append(len(points))
        return propose_standing_bodies(points, **known)

    monkeypatch.setattr(identify, "propose_standing_bodies", count)
    found = proof(lab)
    assert [one.label for one in found.extra_markers] == ["ODD"]
    assert "extra_markers" not in (found.proposal or {})
    assert seen == [15]


def test_axes_and_positions_are_those_of_the_truth(lab: Path) -> None:
    found = proof(lab)
    assert found.axes is not None
    assert (found.axes.up, found.axes.forward, found.axes.sure) == ("+z", "-y", True)
    assert np.array_equal(found.axes.R_new_old, R_OURS_LAB)
    walk = next(r for r in found.recordings if r.name == "walk")
    truth = known_person().session.evaluation[0]
    assert walk.markers.shape == [truth.n_frames, len(truth.labels), 3]
    assert np.allclose(table(lab, walk.markers), truth.markers, atol=1e-6)  # float32 of some metres
    assert (walk.unit, walk.format, walk.rate_hz) == ("mm", "TRC", truth.rate_hz)


def test_gaps_are_reported_as_intervals(lab: Path) -> None:
    truth = known_person().session.evaluation[0]
    holed = truth.markers.copy()
    column = truth.index("RLFE")
    holed[3:8, column] = holed[20, column] = holed[-4:, column] = np.nan
    write_recording(lab / "walk.trc", replace(truth, markers=holed))
    walk = next(r for r in proof(lab).recordings if r.name == "walk")
    knee = next(e for e in walk.labels if e.label == "S01:RKNE")
    n = truth.n_frames
    assert knee.gaps == [(3, 7), (20, 20), (n - 4, n - 1)]
    assert knee.longest_gap_s == pytest.approx(5 / truth.rate_hz)
    assert knee.seen == pytest.approx(1 - 10 / n, abs=1e-4)
    assert np.array_equal(np.isnan(table(lab, walk.markers)[:, column, 0]), np.isnan(holed[:, column, 0]))


def test_labels_are_proposed_with_their_reasons(lab: Path) -> None:
    by_marker = {m.marker: m for m in proof(lab).markers}
    assert (by_marker["RLFE"].label, by_marker["RLFE"].why) == ("S01:RKNE", "known alias")
    assert (by_marker["RMFE"].confidence, by_marker["RMFE"].source) == (1.0, "name")
    assert by_marker["RLFE"].confidence < by_marker["RMFE"].confidence


def renamed(lab: Path, label: str) -> None:
    """The outer right knee marker under a label that says nothing."""
    for name in ("standing", "hips", "walk"):
        text = (lab / f"{name}.trc").read_text(encoding="utf-8")
        (lab / f"{name}.trc").write_text(text.replace("S01:RKNE", label), encoding="utf-8")


@pytest.mark.parametrize("label", ["M7", HOSTILE])
def test_an_unknown_label_is_found_by_its_place(lab: Path, label: str) -> None:
    renamed(lab, label)
    found = proof(lab)
    knee = next(m for m in found.markers if m.marker == "RLFE")
    assert (knee.label, knee.source) == (label, "place")
    assert 0.5 < knee.confidence < 1.0
    assert "moves with the right thigh" in (knee.why or "")
    assert found.proposal is not None
    assert found.proposal["markers"] == {"RLFE": label}


def test_a_label_known_to_mean_something_else_is_no_landmark(lab: Path) -> None:
    renamed(lab, "S01:RSTL")  # the sustentaculum tali in the sets that are known, wherever it stands
    knee = next(m for m in proof(lab).markers if m.marker == "RLFE")
    assert knee.label is None


def test_the_laboratorys_map_is_followed(lab: Path) -> None:
    renamed(lab, "M7")
    found = proof(lab, labels={"M7": "RLFE", "never seen": "LLFE"})
    knee = next(m for m in found.markers if m.marker == "RLFE")
    assert (knee.label, knee.source) == ("M7", "laboratory")
    assert found.proposal is not None
    assert found.proposal["markers"] == {"RLFE": "M7"}
    assert found.problems == []


def test_the_document_outweighs_the_laboratorys_map(lab: Path) -> None:
    renamed(lab, "M7")
    document = {**BARE, "markers": {"RLFE": "M7"}}
    found = proof(lab, document, labels={"M7": "LLFE"})
    assert next(m for m in found.markers if m.marker == "RLFE").source == "document"
    assert next(m for m in found.markers if m.marker == "LLFE").label == "LLFE"


def test_what_cannot_be_read_hides_nothing_of_the_rest(lab: Path) -> None:
    (lab / "broken.c3d").write_bytes(b"\x02\x50" + b"\xff" * 4096)
    (lab / "empty.trc").touch()
    (lab / "femur_r.stl").write_bytes(b"no surface")
    (lab / "notes.txt").write_text("later", encoding="utf-8")
    found = proof(lab)
    problems = {f.name: f.problem for f in found.files if f.problem is not None}
    assert set(problems) == {"broken.c3d", "empty.trc", "femur_r.stl"}
    assert all(p.remedy and p.file == name for name, p in problems.items())
    assert [r.name for r in found.recordings] == ["hips", "standing", "walk"]
    assert found.proposal is not None
    assert "bones" not in found.proposal
    assert next(f for f in found.files if f.name == "notes.txt").kind == "other"


def test_a_document_that_names_an_absent_file_is_reported(lab: Path) -> None:
    document = {**BARE, "model": "lower_limb_14dof", "trials": {"static": "other.trc"}}
    found = proof(lab, document)
    assert found.problems[0].field == "trials.static"
    assert found.problems[0].file == "other.trc"


def test_without_a_recording_there_is_nothing_to_propose(tmp_path: Path) -> None:
    (tmp_path / "empty").mkdir()
    found = proof(tmp_path / "empty")
    assert (found.proposal, found.axes, found.recordings) == (None, None, [])
    assert found.problems[0].severity == "error"


def test_axes_can_be_given(lab: Path) -> None:
    found = proof(lab, settings=Settings(up="+z", forward="+x"))
    assert found.axes is not None
    assert (found.axes.forward, found.axes.given) == ("+x", True)


def test_forces_go_to_the_recording_of_their_name(tmp_path: Path) -> None:
    folder = tmp_path / "lab"
    folder.mkdir()
    force_laboratory(folder)
    found = proof(folder)
    assert found.proposal is not None
    assert set(found.proposal["forces"]) <= {r.file for r in found.recordings}
    item = next(r for r in found.recordings if r.force is not None)
    assert item.force is not None
    force = table(folder, item.force)
    weight = np.nansum(force[:, :, 1], axis=1).mean()
    assert force.shape == (item.frames, len(item.plates), 3)
    assert 300.0 < weight < 1500.0  # N, of a grown person who sways
    assert [p.peak_N for p in item.plates] == pytest.approx(
        np.linalg.norm(force, axis=2).max(axis=0), abs=0.5
    )


def test_a_subject_file_among_the_files_is_followed(lab: Path) -> None:
    shutil.copy(lab / "S01.yaml", lab / "subject.yaml")
    text = (lab / "subject.yaml").read_text(encoding="utf-8").replace("walk.trc", "deep/walk.trc")
    text = text.replace("S01", "other")
    (lab / "subject.yaml").write_text(text, encoding="utf-8")
    found = proof(lab)
    assert next(f for f in found.files if f.name == "walk.trc").named
    assert found.proposal is not None
    assert found.proposal["trials"]["evaluation"] == ["walk.trc"]
    assert found.proposal["subject"] == {"id": "S01", "sex": "F", "height_m": 1.7, "mass_kg": 62.0}


def test_a_whole_document_outweighs_a_subject_file(lab: Path) -> None:
    shutil.copy(lab / "S01.yaml", lab / "subject.yaml")
    document = {**BARE, "model": "lower_limb_14dof", "trials": {"static": "standing.trc"}}
    found = proof(lab, document)
    assert found.proposal == document
    assert next(f for f in found.files if f.name == "walk.trc").role is None


@pytest.mark.parametrize(
    ("name", "bone"),
    [
        ("Femur_R.stl", "femur_r"),
        ("leftTibia.ply", "tibia_l"),
        ("pelvis.obj", "pelvis"),
        ("femur.stl", None),
        ("L_Talus.stl", "talus_l"),
    ],
)
def test_bones_are_known_by_their_names(name: str, bone: str | None) -> None:
    assert recognise_bone(name) == bone


def test_a_segmentation_is_the_persons_bones_unless_surfaces_are_there(lab: Path) -> None:
    nibabel = pytest.importorskip("nibabel")
    labels = nibabel.Nifti1Image(np.ones((4, 5, 6), dtype=np.uint8), np.eye(4))
    nibabel.save(labels, lab / "labels.nii.gz")
    (lab / "labels.json").write_text('{"femur_r": 1}', encoding="utf-8")
    found = proof(lab)
    assert (
        next(f for f in found.files if f.name == "labels.json").why
        == "the names of the labels in labels.nii.gz"
    )
    told = next(f for f in found.files if f.name == "labels.nii.gz")
    assert (told.kind, told.role) == ("segmentation", "bones.segmentation")
    assert found.proposal is not None
    assert found.proposal["bones"] == {"segmentation": "labels.nii.gz", "units": "mm"}
    (lab / "labels.nii.gz").write_bytes(b"no image")
    broken = next(f for f in proof(lab).files if f.name == "labels.nii.gz")
    assert broken.role is None
    assert broken.problem is not None
    assert "NIfTI" in broken.problem.problem


def test_two_standing_recordings_are_not_both_taken(lab: Path) -> None:
    session = known_person().session
    assert session.static is not None
    write_trc(lab / "static 2.trc", replace(session.static, markers=session.static.markers + 0.01))
    found = proof(lab)
    assert sorted(f.role or "" for f in found.files if "sta" in f.name) == ["", "trials.static"]


def test_every_warning_of_loading_says_what_to_do(lab: Path) -> None:
    session = known_person().session
    walk = session.evaluation[0]
    markers = walk.markers.copy()
    knees = [walk.index("RLFE"), walk.index("RMFE")]
    n = walk.n_frames
    markers[n // 3 : n // 2, knees] = markers[n // 3 : n // 2, knees[::-1]]
    markers[5, walk.index("LASIS")] += 100.0
    markers[:, walk.index("RFH")] = np.nan
    write_recording(lab / "walk.trc", replace(walk, markers=markers))
    document = {
        **BARE,
        "model": "lower_limb_14dof",
        "trials": {"static": "standing.trc", "calibration": ["hips.trc", "walk.trc"]},
        "extra_markers": {"NONE": "femur_r"},
    }
    found = [p for p in proof(lab, document).problems if p.severity == "warning"]
    reported = " ".join(p.problem for p in found)
    for word in ("evaluation", "NONE", "RFH", "look exchanged", "than usual"):
        assert word in reported
    assert all(p.remedy and p.remedy != LOOK for p in found)


def test_a_model_that_this_program_wrote_is_taken_where_there_is_no_other(tmp_path: Path) -> None:
    laboratory(tmp_path)
    (tmp_path / "S01.yaml").unlink()
    (tmp_path / "model.json").write_text(
        json.dumps(to_document(load_builtin("lower_limb_14dof"))), encoding="utf-8"
    )
    found = prove_folder(tmp_path, tmp_path / "looked")
    assert next(file.role for file in found.files if file.name == "model.json") == "model"
    subject = load_subject(tmp_path / "looked" / "subject.yaml")
    assert subject.model == str(tmp_path / "looked" / ".." / "model.json")
