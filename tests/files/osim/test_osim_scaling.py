"""Our linear scaling against OpenSim's Model.scale."""

from __future__ import annotations

import numpy as np
import pytest

from scaling_service.files.osim.models import read_osim
from scaling_service.model.compile import compile_model
from scaling_service.model.scaling import scale_model
from scaling_service.numerics.multibody.tree import pose_markers

MODELS = [
    "rajagopal_walk/Rajagopal2016.osim",
    "jia_mri/manual_model.osim",
    "opencap_squat/unscaled_generic.osim",
    "opencap_squat/manually_scaled.osim",
]


def both(oracle, random_poses, path, factors, mass_kg=None, preserve=True):
    """Our scaled model and OpenSim's answer for the same factors."""
    generic = read_osim(path)
    ours = scale_model(generic, factors, mass_kg=mass_kg, preserve_mass_distribution=preserve)
    q = random_poses(generic, 30)
    answer = oracle(
        {
            "operation": "scaled",
            "file": str(path),
            "factors": factors,
            "mass_kg": mass_kg,
            "preserve": preserve,
            "coordinates": generic.coordinate_names,
            "markers": generic.marker_names,
            "poses": q.tolist(),
        }
    )
    placed = pose_markers(compile_model(ours), q, np.zeros(0))
    return ours, placed, answer


def drawn(model, uniform=False):
    rng = np.random.default_rng(3)
    shape = 1 if uniform else 3
    return {
        s: tuple(float(v) for v in rng.uniform(0.8, 1.3, shape).repeat(3 // shape))
        for s in model.segment_names
    }


@pytest.mark.parametrize("file", MODELS)
@pytest.mark.parametrize("preserve", [True, False])
@pytest.mark.parametrize("uniform", [True, False])
def test_geometry_and_inertia_as_opensim(shared_data, oracle, random_poses, file, preserve, uniform):
    path = shared_data / file
    factors = drawn(read_osim(path), uniform)
    factors.pop(read_osim(path).segment_names[1])  # a segment that is not scaled
    mass_kg = None if uniform else 61.5
    ours, placed, answer = both(oracle, random_poses, path, factors, mass_kg, preserve)
    np.testing.assert_allclose(placed, answer["positions"], rtol=0, atol=1e-9)
    for segment in ours.segments:
        theirs = answer["bodies"][segment.name]
        assert segment.mass == pytest.approx(theirs["mass"], rel=1e-12)
        np.testing.assert_allclose(segment.com, theirs["com"], rtol=0, atol=1e-15)
        # OpenSim's inertia of massless bodies stays what it was
        np.testing.assert_allclose(segment.inertia, theirs["inertia"], rtol=1e-10, atol=1e-15)


LINE = {"kind": "LinearFunction", "values": [1.0, 0.0]}
SHIFTED = {"kind": "LinearFunction", "values": [1.0, 0.1]}
SPLINE = {"kind": "SimmSpline", "points": [[-1.0, 0.1], [0.0, 0.3], [1.0, -0.2], [2.0, 0.1]]}


def custom(name, parent, child, translations, **more):
    axes = {0: {"axis": [1, 0, 0], "coordinate": f"{name}_angle", "function": LINE}}
    axes |= {
        k: {"axis": axis, "coordinate": coordinate, "function": function}
        for k, (axis, coordinate, function) in translations.items()
    }
    return {"kind": "CustomJoint", "name": name, "parent": parent, "child": child, "axes": axes, **more}


@pytest.mark.parametrize("reverse", [False, True])
def test_translations_of_every_kind(oracle, random_poses, tmp_path, reverse):
    """Pure coordinates stay, shifted and shaped ones grow, negative axes too, in turned joint frames."""
    path = tmp_path / "moving.osim"
    first = custom("j", "ground", "a", {3: ([1, 0, 0], "j_x", LINE), 4: ([0, 1, 0], "j_y", SHIFTED)})
    second = custom(
        "k",
        "a",
        "b",
        {
            3: ([-1, 0, 0], "k_angle", SPLINE),
            4: ([0, 1, 0], "k_y", LINE),
            5: ([0, 0, 1], "k_z", {"kind": "MultiplierFunction", "scale": 1.2, "inner": SHIFTED}),
        },
        reversed=reverse,
    )
    more = [
        {"kind": "SliderJoint", "name": "s", "parent": "b", "child": "c"},
        {"kind": "PlanarJoint", "name": "p", "parent": "b", "child": "d"},
        {"kind": "FreeJoint", "name": "f", "parent": "d", "child": "e"},
    ]
    oracle({"operation": "build", "file": str(path), "joints": [first, second, *more]})
    _, placed, answer = both(oracle, random_poses, path, drawn(read_osim(path)))
    np.testing.assert_allclose(placed, answer["positions"], rtol=0, atol=1e-9)


@pytest.mark.parametrize(
    ("kind", "reverse"),
    [
        ("EllipsoidJoint", False),
        ("EllipsoidJoint", True),
        ("ScapulothoracicJoint", False),
        ("ConstantCurvatureJoint", False),
        ("ConstantCurvatureJoint", True),
    ],
)
def test_joints_of_surfaces(oracle, random_poses, tmp_path, kind, reverse):
    """Radii grow with the parent, a hinge's origin and an arc's length with the child."""
    path = tmp_path / "surface.osim"
    root = {"kind": "FreeJoint", "name": "root", "parent": "ground", "child": "a"}
    joint = {"kind": kind, "name": "j", "parent": "a", "child": "b", "reversed": reverse}
    oracle({"operation": "build", "file": str(path), "joints": [root, joint]})
    _, placed, answer = both(
        oracle, lambda model, n: 0.35 * random_poses(model, n), path, drawn(read_osim(path))
    )
    np.testing.assert_allclose(placed, answer["positions"], rtol=0, atol=1e-9)


def test_a_dependent_translation_follows_a_uniform_factor(oracle, random_poses, tmp_path):
    path = tmp_path / "coupled.osim"
    joints = [
        custom("j", "ground", "a", {}),
        custom("k", "a", "b", {4: ([0, 1, 0], "glide", LINE)}),
    ]
    couplers = [{"name": "c", "independent": "k_angle", "dependent": "glide", "function": SPLINE}]
    oracle({"operation": "build", "file": str(path), "joints": joints, "couplers": couplers})
    ours, placed, answer = both(oracle, random_poses, path, drawn(read_osim(path), uniform=True))
    np.testing.assert_allclose(placed, answer["positions"], rtol=0, atol=1e-9)
    factor = drawn(read_osim(path), uniform=True)["a"][0]
    (before,), (after,) = read_osim(path).couplers, ours.couplers
    assert after.law == before.law.scale(factor)


def test_oblique_translations_scale_like_everything_else(oracle, tmp_path):
    """OpenSim multiplies them by |axis|.factors, which is not one for factors of one."""
    path = tmp_path / "oblique.osim"
    oblique = custom("k", "a", "b", {3: ([0.6, 0.8, 0], None, {"kind": "Constant", "values": [0.5]})})
    oracle({"operation": "build", "file": str(path), "joints": [custom("j", "ground", "a", {}), oblique]})
    generic = read_osim(path)
    assert scale_model(generic, {"a": (1.0, 1.0, 1.0)}) == generic
    joints = scale_model(generic, {"a": (2.0, 1.0, 1.0)}).segment("b").joints
    (joint,) = [j for j in joints if j.kind == "translation" and abs(j.axis[1]) not in (0, 1)]
    moved = np.array(joint.axis) * joint.law.constant_part
    np.testing.assert_allclose(moved, [0.6, 0.4, 0.0], atol=1e-15)
