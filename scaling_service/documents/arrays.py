"""Tables of numbers that travel as binary files beside a document."""

from __future__ import annotations

from pydantic import Field

from scaling_service.documents.base import Part


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
