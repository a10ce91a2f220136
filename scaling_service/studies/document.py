"""``study.json``: a paper's study done again, its numbers beside ours."""

from __future__ import annotations

from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, Field

from scaling_service.capabilities.cohort.document import StatisticsDocument

STUDY_SCHEMA_VERSION = 1
"""Raised when a reader of an older document would misread a newer one; new keys do not raise it."""


class _Part(BaseModel):
    """Frozen, checked on the way out, and refusing what JSON has no number for."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class Beside(_Part):
    """One cell of a table of the paper beside ours; mean and standard deviation over subjects."""

    quantity: str
    method: str
    paper_mean: float | None = Field(description="Null where the paper gives none.")
    paper_sd: float | None
    mean: float
    sd: float
    paper_stars: str = Field("", description="The paper's mark of a difference from EB.")
    p_from_EB: float | None = Field(None, description="Ours, Tukey's HSD; null where it was not tested.")
    significant: bool | None = Field(None, description="After Friedman's test, at 5 %.")


class ClaimEntry(_Part):
    """One claim of the paper, and whether it holds here."""

    where: str
    claim: str
    paper: str = Field(description="The paper's figures.")
    holds: bool | None = Field(description="Null where this cohort cannot decide.")
    ours: str = Field(description="The figures that the answer rests on.")


class StudyDocument(_Part):
    """``study.json``."""

    schema_version: int = STUDY_SCHEMA_VERSION
    kind: Literal["study"] = "study"
    study: Literal["puchaud2019"]
    source: str
    code_version: str
    settings: dict[str, Any]
    seed: int
    subjects: list[str]
    walkers: list[str] = Field(description="Whose gait alone the paper's number of walkers is.")
    segment_lengths_mm: list[Beside] = Field(description="Table 2.")
    knee_axis_deg: list[Beside] = Field(description="Table 3.")
    kinematic_error_mm: list[Beside] = Field(description="Table 5 and figure 5, on functional movements.")
    literature_error_mm: dict[str, float] = Field(description="Table 5: other studies.")
    length_difference_mm: list[Beside] = Field(description="Figure 4: method minus EB.")
    marker_shift_mm: list[Beside] = Field(description="Section 3.1.")
    claims: list[ClaimEntry]
    notes: list[str] = Field(description="How this study is not the paper's.")
    statistics: StatisticsDocument = Field(description="All subjects; joint angles are figure 6.")
    walkers_statistics: StatisticsDocument
    slowest_subject_s: float
    wall_s: float
