"""Every joint and function kind against OpenSim on models made for it; what is refused is named."""

from __future__ import annotations

import numpy as np
import pytest

from scaling_service.core.errors import ModelRefused
from scaling_service.files.osim.models import read_osim, write_osim
from scaling_service.model.compile import compile_constraints
from scaling_service.model.scaling import scale_model

LINE = {"kind": "LinearFunction", "values": [1.0, 0.0]}
KNOTS = [
    [-2.1, 0.02],
    [-1.2, -0.03],
    [-0.4, 0.05],
    [0.3, 0.01],
    [1.1, -0.06],
    [1.9, 0.03],
    [2.5, 0.0],
    [3.1, 0.04],
]
FUNCTIONS = {
    "line": {"kind": "LinearFunction", "values": [-0.7, 0.2]},
    "constant": {"kind": "Constant", "values": [0.13]},
    "simm": {"kind": "SimmSpline", "points": KNOTS},
    "simm_two_points": {"kind": "SimmSpline", "points": KNOTS[:2]},
    "straight": {"kind": "PiecewiseLinearFunction", "points": KNOTS},
    "gcv_3": {"kind": "GCVSpline", "degree": 3, "points": KNOTS},
    "gcv_5": {"kind": "GCVSpline", "degree": 5, "points": KNOTS},
    "gcv_7": {"kind": "GCVSpline", "degree": 7, "points": KNOTS},
    "polynomial": {"kind": "PolynomialFunction", "values": [0.01, -0.02, 0.03, 0.2, -0.1]},
    "polynomial_line": {"kind": "PolynomialFunction", "values": [0.0, 0.3, -0.1]},
    "sine": {"kind": "Sine", "values": [0.2, 1.7, 0.4, -0.1]},
    "step": {"kind": "StepFunction", "values": [-0.4, 0.7, 0.1, -0.2]},
    "multiplied": {
        "kind": "MultiplierFunction",
        "scale": 1.3,
        "inner": {
            "kind": "MultiplierFunction",
            "scale": -0.5,
            "inner": {"kind": "SimmSpline", "points": KNOTS},
        },
    },
}


def custom(name, child, driven, parent="ground", **more):
    """A custom joint with oblique axes; ``driven`` maps axis number to (coordinate, function)."""
    directions = {
        0: [0.1, 0.2, 0.97],
        1: [1.0, 0.1, 0.0],
        2: [0.0, 2.0, 0.3],
        3: [0.9, 0.3, -0.1],
        4: [0.0, -1.0, 0.0],
        5: [0.1, 0.0, 1.0],
    }
    axes = {
        k: {"axis": directions[k], "coordinate": coordinate, "function": function}
        for k, (coordinate, function) in driven.items()
    }
    return {"kind": "CustomJoint", "name": name, "parent": parent, "child": child, "axes": axes, **more}


@pytest.fixture
def compared(oracle, random_poses, slow_positions, tmp_path):
    """Build a model, read it, and compare markers at random poses, also beyond the ranges."""

    def compare(request, atol=1e-10, reach=1.3):
        path = tmp_path / "synthetic.osim"
        oracle({"operation": "build", "file": str(path), **request})
        model = read_osim(path)
        q = reach * random_poses(model, 40)
        answer = oracle(
            {
                "operation": "positions",
                "file": str(path),
                "coordinates": model.coordinate_names,
                "markers": model.marker_names,
                "poses": q.tolist(),
            }
        )
        np.testing.assert_allclose(slow_positions(model, q), answer["positions"], rtol=0, atol=atol)
        return model

    return compare


