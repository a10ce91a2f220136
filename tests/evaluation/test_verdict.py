"""The verdict, case by case: each rule alone changes it as it says."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from scaling_service.capabilities.scaling.comparison.evidence import (
    Evidence,
    Following,
    MethodEvidence,
    Verdict,
)
from scaling_service.capabilities.scaling.comparison.rules import measure_agreement
from scaling_service.capabilities.scaling.comparison.verdict import judge

RIGHT = frozenset({"hip_r", "knee_r", "ankle_r"})
BOTH = RIGHT | {"hip_l", "knee_l", "ankle_l"}


def following(mean_mm: float, max_mm: float | None = None) -> Following:
    mean = 1e-3 * mean_mm
    return Following(mean, 1.2 * mean, 3.0 * mean if max_mm is None else 1e-3 * max_mm, 2)


def plain(name: str, error_mm: float, **more: object) -> MethodEvidence:
    """A model without fitted numbers."""
    known = {"fitted": following(error_mm), "held_out": following(error_mm), "from_images": name == "EB"}
    return MethodEvidence(method=name, **(known | more))  # type: ignore[arg-type]


def refined(
    name: str, fitted_mm: float, held_out_mm: float, undetermined: int = 5, **more: object
) -> MethodEvidence:
    """A model with 50 fitted numbers."""
    known = {
        "start": name.partition("_")[0],
        "from_images": name.startswith("EB"),
        "fits_lengths": name == "MB_lam",
        "fitted": following(fitted_mm),
        "held_out": following(held_out_mm),
        "parameters": 50,
        "undetermined": undetermined,
    }
    return MethodEvidence(method=name, **(known | more))  # type: ignore[arg-type]


MB = plain("MB", 12.0)
MB_AM = refined("MB_am", 4.0, 5.0)
MB_LAM = refined("MB_lam", 4.5, 5.5)
EB = plain("EB", 8.0)
EB_AM = refined("EB_am", 4.0, 5.0)


def verdict(*methods: MethodEvidence, **more: object) -> Verdict:
    imaged = BOTH if any(m.from_images for m in methods) else frozenset()
    return judge(Evidence(methods, **({"imaged": imaged} | more)))  # type: ignore[arg-type]


def outcome(*methods: MethodEvidence, **more: object) -> tuple[str, str]:
    found = verdict(*methods, **more)
    return found.method, found.strength


def test_a_proven_refinement_of_an_imaged_body_is_decided() -> None:
    assert outcome(MB, MB_LAM, MB_AM, EB, EB_AM) == ("EB_am", "decided")


def test_the_order_of_methods_changes_nothing() -> None:
    assert outcome(EB_AM, MB_AM, EB, MB_LAM, MB) == ("EB_am", "decided")


def test_a_difference_within_the_noise_keeps_the_plain_model() -> None:
    assert outcome(MB, EB, refined("EB_am", 7.0, 7.1)) == ("EB", "decided")
    assert outcome(MB, EB, refined("EB_am", 6.8, 6.9)) == ("EB_am", "decided")


def test_a_gain_that_is_not_kept_is_overfitting() -> None:
    # 6 mm gained where fitted; 2.9 mm or 3.1 mm of them elsewhere.
    found = verdict(MB, EB, refined("EB_am", 2.0, 5.1))
    assert found.method == "EB"
    assert any(
        f.rule == "overfitting" and f.method == "EB_am" and f.speaks == "against" for f in found.findings
    )
    assert any("too little of its gain" in reason for reason in found.why)
    assert outcome(MB, EB, refined("EB_am", 2.0, 4.9)) == ("EB_am", "decided")


def test_a_better_but_undetermined_refinement_leaves_the_question_open() -> None:
    found = verdict(MB, EB, refined("EB_am", 4.0, 5.0, undetermined=26))
    assert (found.method, found.strength) == ("EB", "leaning")
    assert any("26 of its 50 fitted numbers are not determined" in reason for reason in found.why)
    assert outcome(MB, EB, refined("EB_am", 4.0, 5.0, undetermined=25)) == ("EB_am", "decided")
    assert outcome(MB, refined("MB_am", 4.0, 5.0, undetermined=26)) == ("MB", "undecided")


def test_without_images_it_only_leans() -> None:
    found = verdict(MB, MB_LAM, MB_AM)
    assert (found.method, found.strength) == ("MB_am", "leaning")
    assert any("nothing checks the lengths" in reason for reason in found.why)


def test_fitted_lengths_are_not_preferred_however_small_the_error() -> None:
    best = refined("MB_lam", 1.0, 1.5)
    found = verdict(MB, best, MB_AM)
    assert found.method == "MB_am"
    assert any("MB_lam follows them to 1.5 mm" in reason and "moving skin" in reason for reason in found.why)
    assert any("small error alone" in reason for reason in found.why)
    assert outcome(MB, best) == ("MB", "leaning")
    assert verdict(best).method == "MB_lam"  # nothing else to choose


def test_a_model_beyond_the_limits_gives_way() -> None:
    lost = plain("EB", 8.0, held_out=following(8.0, 41.0))
    assert outcome(MB, lost, EB_AM) == ("EB_am", "decided")
    both = (MB, lost, refined("EB_am", 4.0, 5.0, held_out=following(5.0, 41.0)))
    found = verdict(*both)
    assert (found.method, found.strength) == ("MB", "undecided")
    assert any("of one person" in reason for reason in found.why)


def test_those_that_fail_are_named() -> None:
    found = verdict(plain("MB", 8.0, held_out=following(8.0, 41.0)), MB_AM)
    assert found.method == "MB_am"
    assert "MB fails a limit on marker errors." in found.why


def test_the_limits_are_the_published_ones() -> None:
    for rms_mm, max_mm, passed in ((19.9, 39.9, {True}), (20.1, 39.9, {True, False}), (20.1, 40.1, {False})):
        follows = Following(0.01, 1e-3 * rms_mm, 1e-3 * max_mm, 1)
        gates = verdict(plain("MB", 10.0, held_out=follows)).gates
        assert {gate.passed for gate in gates} == passed


def test_where_none_passes_nothing_is_decided() -> None:
    far = [replace(m, held_out=following(15.0, 60.0)) for m in (MB, EB)]
    assert outcome(*far)[1] == "undecided"


@pytest.mark.parametrize(
    ("methods", "said"),
    [
        ((MB_AM,), "Only MB_am was computed"),
        (tuple(replace(m, held_out=None) for m in (MB, EB, EB_AM)), "No trial was held out"),
        ((MB, EB, replace(EB_AM, at_bounds=1)), "stopped at a bound"),
        ((MB, EB, replace(EB_AM, lengths={"femur_r": 0.6})), "unusual for the person's height"),
    ],
)
def test_what_keeps_it_from_deciding_is_said(methods: tuple[MethodEvidence, ...], said: str) -> None:
    found = verdict(*methods, usual_lengths={"femur_r": 0.43})
    assert found.strength == "undecided"
    assert any(said in reason for reason in found.why)
    assert "Use " not in found.headline


def test_without_held_out_trials_the_plain_model_is_named() -> None:
    assert verdict(*(replace(m, held_out=None) for m in (MB, MB_AM))).method == "MB"


def test_agreement_is_over_what_was_imaged() -> None:
    eb = replace(EB, lengths={"femur_r": 0.430, "femur_l": 0.430}, hip_centres={"hip_r": (0.0, 0.0, 0.08)})
    near = replace(MB, lengths={"femur_r": 0.436, "femur_l": 0.5}, hip_centres={"hip_r": (0.003, 0.0, 0.084)})
    found = verdict(near, eb, imaged=RIGHT)
    apart = measure_agreement(Evidence((near, eb), RIGHT))["MB"]
    assert apart.lengths == pytest.approx({"femur_r": 0.006})
    assert apart.hips == pytest.approx({"hip_r": 0.005})
    speaks = {f.method: f.speaks for f in found.findings if f.rule == "image"}
    assert speaks == {"MB": "for", "EB": "for"}
    far = verdict(replace(near, lengths={"femur_r": 0.441}), eb, imaged=RIGHT)
    assert {f.method: f.speaks for f in far.findings if f.rule == "image"}["MB"] == "against"


@pytest.mark.parametrize(("apart_deg", "level"), [(1.9, "good"), (2.1, "fair"), (4.9, "fair"), (5.1, "poor")])
def test_trust_in_angles_follows_how_far_methods_are_apart(apart_deg: float, level: str) -> None:
    apart = {
        ("MB", "EB_am"): ("hip_rotation_r", math.radians(apart_deg)),
        ("EB", "EB_am"): ("knee_angle_r", math.radians(0.5)),
        ("MB", "EB"): ("hip_flexion_r", math.radians(30.0)),  # not of the method chosen
        ("MB_lam", "EB_am"): ("hip_flexion_r", math.radians(30.0)),  # of one that is not trusted anyhow
    }
    (angles,) = [
        t for t in verdict(MB, MB_LAM, EB, EB_AM, angles_apart=apart).trust if t.topic == "Joint angles"
    ]
    assert angles.level == level
    assert f"{apart_deg:.1f}°" in angles.text
    assert "hip_rotation_r, against MB" in angles.text


def test_trust_in_lengths_says_what_was_imaged() -> None:
    def level(*methods: MethodEvidence, **more: object) -> str:
        (found,) = [t for t in verdict(*methods, **more).trust if t.topic == "Lengths and joint centres"]
        return found.level

    assert level(MB, EB, EB_AM) == "good"
    assert level(MB, EB, EB_AM, imaged=RIGHT) == "fair"
    assert level(MB, MB_AM) == "unknown"
    assert level(MB_LAM) == "poor"


def test_a_trial_without_any_marker_is_no_evidence() -> None:
    found = verdict(plain("MB", 0.0, fitted=None, held_out=None))
    assert found.gates == ()
    assert {t.topic: t.level for t in found.trust}["Following the markers"] == "unknown"


def test_no_method_is_refused() -> None:
    with pytest.raises(ValueError, match="at least one"):
        judge(Evidence(()))
