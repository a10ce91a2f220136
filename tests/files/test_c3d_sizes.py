"""Sizes that were measured by hand, as recordings and subject files state them."""

from __future__ import annotations

from dataclasses import replace

import ezc3d
import numpy as np
import pytest

from scaling_service.capabilities.subject.reading import with_stated_sizes
from scaling_service.core.errors import SubjectInvalid
from scaling_service.documents.reading import check_document
from scaling_service.files.c3d import read_c3d, read_stated_sizes
from scaling_service.model.subject import Subject
from scaling_service.model.trial import MeasuredSizes
from tests.files.made import random_trial


def _recorded(path, **processing):
    content = ezc3d.c3d()
    content["parameters"]["POINT"]["UNITS"]["value"] = ["mm"]
    content["parameters"]["POINT"]["RATE"]["value"] = [100]
    content["parameters"]["POINT"]["LABELS"]["value"] = ["RASI"]
    content["data"]["points"] = np.ones((4, 1, 3))
    for name, value in processing.items():
        content.add_parameter("PROCESSING", name, [value])
    content.write(str(path))
    return read_c3d(path).sizes


def test_vicons_processing_group_is_read_from_the_file(tmp_path):
    sizes = _recorded(
        tmp_path / "walk.c3d",
        Bodymass=45.8,
        Height=1480.0,
        MarkerDiameter=10.0,
        RKneeWidth=104.0,
        LAnkleWidth=61.0,
    )
    assert sizes.height_m == pytest.approx(1.48)
    assert sizes.mass_kg == pytest.approx(45.8, abs=1e-5)  # 32-bit floats
    assert sizes.lengths_m == pytest.approx(
        {"marker_diameter": 0.010, "knee_width_r": 0.104, "ankle_width_l": 0.061}
    )


@pytest.mark.parametrize(("height", "width"), [(1480.0, 104.0), (148.0, 10.4), (1.48, 0.104)])
def test_the_unit_is_the_one_that_a_person_can_have(height, width):
    found = read_stated_sizes({"PROCESSING": {"Height": [height], "RKneeWidth": [width]}})
    assert (found.height_m, found.lengths_m) == (1.48, {"knee_width_r": 0.104})


def test_what_was_not_entered_or_is_no_persons_is_left_out():
    stated = {
        "PROCESSING": {"Height": [0.0], "Bodymass": [0.0], "LKneeWidth": [900.0], "RKneeWidth": ["wide"]}
    }
    assert not read_stated_sizes(stated)
    assert not read_stated_sizes({})


def test_the_subject_file_counts_before_the_recordings_and_says_so(tmp_path):
    file = tmp_path / "walk.c3d"
    stated = MeasuredSizes(1.48, 45.8, {"knee_width_r": 0.104})
    trial = random_trial(3, ("RASI",), missing=0.0)
    trials = {file: replace(trial, rate_hz=100.0, sizes=stated)}
    known, notes = with_stated_sizes(Subject(id="S", model="lower_limb_14dof", height_m=1.50), trials)
    assert (known.height_m, known.mass_kg, known.sizes_m) == (1.50, 45.8, {"knee_width_r": 0.104})
    assert tuple(map(str, notes)) == ("walk.c3d states another height than the subject file, which counts",)


def _document(**sizes):
    return check_document(
        {"subject": {"id": "S"}, "model": "lower_limb_14dof", "trials": {"static": "a.c3d"}, "sizes": sizes}
    )


def test_sizes_of_a_subject_file_are_millimetres():
    assert _document(knee_width_r_mm=104, leg_length_l_mm=830.5).sizes_m == pytest.approx(
        {"knee_width_r": 0.104, "leg_length_l": 0.8305}
    )


@pytest.mark.parametrize(
    ("name", "value", "said"),
    [
        ("knee_width_mm", 104, "Did you mean 'knee_width_"),
        ("knee_width_r", 0.104, "Did you mean 'knee_width_r_mm'"),
        ("knee_width_r_mm", 0.104, "between 40 and 200 mm"),
    ],
)
def test_a_size_that_cannot_be_names_field_and_remedy(name, value, said):
    with pytest.raises(SubjectInvalid) as caught:
        _document(**{name: value})
    assert caught.value.field == f"sizes.{name}"
    assert said in str(caught.value)
