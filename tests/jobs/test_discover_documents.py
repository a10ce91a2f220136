"""``discovery.json``: the contract's keys, units, and numbers against what was put in."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import Any

import pytest

from scaling_service.capabilities.discovery.document import (
    DiscoveryDocument,
    LevelDocument,
    QuantityDocument,
    UnexplainedDocument,
)
from scaling_service.capabilities.discovery.effects.catalogue import find_effects
from scaling_service.capabilities.discovery.result import make_discovery_document
from scaling_service.capabilities.discovery.search.findings import NamedEffect
from scaling_service.capabilities.discovery.words import choose_tone, format_quantity, write_headline
from tests.jobs.hand_made import LOAD, LOCKED, SCALE, TOUCH, findings
from tests.jobs.hidden_case import found

CONTRACT = {"verdict", "disagreements", "effects", "gap", "tried", "unexplained"}
EFFECT = {"kind", "where", "driver", "name", "parameters", "confusable_with", "would_separate", "evidence"}
KINDS = {
    "body_mass",
    "marker_offset", "marker_swap", "soft_tissue_artefact", "segment_length",
    "joint_centre_offset", "joint_axis_tilt", "missing_dof", "coupled_motion", "capture_scale", "force_delay",
    "plate_position", "plate_bias", "plate_gain", "plate_rotation", "segment_mass", "segment_com",
    "carried_load", "external_contact", "wobbling_mass", "gravity_tilt", "skin_wobble",
}  # fmt: skip


def written(*effects: NamedEffect) -> dict[str, Any]:
    """As it stands in the file."""
    results = replace(found(), findings=findings(*effects))
    text = json.dumps(make_discovery_document(results).model_dump(mode="json"), allow_nan=False)
    content: dict[str, Any] = json.loads(text)
    assert DiscoveryDocument.model_validate(content).model_dump(mode="json") == content
    return content


def test_the_contract_is_kept() -> None:
    content = written(SCALE)
    assert content.keys() >= CONTRACT | {"schema_version", "settings", "code_version", "input_hashes", "seed"}
    assert content["effects"][0].keys() >= EFFECT
    assert content["effects"][0]["evidence"].keys() >= {"gain_held_out", "p_family_wise"}
    for role in ("fit", "held_out"):
        assert content["gap"][role].keys() >= {"whitened", "markers_mm", "force_N", "moment_Nm"}
        assert content["gap"][role]["whitened"].keys() >= {"before", "after", "floor", "ceiling"}
    assert content["settings"]["search"]["odds"] == 6.0
    evidence = content["effects"][0]["evidence"]  # odds of a hundred to one
    assert evidence["p_family_wise"] == pytest.approx(0.01, rel=0.01)
    assert (evidence["log_odds"], evidence["gain_held_out"]) == (4.6, 0.5)
    assert content["settings"]["processing"]["smoothing"] == "none"


def test_what_is_not_known_is_null_and_lengths_are_mm() -> None:
    gap = written()["gap"]["held_out"]
    assert gap["markers_mm"]["before"] == pytest.approx(10.0)
    assert gap["markers_mm"]["ceiling"] is None
    assert gap["moment_Nm"] is None
    assert (gap["places"]["RLFE"]["unit"], gap["places"]["RLFE"]["floor"]) == ("mm", pytest.approx(1.0))
    assert (gap["places"]["fx"]["unit"], gap["places"]["fx"]["after"]) == ("N", 5.0)
    assert gap["places"]["mx"]["unit"] == "N m"


def test_what_takes_nothing_off_makes_no_verdict() -> None:
    """Headline, verdict and tone say the same."""
    little = written(replace(SCALE, gain=0.001))
    assert not little["effects"][0]["carries"]
    assert (little["verdict"], little["tone"]) == ("nothing", "good")
    assert little["headline"].startswith("Ordinary for people")
    assert written(SCALE)["verdict"] == "found"


def test_a_factor_is_reported_from_one() -> None:
    factor = written(SCALE)["effects"][0]["parameters"]["factor"]
    assert (factor["value"], factor["sd"]) == (pytest.approx(1.01), pytest.approx(0.001))


def test_a_load_has_a_place() -> None:
    """Moments over mass; for a quotient a/b the variance is (sa/b)^2 + (a sb/b^2)^2."""
    numbers = written(LOAD)["effects"][0]["parameters"]
    assert numbers.keys() == {"kg", "x_mm", "y_mm", "z_mm"}
    values = [numbers[k]["value"] for k in ("kg", "x_mm", "y_mm", "z_mm")]
    assert values == pytest.approx([2.0, 50.0, 200.0, 0.0])
    assert numbers["y_mm"]["sd"] == pytest.approx(
        ((20.0 / 2.0) ** 2 + (400.0 * 0.1 / 4.0) ** 2) ** 0.5, rel=1e-5
    )
    assert numbers["z_mm"]["sd"] == pytest.approx(10.0)


def test_effects_without_columns_have_their_own_numbers() -> None:
    locked, touch = (effect["parameters"] for effect in written(LOCKED, TOUCH)["effects"])
    assert locked["axis"]["value"] == [0.0, 1.0, 0.0]
    assert locked["rms_deg"] == {
        "value": 4.0, "sd": None, "usual": [0.0, 15.0], "at_bound": False, "determined": True,
    }  # fmt: skip
    assert locked.keys() == {"axis", "rms_deg"}
    assert {name: touch[name]["value"] for name in ("start_s", "end_s", "rms_N")} == {
        "start_s": 0.5, "end_s": 1.5, "rms_N": 40.0,
    }  # fmt: skip
    assert [touch[name]["sd"] for name in ("start_s", "end_s", "rms_N")] == [0.05, None, 2.0]
    assert written(LOCKED)["effects"][0]["smallest_nameable"] == {}


def test_every_kind_has_a_meaning() -> None:
    assert set(find_effects()) == KINDS
    assert all(len(effect.meaning) > 10 for effect in find_effects().values())


def test_a_mass_has_its_unit_once() -> None:
    assert format_quantity("kg", QuantityDocument(value=7.79, sd=None)) == "7.79 kg"


@pytest.mark.parametrize(
    ("value", "sd", "said"),
    [
        (0.2013, 0.011, "x 0.201 ± 0.011 mm/deg"),
        (12.0, 3.0, "x 12.0 ± 3.0 mm/deg"),
        (1.5, None, "x 1.5 mm/deg"),
    ],
)
def test_a_number_is_shown_to_what_is_known_of_it(value: float, sd: float | None, said: str) -> None:
    assert format_quantity("x_mm_per_deg", QuantityDocument(value=value, sd=sd), spread=True) == said


@pytest.mark.parametrize(
    ("after", "low", "high", "says", "tone"),
    [
        (1.1, 0.9, 1.4, "falls from 2.5 to 1.1 ", "good"),
        (2.2, 1.8, 2.7, "is 2.2 times what is ordinary, 2.5 without, which is no clear change", "fair"),
        (2.5, 2.3, 2.7, "stays at 2.5 ", "fair"),
        (3.5, 3.0, 4.0, "rises from 2.5 to 3.5 ", "fair"),
    ],
)
def test_headline_and_tone_say_of_the_gap_what_its_interval_allows(
    after: float, low: float, high: float, says: str, tone: str
) -> None:
    level = LevelDocument(before=2.5, after=after, floor=1.0, ceiling=1.0, low=low, high=high)
    assert says in write_headline("found", [], level, [], held_out=True)
    assert choose_tone("found", [], level, worse="") == tone


@pytest.mark.parametrize(("after", "says"), [(1.1, False), (2.4, True)])
def test_effects_that_explain_little_are_not_the_whole_headline(after: float, says: bool) -> None:
    level = LevelDocument(before=2.5, after=after, floor=1.0, ceiling=1.0, low=None, high=None)
    left = UnexplainedDocument(
        where=["LCPG"], observable="marker", unit="mm", law="none", rms=42.0, floor=2.0
    )
    said = write_headline("found", [], level, [left], held_out=True)
    assert ("left unexplained, above all at LCPG (42 mm)" in said) is says
