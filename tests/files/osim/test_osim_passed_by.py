"""What motion does not need is passed by, said and kept; constraints stay in what is written."""

from __future__ import annotations

import re
from dataclasses import replace
from xml.etree import ElementTree

import numpy as np
import pytest

from scaling_service.core.errors import ModelRefused
from scaling_service.files.osim.models import read_osim, render_osim, write_osim
from scaling_service.model.body import Law
from scaling_service.model.scaling import scale_model

LIGAMENT = '<HomemadeLigament name="acl"><stiffness>2000</stiffness></HomemadeLigament>'
MOTOR = '<HomemadeMotor name="motor"><coordinate>j_0</coordinate></HomemadeMotor>'
SPRING = "<SpringGeneralizedForce name='spring'><coordinate>j_0</coordinate></SpringGeneralizedForce>"
CONTROLLER = (
    '<PrescribedController name="steering"><actuator_list>motor</actuator_list></PrescribedController>'
)
CHAIN = [
    {"kind": "FreeJoint", "name": "root", "parent": "ground", "child": "a"},
    {"kind": "GimbalJoint", "name": "j", "parent": "a", "child": "b"},
    {"kind": "GimbalJoint", "name": "k", "parent": "b", "child": "c"},
]


@pytest.fixture
def built(oracle, tmp_path):
    """A model file with sets added or changed."""

    def build(*changes, **more):
        path = tmp_path / "model.osim"
        oracle({"operation": "build", "file": str(path), "joints": CHAIN, **more})
        text = re.sub(
            "<(Force|Controller)Set.*?</(Force|Controller)Set>", "", path.read_text(), flags=re.DOTALL
        )
        for old, new in changes:
            assert old in text
            text = text.replace(old, new, 1)
        path.write_text(text)
        return path

    return build


def in_sets(forces, controllers=""):
    sets = f"<ForceSet><objects>{forces}</objects></ForceSet>"
    sets += f"<ControllerSet><objects>{controllers}</objects></ControllerSet>" if controllers else ""
    return "</Model>", f"{sets}</Model>"


@pytest.mark.parametrize("controllers", ["", CONTROLLER])
@pytest.mark.parametrize("known", ["", SPRING])
def test_forces_of_plug_ins_are_passed_by_and_kept(oracle, built, tmp_path, known, controllers):
    plain = read_osim(built())
    path = built(in_sets(LIGAMENT + known + MOTOR, controllers))
    model = read_osim(path)
    assert replace(model, notes=()) == plain
    (note,) = model.notes
    assert "acl (HomemadeLigament), motor (HomemadeMotor)" in note
    factors = {"b": (1.1, 1.2, 1.3)}
    written = tmp_path / "written.osim"
    write_osim(written, scale_model(model, factors), source=path, factors=factors)
    forces = ElementTree.parse(written).getroot().find("Model/ForceSet/objects")
    kinds = [element.tag for element in forces]
    assert sorted(kinds) == sorted(
        ["HomemadeLigament", "HomemadeMotor", *(["SpringGeneralizedForce"] * bool(known))]
    )
    assert forces.find("HomemadeLigament/stiffness").text == "2000"
    kept = ElementTree.parse(written).getroot().findall("Model/ControllerSet/objects/PrescribedController")
    assert [element.get("name") for element in kept] == (["steering"] if controllers else [])
    assert read_osim(written).notes == model.notes


def test_components_of_plug_ins_are_kept_too(built, tmp_path):
    path = built(("</Model>", "<components><HomemadeSensor name='ear'/></components></Model>"))
    model = read_osim(path)
    assert "ear (HomemadeSensor)" in model.notes[0]
    written = tmp_path / "written.osim"
    write_osim(written, model, source=path)
    (ear,) = ElementTree.parse(written).getroot().find("Model/components")
    assert (ear.tag, ear.get("name")) == ("HomemadeSensor", "ear")


def test_coordinates_prescribed_in_time_are_estimated(built):
    """One that is held at a number stays locked there."""
    sine = "<Sine><amplitude>0.1</amplitude></Sine>"
    prescribed = "<prescribed>true</prescribed><prescribed_function>{}</prescribed_function>"
    path = built(
        ('<Coordinate name="j_0">', f'<Coordinate name="j_0">{prescribed.format(sine)}'),
        (
            '<Coordinate name="j_1">',
            f'<Coordinate name="j_1">{prescribed.format("<Constant><value>0.3</value></Constant>")}',
        ),
    )
    model = read_osim(path)
    assert not model.coordinate("j_0").locked
    assert (model.coordinate("j_1").locked, model.coordinate("j_1").default) == (True, 0.3)
    assert [note for note in model.notes if "functions of time" in note and note.endswith(": 'j_0'")]


@pytest.mark.parametrize("version", ["20302", "30000"])
def test_files_of_old_versions_keep_their_constraints(tmp_path, version, oracle):
    path = tmp_path / "old.osim"
    path.write_text(OLD.format(version=version, off="false"))
    model = read_osim(path)
    assert [(c.name, c.kind, [e.segment for e in c.ends]) for c in model.constraints] == [
        ("pin", "point", ["shank", "ground"]),
        ("glue", "weld", ["shank", "foot"]),
    ]
    assert model.constraints[0].ends[0].nominal == (0.1, 0.2, 0.3)
    path.write_text(OLD.format(version=version, off="true"))
    idle = read_osim(path)
    assert [c.name for c in idle.constraints] == ["glue"]
    assert any("does not enforce" in note and "pin" in note for note in idle.notes)


