"""The subject document: what is accepted, and that each mistake names file, field and remedy."""

from __future__ import annotations

import copy
import json
from pathlib import Path
from typing import Any

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from scaling_service.core.errors import FileUnreadable, InputError, SubjectInvalid
from scaling_service.documents.reading import check_document, read_document
from scaling_service.documents.subject import SubjectDocument

WHOLE = """
subject: {id: S01, sex: F, height_m: 1.70, mass_kg: 62.0}
model: generic.osim
marker_set: markers.xml
scale_setup: scale_setup.xml
markers: {RLFE: RKNE}
extra_markers: {RTHI: femur_r}
trials:
  static: Static.c3d
  calibration: [hip.c3d, knee.c3d]
  evaluation: [Walking01.c3d]
forces: {Walking01.c3d: Walking01_kinetics.mot}
bones: {units: mm, pelvis: pelvis.stl, femur_r: femur_r.stl, tibia_r: tibia_r.stl}
image_markers: image_markers.csv
"""
LEAST: dict[str, Any] = {
    "subject": {"id": "S01"},
    "model": "lower_limb_14dof",
    "trials": {"static": "Static.c3d"},
}


def changed(path: str, value: object) -> dict[str, Any]:
    """The least document with one value, at a dotted path, replaced."""
    content = copy.deepcopy(LEAST)
    *parents, last = path.split("/")
    place = content
    for key in parents:
        place = place.setdefault(key, {})
    place[last] = value
    return content


def test_the_whole_contract_is_read() -> None:
    found = check_document(yaml.safe_load(WHOLE))
    assert found.subject.height_m == 1.70
    assert found.trials.files == ("Static.c3d", "hip.c3d", "knee.c3d", "Walking01.c3d")
    assert found.bones is not None
    assert found.bones.meshes == {"pelvis": "pelvis.stl", "femur_r": "femur_r.stl", "tibia_r": "tibia_r.stl"}
    assert found.model_is_file


def test_least_document_takes_the_defaults() -> None:
    found = check_document(LEAST)
    assert (found.markers, found.forces, found.bones, found.subject.mass_kg) == ({}, {}, None, None)


def test_document_survives_its_own_json() -> None:
    found = check_document(yaml.safe_load(WHOLE))
    again = json.loads(found.model_dump_json(exclude_none=True))
    assert check_document(again) == found


@pytest.mark.parametrize("suffix", [".yaml", ".yml", ".json", ""])
def test_json_is_read_under_any_suffix(tmp_path: Path, suffix: str) -> None:
    file = tmp_path / f"subject{suffix}"
    file.write_text(json.dumps(yaml.safe_load(WHOLE), indent=1), encoding="utf-8")
    assert read_document(file) == check_document(yaml.safe_load(WHOLE))


MISTAKES: list[tuple[str, object, str, str]] = [
    ("trails", {}, "trails", "Did you mean 'trials'?"),
    ("subject/height", 1.70, "subject.height", "Did you mean 'height_m'?"),
    ("subject/height_cm", 170, "subject.height_cm", "Did you mean 'height_m'?"),
    ("trials/Calibration", [], "trials.Calibration", "Did you mean 'calibration'?"),
    ("bones", {"units": "mm", "femur": "f.stl"}, "bones.femur", "Did you mean 'femur_"),
    ("bones", {"units": "mm", "calcn_r": "c.stl"}, "bones.calcn_r", "the talus the ankle and the subtalar"),
    ("bones", {"units": "mm", "Calcaneus": "c.stl"}, "bones.Calcaneus", "Leave it out"),
    ("qwerty", 1, "qwerty", "Keys here are subject, model"),
    ("subject/height_m", 170, "subject.height_m", "metres"),
    ("subject/height_m", 1700.0, "subject.height_m", "metres"),
    ("subject/mass_kg", 62000, "subject.mass_kg", "kilograms"),
    ("subject/mass_kg", "62", "subject.mass_kg", "without quotes"),
    ("subject/mass_kg", True, "subject.mass_kg", "without quotes"),
    ("subject/mass_kg", float("nan"), "subject.mass_kg", "Write a number"),
    ("subject/sex", "female", "subject.sex", "Use F or M"),
    ("subject/id", 1, "subject.id", "in quotes"),
    ("subject/id", "../S01", "subject.id", "names folders"),
    ("subject/id", "", "subject.id", "names folders"),
    ("subject", None, "subject", "key: value"),
    ("model", "", "model", "Write it"),
    ("trials/calibration", "hip.c3d", "trials.calibration", "Write a list"),
    ("trials/calibration", [1], "trials.calibration.0", "in quotes"),
    ("trials/evaluation", ["Static.c3d"], "trials.evaluation", "Remove it from one"),
    (
        "trials",
        {"calibration": ["w.c3d"], "evaluation": ["w.c3d"]},
        "trials.evaluation",
        "Remove it from one",
    ),
    ("trials", {"calibration": ["a/w.c3d", "b/w.trc"]}, "trials.calibration", "rename"),
    ("trials", {"calibration": ["w.c3d", "w.c3d"]}, "trials.calibration", "rename"),
    ("trials", {}, "trials", "at least a static or a calibration trial"),
    ("bones", {"pelvis": "p.stl"}, "bones.units", "Add `units:`"),
    ("bones", {"units": "cm"}, "bones.units", "Use mm or m"),
    ("marker_set", "m.xml", "marker_set", "path of an .osim file"),
    ("scale_setup", "s.xml", "scale_setup", "path of an .osim file"),
    ("markers", {"RLFE": "RKNE", "RFH": "RKNE"}, "markers.RFH", "one model marker"),
    ("markers", {1: "RKNE"}, "markers.1", "in quotes"),
    ("markers", ["RKNE"], "markers", "key: value"),
    ("forces", {"walk.c3d": "walk.mot"}, "forces.walk.c3d", "Static.c3d"),
]


