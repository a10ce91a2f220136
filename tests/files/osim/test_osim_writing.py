"""Written models read back, by us and by OpenSim: the same segments and markers at random poses."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from scaling_service.capabilities.scaling.methods.osim_image_based import Registration, find_axis_in_parent
from scaling_service.core.errors import ModelRefused
from scaling_service.files.osim.models import read_osim, write_osim
from scaling_service.model.body import BodyModel, Coordinate, Joint, Law, Marker, Segment, Shape, Term
from scaling_service.model.builtin import BUILTIN_NAMES, load_builtin
from scaling_service.model.compile import compile_model
from scaling_service.model.poses import list_model_values
from scaling_service.model.scaling import scale_model
from scaling_service.numerics.multibody.tree import pose_markers
from tests.files.osim.hand_made import X, Y, hand_made


def tilted(model: BodyModel, joint_name: str, x: float, y: float) -> BodyModel:
    """T = Ry(y) Rx(x) before a joint's first moving rotation and its inverse after the last."""
    segments = []
    for segment in model.segments:
        joints = list(segment.joints)
        if segment.joint_name == joint_name:
            turning = [k for k, j in enumerate(joints) if j.kind == "rotation" and not j.law.is_constant]
            after = [Joint("rotation", X, Law.constant(-x)), Joint("rotation", Y, Law.constant(-y))]
            before = [Joint("rotation", Y, Law.constant(y)), Joint("rotation", X, Law.constant(x))]
            joints[turning[-1] + 1 : turning[-1] + 1] = after
            joints[turning[0] : turning[0]] = before
        segments.append(replace(segment, joints=tuple(joints)))
    return replace(model, segments=tuple(segments))


def placed(model, q, names):
    order = [names.index(name) for name in model.coordinate_names]
    return pose_markers(compile_model(model), q[:, order], np.zeros(0))


@pytest.fixture
def agrees(oracle, random_poses):
    """Compare a written file with the model, through our reading and through OpenSim alone."""

    def compare(path, model, atol=1e-9):
        written = read_osim(path)
        assert written.marker_names == model.marker_names
        q = random_poses(model, 30)
        wanted = pose_markers(compile_model(model), q, np.zeros(0))
        back = placed(written, q, list(model.coordinate_names))
        np.testing.assert_allclose(back, wanted, rtol=0, atol=atol)
        order = [model.coordinate_names.index(name) for name in written.coordinate_names]
        answer = oracle(
            {
                "operation": "positions",
                "file": str(path),
                "coordinates": written.coordinate_names,
                "markers": written.marker_names,
                "poses": q[:, order].tolist(),
            }
        )
        np.testing.assert_allclose(answer["positions"], wanted, rtol=0, atol=atol)
        return written

    return compare


def drawn(model):
    rng = np.random.default_rng(5)
    return {s: tuple(float(v) for v in rng.uniform(0.85, 1.2, 3)) for s in model.segment_names}


@pytest.mark.parametrize(
    ("file", "marker_set", "tilts"),
    [
        (
            "rajagopal_walk/Rajagopal2016.osim",
            None,
            {"walker_knee_r": (0.05, -0.03), "ankle_l": (-0.02, 0.1)},
        ),
        ("gait2354/gait2354_simbody.osim", "gait2354/gait2354_Scale_MarkerSet.xml", {"knee_l": (0.02, 0.03)}),
        ("jia_mri/manual_model.osim", None, {"knee_r": (0.02, 0.03)}),
        ("opencap_squat/unscaled_generic.osim", None, {"walker_knee_r": (0.02, 0.03), "hip_l": (0.01, 0.02)}),
    ],
)
def test_scaled_and_tilted_with_a_source(shared_data, agrees, tmp_path, file, marker_set, tilts):
    source = shared_data / file
    markers = shared_data / marker_set if marker_set else None
    generic = read_osim(source, markers)
    factors = drawn(generic)
    model = scale_model(generic, factors, mass_kg=66.6)
    tilts = {joint: tilt for joint, tilt in tilts.items() if joint in {s.joint_name for s in model.segments}}
    assert tilts
    for joint, (x, y) in tilts.items():
        model = tilted(model, joint, x, y)
    moved = replace(model.markers[1], laws=tuple(law + Law.constant(0.012) for law in model.markers[1].laws))
    extra = Marker.at("extra_one", model.segment_names[-1], (0.01, 0.02, 0.03), anatomical=False)
    model = model.with_markers((moved, *model.markers[2:], extra))
    path = tmp_path / "person.osim"
    write_osim(
        path, model, source=source, factors=factors, axis_tilts=tilts, mass_kg=66.6, marker_set=markers
    )
    written = agrees(path, model)
    assert sum(s.mass for s in written.segments) == pytest.approx(66.6)
    for ours, theirs in zip(model.segments, written.segments, strict=True):
        np.testing.assert_allclose(theirs.com, ours.com, atol=1e-15)
        np.testing.assert_allclose(theirs.inertia, ours.inertia, rtol=1e-10, atol=1e-12)
    assert written.coordinates == model.coordinates
    assert {m.name: m.anatomical for m in written.markers} == {m.name: m.anatomical for m in model.markers}
    assert path.read_text().count("PathPoint name=") == source.read_text().count("PathPoint name=")


