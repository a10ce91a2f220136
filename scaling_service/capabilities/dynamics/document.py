"""``dynamics.json``: residual wrenches of recordings, their uncertainty, and what they say of the inertia."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from scaling_service.documents.results import Provenance, _Result

Six = tuple[float, float, float, float, float, float]
Yes = tuple[bool, bool, bool, bool, bool, bool]


class Wrench(_Result):
    """Six components in ground axes: X forward, Y up, Z right; moments about the root segment's origin."""

    fx_N: float
    fy_N: float
    fz_N: float
    mx_Nm: float
    my_Nm: float
    mz_Nm: float


class ResidualGate(_Result):
    """One published limit on the residual."""

    name: str
    source: str
    value: float
    limit: float
    unit: Literal["N", "N m"]
    passed: bool


class UncertaintyDocument(_Result):
    """What errors of measurement add to ``dr`` (Muller et al. 2017), in the same shares and order."""

    kinematic: Six = Field(description="Of the motion: markers and model.")
    plate: Six = Field(description="Of the force plates.")
    total: Six


class JointLoad(_Result):
    """Generalised force of one coordinate over the judged frames."""

    unit: Literal["N", "N m"]
    peak: float = Field(description="The largest size.")
    rms: float


class TrialDynamicsDocument(_Result):
    """One recording."""

    role: Literal["calibration", "evaluation"]
    forces_from: str = Field(description="File that the forces came from.")
    frames: int = Field(description="Frames that count.")
    left_out: int = Field(description="Frames whose motion or forces are not all known, and ends of them.")
    residual_rms: Wrench
    dr: Six = Field(
        description="Residual RMS over body weight (forces) and body weight times height (moments); "
        "Muller et al. 2017, eq. 7."
    )
    gates: list[ResidualGate]
    joint_loads: dict[str, JointLoad]
    reconstruction_error_mm: float = Field(description="Mean distance of markers from the motion.")
    uncertainty: UncertaintyDocument
    slopes_per_cm: Six = Field(description="Kinematic uncertainty of dr per cm of reconstruction error.")
    r2: Six = Field(description="Of the lines through zero with these slopes.")
    calibration_supported: Yes = Field(
        description="Whether dr exceeds its uncertainty, so that inertia may be blamed for it."
    )
    warnings: list[str]


class InertialChange(_Result):
    """One number of one segment before and after identification."""

    segment: str
    quantity: str
    unit: Literal["kg", "m", "kg m2"]
    before: float
    after: float
    prior_sd: float
    sd: float
    moved: float = Field(description="Change over prior_sd.")
    identifiable: bool


class CombinationPart(_Result):
    """A part of a combination; weights are in units of the prior's standard deviations."""

    segment: str
    quantity: str
    weight: float


class CombinationChange(_Result):
    """A combination of inertial parameters that the recordings determine."""

    parts: list[CombinationPart] = Field(description="The largest ones.")
    gain: float = Field(description="Information of the recordings over that of the prior.")
    moved: float
    sd: float


class WrenchFitDocument(_Result):
    """RMS error of the ground wrench with the inertia before and after."""

    held_out: bool
    frames: int
    before: Wrench
    after: Wrench


class IdentificationDocument(_Result):
    """Inertial parameters from the forces (Futamure et al., eq. 8)."""

    components: Yes = Field(description="Components of the wrench that were used: fx, fy, fz, mx, my, mz.")
    total_mass_kg: tuple[float, float] = Field(description="Before and after.")
    trials: dict[str, WrenchFitDocument]
    held_out_ratio: float | None = Field(
        description="Error of the used components after over before, held-out recordings; null without any."
    )
    combinations: list[CombinationChange]
    parameters: list[InertialChange]
    warnings: list[str]


class DynamicsDocument(Provenance):
    """``dynamics.json``."""

    start: str = Field(description="The method that scaled the model, or 'none'.")
    inertia: str = Field(description="An inertial table, or 'model': what the model holds.")
    mass_kg: float = Field(description="The model's.")
    height_m: float
    trials: dict[str, TrialDynamicsDocument]
    verdict: str = Field(description="Whether these recordings can calibrate this person's inertia.")
    inertial: IdentificationDocument | None = Field(default=None, description="Null where not asked for.")
    warnings: list[str]
    files: list[str] = Field(description="What was written beside this document.")
    wall_s: float
