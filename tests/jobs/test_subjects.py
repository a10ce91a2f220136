"""Subject files with the files that they name."""

from __future__ import annotations

from pathlib import Path

import pytest

from scaling_service.capabilities.subject.reading import hash_input_files, load_subject
from scaling_service.core.errors import SubjectInvalid
from tests.jobs.laboratory import document, write_subject


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A folder with empty recordings; nothing here reads them."""
    for name in ("standing.trc", "hips.trc", "walk.trc", "walk.mot", "femur.stl"):
        (tmp_path / name).write_text(name, encoding="utf-8")
    return tmp_path


def test_paths_are_relative_to_the_file(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = write_subject(
        folder, document(forces={"walk.trc": "walk.mot"}, bones={"units": "m", "femur_r": "femur.stl"})
    )
    monkeypatch.chdir("/")
    subject = load_subject(file)
    assert subject.static == (folder / "standing.trc").resolve()
    assert subject.evaluation == ((folder / "walk.trc").resolve(),)
    assert subject.forces == {"walk.trc": (folder / "walk.mot").resolve()}
    assert subject.bones == {"femur_r": (folder / "femur.stl").resolve()}
    assert subject.bone_units == "m"
    assert (subject.id, subject.sex, subject.height_m, subject.mass_kg) == ("S01", "F", 1.70, 62.0)


def test_absolute_paths_are_kept(folder: Path, tmp_path_factory: pytest.TempPathFactory) -> None:
    elsewhere = tmp_path_factory.mktemp("elsewhere")
    file = write_subject(elsewhere, document(trials={"static": str(folder / "standing.trc")}))
    assert load_subject(file).static == (folder / "standing.trc").resolve()


@pytest.mark.parametrize(
    ("changes", "field", "remedy"),
    [
        ({"trials": {"static": "standin.trc"}}, "trials.static", "Did you mean 'standing.trc'?"),
        (
            {"trials": {"calibration": ["hips.trc", "knee.trc"]}},
            "trials.calibration.1",
            "relative to the subject file",
        ),
        ({"trials": {"static": "nowhere/standing.trc"}}, "trials.static", "relative to the subject file"),
        ({"trials": {"static": "femur.stl"}}, "trials.static", "Export it as .c3d or .trc"),
        ({"model": "lower_limb_14dofs"}, "model", "Did you mean 'lower_limb_14dof'?"),
        ({"model": "generic.osim"}, "model", "relative to the subject file"),
        ({"forces": {"walk.trc": "grf.mot"}}, "forces.walk.trc", "relative to the subject file"),
        ({"bones": {"units": "mm", "pelvis": "pelvis.stl"}}, "bones.pelvis", "relative to the subject file"),
        ({"image_markers": "."}, "image_markers", "relative to the subject file"),
    ],
)
def test_what_is_absent_is_named(folder: Path, changes: dict[str, object], field: str, remedy: str) -> None:
    file = write_subject(folder, document(**changes))
    with pytest.raises(SubjectInvalid) as caught:
        load_subject(file)
    assert caught.value.file == str(file)
    assert caught.value.field == field
    assert remedy in (caught.value.remedy or "")


def test_hashes_follow_the_content_and_not_the_place(
    folder: Path, tmp_path_factory: pytest.TempPathFactory
) -> None:
    file = write_subject(folder, document())
    first = hash_input_files(load_subject(file), file)
    assert set(first) == {"S01.yaml", "standing.trc", "hips.trc", "walk.trc"}
    copy = tmp_path_factory.mktemp("copy")
    for name in first:
        (copy / name).write_bytes((folder / name).read_bytes())
    assert hash_input_files(load_subject(copy / "S01.yaml"), copy / "S01.yaml") == first
    (copy / "walk.trc").write_text("changed", encoding="utf-8")
    second = hash_input_files(load_subject(copy / "S01.yaml"), copy / "S01.yaml")
    assert {name for name in first if first[name] != second[name]} == {"walk.trc"}
