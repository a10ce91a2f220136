"""Scale and inverse kinematics set-ups, old and new."""

from __future__ import annotations

import pytest

from scaling_service.core.errors import FileUnreadable
from scaling_service.files.osim.setups import read_scale_setup
from scaling_service.model.subject import Measurement

SETUP = """<?xml version="1.0" encoding="UTF-8"?>
<OpenSimDocument Version="{version}"><ScaleTool name="s">
<mass> 72.6 </mass>
<GenericModelMaker><model_file>m.osim</model_file><marker_set_file>k.xml</marker_set_file></GenericModelMaker>
<ModelScaler name=""><apply> {scale} </apply><scaling_order> manualScale measurements </scaling_order>
<MeasurementSet><objects>
  <Measurement name="thigh"><apply>true</apply>
    <MarkerPairSet><objects>
      <MarkerPair><markers> A B </markers></MarkerPair><MarkerPair><markers>C D</markers></MarkerPair>
    </objects></MarkerPairSet>
    <BodyScaleSet><objects>
      <BodyScale name="femur_r"><axes> Z X </axes></BodyScale>
      <BodyScale name="femur_l"><axes>Y</axes></BodyScale>
    </objects></BodyScaleSet></Measurement>
  <Measurement name="off"><apply>false</apply>
    <MarkerPairSet><objects><MarkerPair><markers>A B</markers></MarkerPair></objects></MarkerPairSet>
    <BodyScaleSet><objects><BodyScale name="torso"><axes>X</axes></BodyScale></objects></BodyScaleSet>
  </Measurement>
</objects></MeasurementSet>
{scales}
<time_range> 1.0 2.0 </time_range><preserve_mass_distribution> true </preserve_mass_distribution>
</ModelScaler>
<MarkerPlacer><apply>{place}</apply><IKTaskSet><objects>
  <IKMarkerTask name="A"><apply>true</apply><weight> 10 </weight></IKMarkerTask>
  <IKMarkerTask name="B"><apply>false</apply><weight>5</weight></IKMarkerTask>
  <IKCoordinateTask name="knee"><apply>true</apply><weight>1000</weight>
    <value_type>{value_type}</value_type><value>0.25</value></IKCoordinateTask>
  <IKCoordinateTask name="ankle"><apply>true</apply><weight>1</weight></IKCoordinateTask>
</objects></IKTaskSet><time_range>-1 -1</time_range></MarkerPlacer>
</ScaleTool></OpenSimDocument>"""
SCALES = """<ScaleSet name="m"><objects>
  <Scale><scales> 1.1 1.2 1.3 </scales><segment> tibia_r </segment><apply>true</apply></Scale>
  <Scale><scales>9 9 9</scales><segment>tibia_l</segment><apply>false</apply></Scale>
</objects></ScaleSet>"""


@pytest.fixture
def setup(tmp_path):
    def write(**changes):
        given = {
            "version": "20302",
            "scale": "true",
            "place": "true",
            "scales": SCALES,
            "value_type": "manual_value",
        }
        path = tmp_path / "setup.xml"
        path.write_text(SETUP.format(**{**given, **changes}))
        return path

    return write


@pytest.mark.parametrize("version", ["20302", "30000", "40500"])
def test_a_scale_setup(setup, version):
    read = read_scale_setup(setup(version=version))
    assert read.measurements == (
        Measurement("thigh", (("A", "B"), ("C", "D")), {"femur_r": "XZ", "femur_l": "Y"}),
    )
    assert read.manual == {"tibia_r": (1.1, 1.2, 1.3)}
    assert read.order == ("manualScale", "measurements")
    assert read.time_range == (1.0, 2.0)
    assert read.preserve_mass_distribution
    assert read.mass_kg == 72.6
    assert read.placement.marker_weights == {"A": 10.0}
    assert read.placement.coordinate_weights == {"knee": 1000.0, "ankle": 1.0}
    assert read.placement.coordinate_values == {"knee": 0.25}
    assert read.placement.time_range is None


def test_what_is_switched_off(setup):
    read = read_scale_setup(setup(scale="false", place="false"))
    assert (read.measurements, read.manual, read.order) == ((), {}, ())
    assert read.mass_kg is None
    assert read.placement is None


def test_a_set_in_its_own_file(setup, tmp_path):
    (tmp_path / "scales.xml").write_text(f'<OpenSimDocument Version="20302">{SCALES}</OpenSimDocument>')
    assert read_scale_setup(setup(scales='<ScaleSet file="scales.xml"/>')).manual == {
        "tibia_r": (1.1, 1.2, 1.3)
    }


def test_real_setups(shared_data):
    old = read_scale_setup(shared_data / "gait2354/subject01_Setup_Scale.xml")
    assert old.mass_kg == 72.6
    assert [m.name for m in old.measurements] == ["torso", "pelvis", "thigh", "shank", "foot"]
    assert old.manual["femur_r"] == (1.14724, 1.14724, 1.14724)
    assert old.placement.coordinate_weights["mtp_angle_r"] == 1000.0
    assert old.placement.time_range == (1.0, 1.01)
    only_place = read_scale_setup(shared_data / "rajagopal_walk/scale_setup_walk.xml")
    assert only_place.order == ()
    assert only_place.mass_kg is None
    assert len(only_place.placement.marker_weights) == 23


@pytest.mark.parametrize(
    ("old", "new", "field"),
    [
        ("<markers> A B </markers>", "<markers>A</markers>", "MarkerPair"),
        ("<axes> Z X </axes>", "<axes>Q</axes>", "femur_r"),
        ("<scales> 1.1 1.2 1.3 </scales>", "<scales>1.1 0 1</scales>", "Scale"),
        ("<weight> 10 </weight>", "<weight>ten</weight>", "A"),
        ("manualScale measurements", "manual", "ModelScaler"),
        ("manual_value", "from_file", "knee"),
    ],
)
def test_wrong_entries_are_named(setup, old, new, field):
    path = setup()
    path.write_text(path.read_text().replace(old, new))
    with pytest.raises(FileUnreadable) as caught:
        read_scale_setup(path)
    assert caught.value.field == field
    assert caught.value.file == str(path)


@pytest.mark.parametrize("encoding", ["utf-8", "utf-16"])
def test_document_types_are_refused(tmp_path, encoding):
    path = tmp_path / "evil.xml"
    path.write_bytes('<!DOCTYPE a [<!ENTITY b "c">]><ScaleTool>&b;</ScaleTool>'.encode(encoding))
    with pytest.raises(FileUnreadable, match="document type"):
        read_scale_setup(path)


@pytest.mark.parametrize("content", ["", "<ScaleTool>", "<Other/>"])
def test_files_that_are_no_setup(tmp_path, content):
    path = tmp_path / "bad.xml"
    path.write_text(content)
    with pytest.raises(FileUnreadable):
        read_scale_setup(path)
    with pytest.raises(FileUnreadable):
        read_scale_setup(tmp_path / "absent.xml")


@pytest.mark.parametrize(
    ("written", "height_m"), [("1803.4", 1.8034), ("-1", None), ("1.80", None), ("99", None)]
)
def test_a_height_is_taken_where_it_can_be_one(tmp_path, written, height_m):
    file = tmp_path / "setup.xml"
    file.write_text(f"<ScaleTool><mass>0</mass><height>{written}</height></ScaleTool>", encoding="utf-8")
    assert read_scale_setup(file).height_m == (None if height_m is None else pytest.approx(height_m))
