"""``study.json`` of Muller et al. 2017 done again."""

from __future__ import annotations

from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, Field

from scaling_service.studies.document import STUDY_SCHEMA_VERSION, ClaimEntry

Six = tuple[float, float, float, float, float, float]
"""fx, fy, fz over body weight, mx, my, mz over body weight times stature; X forward, Y up, Z right."""


class _Part(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class IdentificationEntry(_Part):
    """Residual indicators on the held-out performance before and after an identification."""

    residual_before: Six
    residual_after: Six
    true_error_before: Six = Field(description="What the inertia leaves of the true motion and forces.")
    true_error_after: Six


class LevelEntry(_Part):
    """One level of added reconstruction error."""

    added_mm: float
    dispersion: Six
    distinct_motions: int


class MarkerEntry(_Part):
    """One marker's error and its share of the uncertainty."""

    marker: str
    sd_mm: float = Field(description="Of its own error per direction, after the filter.")
    shares: Six = Field(description="Of the variance of each component.")


class WindowEntry(_Part):
    """One window of frames worth calibrating with."""

    start_s: float
    stop_s: float
    gain: float = Field(description="Information on inertia that it adds, nats.")
    uncertainty: float = Field(description="Mean SD of the residual force over body weight.")


class PropagatedEntry(_Part):
    """One recording's residual and its uncertainty, by samples."""

    name: str
    reconstruction_error_mm: float
    frames: int
    dr: Six
    kinematic: Six
    plate: Six
    total: Six
    slopes_per_cm: Six
    r2: Six
    r2_centred: Six
    levels: list[LevelEntry]
    calibration_supported: tuple[bool, bool, bool, bool, bool, bool]
    verdict: str


class PersonEntry(PropagatedEntry):
    """One virtual person."""

    linear_slopes_per_cm: Six
    true_measurement_error: Six
    true_inertial_error: Six
    markers_sd: Six = Field(description="Standard deviation by the markers' errors.")
    supported_by_markers: tuple[bool, bool, bool, bool, bool, bool] = Field(
        description="Where dr exceeds that by the root of two: inertia then has the larger part."
    )
    coverage: Six = Field(description="Share of frames whose true error lies within 1.96 of it.")
    markers: list[MarkerEntry] = Field(description="Those with the largest shares, largest first.")
    windows: list[WindowEntry]
    windows_share: float = Field(description="Of the whole recording's information.")
    identified_beside_tables: IdentificationEntry
    identified_freely: IdentificationEntry


class Muller2017Document(_Part):
    """``study.json``."""

    schema_version: int = STUDY_SCHEMA_VERSION
    kind: Literal["study"] = "study"
    study: Literal["muller2017"] = "muller2017"
    source: str
    code_version: str
    settings: dict[str, Any]
    seed: int
    persons: list[PersonEntry]
    recordings: list[PropagatedEntry] = Field(description="Real ones, if given; claims leave them out.")
    claims: list[ClaimEntry]
    notes: list[str] = Field(description="How this study is not the paper's.")
    wall_s: float