@pytest.mark.parametrize(
    ("kind", "count"),
    [
        ("WeldJoint", 0),
        ("PinJoint", 1),
        ("SliderJoint", 1),
        ("UniversalJoint", 2),
        ("GimbalJoint", 3),
        ("BallJoint", 3),
        ("FreeJoint", 6),
        ("PlanarJoint", 3),
    ],
)
@pytest.mark.parametrize("reverse", [False, True])
def test_joints_of_fixed_kind(compared, kind, count, reverse):
    root = {"kind": "FreeJoint", "name": "root", "parent": "ground", "child": "a"}
    model = compared(
        {"joints": [root, {"kind": kind, "name": "j", "parent": "a", "child": "b", "reversed": reverse}]}
    )
    assert len(model.coordinates) == 6 + count
    assert model.segment("b").parent == "a"
    assert model.segment("b").mass == 2.0


@pytest.mark.parametrize("name", FUNCTIONS)
def test_functions_of_custom_joints(compared, name):
    joint = custom("j", "a", {0: ("q", LINE), 1: ("q", FUNCTIONS[name]), 4: ("q", FUNCTIONS[name])})
    # m: OpenSim's generalised splines of degree 7 carry rounding of 1e-10 themselves
    compared({"joints": [joint]}, atol=1e-8 if name == "gcv_7" else 1e-10)


@pytest.mark.parametrize("reverse", [False, True])
def test_order_of_six_axes_and_nested_frames(compared, reverse):
    driven = {k: (f"q{k}", FUNCTIONS["line"] if k % 2 else LINE) for k in range(6)}
    first = custom("j", "a", driven)
    second = custom("k", "b", {k: (f"p{k}", LINE) for k in range(6)}, parent="a", reversed=reverse)
    model = compared({"joints": [first, second], "nested": "a"})
    assert {m.segment for m in model.markers} == {"a", "b", "tip"}


@pytest.mark.parametrize(
    ("kind", "count", "reverse"),
    [
        ("EllipsoidJoint", 3, False),
        ("EllipsoidJoint", 3, True),
        ("ScapulothoracicJoint", 4, False),  # OpenSim itself crashes on a reversed one
        ("ConstantCurvatureJoint", 3, False),
        ("ConstantCurvatureJoint", 3, True),
    ],
)
def test_joints_of_surfaces(compared, kind, count, reverse):
    root = {"kind": "FreeJoint", "name": "root", "parent": "ground", "child": "a"}
    request = {
        "joints": [root, {"kind": kind, "name": "j", "parent": "a", "child": "b", "reversed": reverse}]
    }
    # OpenSim bends arcs by up to a right angle
    model = compared(request, reach=0.35 if kind == "ConstantCurvatureJoint" else 1.3)
    assert len(model.coordinates) == 6 + count
    assert model.segment("b").parent == "a"


def test_axes_that_follow_several_coordinates(compared):
    turns = {k: (f"q{k}", LINE) for k in range(3)}
    polynomial = {"kind": "MultivariatePolynomialFunction", "dimension": 2, "order": 3}
    glide = polynomial | {"values": [0.01, -0.02, 0.03, 0.02, -0.01, 0.05, 0.0, -0.04, 0.02, 0.01]}
    plane = {
        "kind": "MultivariatePolynomialFunction",
        "dimension": 3,
        "order": 1,
        "values": [0.1, 0, 0.2, 0.3],
    }
    joint = custom("j", "a", turns | {3: (["q2", "q0"], glide), 5: (["q0", "q1", "q2"], plane)})
    compared({"joints": [joint]})


CLOSING = ("WeldConstraint", "PointConstraint", "ConstantDistanceConstraint", "PointOnLineConstraint")


