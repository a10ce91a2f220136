"""What a capability offers to the service: a request, the work that it asks for, and how its result looks."""

from __future__ import annotations

import json
import typing
from abc import abstractmethod
from collections import abc
from dataclasses import dataclass
from pathlib import Path

import pydantic

from scaling_service.capabilities.shared import settings as shared_settings
from scaling_service.core.options import Options
from scaling_service.core.progress import Progress
from scaling_service.documents.base import require_plain_name
from scaling_service.documents.reading import check_document
from scaling_service.documents.subject import Identifier, SubjectDocument

Documents = abc.Mapping[str, abc.Mapping[str, typing.Any]]
"""Subject to its document, as JSON gave it."""

Needed = abc.Mapping[str, abc.Mapping[str, str]]
"""Subject to the files that a job reads: where the name stands (a field), and the name."""

Work = abc.Callable[[typing.Any, Path, Path, Progress], typing.Any]
"""Request, folder of inputs, folder of outputs, progress -> the result, JSON-ready.

The folder of inputs has one folder for each subject, with its document as ``subject.json`` and the
uploaded files beside it. What is written to the folder of outputs becomes the job's files. Raises InputError:
whatever in the subject, the model, the recordings or their forces cannot be used.
"""

Chosen = typing.TypeVar("Chosen", bound=Options)


class JobRequest(Options):
    """A request for a job. Unknown keys are errors."""

    reads_every_file: typing.ClassVar[bool] = False
    """Whether it reads all uploaded files of its subjects, and not only those that it needs."""

    @property
    @abstractmethod
    def subjects(self) -> tuple[str, ...]:
        """Whose data the job rests on."""

    @abstractmethod
    def list_needed(self, documents: Documents) -> Needed:
        """The uploaded files that it reads (SubjectInvalid: a document does not allow what is asked for)."""

    def part(self, kind: type[Chosen]) -> Chosen:
        """The options of one kind among those of the request."""
        return kind(**{name: getattr(self, name) for name in kind.model_fields})


class OfOneSubject(JobRequest):
    """A request that concerns one subject."""

    subject: Identifier = pydantic.Field(description="Name of the subject, as uploaded.", examples=["S01"])

    @property
    def subjects(self) -> tuple[str, ...]:
        """The one."""
        return (self.subject,)


class WithTables(JobRequest):
    """A request whose result has tables."""

    tables: tuple[typing.Literal["csv", "parquet", "bids"], ...] = pydantic.Field(
        default=(),
        description="Tables of the results among the files, under tables/, with units and source: csv, "
        "parquet, bids (motions under Motion-BIDS' names).",
    )


class OfRecordings(OfOneSubject, WithTables):
    """A request that rests on all files of a subject's document."""

    settings: shared_settings.Settings = pydantic.Field(
        default=shared_settings.Settings(), description="How recordings are processed and models fitted."
    )

    def list_needed(self, documents: Documents) -> Needed:
        """All files that the subject's document names."""
        return {self.subject: list_named_files(check_document(documents[self.subject]))}


class OfForces(OfRecordings):
    """A request that rests on recordings with forces."""

    subject: Identifier = pydantic.Field(
        description="Name of the subject, as uploaded: a model with feet, and recordings with forces.",
        examples=["S02"],
    )
    settings: shared_settings.Settings = pydantic.Field(
        default=shared_settings.UNSMOOTHED, description="How recordings are processed and models fitted."
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class Parts:
    """How a job is made of others, which any runner computes at any time; its own work comes after them."""

    kind: str  # of the parts
    requests: abc.Callable[[typing.Any], abc.Sequence[JobRequest]]
    """From the request to those of the parts; each concerns subjects of the whole."""
    file: str
    """Name of the file of each part that the work needs: it lies where the part wrote it, but among the
    inputs. How the parts ended stands there, too (``PARTS`` in ``documents.names``). All files of the parts
    become files of the whole."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Kind:
    """One kind of job; a capability's ``job`` module has a table ``KINDS`` of them."""

    request: type[JobRequest]  # what is asked for; its fields are the body over HTTP
    work: Work  # can be named from another process; it runs there, and imports what computes there
    route: str | None  # where it is asked for over HTTP, below the version; None: it is a part of others only
    result: type[pydantic.BaseModel] | None = None  # what the result follows
    parts: Parts | None = None
    """Where it is made of others. Its work then sees the subjects' documents, but not their files."""
    brief: bool = False
    """Whether it takes seconds while somebody waits: it starts although all workers compute."""

    def perform(self, request: abc.Mapping[str, typing.Any], folder: Path, progress: Progress) -> typing.Any:
        """Do the work in a folder with inputs and outputs; ``request``: as JSON gave it."""
        asked = self.request.model_validate_json(json.dumps(request))
        return self.work(asked, folder / "inputs", folder / "outputs", progress)


def list_named_files(document: SubjectDocument) -> dict[str, str]:
    """Field to the file that stands there (InputError: its name is a path or has special characters)."""
    trials = document.trials
    named: dict[str, str | None] = {
        "model": document.model if document.model_is_file else None,
        "marker_set": document.marker_set,
        "scale_setup": document.scale_setup,
        "trials.static": trials.static,
        "image_markers": document.image_markers,
    }
    named |= {f"trials.calibration.{k}": name for k, name in enumerate(trials.calibration)}
    named |= {f"trials.evaluation.{k}": name for k, name in enumerate(trials.evaluation)}
    named |= {f"forces.{trial}": name for trial, name in document.forces.items()}
    named |= {f"bones.{b}": name for b, name in (document.bones.meshes if document.bones else {}).items()}
    return {field: require_plain_name(name, field) for field, name in named.items() if name is not None}