@pytest.mark.parametrize("kind", ["PinJoint", "UniversalJoint", "GimbalJoint", "BallJoint"])
@pytest.mark.parametrize("reverse", [False, True])
def test_tilts_of_joints_of_fixed_kind(oracle, agrees, tmp_path, kind, reverse):
    source, path = tmp_path / "source.osim", tmp_path / "tilted.osim"
    joints = [
        {"kind": "FreeJoint", "name": "root", "parent": "ground", "child": "a"},
        {"kind": kind, "name": "j", "parent": "a", "child": "b", "reversed": reverse},
    ]
    oracle({"operation": "build", "file": str(source), "joints": joints, "nested": "b"})
    model = tilted(read_osim(source), "j", 0.11, -0.07)
    write_osim(path, model, source=source, axis_tilts={"j": (0.11, -0.07)})
    agrees(path, model)
    with pytest.raises(ModelRefused) as caught:
        write_osim(path, model, source=source, axis_tilts={"root": (0.1, 0.1)})
    assert caught.value.field == "root"


@pytest.mark.parametrize("kind", ["PinJoint", "GimbalJoint"])
@pytest.mark.parametrize("reverse", [False, True])
@pytest.mark.parametrize("child_stays", [False, True])
def test_joints_that_an_image_moved(oracle, agrees, tmp_path, kind, reverse, child_stays):
    source, path = tmp_path / "source.osim", tmp_path / "moved.osim"
    joints = [
        {"kind": "FreeJoint", "name": "root", "parent": "ground", "child": "a"},
        {"kind": kind, "name": "j", "parent": "a", "child": "b", "reversed": reverse},
    ]
    oracle({"operation": "build", "file": str(source), "joints": joints, "nested": "b"})
    found = Registration(read_osim(source))
    values = list_model_values(found.model)
    by = np.array([0.01, -0.02, 0.03])
    if child_stays:
        found.move_axis(found.model.segment("b"), by, values)
    else:
        found.shift(found.model.segment("b"), by)
    found.turn(found.model.segment("b"), np.array([0.6, 0.0, 0.8]), values)
    if not child_stays:
        found.turn_child(found.model.segment("b"), np.array([0.1, 0.05, -0.2]), np.array([0.0, 0.1, 0.02]))
    assert find_axis_in_parent(found.model.segment("b"), values) == pytest.approx([0.6, 0.0, 0.8])
    write_osim(path, found.model, source=source, joint_moves=found.moves)
    agrees(path, found.model)


LINE = {"kind": "LinearFunction", "values": [1.0, 0.0]}
SPLINE = {"kind": "SimmSpline", "points": [[-1.0, 0.1], [0.0, 0.3], [1.0, -0.2], [2.0, 0.1]]}


