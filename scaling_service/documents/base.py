"""What all documents have in common."""

from __future__ import annotations

from typing import Annotated

from pydantic import AfterValidator, BaseModel, ConfigDict

Rounded = Annotated[float, AfterValidator(lambda value: round(value, 4))]
"""In mm or degrees: a tenth of a micrometre, or less than a second of arc."""


class Part(BaseModel):
    """A document or a part of one: frozen, unknown keys and numbers that JSON does not have are errors.

    It also reads from results that have the same names.
    """

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False, from_attributes=True)
