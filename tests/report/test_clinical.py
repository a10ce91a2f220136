"""The chapter for gait laboratories: the document's numbers, and plain words where there are none."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from scaling_service.capabilities.scaling.clinical_gait import VARIABLES, read_schwartz2008
from scaling_service.capabilities.scaling.report.angles import build_clinical_section
from scaling_service.documents.results import (
    ClinicalCurve,
    ClinicalCycle,
    ClinicalDocument,
    ClinicalSide,
    MethodResult,
)
from tests.documents.test_results import METHOD
from tests.report.reading import data, read, tables

SCORES = {angle: 1.0 + k for k, angle in enumerate(VARIABLES)}


def side(curves: tuple[str, ...] = VARIABLES, gps: float | None = 5.63) -> ClinicalSide:
    bands = read_schwartz2008().bands
    return ClinicalSide(
        cycles=[ClinicalCycle(trial="walk<1>", start_s=0.5, end_s=1.5)] * 2,
        curves={
            angle: ClinicalCurve(
                mean_deg=np.degrees(bands[angle].mean).round(3).tolist(), sd_deg=[1.0] * 51, n_cycles=2
            )
            for angle in curves
        },
        gvs_deg={angle: SCORES[angle] for angle in curves},
        gps_deg=gps,
    )


def document(sides: dict[Any, ClinicalSide], gps: float | None = None, **more: Any) -> ClinicalDocument:
    fields: dict[str, Any] = {
        "reference": "a reference",
        "population": "83 children",
        "sides": sides,
        "gps_deg": gps,
        "reference_gvs_deg": dict.fromkeys(VARIABLES, 5.0),
        "reference_gps_deg": 5.0,
        "held_out": True,
        "left_out": [],
        "doubtful": ["pelvic tilt: no marker"],
        "reason": "" if sides else "the pelvis does not go straight",
    }
    return ClinicalDocument(**(fields | more))


def section(clinical: ClinicalDocument | None) -> str:
    method = MethodResult(**(METHOD | {"method": "MB", "clinical": clinical}))
    return build_clinical_section({"MB": method}, "MB").html()


def test_curves_stand_before_the_band_and_scores_are_the_documents() -> None:
    html = section(document({"r": side(), "l": side()}, 5.5))
    root = read(html)
    figures = [content for content in data(root) if "data" in content]
    assert len(figures) == len(VARIABLES) + 1
    tilt = figures[0]["data"]
    assert [trace.get("fill") for trace in tilt] == ["toself"] * 3 + [None] * 2  # band, both SD, both means
    assert [trace["name"] for trace in tilt[3:]] == ["left", "right"]
    bars = [trace for trace in figures[-1]["data"] if trace["type"] == "bar"]
    assert [bar["name"] for bar in bars] == ["left", "right"]
    assert len(bars[0]["x"]) == len(VARIABLES) + 1
    found = {row[0]: row[1] for rows in tables(root).values() for row in rows[1:]}
    assert found["knee flexion, right"] == "7.0"
    assert found["GPS, both sides"] == "5.5"
    assert "5.5 degrees (left 5.6, right 5.6)" in html
    assert "walk&lt;1&gt;" in html
    assert "2 left and 2 right" in html
    assert "pelvic tilt: no marker." in html


def test_without_feet_no_score_is_given_and_it_is_said_why() -> None:
    legs = VARIABLES[:-2]
    html = section(
        document({"r": side(legs, None), "l": side(legs, None)}, left_out=["ankle and foot: no heel and toe"])
    )
    assert "No Gait Profile Score" in html
    assert "ankle dorsiflexion, foot progression" in html
    assert "Not given: ankle and foot: no heel and toe." in html
    figures = [content for content in data(read(html)) if "data" in content]
    assert len(figures) == len(legs) + 1
    assert len(figures[-1]["data"][0]["x"]) == len(legs)
    assert not [row for rows in tables(read(html)).values() for row in rows if "GPS" in row[0]]


def test_one_side_alone_is_shown() -> None:
    html = section(document({"l": side()}))
    assert "2 left" in html
    assert not [row for rows in tables(read(html)).values() for row in rows if "right" in row[0]]


@pytest.mark.parametrize(
    ("clinical", "said"),
    [(document({}), "the pelvis does not go straight"), (None, "no movement was recorded")],
)
def test_without_cycles_the_reason_is_said(clinical: ClinicalDocument | None, said: str) -> None:
    assert f"No gait cycle is shown: {said}." in section(clinical)
