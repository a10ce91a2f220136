"""``study.json`` of the study of Muller et al. 2017."""

from __future__ import annotations

import typing

import numpy as np
import pydantic
from numpy.typing import NDArray

from scaling_service.core.arrays import Array
from scaling_service.documents.base import Part
from scaling_service.studies import claims

_DIGITS = 8


def _to_plain(values: typing.Any) -> typing.Any:
    """Arrays as tuples."""
    return tuple(values.tolist()) if isinstance(values, np.ndarray) else values


def _round_digits(value: float) -> float:
    """Eight digits after the point; smaller numbers, such as the plates', to four that count."""
    return float(f"{value:.4g}") if abs(value) < 1e-4 else round(value, _DIGITS)


_Number = typing.Annotated[float, pydantic.AfterValidator(_round_digits)]
Six = typing.Annotated[
    tuple[_Number, _Number, _Number, _Number, _Number, _Number], pydantic.BeforeValidator(_to_plain)
]
"""fx, fy, fz over body weight, mx, my, mz over body weight times stature; X forward, Y up, Z right."""

SixFlags = typing.Annotated[tuple[bool, bool, bool, bool, bool, bool], pydantic.BeforeValidator(_to_plain)]


class IdentificationEntry(Part):
    """Residual indicators on the held-out performance before and after an identification."""

    residual_before: Six
    residual_after: Six
    true_error_before: Six = pydantic.Field(
        description="What the inertia leaves of the true motion and forces."
    )
    true_error_after: Six

    @property
    def growth(self) -> Array:
        """(6,): true error after over before."""
        return np.divide(self.true_error_after, self.true_error_before)

    @property
    def worse(self) -> float:
        """True error after over before, all components together."""
        return float(np.linalg.norm(self.true_error_after) / np.linalg.norm(self.true_error_before))


class LevelEntry(Part):
    """One level of added reconstruction error."""

    added_mm: float
    dispersion: Six
    distinct_motions: int


class MarkerEntry(Part):
    """One marker's error and its share of the uncertainty."""

    marker: str
    sd_mm: float = pydantic.Field(description="Of its own error per direction, after the filter.")
    shares: Six = pydantic.Field(description="Of the variance of each component.")


class WindowEntry(Part):
    """One window of frames worth calibrating with."""

    start_s: float
    stop_s: float
    gain: float = pydantic.Field(description="Information on inertia that it adds, nats.")
    uncertainty: float = pydantic.Field(description="Mean SD of the residual force over body weight.")


class PropagatedEntry(claims.PersonPart):
    """One recording's residual and its uncertainty, by samples."""

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
    calibration_supported: SixFlags
    verdict: str


class PersonEntry(PropagatedEntry):
    """One virtual person."""

    linear_slopes_per_cm: Six
    true_measurement_error: Six
    true_inertial_error: Six
    markers_sd: Six = pydantic.Field(description="Standard deviation by the markers' errors.")
    supported_by_markers: SixFlags = pydantic.Field(
        description="Where dr exceeds that by the root of two: inertia then has the larger part."
    )
    coverage: Six = pydantic.Field(description="Share of frames whose true error lies within 1.96 of it.")
    markers: list[MarkerEntry] = pydantic.Field(description="Those with the largest shares, largest first.")
    windows: list[WindowEntry]
    windows_share: float = pydantic.Field(description="Of the whole recording's information.")
    identified_beside_tables: IdentificationEntry
    identified_freely: IdentificationEntry

    @property
    def blamed(self) -> NDArray[np.bool_]:
        """(6,): whether the true inertial error exceeds the true error of the measurement."""
        return np.greater(self.true_inertial_error, self.true_measurement_error)


class Muller2017Document(claims.StudyDocument):
    """``study.json``."""

    study: typing.Literal["muller2017"] = "muller2017"
    persons: list[PersonEntry]
    recordings: list[PropagatedEntry] = pydantic.Field(
        description="Real ones, if given; claims leave them out."
    )

    @property
    def size(self) -> int:
        """How many virtual persons there are."""
        return len(self.persons)
