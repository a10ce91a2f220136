"""The request to search for what a model does not have, as `discover` on the command line takes it."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from scaling_service.capabilities.discovery.settings import AS_MEASURED, PLAIN, DiscoverSettings
from scaling_service.capabilities.scaling.request import ChosenSettings, OfRecordings


class DiscoverRequest(OfRecordings):
    """Find where a subject's model and recordings disagree, and name the effects that are missing."""

    settings: ChosenSettings = Field(
        default=AS_MEASURED,
        description="How recordings are processed and models fitted; for the search they are best neither "
        "smoothed nor filled.",
    )
    start: Literal["MB", "MB_lam", "MB_am", "EB", "EB_am", "none"] | None = Field(
        default=None,
        description="Scaling to start from; 'none' takes the model as it is. EB_am where there are bones, "
        "else MB_am, unless given.",
        examples=["MB_am"],
    )
    inertia: Literal["dumas2007", "dumas_wojtusch2018", "deleva1996", "winter2009", "model"] | None = Field(
        default=None,
        description="Inertial table for built-in models, where there are forces; 'model' keeps the model's "
        "own.",
    )
    cutoff_hz: float = Field(
        default=PLAIN.cutoff_hz, gt=0.0, le=1000.0, description="Of the filter that motion and forces pass."
    )

    @property
    def chosen(self) -> DiscoverSettings:
        """The same for the computation."""
        return DiscoverSettings(self.start, self.inertia, self.cutoff_hz)
