"""The report of a cohort, read back: its numbers are those of the statistics, its words follow from them."""

from __future__ import annotations

import re
from collections.abc import Mapping

import numpy as np
import pytest

from scaling_service.capabilities.cohort.result import (
    CohortDocument,
    StatisticsDocument,
    SubjectEntry,
)
from scaling_service.capabilities.cohort.run import write_headline, write_reasons
from scaling_service.capabilities.cohort.statistics import CohortSettings, compute_cohort_statistics
from scaling_service.capabilities.cohort.summary import Following, MethodSummary, SubjectSummary
from scaling_service.capabilities.cohort.words import summarise
from scaling_service.numerics.statistics.waveforms import WaveformSettings
from tests.report.reading import Node, read

QUICK = CohortSettings(waveforms=WaveformSettings(rearrangements=300))
ERRORS = {"MB": 0.012, "MB_am": 0.005, "EB": 0.007}
LENGTHS = {"MB": 0.440, "MB_am": 0.440, "EB": 0.430}


def someone(k: int, methods: Mapping[str, float] = ERRORS) -> SubjectSummary:
    rng = np.random.default_rng([7, k])
    size = 0.01 * rng.normal()
    wave = 0.5 * np.sin(np.linspace(0, 6.28, 101)) + 0.05 * rng.normal()
    return SubjectSummary(
        subject=f"S<{k}>",
        methods={
            m: MethodSummary(
                lengths={"femur_r": LENGTHS[m] + size + 0.001 * rng.normal()},
                trials={"walk": Following("evaluation", error + 2e-4 * rng.normal(), 0.01, 0.03)},
                curves={"knee_angle_r": tuple(wave + (0.2 if m == "MB" else 0.0) + 0.005 * rng.normal())},
            )
            for m, error in methods.items()
        },
        strides={"r": 2},
    )


def page_of(people: list[SubjectSummary]) -> tuple[Node, StatisticsDocument]:
    found = compute_cohort_statistics(people, tuple(ERRORS), settings=QUICK)
    document = CohortDocument(
        code_version="0",
        cohort="a <cohort>.csv",
        methods_asked=None,
        settings={},
        seed=0,
        headline=write_headline(found),
        why=write_reasons(found, {p.subject: {} for p in people}),
        subjects=[
            SubjectEntry(
                id=p.subject,
                file="f.yaml",
                groups={},
                status="done",
                reason="",
                kept=False,
                folder=p.subject,
                methods=list(p.methods),
                left_out={},
                strides={},
                no_strides={},
                wall_s=1.0,
            )
            for p in people
        ],
        statistics=found,
        notes=[],
        wall_s=1.0,
    )
    return read(summarise(document).html()), found


@pytest.fixture(scope="module")
def cohort() -> tuple[Node, StatisticsDocument]:
    return page_of([someone(k) for k in range(9)])


def rows(page: Node, caption: str) -> list[list[str]]:
    table = next(t for t in page.all("table") if caption in (t.attributes["aria-label"] or ""))
    return [[cell.text for cell in (*row.all("th"), *row.all("td"))] for row in table.all("tr")]


def test_numbers_are_those_of_the_statistics(cohort: tuple[Node, StatisticsDocument]) -> None:
    page, found = cohort
    scalar = found.quantity("kinematic_error_mm", "evaluation")
    head, title, row, *_ = rows(page, "The methods over subjects")
    assert title == ["Kinematic error, mm"]
    assert head[1:] == ["subjects", "MB", "MB_am", "EB", "Friedman p"]
    shown = [f"{scalar.mean[m]:.1f} ± {scalar.sd[m]:.1f}" for m in head[2:5]]
    assert row[:5] == ["held-out trials", "9", *shown]


def test_groups_are_told_apart(cohort: tuple[Node, StatisticsDocument]) -> None:
    _, found = cohort
    errors = found.quantity("kinematic_error_mm", "evaluation").values
    groups = {subject: {"shoes": "on" if k < 3 else "off"} for k, subject in enumerate(errors)}
    (reported,) = [said for said in write_reasons(found, groups) if said.startswith("By shoes")]
    shod = np.mean([errors[subject]["EB"] for subject in list(errors)[:3]])
    assert re.search(rf"on \(3\): MB_am \d\.\d, EB {shod:.1f}, MB", reported)
    assert "off (6): " in reported


def test_the_summary_ranks_by_the_error_and_names_the_nearest(
    cohort: tuple[Node, StatisticsDocument],
) -> None:
    page, _ = cohort
    assert re.search(
        r"smallest first: MB_am [45]\.\d, EB [67]\.\d, MB 1[12]\.\d\. The methods differ", page.text
    )

    assert re.search(
        r"MB_am follows the markers of 9 persons most closely, to [45]\.\d mm on held-out trials", page.text
    )
    assert "Lengths against the image, RMS in mm, nearest first" in page.text
    assert "Joint angles differ between methods in the gait cycle for knee angle, right" in page.text


def test_names_are_shown_as_they_are(cohort: tuple[Node, StatisticsDocument]) -> None:
    page, _ = cohort
    assert [r[0] for r in rows(page, "How every subject ended")[1:]] == [f"S<{k}>" for k in range(9)]
    assert "a <cohort>.csv" in page.text


def test_who_lacks_a_method_is_named() -> None:
    people = [*(someone(k) for k in range(5)), someone(5, {"MB": 0.012, "MB_am": 0.005})]
    page, _ = page_of(people)
    assert "Not counted: S<5> (no EB)" in page.text


def test_one_subject_is_described_not_tested() -> None:
    page, _ = page_of([someone(0)])
    assert "no test" in page.text
    assert "differ (Tukey" not in page.text
