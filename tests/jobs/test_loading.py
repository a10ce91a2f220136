"""Recordings in a laboratory's own axes, unit and names become the model's."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from scaling_service.capabilities.shared.settings import Settings
from scaling_service.capabilities.subject.axes import agree_on_axes
from scaling_service.capabilities.subject.files import read_files, read_model
from scaling_service.capabilities.subject.loading import load
from scaling_service.capabilities.subject.preparing import Loaded
from scaling_service.capabilities.subject.reading import load_subject
from scaling_service.core.errors import InputError, SubjectInvalid, blame_file
from scaling_service.files.trc import write_trc
from scaling_service.model.subject import Subject
from scaling_service.numerics.multibody.rigid import rotate_about
from scaling_service.recording.orientation import decide
from tests.jobs.conftest import UNSMOOTHED
from tests.jobs.laboratory import known_person, laboratory, write_recording


def load_all(subject: Subject, settings: Settings = Settings(), *, facing: bool = False) -> Loaded:
    return load(subject, read_files(subject), settings, facing=facing)


def test_axes_unit_and_names_are_found(subject_file: Path) -> None:
    loaded = load_all(load_subject(subject_file), UNSMOOTHED, facing=True)
    person = known_person().session
    assert loaded.axes == "up +z, forward -y"
    for ours, true in zip(
        (loaded.session.static, *loaded.session.dynamic), (person.static, *person.dynamic), strict=True
    ):
        assert ours is not None
        assert true is not None
        assert set(ours.labels) == set(true.labels)
        # TRC keeps 10 nm
        np.testing.assert_allclose(ours.select(true.labels).markers, true.markers, rtol=0, atol=2e-8)


def test_what_was_taken_for_what_is_reported(subject_file: Path) -> None:
    loaded = load_all(load_subject(subject_file))
    assert loaded.markers_used["RLFE"] == ("S01:RKNE",)
    assert loaded.markers_used["RFH"] == ("RFH",)
    session = loaded.session
    assert session.static is not None
    kinds = {repair.what for repair in session.static.repairs}
    assert {"up_axis", "forward_axis", "label"} <= kinds


@pytest.mark.parametrize("order", [1, -1])
def test_a_turn_counts_less_than_a_straight_walk(order: int) -> None:
    """Whichever stands first, and however many tie."""
    walk = known_person().session.evaluation[0]
    roles = {label: label for label in walk.labels}
    turned = walk.with_markers(walk.markers @ rotate_about([0.0, 1.0, 0.0], np.radians(55.0)).T)
    decided = {Path(t.name): decide(t, roles=roles) for t in (walk, replace(turned, name="turn"))}
    assert sorted({axes.forward for axes in decided.values()}) == ["+x", "-z"]
    assert agree_on_axes(dict(list(decided.items())[::order]), None).forward == "+x"


def test_given_axes_win(subject_file: Path) -> None:
    settings = Settings(up="+y", forward="x", processing=UNSMOOTHED.processing)
    loaded = load_all(load_subject(subject_file), settings)
    assert loaded.axes == "up +y, forward +x"


def test_labels_may_differ_from_trial_to_trial(tmp_path: Path) -> None:
    file = laboratory(tmp_path)
    walk = known_person().session.evaluation[0].relabel({"RLFE": "RKNEE"})
    write_trc(tmp_path / "walk.trc", walk)
    assert load_all(load_subject(file)).markers_used["RLFE"] == ("S01:RKNE", "RKNEE")


def test_the_subject_files_map_wins_over_a_markers_own_name(tmp_path: Path) -> None:
    person = known_person()
    file = laboratory(tmp_path, person, markers={"RFH": "RFHX"})
    for name, trial in (("standing", person.session.static), ("hips", person.session.calibration[0])):
        assert trial is not None
        write_recording(tmp_path / f"{name}.trc", trial.relabel({"RFH": "RFHX", "RMM": "RFH"}))
    session = load_all(load_subject(file), UNSMOOTHED, facing=True).session
    assert session.static is not None
    assert person.session.static is not None
    found, true = session.static.position("RFH"), person.session.static.position("RFH")
    np.testing.assert_allclose(found, true, rtol=0, atol=2e-8)
    assert session.static.labels.count("RFH") == 1
    assert any("left out" in repair.detail for repair in session.static.repairs)


def test_a_mapped_label_may_be_in_the_static_trial_only(tmp_path: Path) -> None:
    person = known_person()
    file = laboratory(tmp_path, person, markers={"RMFE": "INNER"})
    assert person.session.static is not None
    write_recording(tmp_path / "standing.trc", person.session.static.relabel({"RMFE": "INNER"}))
    for name, trial in (("hips", person.session.calibration[0]), ("walk", person.session.evaluation[0])):
        write_recording(tmp_path / f"{name}.trc", trial.select([n for n in trial.labels if n != "RMFE"]))
    assert load_all(load_subject(file)).markers_used["RMFE"] == ("INNER",)


@pytest.mark.parametrize(
    ("changes", "field", "remedy"),
    [
        ({"markers": {"RFH": "RHFBX"}}, "markers.RFH", "Their labels are"),
        ({"markers": {"RXYZ": "RFH"}}, "markers.RXYZ", "It has"),
        ({"extra_markers": {"RTHI": "femur"}}, "extra_markers.RTHI", "Did you mean 'femur_"),
    ],
)
def test_wrong_names_are_named(tmp_path: Path, changes: dict[str, object], field: str, remedy: str) -> None:
    file = laboratory(tmp_path, **changes)
    with pytest.raises(InputError) as caught, blame_file(file):
        load_all(load_subject(file))
    assert caught.value.file is not None
    assert caught.value.field == field
    assert remedy in (caught.value.remedy or "")


def test_markers_that_no_recording_shows_are_reported(tmp_path: Path) -> None:
    person = known_person()
    file = laboratory(tmp_path, person, extra_markers={"RTHI": "femur_r"})
    for name in ("standing", "hips", "walk"):
        trial = {"standing": person.session.static, "hips": person.session.calibration[0]}.get(
            name, person.session.evaluation[0]
        )
        assert trial is not None
        write_recording(tmp_path / f"{name}.trc", trial.select([n for n in trial.labels if n != "LFH"]))
    warnings = load_all(load_subject(file)).session.warnings
    assert any("no recording shows LFH" in text for text in warnings)
    assert any("RTHI" in text and "left out" in text for text in warnings)


def test_a_damaged_recording_is_named(tmp_path: Path) -> None:
    file = laboratory(tmp_path)
    (tmp_path / "hips.trc").write_text("nothing", encoding="utf-8")
    with pytest.raises(InputError) as caught:
        load_all(load_subject(file))
    assert caught.value.file == str((tmp_path / "hips.trc").resolve())
    assert caught.value.remedy


def test_trials_named_by_their_stem_become_paths(tmp_path: Path) -> None:
    path = tmp_path / "walk.trc"
    for named, shown in (("walk", str(path)), (None, "subject.yaml"), ("other.c3d", "other.c3d")):
        with pytest.raises(InputError) as caught, blame_file(Path("subject.yaml"), [path]):
            raise SubjectInvalid("wrong", file=named)
        assert caught.value.file == shown


def test_models_by_name_or_path(tmp_path: Path) -> None:
    assert read_model("squat_4dof").name == "squat_4dof"
    with pytest.raises(InputError, match="no built-in model"):
        read_model("nobody")
    with pytest.raises(InputError):
        read_model(tmp_path / "absent.osim")
