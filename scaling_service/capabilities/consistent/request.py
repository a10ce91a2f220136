"""The request for dynamically consistent motion, as `consistent` on the command line takes it."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from scaling_service.capabilities.dynamics.settings import PLAIN, UNSMOOTHED, DynamicsSettings
from scaling_service.capabilities.scaling.request import ChosenSettings, OfRecordings
from scaling_service.documents.subject import Identifier


class ConsistentRequest(OfRecordings):
    """Find the motion, geometry and inertia that a subject's markers and ground forces agree on."""

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
        "else MB_am, unless given. The planar squat_4dof is scaled by its standing.",
        examples=["none"],
    )
    inertia: Literal["dumas2007", "dumas_wojtusch2018", "deleva1996", "winter2009", "model"] | None = Field(
        default=None,
        description="Inertial table that identification starts from; 'model' takes the model's own.",
    )
    cutoff_hz: float = Field(
        default=PLAIN.cutoff_hz,
        gt=0.0,
        le=1000.0,
        description="Of the filter of forces and of the classical motion.",
    )

    @property
    def chosen(self) -> DynamicsSettings:
        """The same for the computation."""
        return DynamicsSettings(self.start, self.inertia, self.cutoff_hz)
