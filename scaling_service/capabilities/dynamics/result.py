"""What `dynamics` finds: residual wrenches, their uncertainty and what they say of the inertia."""

from __future__ import annotations

import typing
from collections import abc
from dataclasses import dataclass
from html import escape

import numpy as np
import pydantic
from numpy.typing import NDArray

from scaling_service.core.tables import ResultTable
from scaling_service.core.text import list_few
from scaling_service.documents import base
from scaling_service.documents.results import Provenance

if typing.TYPE_CHECKING:
    from scaling_service.capabilities.dynamics import start
    from scaling_service.capabilities.dynamics import weight as weights
    from scaling_service.capabilities.dynamics.inertia.parameters import InertialIdentification
    from scaling_service.capabilities.dynamics.uncertainty import total
    from scaling_service.capabilities.dynamics.unmeasured import Unmeasured
    from scaling_service.capabilities.kinetics import inverse_dynamics
    from scaling_service.capabilities.kinetics.forces import TrialForces


def _round_figures(value: float) -> float:
    """Six significant figures; forces are not known to more than three."""
    return float(f"{value:.6g}")


Number = typing.Annotated[float, pydantic.AfterValidator(_round_figures)]
Six = typing.Annotated[tuple[Number, Number, Number, Number, Number, Number], pydantic.BeforeValidator(tuple)]
Yes = tuple[bool, bool, bool, bool, bool, bool]


class Wrench(base.Part):
    """Six components in ground axes: X forward, Y up, Z right; moments about the root segment's origin."""

    fx_N: Number
    fy_N: Number
    fz_N: Number
    mx_Nm: Number
    my_Nm: Number
    mz_Nm: Number

    @pydantic.model_validator(mode="before")
    @classmethod
    def _name_components(cls, values: typing.Any) -> typing.Any:
        """Six numbers of an array by their names."""
        return dict(zip(cls.model_fields, values, strict=True)) if isinstance(values, np.ndarray) else values


class ResidualGate(base.Part):
    """One published limit on the residual."""

    name: str
    source: str
    value: Number
    limit: Number
    unit: typing.Literal["N", "N m"]
    passed: bool


class UncertaintyDocument(base.Part):
    """What errors of measurement add to ``dr`` (Muller et al. 2017), in the same shares and order."""

    kinematic: Six = pydantic.Field(description="Of the motion: markers and model.")
    plate: Six = pydantic.Field(description="Of the force plates.")
    total: Six


class JointLoad(base.Part):
    """Generalised force of one coordinate over the judged frames."""

    unit: typing.Literal["N", "N m"]
    peak: Number = pydantic.Field(description="The largest size.")
    rms: Number


class TrialDynamicsDocument(base.Part):
    """One recording."""

    role: typing.Literal["calibration", "evaluation"]
    forces_from: str = pydantic.Field(description="File that the forces came from.")
    frames: int = pydantic.Field(description="Frames that count.")
    left_out: int = pydantic.Field(
        description="Frames whose motion or forces are not all known, and ends of them."
    )
    residual_rms: Wrench
    dr: Six = pydantic.Field(
        description="Residual RMS over body weight (forces) and body weight times height (moments); "
        "Muller et al. 2017, eq. 7."
    )
    gates: list[ResidualGate]
    joint_loads: dict[str, JointLoad]
    reconstruction_error_mm: Number = pydantic.Field(description="Mean distance of markers from the motion.")
    uncertainty: UncertaintyDocument
    slopes_per_cm: Six = pydantic.Field(
        description="Kinematic uncertainty of dr per cm of reconstruction error."
    )
    r2: Six = pydantic.Field(description="Of the lines through zero with these slopes.")
    calibration_supported: Yes = pydantic.Field(
        description="Whether dr exceeds its uncertainty and the plates measure all that bears the person, "
        "so that inertia may be blamed for it."
    )
    unmeasured: list[str] = pydantic.Field(
        default=[],
        description="Flight, and when a chair, a step or a missing plate bears the person.",
    )
    warnings: list[str]


class InertialChange(base.Part):
    """One number of one segment before and after identification."""

    segment: str
    quantity: str
    unit: typing.Literal["kg", "m", "kg m2"]
    before: Number
    after: Number
    prior_sd: Number
    sd: Number
    moved: Number = pydantic.Field(description="Change over prior_sd.")
    identifiable: bool


class CombinationPart(base.Part):
    """A part of a combination; weights are in units of the prior's standard deviations."""

    segment: str
    quantity: str
    weight: Number


class CombinationChange(base.Part):
    """A combination of inertial parameters that the recordings determine."""

    parts: list[CombinationPart] = pydantic.Field(description="The largest ones.")
    gain: Number = pydantic.Field(description="Information of the recordings over that of the prior.")
    moved: Number
    sd: Number


class WrenchFitDocument(base.Part):
    """RMS error of the ground wrench with the inertia before and after."""

    held_out: bool
    frames: int
    before: Wrench
    after: Wrench