BODY = """<Body name="{name}"><mass>3.0</mass><mass_center>0 -0.2 0</mass_center>
  <inertia_xx>0.04</inertia_xx><inertia_yy>0.04</inertia_yy><inertia_zz>0.04</inertia_zz>
  <inertia_xy>0</inertia_xy><inertia_xz>0</inertia_xz><inertia_yz>0</inertia_yz>
  <Joint><PinJoint name="{name}_pin"><parent_body>{parent}</parent_body>
    <location_in_parent>0.1 0.2 0.3</location_in_parent><orientation_in_parent>0 0 0</orientation_in_parent>
    <location>0 0 0</location><orientation>0 0 0</orientation>
    <CoordinateSet><objects><Coordinate name="{name}_angle"/></objects></CoordinateSet>
  </PinJoint></Joint></Body>"""
OLD = (
    '<?xml version="1.0"?><OpenSimDocument Version="{version}"><Model name="old"><BodySet><objects>'
    '<Body name="ground"><mass>0</mass><mass_center>0 0 0</mass_center></Body>'
    + BODY.replace("{name}", "shank").replace("{parent}", "ground")
    + BODY.replace("{name}", "foot").replace("{parent}", "shank")
    + """</objects></BodySet><ConstraintSet><objects>
    <PointConstraint name="pin"><isDisabled>{off}</isDisabled><body_1>shank</body_1><body_2>ground</body_2>
      <location_body_1>0.1 0.2 0.3</location_body_1><location_body_2>0 0 0</location_body_2></PointConstraint>
    <WeldConstraint name="glue"><isDisabled>false</isDisabled><body_1>shank</body_1><body_2>foot</body_2>
      <location_body_1>0.1 0 0</location_body_1><orientation_body_1>0 0.1 0</orientation_body_1>
      <location_body_2>0 0 0</location_body_2><orientation_body_2>0 0 0</orientation_body_2></WeldConstraint>
    </objects></ConstraintSet></Model></OpenSimDocument>"""
)

CLOSING = ("WeldConstraint", "PointConstraint", "ConstantDistanceConstraint", "PointOnLineConstraint")


@pytest.mark.parametrize("kind", CLOSING)
def test_constraints_stay_in_what_is_written(built, tmp_path, kind):
    path = built(closing=[[kind, "a", "c"]])
    model = read_osim(path)
    factors = {"a": (1.1, 1.2, 1.3), "c": (0.8, 0.9, 1.0)}
    scaled = scale_model(model, factors)
    written = tmp_path / "written.osim"
    write_osim(written, scaled, source=path, factors=factors)
    (ours,), (theirs,) = scaled.constraints, read_osim(written).constraints
    before = np.array([end.nominal for end in model.constraints[0].ends])
    after = before * [factors["a"], factors["c"]]
    np.testing.assert_allclose([end.nominal for end in ours.ends], after, atol=1e-15)
    np.testing.assert_allclose([end.nominal for end in theirs.ends], after, atol=1e-15)
    assert (theirs.kind, theirs.distance) == (ours.kind, ours.distance)
    np.testing.assert_allclose(theirs.turns, ours.turns, atol=1e-14)


def test_a_translation_that_follows_several_coordinates_grows_with_its_parent(oracle, tmp_path):
    """By a uniform factor: OpenSim scales couplers by no other."""
    line, plane = {"kind": "LinearFunction", "values": [1.0, 0.0]}, [0.1, 0.02, -0.03]
    axes = {4: {"axis": [0, 1, 0], "coordinate": "glide", "function": line}}
    joints = [*CHAIN, {"kind": "CustomJoint", "name": "s", "parent": "c", "child": "d", "axes": axes}]
    law = {"kind": "MultivariatePolynomialFunction", "dimension": 2, "order": 1, "values": plane}
    couplers = [{"name": "both", "independent": ["j_0", "j_1"], "dependent": "glide", "function": law}]
    path, written = tmp_path / "model.osim", tmp_path / "written.osim"
    oracle({"operation": "build", "file": str(path), "joints": joints, "couplers": couplers})
    model, factors = read_osim(path), {"c": (1.2, 1.2, 1.2)}
    write_osim(written, scale_model(model, factors), source=path, factors=factors)
    before, after = (
        {
            c: sum(t.gain for t in m.constraints[0].law.terms if t.coordinate == c)
            for c in ("glide", "j_0", "j_1")
        }
        for m in (model, read_osim(written))
    )
    assert after["glide"] == before["glide"] == 1.0
    for name in ("j_0", "j_1"):
        assert after[name] == pytest.approx(1.2 * before[name], rel=1e-12)


def test_a_constraint_that_opensim_would_lose_is_refused(built):
    path = built(closing=[["PointConstraint", "a", "c"]])
    model = read_osim(path)
    moved = replace(model.constraints[0].ends[0], laws=(Law.constant(0.5), Law(), Law()))
    other = replace(model.constraints[0], ends=(moved, model.constraints[0].ends[1]))
    with pytest.raises(ModelRefused) as caught:
        render_osim(replace(model, constraints=(other,)), source=path)
    assert caught.value.field == "closing"