@pytest.mark.parametrize("reverse", [False, True])
def test_oblique_translations_keep_our_scaling(oracle, agrees, tmp_path, reverse):
    source, path = tmp_path / "source.osim", tmp_path / "written.osim"
    axes = {
        0: {"axis": [1, 0.2, 0], "coordinate": "q", "function": LINE},
        1: {"axis": [0, 1, 0], "function": {"kind": "Constant", "values": [0.3]}},
        2: {"axis": [0, 0.2, 1], "coordinate": "p", "function": LINE},
        3: {"axis": [0.6, 0.8, 0], "coordinate": "q", "function": SPLINE},
        4: {
            "axis": [0, 2.0, 0],
            "coordinate": "q",
            "function": {"kind": "MultiplierFunction", "scale": 0.7, "inner": SPLINE},
        },
    }
    joints = [
        {"kind": "FreeJoint", "name": "root", "parent": "ground", "child": "a"},
        {"kind": "CustomJoint", "name": "j", "parent": "a", "child": "b", "axes": axes, "reversed": reverse},
    ]
    oracle({"operation": "build", "file": str(source), "joints": joints})
    factors = drawn(read_osim(source))
    model = tilted(scale_model(read_osim(source), factors), "j", 0.05, 0.02)
    write_osim(path, model, source=source, factors=factors, axis_tilts={"j": (0.05, 0.02)})
    agrees(path, model)


def test_without_a_source(agrees, tmp_path):
    path = tmp_path / "built.osim"
    model = hand_made()
    write_osim(path, model)
    written = agrees(path, model)
    assert written.name == "hand_made"
    assert {c.name: c for c in written.coordinates} == {c.name: c for c in model.coordinates}
    for ours in model.segments:
        theirs = written.segment(ours.name)
        assert (theirs.parent, theirs.joint_name) == (ours.parent, ours.joint_name)
        assert (theirs.mass, theirs.com, theirs.inertia) == (ours.mass, ours.com, ours.inertia)


@pytest.mark.parametrize(
    "file",
    ["rajagopal_walk/Rajagopal2016.osim", "opencap_squat/unscaled_generic.osim", "jia_mri/manual_model.osim"],
)
def test_imported_models_without_their_source(shared_data, agrees, tmp_path, file):
    model = read_osim(shared_data / file)
    write_osim(tmp_path / "again.osim", model)
    written = agrees(tmp_path / "again.osim", model)
    assert {c.dependent for c in written.couplers} == {c.dependent for c in model.couplers}


def test_inertia_may_come_from_the_model(oracle, tmp_path):
    source, path = tmp_path / "source.osim", tmp_path / "written.osim"
    pin = {"kind": "PinJoint", "name": "j", "parent": "ground", "child": "a"}
    oracle({"operation": "build", "file": str(source), "joints": [pin]})
    model = read_osim(source)
    identified = replace(
        model.segments[0], mass=3.21, com=(0.1, 0.2, 0.3), inertia=(0.03, 0.04, 0.05, 0.001, 0.002, 0.003)
    )
    write_osim(path, replace(model, segments=(identified,)), source=source, inertia_from_model=True)
    written = read_osim(path).segments[0]
    assert (written.mass, written.com, written.inertia) == (
        identified.mass,
        identified.com,
        identified.inertia,
    )


@pytest.mark.parametrize("name", BUILTIN_NAMES)
def test_built_in_models(agrees, tmp_path, name):
    path = tmp_path / "builtin.osim"
    model = load_builtin(name)
    write_osim(path, model)
    written = agrees(path, model)
    for ours in model.coordinates:
        theirs = written.coordinate(ours.name)
        finite = replace(ours, lower=max(ours.lower, -10.0), upper=min(ours.upper, 10.0))
        assert theirs == finite  # OpenSim has no open ranges; unclamped ones do not bind
    assert [s.mass for s in written.segments] == [s.mass for s in model.segments]


def test_functions_keep_all_their_digits(agrees, tmp_path):
    """OpenSim writes their points with six: a knee that bends by a curve would be 2 um off at the foot."""
    x = (-0.34906585, 0.523598776, 2.44346095)
    start, slopes = 0.28939512, (-0.91234567, -1.03456789)
    bend = Shape(x, ((slopes[0], start), (slopes[1], start + slopes[0] * (x[1] - x[0]))))
    knee = (
        Joint("translation", Y, Law.constant(-0.4)),
        Joint("rotation", X, Law((Term(1.0, coordinate="knee", shape=bend),))),
    )
    shank = Segment(name="shank", parent="ground", joint_name="knee", joints=knee, mass=3.0)
    model = BodyModel(
        name="leg",
        segments=(shank,),
        coordinates=(Coordinate(name="knee", lower=-0.3, upper=2.4),),
        markers=(Marker.at("toe", "shank", (0.2, -0.5, 0.0)),),
    )
    write_osim(tmp_path / "curved.osim", model)
    agrees(tmp_path / "curved.osim", model)