@pytest.mark.parametrize(("path", "value", "field", "remedy"), MISTAKES)
def test_mistakes_name_file_field_and_remedy(path: str, value: object, field: str, remedy: str) -> None:
    with pytest.raises(SubjectInvalid) as caught:
        check_document(changed(path, value), file="S01.yaml")
    assert caught.value.file == "S01.yaml"
    assert caught.value.field == field
    assert caught.value.remedy is not None
    assert remedy in caught.value.remedy


def test_a_label_is_either_the_models_marker_or_an_extra_one() -> None:
    content = LEAST | {"markers": {"RLFE": "RKNE"}, "extra_markers": {"RKNE": "femur_r"}}
    with pytest.raises(SubjectInvalid, match="under `markers` too"):
        check_document(content)


def test_the_static_trial_may_also_be_fitted() -> None:
    found = check_document(LEAST | {"trials": {"static": "a.c3d", "calibration": ["a.c3d"]}})
    assert found.trials.files == ("a.c3d",)


def test_further_problems_are_counted() -> None:
    content = changed("subject/sex", "x") | {"model": 3}
    with pytest.raises(SubjectInvalid, match="and 1 more problem"):
        check_document(content)


@pytest.mark.parametrize(
    ("name", "text", "problem"),
    [
        ("s.yaml", "subject: {id: S01}\nmodel: a\nmodel: b\n", "given twice"),
        ("s.yaml", "subject: {id: S01, id: S02}\n", "given twice"),
        ("s.json", '{"model": "a", "model": "b"}', "given twice"),
        ("s.yaml", "subject: [1, 2\n", "not valid YAML"),
        ("s.yaml", "\tsubject: 1\n", "not valid YAML"),
        ("s.yaml", "subject: !!python/object/apply:os.getcwd []\n", "not valid YAML"),
        ("s.json", '{"model": ', "not valid JSON"),
        ("s.yaml", "", "not nothing"),
        ("s.yaml", "- a\n- b\n", "not a list"),
        ("s.yaml", "just a text\n", "not a text"),
        ("s.json", "[" * 100_000, "nested too deeply"),
    ],
)
def test_texts_that_are_no_document(tmp_path: Path, name: str, text: str, problem: str) -> None:
    file = tmp_path / name
    file.write_text(text, encoding="utf-8")
    with pytest.raises(SubjectInvalid, match=problem) as caught:
        read_document(file)
    assert caught.value.file == str(file)
    assert caught.value.field
    assert caught.value.remedy


def test_a_yaml_error_names_its_line(tmp_path: Path) -> None:
    file = tmp_path / "s.yaml"
    file.write_text("subject:\n  id: S01\n  id: S02\n", encoding="utf-8")
    with pytest.raises(SubjectInvalid) as caught:
        read_document(file)
    assert caught.value.field == "line 3, column 3"


@pytest.mark.parametrize("content", [b"\xff\xfe\x00s", b"x" * 1_000_001])
def test_files_that_are_no_text(tmp_path: Path, content: bytes) -> None:
    file = tmp_path / "s.yaml"
    file.write_bytes(content)
    with pytest.raises(FileUnreadable) as caught:
        read_document(file)
    assert caught.value.remedy


@pytest.mark.parametrize("name", ["absent.yaml", "."])
def test_files_that_are_not_there(tmp_path: Path, name: str) -> None:
    with pytest.raises(FileUnreadable) as caught:
        read_document(tmp_path / name)
    assert caught.value.file == str(tmp_path / name)


_KEYS = st.sampled_from([*SubjectDocument.model_fields, "x"])
_LEAVES = st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5)
_CONTENT = st.recursive(
    _LEAVES,
    lambda inner: (
        st.lists(inner, max_size=3) | st.dictionaries(_KEYS | st.text(max_size=3), inner, max_size=4)
    ),
    max_leaves=12,
)


def test_an_unknown_key_inside_a_list_of_a_free_key_names_its_neighbours() -> None:
    with pytest.raises(SubjectInvalid) as caught:
        check_document(LEAST | {"corrections": {"walk.c3d": [{"lables": ["A", "B"]}]}})
    assert caught.value.field == "corrections.walk.c3d.0.lables"
    assert caught.value.remedy == "Did you mean 'labels'?"


@given(content=st.dictionaries(_KEYS, _CONTENT))
def test_whatever_is_given_is_a_document_or_an_input_error(content: dict[str, Any]) -> None:
    try:
        check_document(LEAST | content)
    except InputError as error:
        reported = (error.field, error.remedy)
    else:
        reported = ("none", "needed")
    assert all(reported)
