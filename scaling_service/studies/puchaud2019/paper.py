"""The numbers of Puchaud et al. 2019, from ``reference_models``, and those of a cohort beside them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from typing import Literal

import numpy as np
from pydantic import Field

from scaling_service.capabilities.cohort.document import Part, Rounded, StatisticsDocument
from scaling_service.capabilities.cohort.groups import ScalarComparison
from scaling_service.capabilities.cohort.statistics import CohortStatistics
from scaling_service.model.reference import read_reference, reference_folder
from scaling_service.studies.claims import StudyDocument


class Beside(Part):
    """One cell of a table of the paper beside ours; mean and standard deviation over subjects."""

    quantity: str
    method: str
    paper_mean: Rounded | None = Field(description="Null where the paper gives none.")
    paper_sd: Rounded | None
    mean: Rounded
    sd: Rounded
    paper_stars: str = Field(default="", description="The paper's mark of a difference from EB.")
    p_from_EB: float | None = Field(
        default=None, description="Ours, Tukey's HSD; null where it was not tested."
    )
    significant: bool | None = Field(default=None, description="After Friedman's test, at 5 %.")


class Puchaud2019Document(StudyDocument):
    """``study.json``."""

    study: Literal["puchaud2019"] = "puchaud2019"
    subjects: list[str]
    walkers: list[str] = Field(description="Whose gait alone the paper's number of walkers is.")
    segment_lengths_mm: list[Beside] = Field(description="Table 2.")
    knee_axis_deg: list[Beside] = Field(description="Table 3.")
    kinematic_error_mm: list[Beside] = Field(description="Table 5 and figure 5, on functional movements.")
    literature_error_mm: dict[str, float] = Field(description="Table 5: other studies.")
    length_difference_mm: list[Beside] = Field(description="Figure 4: method minus EB.")
    marker_shift_mm: list[Beside] = Field(description="Section 3.1.")
    statistics: StatisticsDocument = Field(description="All subjects; joint angles are figure 6.")
    walkers_statistics: StatisticsDocument
    slowest_subject_s: float

    @property
    def size(self) -> int:
        """How many virtual persons there are."""
        return len(self.subjects)


METHODS = ("MB", "MB_lam", "MB_am", "EB", "EB_am")
"""The five models, in the order of the paper's figures."""

LENGTHS = ("femur_r", "femur_l", "inter_hip", "shank_r", "shank_l")
"""The rows of table 2."""

AXES = ("r_x", "r_y", "l_x", "l_y")
"""Turns of the knee axes, as in table 3."""

SAME_LENGTHS: Mapping[str, str] = {"MB_am": "MB", "EB_am": "EB"}
"""Methods that keep the lengths of their first guess share its column in table 2."""

_MM = 1e-3


@dataclass(frozen=True, slots=True)
class Spread:
    """Mean and standard deviation over subjects, m or rad."""

    mean: float
    sd: float


Table = Mapping[str, Mapping[str, Spread]]
"""Method to quantity to its spread."""


@dataclass(frozen=True, slots=True)
class Paper:
    """What the paper found."""

    source: str
    lengths: Table  # table 2, m
    differs_from_EB: Mapping[str, Mapping[str, str]]  # method to length to stars, where table 2 has any
    knee_axes: Table  # table 3, rad
    errors: Mapping[str, Spread]
    shifts: Mapping[str, Spread]
    """``errors``, ``shifts``: method to kinematic error (figure 5) and marker shift (section 3.1), m."""
    length_differences: Table  # method minus EB (figure 4), m
    literature_errors: Mapping[str, float]
    """Table 5: study to its mean kinematic error, m."""


@cache
def paper() -> Paper:
    """The paper's numbers, read once."""
    content = read_reference(reference_folder() / "puchaud2019.yaml")
    lengths = content["segment_lengths_mm"]
    table = _table({m: lengths[SAME_LENGTHS.get(m, m)] for m in METHODS}, _MM)
    return Paper(
        source=" ".join(content["source"].split()),
        lengths=table,
        differs_from_EB=lengths["differs_from_EB"],
        knee_axes=_table(content["knee_axis_deg"], float(np.pi / 180.0)),
        errors=_spreads(content["kinematic_error_mm"], _MM),
        shifts=_spreads(content["marker_shift_mm"], _MM),
        length_differences=_table(content["length_difference_mm"], _MM),
        literature_errors={who: _MM * value for who, value in content["literature_error_mm"].items()},
    )


def _table(content: Mapping[str, Mapping[str, list[float]]], unit: float) -> dict[str, dict[str, Spread]]:
    return {method: _spreads(row, unit) for method, row in content.items()}


def _spreads(content: Mapping[str, list[float]], unit: float) -> dict[str, Spread]:
    return {name: Spread(unit * mean, unit * sd) for name, (mean, sd) in content.items()}


_TO_MM, _TO_DEG = 1e3, 180.0 / math.pi


def lengths(cohort: CohortStatistics) -> list[Beside]:
    """Table 2, mm."""
    known = paper()
    return [
        _against_image(
            cohort.scalar("segment_length", name),
            method,
            known.lengths[method][name],
            known.differs_from_EB.get(method, {}).get(name, ""),
        )
        for name in LENGTHS
        for method in METHODS
    ]


def knee_axes(cohort: CohortStatistics) -> list[Beside]:
    """Table 3, degrees."""
    return [
        _cell(cohort.scalar("knee_axis", name), method, row[name], _TO_DEG)
        for method, row in paper().knee_axes.items()
        for name in AXES
    ]


def errors(cohort: CohortStatistics) -> list[Beside]:
    """Figure 5, of which table 5 repeats some means, mm."""
    found = cohort.scalar("kinematic_error", "calibration")
    return [_against_image(found, method, paper().errors[method]) for method in METHODS]


def length_differences(cohort: CohortStatistics) -> list[Beside]:
    """Figure 4: method minus EB, mm."""
    cells = []
    for method in ("MB", "MB_lam"):
        for name in LENGTHS:
            values = cohort.scalar("segment_length", name).values
            gaps = np.array([of[method] - of["EB"] for of in values.values()])
            ours = Spread(float(gaps.mean()), float(gaps.std(ddof=1)))
            cells.append(_beside(name, method, paper().length_differences[method].get(name), ours, _TO_MM))
    return cells


def marker_shifts(cohort: CohortStatistics) -> list[Beside]:
    """Section 3.1, mm. The paper's scatter is over coordinates, ours over subjects."""
    found = cohort.scalar("marker_shift", "mean_over_markers")
    return [_cell(found, method, spread, _TO_MM) for method, spread in paper().shifts.items()]


def _cell(found: ScalarComparison, method: str, theirs: Spread, unit: float) -> Beside:
    return _beside(found.quantity, method, theirs, Spread(found.mean[method], found.sd[method]), unit)


def _beside(quantity: str, method: str, theirs: Spread | None, ours: Spread, unit: float) -> Beside:
    return Beside(
        quantity=quantity,
        method=method,
        paper_mean=None if theirs is None else unit * theirs.mean,
        paper_sd=None if theirs is None else unit * theirs.sd,
        mean=unit * ours.mean,
        sd=unit * ours.sd,
    )


def _against_image(found: ScalarComparison, method: str, theirs: Spread, stars: str = "") -> Beside:
    plain = _cell(found, method, theirs, _TO_MM)
    if method == "EB" or found.test is None:
        return plain
    pair = found.test.pair(method, "EB")
    tested = {"paper_stars": stars, "p_from_EB": pair.p, "significant": pair.significant}
    return plain.model_copy(update=tested)
