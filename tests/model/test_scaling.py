"""Linear scaling by closed forms and invariants (against OpenSim: tests/files/osim)."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from scaling_service.model.body import BodyModel, Coordinate, Joint, Law, Marker, Segment
from scaling_service.model.compile import compile_model
from scaling_service.model.scaling import scale_model
from scaling_service.numerics.multibody.tree import pose_markers

INERTIA = (0.02, 0.01, 0.03, 0.001, -0.002, 0.003)


@pytest.fixture
def model():
    thigh = (
        Joint("translation", (0.6, 0.0, 0.8), Law.constant(0.3), "pelvis"),
        Joint("rotation", (0.0, 0.0, 1.0), Law.of("hip")),
    )
    root = (Joint("translation", (1.0, 0.0, 0.0), Law.of("x")),)
    segments = (
        Segment(
            name="pelvis",
            parent="ground",
            joint_name="root",
            joints=root,
            mass=10.0,
            com=(0.1, 0.0, 0.0),
            inertia=INERTIA,
        ),
        Segment(
            name="thigh",
            parent="pelvis",
            joint_name="hip",
            joints=thigh,
            mass=5.0,
            com=(0.0, -0.2, 0.0),
            inertia=INERTIA,
        ),
    )
    markers = (Marker.at("a", "pelvis", (0.1, 0.2, 0.3)), Marker.at("b", "thigh", (0.0, -0.4, 0.05)))
    return BodyModel(
        name="m",
        segments=segments,
        coordinates=(Coordinate(name="x", kind="translation"), Coordinate(name="hip")),
        markers=markers,
    )


def test_one_factor_for_all_enlarges_the_picture(model):
    q = np.array([[0.0, 0.3], [0.0, -0.7]])
    size = 1.25
    bigger = scale_model(model, dict.fromkeys(model.segment_names, (size,) * 3))
    before = pose_markers(compile_model(model), q, np.zeros(0))
    after = pose_markers(compile_model(bigger), q, np.zeros(0))
    np.testing.assert_allclose(after, size * before, rtol=0, atol=1e-15)
    # mass kept: inertia grows with the square of length
    np.testing.assert_allclose(bigger.segment("thigh").inertia, size**2 * np.array(INERTIA), rtol=1e-14)
    heavier = scale_model(model, {"thigh": (size,) * 3}, preserve_mass_distribution=False).segment("thigh")
    assert heavier.mass == pytest.approx(5.0 * size**3)
    np.testing.assert_allclose(heavier.inertia, size**5 * np.array(INERTIA), rtol=1e-14)


def test_components_scale_along_the_segments_axes(model):
    wider = scale_model(model, {"pelvis": (2.0, 1.0, 1.0)})
    placed = pose_markers(compile_model(wider), np.array([[0.5, 0.0]]), np.zeros(0))[0]
    np.testing.assert_allclose(placed, [[0.7, 0.2, 0.3], [0.86, -0.4, 0.29]], atol=1e-15)
    assert wider.segment("pelvis").com == (0.2, 0.0, 0.0)
    assert wider.marker("b") == model.marker("b")


def test_factors_of_one_change_nothing(model):
    same = scale_model(model, dict.fromkeys(model.segment_names, (1.0, 1.0, 1.0)))
    assert [s.inertia for s in same.segments] == [s.inertia for s in model.segments]
    assert same.markers == model.markers
    q = np.array([[0.1, 0.2]])
    np.testing.assert_allclose(
        pose_markers(compile_model(same), q, np.zeros(0)),
        pose_markers(compile_model(model), q, np.zeros(0)),
        atol=1e-16,
    )


def test_a_total_mass_keeps_the_proportions(model):
    light = scale_model(model, {}, mass_kg=7.5)
    assert [s.mass for s in light.segments] == [5.0, 2.5]
    np.testing.assert_allclose(light.segment("thigh").inertia, 0.5 * np.array(INERTIA), rtol=1e-15)


def test_markers_that_do_not_follow_size_stay(model):
    fixed = model.with_markers((replace(model.markers[0], follows_size=False),))
    assert scale_model(fixed, {"pelvis": (2.0, 2.0, 2.0)}).markers == fixed.markers


@pytest.mark.parametrize("factor", [0.0, -1.0, float("nan"), float("inf")])
def test_impossible_factors(model, factor):
    with pytest.raises(ValueError, match="thigh"):
        scale_model(model, {"thigh": (1.0, factor, 1.0)})
    with pytest.raises(ValueError, match="mass"):
        scale_model(model, {}, mass_kg=factor)
    with pytest.raises(KeyError):
        scale_model(model, {"tail": (1.0, 1.0, 1.0)})
