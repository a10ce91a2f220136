"""Sentences that results hold, each said as the numbers beside it are."""

from __future__ import annotations

import pytest

from scaling_service.capabilities.discovery.result import BonesDocument, ExpectationDocument
from scaling_service.capabilities.discovery.words import describe_bones
from scaling_service.capabilities.dynamics.words import write_inertial_headline


@pytest.mark.parametrize(
    ("ratio", "said", "tone"),
    [
        (0.9, "10 % better", "good"),
        (0.998, "no better", "fair"),
        (1.002, "no better", "fair"),
        (1.1, "10 % worse", "poor"),
    ],
)
def test_what_an_inertia_gains_is_good_news_if_there_is_any(ratio: float, said: str, tone: str) -> None:
    headline, judged = write_inertial_headline(2, ratio, [True] * 6)
    assert (
        headline
        == f"2 combinations of parameters moved; the wrench of held-out recordings is explained {said}"
    )
    assert judged == tone


def test_what_is_known_of_bones_is_told_where_something_is() -> None:
    nothing = BonesDocument(skin_mm={}, expectations=[], left_out=[])
    expected = ExpectationDocument(
        coordinate="knee_rotation_r",
        at_rest_deg=0.0,
        follows=["knee_angle_r"],
        sd_deg=3.0,
        source="bone pins",
    )
    known = BonesDocument(skin_mm={"RTHI": 12.0}, expectations=[expected], left_out=["skin at the left knee"])
    posture, skin, left = describe_bones(known)
    assert list(describe_bones(nothing)) == []
    assert posture.startswith("right knee rotation is expected")
    assert "following right knee" in posture
    assert "RTHI by 12 mm" in skin
    assert left.startswith("Named but left out of model.json: skin at the left knee")
