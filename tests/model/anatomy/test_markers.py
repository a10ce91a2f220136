"""Which label means which marker: on the label sets of public recordings, and where it must refuse."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from hypothesis import given
from hypothesis import strategies as st

from scaling_service.core.errors import InputError
from scaling_service.model.anatomy.markers import (
    PLANAR_SOURCES,
    find_canonical,
    is_computed,
    match_labels,
    strip_prefix,
)
from scaling_service.model.builtin import load_builtin

LOWER = [m.name for m in load_builtin("lower_limb_14dof").markers if m.weight > 0]
WHOLE = [m.name for m in load_builtin("full_body_35dof").markers if m.weight > 0]


def both_sides(right: str, *midline: str) -> list[str]:
    """Labels of the right side, the same for the left, and those of the midline."""
    left = {"R": "L", "r": "L"}
    sided = [label for name in right.split() for label in (name, left[name[0]] + name[1:])]
    return [*sided, *midline]


# what public recordings carry
PLUG_IN_GAIT_LIKE = both_sides(
    "RSHO RBAK RPSI RASI RTRO RTHI RKNE RMFC RHFB RTUB RSHN RANK RMMA RLCA RSTL RPCA RCPG RHEE RP5M RP1M "
    "RD5M RTOE RD1M RHLX"
)
ISB_LIKE = both_sides(
    "RTEMP RA RLHE RMHE RUS RRS RHMH5 RHMH2 RFT3 RPSIS RASIS RGT RLFE RMFE RLM RSPH RCAL RMFH5 RMFH1 RTT2 "
    "RATT RTHI1 RLEG1",
    *("HV", "SUP", "STR", "C7", "T10", "SEL"),
)
STANFORD = both_sides(
    "r.ASIS r.PSIS r_5meta R_HJC R_HJC_reg R_Shoulder R_Sternum r_ankle r_calc R_elbow_lat R_elbow_med "
    "r_knee r_mankle r_mknee r_sh2 r_shank_antsup r_thigh1 r_toe R_wrist_radius R_wrist_ulna",
    "C7",
)
OPENSIM_DOTS = both_sides(
    "R.ASIS R.Thigh.Upper R.Knee.Lat R.Knee.Med R.Shank.Upper R.Ankle.Lat R.Ankle.Med R.Heel R.Midfoot.Sup "
    "R.Toe.Tip R.Acromium R.Bicep R.Elbow R.Toe.Lat R.Temple",
    *("V.Sacral", "Sternum", "Top.Head"),
)
RAJAGOPAL = both_sides(
    "R.Shoulder R.Clavicle R.Biceps R.Elbow R.MElbow R.Forearm R.Wrist R.ASIS R.PSIS R.TH1 R.Knee R.MKnee "
    "R.SH1 R.Ankle R.MAnkle R.Heel R.MT5 R.Toe R_HJC R.HeelGround R.AnkleJoint R.KneeJoint R.MT5Ground",
    *("S2", "MidASIS", "MidPSIS"),
)


@pytest.mark.parametrize(
    ("labels", "expected"),
    [
        (
            PLUG_IN_GAIT_LIKE,
            {
                "RASIS": "RASI",
                "RPSIS": "RPSI",
                "RLFE": "RKNE",
                "RMFE": "RMFC",
                "RFH": "RHFB",
                "RLM": "RANK",
                "RMM": "RMMA",
            },
        ),
        (ISB_LIKE, {name: name for name in ("RASIS", "RPSIS", "RLFE", "RMFE", "RLM")} | {"RMM": "RSPH"}),
        (
            STANFORD,
            {
                "RASIS": "r.ASIS",
                "RPSIS": "r.PSIS",
                "RLFE": "r_knee",
                "RMFE": "r_mknee",
                "RLM": "r_ankle",
                "RMM": "r_mankle",
            },
        ),
        (
            OPENSIM_DOTS,
            {
                "RASIS": "R.ASIS",
                "RLFE": "R.Knee.Lat",
                "RMFE": "R.Knee.Med",
                "RLM": "R.Ankle.Lat",
                "RMM": "R.Ankle.Med",
            },
        ),
        (
            RAJAGOPAL,
            {
                "RASIS": "R.ASIS",
                "RPSIS": "R.PSIS",
                "RLFE": "R.Knee",
                "RMFE": "R.MKnee",
                "RLM": "R.Ankle",
                "RMM": "R.MAnkle",
            },
        ),
    ],
    ids=["plug-in gait", "isb", "stanford", "opensim", "rajagopal"],
)
def test_lower_limb_in_public_label_sets(labels: list[str], expected: dict[str, str]) -> None:
    found = match_labels(labels, LOWER)
    right = {marker: label for marker, label in found.mapped.items() if marker.startswith("R")}
    left = {marker: label for marker, label in found.mapped.items() if marker.startswith("L")}
    assert right == expected
    assert left == {f"L{marker[1:]}": f"L{label[1:]}" for marker, label in expected.items()}
    assert set(found.unused_labels) == set(labels) - set(found.mapped.values())


def test_whole_body_takes_no_toe_tip_nor_base_for_a_head() -> None:
    """Toe tips, metatarsal bases and computed points must not stand in for metatarsal heads."""
    assert match_labels(PLUG_IN_GAIT_LIKE, WHOLE).mapped["RMT5"] == "RD5M"
    assert match_labels(PLUG_IN_GAIT_LIKE, WHOLE).mapped["RTOE"] == "RTOE"
    assert match_labels(RAJAGOPAL, WHOLE).mapped["RMT5"] == "R.MT5"
    for labels in (RAJAGOPAL, STANFORD, ISB_LIKE, OPENSIM_DOTS):
        assert "RTOE" not in match_labels(labels, WHOLE).mapped
        assert not any(map(is_computed, match_labels(labels, WHOLE).mapped.values()))


def test_aliases_are_symmetrical_between_foreign_names() -> None:
    """A model from OpenSim meets a recording from elsewhere, neither using the built-in names."""
    found = match_labels(["R.ASIS", "R_elbow_lat", "r_mankle"], ["RASI", "RLEL", "RMMAL", "RTH1"])
    assert found.mapped == {"RASI": "R.ASIS", "RLEL": "R_elbow_lat", "RMMAL": "r_mankle"}


def test_tracking_markers_match_by_name_only() -> None:
    assert match_labels(["R.TH1"], ["RTH1"]).mapped == {}
    assert match_labels(["rth1"], ["RTH1"]).mapped == {"RTH1": "rth1"}


@pytest.mark.parametrize(
    "name", ["RTHI", "R.Toe", "r_toe", "RTOE", "R.Wrist", "R_HJC", "R.KneeJoint", "Sternum", "RA", ""]
)
def test_names_without_a_known_place(name: str) -> None:
    assert find_canonical(name) is None


@given(st.sampled_from(WHOLE), st.sampled_from(["", "S01:", "Lab:S 1:"]), st.sampled_from([str, str.lower]))
def test_prefix_and_capitals_do_not_matter(marker: str, prefix: str, write: Callable[[str], str]) -> None:
    label = prefix + write(marker)
    assert match_labels([label], WHOLE).mapped == {marker: label}
    assert strip_prefix(label) == write(marker)


@given(st.sampled_from([m for m in WHOLE if find_canonical(m)]))
def test_canonical_names_stand_for_themselves(marker: str) -> None:
    assert find_canonical(marker) == marker


def test_no_right_alias_means_a_left_place() -> None:
    for labels in (PLUG_IN_GAIT_LIKE, ISB_LIKE, STANFORD, OPENSIM_DOTS, RAJAGOPAL):
        for marker, label in match_labels(labels, WHOLE).mapped.items():
            if marker[0] in "RL":
                assert label[0].upper() == marker[0]


def test_order_of_precedence() -> None:
    wanted = ["RLFE"]
    assert match_labels(["RKNE", "RLFE"], wanted).mapped == {"RLFE": "RLFE"}
    assert match_labels(["RKNE", "S:RLFE"], wanted).mapped == {"RLFE": "S:RLFE"}
    assert match_labels(["RKNE", "rlfe"], wanted).mapped == {"RLFE": "rlfe"}
    assert match_labels(["RKNE", "RLFE"], wanted, {"RLFE": "RKNE"}).mapped == {"RLFE": "RKNE"}


def test_a_label_serves_one_marker() -> None:
    found = match_labels(["RKNE"], ["RLFE", "RKNE"])
    assert found.mapped == {"RKNE": "RKNE"}


def test_explicit_label_may_leave_out_the_prefix() -> None:
    assert match_labels(["S01:odd"], ["RLFE"], {"RLFE": "odd"}).mapped == {"RLFE": "S01:odd"}


def test_renames_lead_from_labels_to_markers() -> None:
    assert match_labels(["RKNE"], ["RLFE"]).renames == {"RKNE": "RLFE"}


def test_notes_say_what_was_decided() -> None:
    notes = match_labels(
        ["S:RASI", "RLFE", "R_HJC", "odd"], ["RASIS", "RLFE", "R_HJC", "RMM"], {"RMM": "odd"}
    ).notes
    assert any("RASIS" in n and "S:RASI" in n and "alias" in n for n in notes)
    assert any("R_HJC" in n and "computed" in n for n in notes)
    assert any("RMM" in n and "subject file" in n for n in notes)
    assert not any(n.startswith("RLFE") for n in notes)


@pytest.mark.parametrize(
    ("labels", "wanted", "explicit", "said"),
    [
        (["RKNE", "R.Knee.Lat"], ["RLFE"], {}, ["RKNE", "R.Knee.Lat", "RLFE"]),
        (["A:RASIS", "B:RASIS"], ["RASIS"], {}, ["A:RASIS", "B:RASIS"]),
        (["R.Knee"], ["RLFE", "RKNE"], {}, ["RLFE", "RKNE", "R.Knee"]),
        (["RASI"], ["RLFE"], {"RLFE": "RKNE"}, ["RKNE", "RASI"]),
        (["RKNE"], ["RLFE"], {"RXXX": "RKNE"}, ["RXXX", "RLFE"]),
        (["RKNE"], ["RLFE", "RMFE"], {"RLFE": "RKNE", "RMFE": "RKNE"}, ["RKNE"]),
        (["A:RKNE", "B:RKNE"], ["RLFE"], {"RLFE": "RKNE"}, ["A:RKNE", "B:RKNE"]),
    ],
)
def test_refusals_name_what_is_wrong(
    labels: list[str], wanted: list[str], explicit: dict[str, str], said: list[str]
) -> None:
    with pytest.raises(InputError) as caught:
        match_labels(labels, wanted, explicit)
    assert all(word in str(caught.value) for word in said)
    assert (caught.value.field or "").startswith("markers.")
    assert caught.value.remedy


VICON = (
    "PELO PELA PELL PELP RFEO LFEA RFEL LFEP RTIO LTIA RTIL LTIP RFOO LFOA RTOO LTOP HEDO HEDA TRXO TRXP "
    "RCLO LCLO RHUO LHUA RRAO LRAP RHNO LHNL CentreOfMass CentreOfMassFloor RAJC RHJC LKJC RKneeAngles "
    "LHipMoment RAnklePower RKneeForce RGroundReactionForce LNormalisedGRF"
)
SKIN = "RSTL LPCA RLCA RFAL LFAX RTAM RP1M RCPG RHLX RTOE RTIB LFIN RUPA RFRM CLAV RSPH SEL RLEL"


def test_points_that_vicon_computes_are_reported_from_markers() -> None:
    assert all(is_computed(f"S01:{label}") for label in VICON.split())
    assert not any(is_computed(label) for label in SKIN.split())


def test_planar_markers_have_sources() -> None:
    assert set(PLANAR_SOURCES) == set(load_builtin("squat_4dof").marker_names)
    known = set(WHOLE) | {"RTIB", "LTIB", "RTHI", "LTHI"}  # tracking markers of Plug-in Gait
    assert all(set(names) <= known for names in PLANAR_SOURCES.values())