@pytest.mark.parametrize("other", ["b", "ground"])
@pytest.mark.parametrize("kind", CLOSING)
def test_poses_that_obey_the_model_obey_opensim(oracle, tmp_path, kind, other):
    path = tmp_path / "closed.osim"
    joints = [
        {"kind": "FreeJoint", "name": "root", "parent": "ground", "child": "a"},
        {"kind": "EllipsoidJoint", "name": "j", "parent": "a", "child": "b"},
        {"kind": "FreeJoint", "name": "k", "parent": "a", "child": "c"},
    ]
    oracle({"operation": "build", "file": str(path), "joints": joints, "closing": [[kind, "c", other]]})
    model = read_osim(path)
    closure = compile_constraints(model)
    q = np.random.default_rng(5).uniform(-0.5, 0.5, (20, len(model.coordinates)))
    none, free, bound = np.zeros(0), np.arange(q.shape[1]), np.full(q.shape[1], np.inf)
    request = {"operation": "missed", "file": str(path), "coordinates": model.coordinate_names}
    before = np.abs(oracle({**request, "poses": q.tolist()})["missed"]).max(axis=1)
    assert (before > 1e-3).all()
    if kind == "PointConstraint":
        ours = np.linalg.norm(closure.evaluate(q, none), axis=1)
        theirs = np.linalg.norm(oracle({**request, "poses": q.tolist()})["missed"], axis=1)
        np.testing.assert_allclose(ours, theirs, rtol=0, atol=1e-12)
    closure.close(q, none, free, -bound, bound)
    assert np.abs(oracle({**request, "poses": q.tolist()})["missed"]).max() < 1e-9


@pytest.mark.parametrize("kind", ["PinJoint", "BallJoint", "WeldJoint", "EllipsoidJoint"])
def test_joints_that_close_loops(oracle, tmp_path, kind):
    """A pose that obeys the weld of the body's copy obeys OpenSim's own cut."""
    path = tmp_path / "loop.osim"
    joints = [
        {"kind": "GimbalJoint", "name": "one", "parent": "ground", "child": "a"},
        {"kind": "GimbalJoint", "name": "two", "parent": "a", "child": "b"},
        {"kind": "GimbalJoint", "name": "three", "parent": "b", "child": "c"},
        {"kind": kind, "name": "loop", "parent": "ground", "child": "c", "closing": True},
    ]
    oracle({"operation": "build", "file": str(path), "joints": joints})
    model = read_osim(path)
    assert model.segment_names[-1] == "c_of_loop"
    assert [(c.name, c.kind) for c in model.constraints] == [("loop", "weld")]
    q = np.random.default_rng(5).uniform(-0.3, 0.3, (20, len(model.coordinates)))
    bound = np.full(q.shape[1], np.inf)
    compile_constraints(model).close(q, np.zeros(0), np.arange(q.shape[1]), -bound, bound)
    request = {"operation": "missed", "file": str(path), "coordinates": model.coordinate_names}
    assert np.abs(oracle({**request, "poses": q.tolist()})["missed"]).max() < 1e-9
    factors = dict.fromkeys(model.segment_names, (1.1, 0.9, 1.2))
    scaled, written = scale_model(model, factors), tmp_path / "written.osim"
    write_osim(written, scaled, source=path, factors=factors, inertia_from_model=True)
    assert read_osim(written).segment_names == model.segment_names


def test_a_coupler_of_several_coordinates_is_a_constraint(oracle, tmp_path):
    path = tmp_path / "coupled.osim"
    law = {"kind": "MultivariatePolynomialFunction", "dimension": 2, "order": 2}
    couplers = [
        {
            "name": "both",
            "independent": ["q0", "q1"],
            "dependent": "p0",
            "function": law | {"values": [0.1, 0.2, -0.3, 0.4, 0.5, -0.2]},
        }
    ]
    joints = [
        custom("j", "a", {k: (f"q{k}", LINE) for k in range(3)}),
        custom("k", "b", {0: ("p0", LINE)}, parent="a"),
    ]
    oracle({"operation": "build", "file": str(path), "joints": joints, "couplers": couplers})
    model = read_osim(path)
    assert set(model.coordinate_names) == {"q0", "q1", "q2", "p0"}
    assert [(c.name, c.kind) for c in model.constraints] == [("both", "law")]
    q = np.random.default_rng(5).uniform(-0.5, 0.5, (10, 4))
    request = {"operation": "missed", "file": str(path), "coordinates": model.coordinate_names}
    missed = np.array(oracle({**request, "poses": q.tolist()})["missed"])
    ours = compile_constraints(model).evaluate(q, np.zeros(0))
    np.testing.assert_allclose(np.abs(ours[:, 0]), np.abs(missed[:, 0]), atol=1e-12)


