"""Bones of a model: by names, by the tree of its joints, and as a person tells them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from scaling_service.capabilities.subject.files import read_model
from scaling_service.core.errors import SubjectInvalid
from scaling_service.model.anatomy.bones import BONES, assign_bones, find_body, find_bones_by_tree
from scaling_service.model.anatomy.lengths import find_joint_centres, measure_segment_lengths
from scaling_service.model.body import GROUND, BodyModel, Joint, Law
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
    assert any("right femur is" in note and "`bone_bodies:`" in note for note in map(str, notes))
    for name in ("femur_r", "shank_l", "inter_hip"):
        assert measure_segment_lengths(reported)[name] == pytest.approx(
            measure_segment_lengths(model)[name], abs=1e-12
        )
    assert from_document(to_document(reported)) == reported


def bare(model: BodyModel, keep: frozenset[str]) -> BodyModel:
    """Some of a model's segments, hanging on the first of them."""
    kept = tuple(s for s in model.segments if s.name in keep)
    first = replace(kept[0], parent=GROUND)
    markers = tuple(m for m in model.markers if m.segment in keep)
    return replace(model, segments=(first, *kept[1:]), markers=markers)


@pytest.mark.parametrize("axis", [(1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)])
def test_sides_are_told_by_the_feet_whatever_the_axes(axis: tuple[float, float, float]) -> None:
    model = load_builtin("full_body_35dof")
    root = model.segments[0]
    turn = Joint("rotation", axis, Law.constant(2.0))
    turned = replace(model, segments=(replace(root, joints=(turn, *root.joints)), *model.segments[1:]))
    blank, new = without_names(turned)
    assert find_bones_by_tree(blank) == {
        bone: new[name] for bone in BONES if (name := find_body(model, bone)) is not None
    }


def test_arms_are_no_legs() -> None:
    model = load_builtin("full_body_35dof")
    arms = frozenset(s.name for s in model.segments if find_body(model, s.name) is None) - {"pelvis"}
    assert any(name.startswith("humerus") for name in arms)
    upper = bare(model, arms)
    assert find_bones_by_tree(upper) == {}
    assert assign_bones(upper, {}) == (upper, ())


def test_one_leg_is_told_by_its_foot() -> None:
    model = load_builtin("lower_limb_feet_18dof")
    own = frozenset(n for n in model.segment_names if not n.endswith("_r"))
    blank, new = without_names(bare(model, own))
    assert find_bones_by_tree(blank) == {
        bone: new[name] for bone in BONES if (name := find_body(model, bone)) is not None and name in own
    }


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
    assert "right femur is" in str(notes[0])
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
