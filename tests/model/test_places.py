"""Landmarks of a model told by where its markers are, whatever they are called."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from scaling_service.model.anatomy.markers import find_canonical
from scaling_service.model.body import BodyModel, Joint, Law, Marker, to_vector
from scaling_service.model.builtin import BUILTIN_NAMES, load_builtin
from scaling_service.model.places import find_landmarks_by_place
from scaling_service.model.scaling import scale_model

KNOWN = ("ASIS", "PSIS", "LFE", "MFE", "LM", "MM")


def hidden(model: BodyModel, rng: np.random.Generator) -> tuple[BodyModel, dict[str, str]]:
    """The model with names that say nothing, markers moved by millimetres, and what they were."""
    names = {m.name: f"Q{k}" for k, m in enumerate(model.markers) if m.weight > 0.0}
    moved = tuple(
        Marker.at(names[m.name], m.segment, to_vector(np.array(m.nominal) + rng.normal(0.0, 0.004, 3)))
        for m in model.markers
        if m.weight > 0.0
    )
    joints = tuple(m for m in model.markers if m.weight == 0.0)  # joint centres that a file may hold
    roles = {label: find_canonical(name) or name for name, label in names.items()}
    return model.with_markers((*moved, *joints)), roles


@pytest.mark.parametrize("name", [name for name in BUILTIN_NAMES if name != "squat_4dof"])
@pytest.mark.parametrize("size", [0.7, 1.0, 1.15])
def test_landmarks_of_the_legs_are_found_without_their_names(name: str, size: float) -> None:
    model = load_builtin(name)
    sized = scale_model(model, dict.fromkeys(model.segment_names, (size,) * 3))
    model, roles = hidden(sized, np.random.default_rng(7))
    wanted = {label: role for label, role in roles.items() if role[1:] in KNOWN}
    assert len(wanted) >= 8
    assert find_landmarks_by_place(model) == wanted


def test_a_name_that_says_what_it_is_is_believed() -> None:
    assert find_landmarks_by_place(load_builtin("lower_limb_14dof")) == {}


@pytest.mark.parametrize("up", [0.06, 0.1, 0.2])
def test_clusters_are_no_landmarks(up: float) -> None:
    model = load_builtin("lower_limb_14dof")
    at = to_vector(np.add(model.marker("RLFE").nominal, (0.0, up, 0.0)))
    kept = tuple(m for m in model.markers if m.name not in ("RLFE", "RMFE"))
    assert find_landmarks_by_place(model.with_markers((*kept, Marker.at("TH1", "femur_r", at)))) == {}


def test_models_without_legs_have_none() -> None:
    model = load_builtin("lower_limb_14dof")
    at = Marker.at("A1", model.segment_names[0], (0.0, 0.0, 0.0))
    assert find_landmarks_by_place(replace(model, segments=model.segments[:1], markers=(at,))) == {}


def turned(model: BodyModel, axis: tuple[float, float, float], angle: float) -> BodyModel:
    """The model as it stands in a laboratory with other axes."""
    root = model.segments[0]
    turn = Joint("rotation", axis, Law.constant(angle))
    return replace(model, segments=(replace(root, joints=(turn, *root.joints)), *model.segments[1:]))


@pytest.mark.parametrize("axis", [(1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)])
@pytest.mark.parametrize("angle", [0.5 * np.pi, np.pi])
def test_the_model_may_stand_along_any_axis(axis: tuple[float, float, float], angle: float) -> None:
    model, roles = hidden(load_builtin("full_body_35dof"), np.random.default_rng(3))
    wanted = {label: role for label, role in roles.items() if role[1:] in KNOWN}
    assert find_landmarks_by_place(turned(model, axis, angle)) == wanted


@pytest.mark.parametrize("bend", [0.3, 1.0])
def test_knees_may_be_bent_by_default(bend: float) -> None:
    model, roles = hidden(load_builtin("lower_limb_feet_18dof"), np.random.default_rng(4))
    bent = tuple(
        replace(c, default=np.sign(c.lower + c.upper) * bend) if c.name.startswith("knee") else c
        for c in model.coordinates
    )
    wanted = {label: role for label, role in roles.items() if role[1:] in KNOWN}
    assert find_landmarks_by_place(replace(model, coordinates=bent)) == wanted


def test_one_marker_between_where_psis_would_be_is_the_sacrum() -> None:
    model = load_builtin("lower_limb_14dof")
    middle = np.add(model.marker("RPSIS").nominal, model.marker("LPSIS").nominal) / 2.0
    sacral = Marker.at("B1", "pelvis", to_vector(middle))
    fewer = tuple(m for m in model.markers if m.name not in ("RPSIS", "LPSIS"))
    assert find_landmarks_by_place(model.with_markers((*fewer, sacral))) == {"B1": "SACR"}
    assert find_landmarks_by_place(model.with_markers((*model.markers, sacral))) == {}


def test_a_name_that_lies_elsewhere_is_not_believed() -> None:
    model = load_builtin("lower_limb_14dof")
    up = to_vector(np.add(model.marker("RLFE").nominal, (0.0, 0.2, 0.0)))
    called = {"RLFE": "Q1"}
    markers = tuple(replace(m, name=called.get(m.name, m.name)) for m in model.markers)
    misnamed = model.with_markers((*markers, Marker.at("RLFE", "femur_r", up)))
    assert find_landmarks_by_place(misnamed) == {"RLFE": None, "Q1": "RLFE"}
