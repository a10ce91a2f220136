"""Which marker set labels belong to: on public recordings, on made ones, and where nothing is to be said."""

from __future__ import annotations

from pathlib import Path

import pytest

from scaling_service.files.recording import read_recording
from scaling_service.model.anatomy.marker_sets import assign_tracking_segments, find_plane_marker, recognise
from scaling_service.model.anatomy.markers import find_canonical
from scaling_service.model.builtin import load_builtin
from scaling_service.model.marker_sets import list_marker_sets


@pytest.mark.parametrize(
    ("folder", "name", "lacks", "additions"),
    [
        ("clinic/HC030A", "plug_in_gait", (), ("Oxford foot model",)),
        ("jia_mri", "plug_in_gait_lower", ("RTIB", "LTIB"), ("Oxford foot model",)),
        ("functional", "isb", (), ()),
        ("gait2354", "cleveland_clinic", (), ()),
        ("rajagopal_walk", "rajagopal2016", (), ()),
        ("opencap_squat", "opencap_laboratory", (), ()),
        ("living_bone/knee_pins", None, (), ()),
    ],
)
def test_sets_of_public_recordings(
    shared_data: Path, folder: str, name: str | None, lacks: tuple[str, ...], additions: tuple[str, ...]
) -> None:
    files = [f for f in sorted((shared_data / folder).iterdir()) if f.suffix in (".c3d", ".trc")]
    found = recognise(label for f in files for label in read_recording(f).labels)
    if name is None:
        assert found is None
        return
    assert found is not None
    assert (found.name, found.lacks, found.additions) == (name, lacks, additions)


@pytest.mark.parametrize("name", [n for n, s in list_marker_sets().items() if not s.adds_to_others])
@pytest.mark.parametrize("optional", [False, True])
def test_each_set_is_recognised_in_its_own_labels(name: str, optional: bool) -> None:
    asked = [n for n in list_marker_sets()[name].labels if optional or not n.optional]
    found = recognise(f"S01:{label.label}" for label in asked)
    assert found is not None
    assert (found.name, found.share, found.lacks) == (name, 1.0, ())
    assert found.key_points == (name == "video_keypoints")


LEGS = [side + name for name in ("ASI", "THI", "TIB", "ANK", "HEE", "TOE") for side in "RL"]
"""Of Plug-in Gait, without knees and the back of the pelvis."""


def test_a_sacral_marker_stands_for_both_behind() -> None:
    lower = [*LEGS, "RKNE", "LKNE"]
    assert recognise([*lower, "SACR"]).lacks == ()
    assert recognise([*lower, "RPSI", "LPSI"]).lacks == ()
    assert recognise([*lower, "RPSI"]).lacks == ("LPSI",)


def test_one_leg_is_a_set_of_one_leg() -> None:
    found = recognise(["RASI", "SACR", "RTHI", "RKNE", "RTIB", "RANK", "RHEE", "RTOE"])
    assert found is not None
    assert (found.name, found.lacks) == ("plug_in_gait_lower", ())


def test_computed_points_and_foreign_labels_are_no_set() -> None:
    assert recognise(["RFEO", "RTIO", "LFEA", "CentreOfMass", "RKneeAngles"]) is None
    assert recognise([f"M{k}" for k in range(40)]) is None
    assert recognise([]) is None


def test_the_device_is_reported_beside_its_set() -> None:
    labels = [
        "RASI",
        "LASI",
        "SACR",
        "RTHI",
        "LTHI",
        "RTIB",
        "LTIB",
        "RANK",
        "LANK",
        "RHEE",
        "LHEE",
        "RTOE",
        "LTOE",
    ]
    device = [f"{side}{name}" for side in "RL" for name in ("KAX", "KD1", "KD2")]
    found = recognise([*labels, *device])
    assert found is not None
    assert found.additions == ("knee alignment device",)
    assert found.lacks == ("RKNE", "LKNE")


def test_tracking_markers_go_where_the_model_has_their_segment() -> None:
    labels = ["S:RTHI", "LTIB", "RCPG", "RHLX", "SACR", "RASI", "C7", "RFEO", "odd"]
    assert assign_tracking_segments(labels, load_builtin("lower_limb_14dof")) == {
        "S:RTHI": "femur_r",
        "LTIB": "tibia_l",
        "SACR": "pelvis",
    }
    assert assign_tracking_segments(labels, load_builtin("lower_limb_feet_18dof"))["RCPG"] == "calcn_r"
    assert "C7" not in assign_tracking_segments(labels, load_builtin("full_body_35dof"))


def test_the_wand_tells_the_plane_of_the_joint_below() -> None:
    labels = ["RTHI", "RTHAP", "LTHI", "RTIB", "R.TH1"]
    assert find_plane_marker(labels, "knee", "r") == "RTHI"
    assert find_plane_marker(labels, "ankle", "r") == "RTIB"
    assert find_plane_marker(labels, "ankle", "l") is None
    assert find_plane_marker(["R.Thigh.Upper", "R.TH1", "RTHI1"], "knee", "r") is None
    assert find_canonical("RTHI") is None
    assert find_canonical("LSACR") is None