class IdentificationDocument(base.Part):
    """Inertial parameters from the forces (Futamure et al., eq. 8)."""

    headline: str = pydantic.Field(default="", description="What it found, in one sentence.")
    tone: base.Tone = pydantic.Field(default="plain", description="Whether the headline is good news.")
    components: Yes = pydantic.Field(
        description="Components of the wrench that were used: fx, fy, fz, mx, my, mz."
    )
    total_mass_kg: tuple[Number, Number] = pydantic.Field(description="Before and after.")
    trials: dict[str, WrenchFitDocument]
    held_out_ratio: Number | None = pydantic.Field(
        description="Error of the used components after over before, held-out recordings; null without any."
    )
    combinations: list[CombinationChange]
    parameters: list[InertialChange]
    warnings: list[str]


class WeightDocument(base.Part):
    """Mass by the momentum balance of all recordings with forces, beside the model's."""

    declared_kg: Number
    plates_kg: Number
    sd_kg: Number
    differs: bool = pydantic.Field(
        default=False, description="Whether the declared mass is wrong beyond doubt."
    )
    by_trial_kg: dict[str, Number] = pydantic.Field(description="What the plates bear in each recording.")


class DynamicsDocument(Provenance):
    """``dynamics.json``."""

    start: str = pydantic.Field(description="The method that scaled the model, or 'none'.")
    inertia: str = pydantic.Field(description="An inertial table, or 'model': what the model holds.")
    mass_kg: Number = pydantic.Field(description="The model's.")
    weight: WeightDocument
    height_m: float
    trials: dict[str, TrialDynamicsDocument]
    headline: str = pydantic.Field(default="", description="The verdict in one sentence.")
    tone: base.Tone = pydantic.Field(default="plain", description="Whether the headline is good news.")
    verdict: str = pydantic.Field(description="Whether these recordings can calibrate this person's inertia.")
    inertial: IdentificationDocument | None = pydantic.Field(
        default=None, description="Null where not asked for."
    )
    warnings: list[str]
    files: list[str] = pydantic.Field(description="What was written beside this document.")
    wall_s: float


class ResidualTrial(base.Part):
    """The residual wrench over one recording."""

    start_s: float
    rate_hz: float
    residual: base.ArrayEntry = pydantic.Field(
        description="Frames, 6: force in N, moment about the root segment's origin in N m, in ground axes."
    )


class ResidualScene(base.Scene):
    """Residual wrenches over time; frames that do not count are unknown."""

    trials: dict[str, ResidualTrial]


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class TrialDynamics:
    """One recording's dynamics."""

    forces: TrialForces
    dynamics: inverse_dynamics.InverseDynamics
    frames: NDArray[np.bool_]  # (n,): those that count; see ``judged_frames``
    residuals: inverse_dynamics.Residuals  # over these frames
    recording: total.LoadedMotion  # the same, as its uncertainty is asked of it
    uncertainty: total.WrenchUncertainty  # of the residual, over the same frames
    # flight, and what bears the person that no plate measures
    unmeasured: tuple[Unmeasured, ...] = ()
    warnings: tuple[str, ...] = ()  # plain sentences

    @property
    def calibration_supported(self) -> NDArray[np.bool_]:
        """Components (6,) whose residual inertia may be blamed for; none where plates do not measure all."""
        return np.asarray(self.uncertainty.calibration_supported & (not self.unmeasured))


@dataclass(frozen=True, slots=True, eq=False, repr=False, kw_only=True)
class DynamicsResults:
    """Dynamics of all of a subject's recordings that have forces."""

    prepared: start.Prepared
    trials: abc.Mapping[str, TrialDynamics]  # by the stems of the trials' files
    weight: weights.Weight  # by the plates, beside the model's
    verdict: str  # in plain words: what the residuals say of the model
    document: DynamicsDocument  # ``dynamics.json``: N and N m
    inertial: InertialIdentification | None = None  # where it was asked for and the verdict allows it

    @property
    def residuals(self) -> ResultTable:
        """RMS of the residual wrench of every recording, N and N m."""
        units = list(Wrench.model_fields)
        rows = tuple((name, *map(float, trial.residuals.rms)) for name, trial in self.trials.items())
        return ResultTable("RMS of the residual", ("trial", *units), rows)

    @property
    def tables(self) -> dict[str, ResultTable]:
        """The residuals of all recordings."""
        return {"residuals": self.residuals}

    def __repr__(self) -> str:
        return f"{self.residuals!r}\n{self.verdict}"

    def _repr_html_(self) -> str:
        return f"{self.residuals._repr_html_()}<p>{escape(self.verdict)}</p>"


def merge_warnings(document: DynamicsDocument) -> list[str]:
    """The recordings' warnings, what holds of several of them said once."""
    where: dict[str, list[str]] = {}
    for name, trial in document.trials.items():
        for warning in trial.warnings:
            where.setdefault(warning.removeprefix(f"{name}: "), []).append(name)
    return [f"{list_few(names)}: {said}" for said, names in where.items()]