def test_couplers_are_substituted(compared):
    """Every pair of a coupling and a following function, each pair on a branch of its own."""
    joints, couplers = [], []
    for coupling in ("line", "simm", "straight", "polynomial", "multiplied", "constant"):
        for following in ("line", "simm", "straight", "polynomial"):
            if coupling == following == "polynomial":
                continue  # of degree 16: a constraint, see below
            name = f"{coupling}_{following}"
            joints += [
                custom(f"j_{name}", f"a_{name}", {0: (f"q_{name}", LINE)}),
                custom(
                    f"k_{name}",
                    f"b_{name}",
                    {1: (f"d_{name}", LINE), 3: (f"d_{name}", FUNCTIONS[following])},
                    parent=f"a_{name}",
                ),
            ]
            couplers.append(
                {
                    "name": f"c_{name}",
                    "independent": f"q_{name}",
                    "dependent": f"d_{name}",
                    "function": FUNCTIONS[coupling],
                }
            )
    model = compared({"joints": joints, "couplers": couplers}, atol=1e-9)
    assert all(name.startswith("q_") for name in model.coordinate_names)
    assert {(c.dependent[2:], c.independent[2:]) for c in model.couplers} == {
        (c["name"][2:], c["name"][2:]) for c in couplers
    }


def test_couplers_that_follow_each_other(compared):
    model = compared(
        {
            "joints": [
                custom("j", "a", {0: ("q", LINE)}),
                custom("k", "b", {1: ("d", LINE)}, parent="a"),
                custom("l", "c", {2: ("e", LINE), 4: ("e", FUNCTIONS["simm"])}, parent="b"),
            ],
            "couplers": [
                {"name": "second", "independent": "d", "dependent": "e", "function": FUNCTIONS["line"]},
                {"name": "first", "independent": "q", "dependent": "d", "function": FUNCTIONS["simm"]},
            ],
        }
    )
    assert model.coordinate_names == ("q",)
    assert {c.independent for c in model.couplers} == {"q"}


def refused(oracle, path, request):
    oracle({"operation": "build", "file": str(path), **request})
    with pytest.raises(ModelRefused) as caught:
        read_osim(path)
    return caught.value


def test_refusals_name_the_component(oracle, tmp_path):
    path = tmp_path / "bad.osim"
    stairs = custom("stairs", "a", {0: ("q", {"kind": "PiecewiseConstantFunction", "points": KNOTS})})
    assert refused(oracle, path, {"joints": [stairs]}).field == "stairs"


def test_a_joint_of_a_plug_in_is_refused(oracle, tmp_path):
    path = tmp_path / "plugin.osim"
    pin = {"kind": "PinJoint", "name": "odd", "parent": "ground", "child": "a"}
    oracle({"operation": "build", "file": str(path), "joints": [pin]})
    path.write_text(path.read_text().replace("PinJoint", "HomemadeJoint"))
    with pytest.raises(ModelRefused, match="HomemadeJoint") as caught:
        read_osim(path)
    assert caught.value.field == "odd"


def test_what_cannot_be_put_in_place_of_a_coordinate_is_a_constraint(oracle, tmp_path):
    """A composition of too high a degree, and a coordinate that a surface takes."""
    steep = {"kind": "PolynomialFunction", "values": [0.1] * 6}
    path = tmp_path / "steep.osim"
    joints = [
        custom("j", "a", {0: ("q", LINE)}),
        custom("k", "b", {1: ("d", LINE), 3: ("d", steep)}, parent="a"),
        {"kind": "EllipsoidJoint", "name": "e", "parent": "b", "child": "c"},
    ]
    couplers = [
        {"name": "c", "independent": "q", "dependent": "d", "function": steep},
        {"name": "s", "independent": "q", "dependent": "e_0", "function": LINE},
        {"name": "t", "independent": "q", "dependent": "e_2", "function": LINE},
    ]
    oracle({"operation": "build", "file": str(path), "joints": joints, "couplers": couplers})
    model = read_osim(path)
    assert sorted(c.name for c in model.constraints) == ["c", "s"]
    assert [c.dependent for c in model.couplers] == ["e_2"]


