"""The verdict rests on the posterior's deviations, and on nothing that ranks methods by their residuals."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from types import MappingProxyType

import pytest

from scaling_service.capabilities.scaling.comparison.evidence import (
    Evidence,
    Following,
    MethodEvidence,
    Moment,
)
from scaling_service.capabilities.scaling.comparison.verdict import STRANGE, judge
from scaling_service.documents.results import VerdictDocument

BOTH = frozenset({"hip_r", "knee_r", "ankle_r", "hip_l", "knee_l", "ankle_l"})


def following(mean_mm: float) -> Following:
    mean = 1e-3 * mean_mm
    return Following(mean, 3.0 * mean)


def plain(name: str, error_mm: float) -> MethodEvidence:
    known = following(error_mm)
    return MethodEvidence(method=name, fitted=known, held_out=known, from_images=name.startswith("EB"))


MB, MB_LAM, EB = plain("MB", 12.0), plain("MB_lam", 4.0), plain("EB", 8.0)
MAP = replace(
    plain("MAP", 9.0),
    skin=1.1,
    lengths={"femur_r": 0.43},
    length_sds={"femur_r": 0.008},
    centre_sds={"hip_r": 0.009},
    angle_sds={"hip_flexion_r": math.radians(2.9)},
)


def verdict(
    *methods: MethodEvidence,
    imaged: frozenset[str] = frozenset(),
    usual_lengths: Mapping[str, float] = MappingProxyType({}),
    contradictions: tuple[str, ...] = (),
) -> VerdictDocument:
    return judge(Evidence(methods, imaged, usual_lengths, contradictions))


@pytest.mark.parametrize("methods", [(MB, MB_LAM, EB, MAP), (MAP, EB, MB_LAM, MB), (MAP,)])
def test_the_posterior_is_the_answer_whatever_else_was_computed(methods) -> None:
    found = verdict(*methods)
    assert (found.method, found.strength) == ("MAP", "decided")
    assert found.headline == "Use MAP for this person: lengths to ± 8 mm, joint angles to ± 2.9°."


def test_models_nearer_to_the_markers_are_named_and_change_nothing() -> None:
    closer, further = (replace(MB_LAM, held_out=following(mm)) for mm in (0.1, 30.0))
    first, second = verdict(MAP, closer), verdict(MAP, further)
    assert any("MB_lam comes nearer to the markers" in reason for reason in first.why)
    assert not any("nearer" in reason for reason in second.why)
    for name in ("method", "strength", "headline", "trust"):
        assert getattr(first, name) == getattr(second, name)


def test_what_people_say_more_of_than_recordings_is_leant_on() -> None:
    found = verdict(MB, replace(MAP, by_people=("scale.femur_r", "centre.hip_r.x")))
    assert found.strength == "leaning"
    assert "leans on what is ordinary in people" in found.headline
    assert any("the right femur's length, the right hip's centre" in reason for reason in found.why)


@pytest.mark.parametrize(
    ("found", "said"),
    [
        (verdict(replace(MAP, skin=1.01 * STRANGE)), "mislabelled or strayed"),
        (
            verdict(replace(MAP, skin=1.01 * STRANGE, worst=Moment("RLFE", "walk", 1.2, 0.074))),
            "markers (RLFE is farthest, 74 mm in walk at 1.20 s), loose clothing",
        ),
        (verdict(replace(MAP, lengths={"femur_r": 0.6}), usual_lengths={"femur_r": 0.43}), "unusual for"),
        (verdict(MB, EB), "MAP was not computed"),
        (verdict(MAP, contradictions=("femur_r is 421 mm by the bones",)), "femur_r is 421 mm by the bones."),
    ],
)
def test_what_keeps_it_from_deciding_is_said_first(found: VerdictDocument, said: str) -> None:
    assert found.strength == "undecided"
    assert said in found.why[0]
    assert not found.headline.startswith("Use ")
    assert "±" not in found.headline


def test_without_the_posterior_no_method_is_preferred_by_its_error() -> None:
    assert verdict(MB, MB_LAM).method == "MB"
    assert verdict(MB, MB_LAM, EB, imaged=BOTH).method == "EB"
    levels = {t.topic: t.level for t in verdict(MB, MB_LAM).trust}
    assert set(levels.values()) == {"unknown"}


@pytest.mark.parametrize(("deg", "level"), [(1.9, "good"), (2.1, "fair"), (4.9, "fair"), (5.1, "poor")])
def test_trust_in_angles_follows_their_deviation(deg: float, level: str) -> None:
    sds = {"hip_rotation_r": math.radians(deg), "knee_angle_r": math.radians(0.5)}
    (angles,) = [t for t in verdict(replace(MAP, angle_sds=sds)).trust if t.topic == "Joint angles"]
    assert angles.level == level
    assert f"{deg:.1f}°" in angles.text
    assert "(hip rotation, right)" in angles.text


@pytest.mark.parametrize(("mm", "level"), [(9.0, "good"), (11.0, "fair"), (21.0, "poor")])
def test_trust_in_lengths_follows_their_deviation(mm: float, level: str) -> None:
    lengths = {t.topic: t for t in verdict(replace(MAP, length_sds={"femur_r": 1e-3 * mm})).trust}[
        "Lengths and joint centres"
    ]
    assert lengths.level == level
    assert "(hip, right)" in lengths.text


@pytest.mark.parametrize(("skin", "level"), [(1.5, "good"), (2.5, "fair"), (3.5, "poor")])
def test_markers_are_judged_by_ordinary_skin_alone(skin: float, level: str) -> None:
    for error in (2.0, 40.0):
        found = verdict(replace(MAP, skin=skin, held_out=following(error)))
        assert {t.topic: t.level for t in found.trust}["Following the markers"] == level


def test_a_trial_without_any_marker_is_no_evidence() -> None:
    found = verdict(replace(MAP, fitted=None, held_out=None))
    assert {t.topic: t.level for t in found.trust}["Following the markers"] == "unknown"


def test_no_method_is_refused() -> None:
    with pytest.raises(ValueError, match="at least one"):
        judge(Evidence(()))


def test_a_joint_at_its_stop_is_named_first() -> None:
    stop = "walk: right forearm rotation stands at its stop, 120 deg, for 43% of the recording"
    found = judge(Evidence((MethodEvidence(method="MAP", stops=(stop,)),)))
    assert found.why[0] == f"{stop}."
