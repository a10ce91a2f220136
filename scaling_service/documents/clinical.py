"""Joint angles as gait laboratories read them, over gait cycles, degrees."""

from __future__ import annotations

from typing import Literal

from pydantic import BaseModel, ConfigDict, Field


class _Result(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class ClinicalCycle(_Result):
    """One gait cycle, from contact to contact of the same foot."""

    trial: str
    start_s: float
    end_s: float


class ClinicalCurve(_Result):
    """An angle over the gait cycle at 0, 2, … 100 %."""

    mean_deg: list[float]
    sd_deg: list[float] | None = Field(description="Between cycles; null of a single one.")
    n_cycles: int


class ClinicalSide(_Result):
    """One leg."""

    cycles: list[ClinicalCycle]
    curves: dict[str, ClinicalCurve]
    gvs_deg: dict[str, float] = Field(
        description="Gait Variable Scores, the Movement Analysis Profile (Baker 2009)."
    )
    gps_deg: float | None = Field(description="Gait Profile Score; null where one of nine angles is missing.")


class ClinicalDocument(_Result):
    """Conventional angles of one model: curves, profile and score against a reference population."""

    reference: str
    population: str
    sides: dict[Literal["r", "l"], ClinicalSide]
    gps_deg: float | None = Field(description="Of both sides, the pelvis counted once (as on the left).")
    reference_gvs_deg: dict[str, float] = Field(
        description="RMS distance of the reference's own members from its mean."
    )
    reference_gps_deg: float = Field(description="The same over all nine angles.")
    held_out: bool = Field(description="Whether the cycles are from trials that were not fitted.")
    left_out: list[str] = Field(description="Angles that are not given, and why.")
    doubtful: list[str] = Field(description="Angles that are given but rest on little, and why.")
    reason: str = Field(description="Why there is no gait cycle; empty where there is one.")
