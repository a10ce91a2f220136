"""Tracking markers that sit on another segment than their name or the subject file says."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from scaling_service.capabilities.intake.run import prove
from scaling_service.capabilities.subject.loading import Loaded, load, read_files
from scaling_service.capabilities.subject.reading import load_subject
from scaling_service.core.arrays import Array
from scaling_service.model.trial import Trial
from scaling_service.numerics.multibody.rigid import fit_rigid
from tests.jobs.laboratory import document, known_person, write_recording, write_subject

SHANK, THIGH = ("RFH", "RLM", "RMM"), ("RASIS", "RLFE", "RMFE")


def write_with(folder: Path, label: str, of: tuple[str, ...], at: Array, **changes: object) -> Path:
    """A laboratory with one more label, which keeps its place to three others; its subject file.

    ``at``: (3,), how much of each of the three there is in its place.
    """
    session = known_person(4.0).session
    standing = session.static
    assert standing is not None
    places = np.array([standing.position(name).mean(axis=0) for name in of])
    place = at @ places

    def carry(trial: Trial) -> Trial:
        R, shift = fit_rigid(places, np.stack([trial.position(name) for name in of], axis=1))
        path = (R @ place + shift)[:, None]
        return replace(
            trial, labels=(*trial.labels, label), markers=np.concatenate([trial.markers, path], axis=1)
        )

    for name, trial in (
        ("standing", standing),
        ("hips", session.calibration[0]),
        ("walk", session.evaluation[0]),
    ):
        write_recording(folder / f"{name}.trc", carry(trial))
    return write_subject(folder, document(**changes))


def load_all(file: Path) -> Loaded:
    subject = load_subject(file)
    return load(subject, read_files(subject))


MIDDLE = np.array([0.6, 0.3, 0.1])


@pytest.mark.parametrize("said", [{"RTHI": "femur_r"}, None])
def test_a_thigh_marker_that_moves_with_the_shank_is_told(tmp_path: Path, said: object) -> None:
    loaded = load_all(write_with(tmp_path, "RTHI", SHANK, MIDDLE, extra_markers=said))
    (note,) = [note for note in loaded.session.notes if note.code == "elsewhere"]
    assert note.place == "RTHI"
    assert "right tibia" in note.problem
    assert ("RTHI" in loaded.session.subject.extra_markers) == (said is not None)


@pytest.mark.parametrize(("label", "of", "segment"), [("RTIB", SHANK, "tibia_r"), ("RTHI", THIGH, "femur_r")])
def test_a_marker_where_the_subject_file_says_is_not_told(
    tmp_path: Path, label: str, of: tuple[str, ...], segment: str
) -> None:
    loaded = load_all(write_with(tmp_path, label, of, MIDDLE, extra_markers={label: segment}))
    assert [note for note in loaded.session.notes if note.code == "elsewhere"] == []


def test_a_look_proposes_the_segment_that_it_moves_with(tmp_path: Path) -> None:
    (tmp_path / "lab").mkdir()
    write_with(tmp_path / "lab", "RTHI", SHANK, MIDDLE)
    (tmp_path / "lab" / "S01.yaml").unlink()
    found = prove(tmp_path / "lab", {"subject": {"id": "S01"}}, tmp_path / "out")
    (extra,) = [one for one in found.extra_markers if one.label == "RTHI"]
    assert extra.segment == "tibia_r"
