"""The labels that a laboratory gives to markers, as they travel."""

from __future__ import annotations

from datetime import datetime
from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field, StringConstraints

MOST = 2000
"""Entries of a map. Chosen: many times the markers of a whole body."""

_Word = Annotated[str, StringConstraints(min_length=1, max_length=200)]
MarkerLabels = Annotated[dict[_Word, _Word], Field(max_length=MOST)]
"""Label in the recordings to model marker."""


class MarkerMap(BaseModel):
    """Which label is which marker in a laboratory."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    labels: MarkerLabels = Field(
        description="Label in the recordings to model marker.", examples=[{"RKN": "RLFE"}]
    )


class MarkerMapDocument(MarkerMap):
    """A laboratory's map as it is kept."""

    updated_at: datetime | None = Field(description="Null where none was given yet.")
