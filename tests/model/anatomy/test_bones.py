"""Bones of a model: by names, by the tree of its joints, and as a person tells them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from scaling_service.capabilities.subject.loading import read_model
from scaling_service.core.errors import SubjectInvalid
from scaling_service.model.anatomy.bones import BONES, assign_bones, find_body, find_bones_by_tree
from scaling_service.model.anatomy.lengths import find_joint_centres, measure_segment_lengths
from scaling_service.model.body import GROUND, BodyModel
from scaling_service.model.builtin import load_builtin
from scaling_service.model.document import from_document, to_document


def without_names(model: BodyModel) -> tuple[BodyModel, dict[str, str]]:
    """The model with segments called S0, S1 …, and their names before to those after."""
    new = {name: f"S{k}" for k, name in enumerate(model.segment_names)} | {GROUND: GROUND}
    segments = tuple(
        replace(
            s,
            name=new[s.name],
            parent=new[s.parent],
            joints=tuple(
                replace(j, scales_with=None if j.scales_with is None else new[j.scales_with])
                for j in s.joints
            ),
        )
        for s in model.segments
    )
    markers = tuple(replace(m, segment=new[m.segment]) for m in model.markers)
    return replace(model, segments=segments, markers=markers), new


@pytest.mark.parametrize(
    "file", ["rajagopal_walk/Rajagopal2016", "gait2354/gait2354_simbody", "opencap_squat/unscaled_generic"]
)
def test_joints_tell_the_bones_that_names_tell(shared_data, file: str) -> None:
    pytest.importorskip("opensim")
    model = read_model(shared_data / f"{file}.osim")
    assert find_bones_by_tree(model) == {bone: find_body(model, bone) for bone in BONES}
    blank, new = without_names(model)
    reported, notes = assign_bones(blank, {})
    assert dict(reported.bones) == {bone: new[str(find_body(model, bone))] for bone in BONES}
    assert any("femur_r is" in note and "`bone_bodies:`" in note for note in notes)
    for name in ("femur_r", "shank_l", "inter_hip"):
        assert measure_segment_lengths(reported)[name] == pytest.approx(
            measure_segment_lengths(model)[name], abs=1e-12
        )
    assert from_document(to_document(reported)) == reported


def test_a_model_whose_names_say_everything_is_left_alone() -> None:
    model = load_builtin("lower_limb_feet_18dof")
    assert assign_bones(model, {}) == (model, ())


def test_a_person_overrides_what_is_found() -> None:
    model, new = without_names(
        load_builtin("lower_limb_14dof")
    )  # without feet, its joints do not show the shanks
    assert find_bones_by_tree(model) == {}
    said = {bone: new[bone] for bone in ("pelvis", "femur_r", "tibia_r")}
    reported, notes = assign_bones(model, said)
    assert dict(reported.bones) == said
    assert "femur_r is" in notes[0]
    centre, known = (
        find_joint_centres(reported)["hip_r"],
        find_joint_centres(load_builtin("lower_limb_14dof"))["hip_r"],
    )
    assert centre[0] == new["pelvis"]
    assert np.array(centre[1]) == pytest.approx(np.array(known[1]))
    swapped, _ = assign_bones(load_builtin("lower_limb_14dof"), {"femur_r": "femur_l", "tibia_r": "tibia_l"})
    assert find_body(swapped, "femur_r") == "femur_l"


def test_bones_on_no_segment_or_on_one_twice_are_refused() -> None:
    model = load_builtin("lower_limb_feet_18dof")
    with pytest.raises(SubjectInvalid, match=r"no segment 'thigh'.*bone_bodies.femur_r|bone_bodies.femur_r"):
        assign_bones(model, {"femur_r": "thigh"})
    with pytest.raises(SubjectInvalid, match="named for"):
        assign_bones(model, {"femur_r": "tibia_r", "tibia_r": "tibia_r"})
    foot = str(find_body(model, "calcn_r"))
    reported, _ = assign_bones(model, {"talus_r": foot, "calcn_r": foot})  # a foot of one piece is both
    assert find_body(reported, "talus_r") == foot
