"""What all documents have in common, and tables of numbers that travel as binary files beside them."""

from __future__ import annotations

from typing import Annotated

from pydantic import AfterValidator, BaseModel, ConfigDict, Field

Rounded = Annotated[float, AfterValidator(lambda value: round(value, 4))]
"""In mm or degrees: a tenth of a micrometre, or less than a second of arc."""


class Part(BaseModel):
    """A document or a part of one: frozen, unknown keys and numbers that JSON does not have are errors.

    It also reads from results that have the same names.
    """

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False, from_attributes=True)


class Overview(Part):
    """A table's first level: few frames for a first look."""

    file: str = Field(description="Path among the job's files.")
    shape: list[int]
    step: int = Field(description="Frames of the table to one of this.")


class ArrayEntry(Part):
    """A table of little-endian float32 in C order, frames first; NaN is unknown."""

    file: str = Field(description="Path among the job's files; frame i begins at byte i times a row's.")
    shape: list[int]
    unit: str
    overview: Overview | None = Field(default=None, description="There where the table has many frames.")


class PlateEntry(Part):
    """A force plate in a recording."""

    name: str
    corners_m: list[tuple[float, float, float]] | None = Field(
        description="Four corners; null where the file has none."
    )
    peak_N: float | None = Field(description="Largest force on it; null where none is known.")
    kind: int | None = Field(default=None, description="Type by the C3D standard; null for tables.")
    centre_m: list[float] | None = Field(default=None, description="Of its surface, x, y, z.")
    loaded_by: list[str] = Field(default=[], description="Who stood on it and when, in words.")
    offset_N: float | None = Field(default=None, description="Its reading while no foot is near it.")
