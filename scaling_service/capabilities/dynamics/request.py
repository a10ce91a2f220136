"""The request to check a model's dynamics, as `dynamics` on the command line takes it."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from scaling_service.capabilities.dynamics.settings import PLAIN, UNSMOOTHED, DynamicsSettings
from scaling_service.capabilities.scaling.request import ChosenSettings, OfRecordings
from scaling_service.documents.subject import Identifier

MOST_SAMPLES = 2000
"""Chosen: twice the paper's; more would only hold a worker."""


class DynamicsRequest(OfRecordings):
    """Compute joint loads and residuals from a subject's forces, with their uncertainty."""

    subject: Identifier = Field(
        description="Name of the subject, as uploaded: a model with feet, and recordings with forces.",
        examples=["S02"],
    )
    settings: ChosenSettings = Field(
        default=UNSMOOTHED, description="How recordings are processed and models fitted."
    )
    start: Literal["MB", "MB_lam", "MB_am", "EB", "EB_am", "none"] | None = Field(
        default=None,
        description="Scaling to start from; 'none' takes the model as it is. EB_am where there are bones, "
        "else MB_am, unless given.",
        examples=["none"],
    )
    inertia: Literal["dumas2007", "dumas_wojtusch2018", "deleva1996", "winter2009", "model"] | None = Field(
        default=None,
        description="Inertial table for built-in models; 'model' keeps the model's own. dumas2007 for "
        "built-in models that were scaled, else the model's own, unless given.",
    )
    cutoff_hz: float = Field(
        default=PLAIN.cutoff_hz, gt=0.0, le=1000.0, description="Of the filter that motion and forces pass."
    )
    identify: bool = Field(default=False, description="Identify the inertia from the calibration trials.")
    free_mass: bool = Field(default=False, description="Let identification change the total mass.")
    sides_apart: bool = Field(default=False, description="Let identification change left and right apart.")
    despite_verdict: bool = Field(
        default=False, description="Identify even where the verdict is that it would fit noise."
    )
    samples: int = Field(
        default=PLAIN.samples,
        ge=2,
        le=MOST_SAMPLES,
        description="Samples of the uncertainty per level.",
        examples=[20],
    )

    @property
    def chosen(self) -> DynamicsSettings:
        """The same for the computation."""
        return DynamicsSettings(
            self.start,
            self.inertia,
            self.cutoff_hz,
            self.identify,
            not self.free_mass,
            not self.sides_apart,
            self.despite_verdict,
            self.samples,
        )
