"""Knees with more freedom: the same model at zero, the ISB's order and signs, known angles back."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from scaling_service.core.errors import SubjectInvalid
from scaling_service.model.anatomy.frames import Frames, compute_knee_angles
from scaling_service.model.anatomy.knees import list_stiff_knees
from scaling_service.model.body import BodyModel
from scaling_service.model.builtin import load_builtin
from scaling_service.model.parameters import KneeKind, with_knee
from scaling_service.model.poses import pose_neutral_frames, pose_neutral_markers
from tests.numerics.bodies import leg


@pytest.mark.parametrize("name", ["lower_limb_14dof", "full_body_35dof"])
@pytest.mark.parametrize(("kind", "added"), [("universal", 2), ("spherical", 4)])
def test_at_zero_nothing_has_changed(name: str, kind: KneeKind, added: int) -> None:
    model = load_builtin(name)
    more = with_knee(model, kind)
    assert len(more.coordinates) == len(model.coordinates) + added
    bent = {"knee_angle_r": 0.7, "knee_angle_l": 0.3, "hip_rotation_l": 0.2}
    before, after = pose_neutral_markers(model, bent), pose_neutral_markers(more, bent)
    for marker, place in before.items():
        np.testing.assert_allclose(after[marker], place, atol=1e-15)


def test_a_hinge_is_the_model_itself() -> None:
    model = load_builtin("lower_limb_14dof")
    assert with_knee(model, "hinge") is model


@pytest.mark.parametrize("side", ["r", "l"])
def test_angles_are_those_of_the_isb(side: str) -> None:
    """Against the joint coordinate system of Grood and Suntay computed from the frames."""
    model = with_knee(load_builtin("lower_limb_14dof"), "spherical")
    names = [f"knee_{a}_{side}" for a in ("angle", "adduction", "rotation")]
    values = dict(zip(names, (0.9, 0.15, -0.3), strict=True))
    frames = pose_neutral_frames(model, values)
    thigh, shank = (Frames(frames[f"{b}_{side}"][0][None], np.zeros((1, 3))) for b in ("femur", "tibia"))
    assert compute_knee_angles(thigh, shank, side)[0] == pytest.approx((0.9, 0.15, -0.3))


@pytest.mark.parametrize(
    ("coordinate", "inward"), [("knee_adduction", "ankle inward"), ("knee_rotation", "toes inward")]
)
def test_positive_is_inward_on_both_sides(coordinate: str, inward: str) -> None:
    model = with_knee(load_builtin("full_body_35dof"), "spherical")
    for side, towards in (("r", -1.0), ("l", 1.0)):
        marker = f"{side.upper()}LM" if inward.startswith("ankle") else f"{side.upper()}TOE"
        moved = (
            pose_neutral_markers(model, {f"{coordinate}_{side}": 0.2})[marker]
            - pose_neutral_markers(model)[marker]
        )
        assert towards * moved[2] > 0.0


def test_a_universal_knee_flexes_and_turns() -> None:
    model = with_knee(load_builtin("lower_limb_14dof"), "universal")
    assert model.coordinate_names[9:11] == ("knee_angle_r", "knee_rotation_r")
    frames = pose_neutral_frames(model, {"knee_angle_r": 1.0, "knee_rotation_r": 0.4})
    relative = frames["femur_r"][0].T @ frames["tibia_r"][0]
    np.testing.assert_allclose(relative, Rotation.from_euler("ZY", [-1.0, 0.4]).as_matrix(), atol=1e-12)


@pytest.mark.parametrize("model", [load_builtin("squat_4dof"), None], ids=["squat", "coupled"])
def test_other_knees_are_refused(model: BodyModel | None) -> None:
    with pytest.raises(SubjectInvalid, match="knee"):
        with_knee(model or _coupled(), "universal")


def _coupled() -> BodyModel:
    """A knee whose centre glides with flexion, as in OpenSim's models."""
    body = leg(np.random.default_rng(0))
    renamed = tuple(replace(s, name="tibia_r" if s.name == "tibia" else s.name) for s in body.segments)
    return replace(body, segments=renamed, markers=())


def test_a_knee_of_which_nothing_is_free_is_stiff() -> None:
    model = load_builtin("full_body_35dof")
    assert list(list_stiff_knees(model)) == []
    locked = tuple(replace(c, locked=c.locked or c.name == "knee_angle_l") for c in model.coordinates)
    assert list(list_stiff_knees(replace(model, coordinates=locked))) == ["knee_l"]
