"""What all documents have in common: names, versions, and tables of numbers that travel beside them."""

from __future__ import annotations

import math
import re
from typing import Annotated, Literal

from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict, Field

from scaling_service.core.errors import InputError

Rounded = Annotated[float, AfterValidator(lambda value: round(value, 4))]
"""In mm or degrees: a tenth of a micrometre, or less than a second of arc."""

Known = Annotated[
    float | None,
    BeforeValidator(lambda v: v if not isinstance(v, float) else round(v, 4) if math.isfinite(v) else None),
]
"""The same; null where it is not finite."""

DOCUMENT = "subject.json"  # under this name a subject's document lies beside its files when a job computes

PARTS = ".parts.json"
"""Under this name it stands among the inputs how the parts of a job ended; no subject is called so."""

SCENE_VERSION = 1
"""Raised when a reader of an older scene would misread a newer one; new keys do not raise it."""

_PLAIN = re.compile(r"\w[\w .()+=@,\-]{0,199}")
_MOST_BYTES = 255  # of a name, on the usual file systems

Tone = Literal["good", "fair", "poor", "unknown", "plain"]
"""Whether a sentence is good news, as it is decided where the sentence is written."""


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


class Scene(Part):
    """What is drawn over time beside a result, its numbers in tables."""

    schema_version: int = SCENE_VERSION


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


def require_plain_name(name: str, field: str = "name") -> str:
    """The name, if it is one that an uploaded file can have.

    Raises InputError: it has a folder or a special character in it, is too long, or is reserved.

    Examples
    --------
    >>> require_plain_name("Walking01.c3d")
    'Walking01.c3d'
    """
    good = _PLAIN.fullmatch(name) is not None and not name.endswith((" ", "."))
    if not good or len(name.encode()) > _MOST_BYTES or name.casefold() == DOCUMENT:
        raise InputError(
            f"'{name[:60]}' cannot be the name of an uploaded file",
            field=field,
            remedy="Use up to 200 letters, digits, spaces, dots and hyphens, without folders"
            + (f"; '{DOCUMENT}' is taken" if name.casefold() == DOCUMENT else ""),
        )
    return name
