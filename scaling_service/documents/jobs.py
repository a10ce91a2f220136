"""What travels about a job: its state, and why it failed."""

from __future__ import annotations

from enum import StrEnum

from pydantic import ConfigDict, Field

from scaling_service.core.errors import InputError
from scaling_service.documents.base import Part


class State(StrEnum):
    """Where a job stands."""

    WAITING = "waiting"
    """For the jobs that it is made of."""
    QUEUED = "queued"
    RUNNING = "running"
    CANCELLING = "cancelling"
    DONE = "done"
    FAILED = "failed"
    CANCELLED = "cancelled"

    @property
    def is_over(self) -> bool:
        """Whether nothing more happens by itself."""
        return self in (State.DONE, State.FAILED, State.CANCELLED)

    @property
    def is_leased(self) -> bool:
        """Whether a worker holds the job."""
        return self in (State.RUNNING, State.CANCELLING)


class Failure(Part):
    """Why a job failed, in the words of the command line's errors."""

    model_config = ConfigDict(json_schema_serialization_defaults_required=True)

    kind: str = Field(description="Class of the error, such as MarkerMissing.")
    problem: str = Field(description="What is wrong, one sentence.")
    file: str | None = Field(default=None, description="The file in which it was found.")
    field: str | None = Field(default=None, description="The key, column, label or component in it.")
    remedy: str | None = Field(default=None, description="What to do about it.")

    def __str__(self) -> str:
        return str(InputError(self.problem, file=self.file, field=self.field, remedy=self.remedy))
