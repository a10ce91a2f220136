"""What a user can choose: one model, from which command line, HTTP body, web form and provenance all come."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from pydantic import BaseModel, ConfigDict

LARGEST = 1e9
"""Of any number among options. Chosen: far above all that make sense."""


def _leave_examples_out(schema: dict[str, Any]) -> None:
    """Of a schema for other programs: examples in docstrings are for Python."""
    if "description" in schema:
        schema["description"] = schema["description"].partition("\n\nExamples\n")[0]


class Options(BaseModel):
    """Base of all options: frozen; unknown keys are errors, so are numbers that are none.

    A field's description is its help text, its bounds hold everywhere. A field that is annotated with
    :class:`Flag` is an option of the commands whose function takes the model.
    """

    model_config = ConfigDict(
        extra="forbid", frozen=True, allow_inf_nan=False, json_schema_extra=_leave_examples_out
    )

    def resolved(self) -> dict[str, Any]:
        """All options with their defaults, as plain values for a document."""
        return self.model_dump()


@dataclass(frozen=True, slots=True, kw_only=True)
class Flag:
    """How a field is given on the command line, where that does not follow from the field.

    Parameters
    ----------
    name : str, optional
        Such as ``--frames``; made of the field's name unless given.
    metavar, panel : str, optional
        What stands for the value in the help text, and the panel that the option is shown in.
    help : str, optional
        In place of the field's description.
    kind : type, optional
        What the command line reads, where ``read`` makes the field's value of it.
    read : callable, optional
    least : float, optional
        The smallest that is read.
    """

    name: str | None = None
    metavar: str | None = None
    panel: str | None = None
    help: str | None = None
    kind: Any = None
    read: Callable[[Any], Any] | None = None
    least: float | None = None