OLD_MODEL = """<?xml version="1.0" encoding="UTF-8"?>
<OpenSimDocument Version="20302"><Model name="old"><BodySet><objects>
<Body name="ground"><mass>0</mass><mass_center>0 0 0</mass_center></Body>
<Body name="shank"><mass>3.0</mass><mass_center>0 -0.2 0</mass_center>
  <inertia_xx>0.04</inertia_xx><inertia_yy>0.005</inertia_yy><inertia_zz>0.041</inertia_zz>
  <inertia_xy>0</inertia_xy><inertia_xz>0</inertia_xz><inertia_yz>0</inertia_yz>
  <Joint><CustomJoint name="knee"><parent_body>ground</parent_body>
    <location_in_parent>0.1 0.2 0.3</location_in_parent>
    <orientation_in_parent>0.1 0.2 0.3</orientation_in_parent>
    <location>0.01 0.02 0.03</location><orientation>-0.1 0 0.2</orientation>
    <CoordinateSet><objects>
      <Coordinate name="knee_angle"><default_value>0.1</default_value>
      <range>-2 0.2</range><clamped>true</clamped><locked>false</locked></Coordinate>
    </objects></CoordinateSet>
    <SpatialTransform>
      <TransformAxis name="rotation1"><coordinates>knee_angle</coordinates><axis>0 0 1</axis>
        <function><LinearFunction><coefficients>1 0</coefficients></LinearFunction></function></TransformAxis>
      <TransformAxis name="rotation2"><coordinates/><axis>0 1 0</axis>
        <function><Constant><value>0</value></Constant></function></TransformAxis>
      <TransformAxis name="rotation3"><coordinates/><axis>1 0 0</axis>
        <function><Constant><value>0</value></Constant></function></TransformAxis>
      <TransformAxis name="translation1"><coordinates>knee_angle</coordinates><axis>1 0 0</axis>
        <function><NaturalCubicSpline>
          <x>-2 -1 0 0.2</x><y>0.03 0.01 -0.01 0.02</y></NaturalCubicSpline></function>
      </TransformAxis>
      <TransformAxis name="translation2"><coordinates/><axis>0 1 0</axis>
        <function><Constant><value>0.05</value></Constant></function></TransformAxis>
      <TransformAxis name="translation3"><coordinates/><axis>0 0 1</axis>
        <function><Constant><value>0</value></Constant></function></TransformAxis>
    </SpatialTransform></CustomJoint></Joint></Body>
</objects></BodySet>
<MarkerSet><objects><Marker name="ankle"><body>shank</body><location>0 -0.4 0.05</location>
<fixed>true</fixed></Marker></objects></MarkerSet></Model></OpenSimDocument>"""


def test_files_of_version_2(oracle, random_poses, slow_positions, tmp_path):
    path = tmp_path / "old.osim"
    path.write_text(OLD_MODEL)
    model = read_osim(path)
    (coordinate,) = model.coordinates
    assert (coordinate.name, coordinate.lower, coordinate.clamped) == ("knee_angle", -2.0, True)
    assert model.markers[0].anatomical
    assert model.segments[0].inertia[:3] == (0.04, 0.005, 0.041)
    q = random_poses(model, 20, beyond=0.3)
    request = {
        "operation": "positions",
        "file": str(path),
        "coordinates": model.coordinate_names,
        "markers": model.marker_names,
        "poses": q.tolist(),
    }
    np.testing.assert_allclose(slow_positions(model, q), oracle(request)["positions"], rtol=0, atol=1e-12)
    # the spline's value enters, in the parent's turned joint frame
    assert any(t.shape is not None for j in model.segments[0].joints for t in j.law.terms)
