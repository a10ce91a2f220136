"""``study.json`` of Puchaud et al. 2019 done again, its numbers beside ours."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from scaling_service.capabilities.cohort.document import Part, Rounded, StatisticsDocument
from scaling_service.studies.claims import StudyDocument


class Beside(Part):
    """One cell of a table of the paper beside ours; mean and standard deviation over subjects."""

    quantity: str
    method: str
    paper_mean: Rounded | None = Field(description="Null where the paper gives none.")
    paper_sd: Rounded | None
    mean: Rounded
    sd: Rounded
    paper_stars: str = Field("", description="The paper's mark of a difference from EB.")
    p_from_EB: float | None = Field(None, description="Ours, Tukey's HSD; null where it was not tested.")
    significant: bool | None = Field(None, description="After Friedman's test, at 5 %.")


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
