"""What can be asked for: the body of a request, with every default written out."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterator, Mapping
from dataclasses import fields, is_dataclass
from typing import Annotated, Any, ClassVar, Literal

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, field_validator

from scaling_service.bones.whole import BONES
from scaling_service.capabilities.scaling.methods.table import METHODS
from scaling_service.capabilities.subject.settings import Settings
from scaling_service.core.errors import SubjectInvalid
from scaling_service.documents.names import plain_name
from scaling_service.documents.reading import check_document
from scaling_service.documents.subject import Identifier, SubjectDocument

Documents = Mapping[str, Mapping[str, Any]]
"""Subject to its document, as JSON gave it."""

Needed = Mapping[str, Mapping[str, str]]
"""Subject to the files that a job reads: where the name stands (a field), and the name."""


def _known(methods: list[str] | None) -> list[str] | None:
    for method in methods or ():
        if method not in METHODS:
            raise ValueError(f"there is no method '{method}'; methods are {', '.join(METHODS)}")
    if methods is not None and (not methods or len(set(methods)) < len(methods)):
        raise ValueError("name each method once, and at least one")
    return methods


def _sensible(settings: Settings) -> Settings:
    for name, value in _numbers(settings):
        if not 0 <= value <= _LARGEST:
            raise ValueError(f"{name} is not possible; give a number from 0 to {_LARGEST:g}")
    if settings.calibration.n_frames < 1 or settings.calibration.max_loops < 1:
        raise ValueError("n_frames and max_loops are at least 1")
    return settings


_LARGEST = 10**9
"""Of any number among settings. Chosen: far above all that make sense."""

ChosenMethods = Annotated[list[str] | None, AfterValidator(_known)]
ChosenSettings = Annotated[Settings, AfterValidator(_sensible)]


class JobRequest(BaseModel):
    """A request for a job. Unknown keys are errors."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    reads_every_file: ClassVar[bool] = False
    """Whether it reads all uploaded files of its subjects, and not only those that it needs."""

    @property
    @abstractmethod
    def subjects(self) -> tuple[str, ...]:
        """Whose data the job rests on."""

    @abstractmethod
    def needed(self, documents: Documents) -> Needed:
        """The uploaded files that it reads.

        Raises
        ------
        SubjectInvalid
            A document does not allow what is asked for.
        """


class OfOneSubject(JobRequest):
    """A request that concerns one subject."""

    subject: Identifier = Field(description="Name of the subject, as uploaded.", examples=["S01"])

    @property
    def subjects(self) -> tuple[str, ...]:
        """The one."""
        return (self.subject,)


class OfRecordings(OfOneSubject):
    """A request that rests on all files of a subject's document."""

    settings: ChosenSettings = Field(
        default=Settings(), description="How recordings are processed and models fitted."
    )

    def needed(self, documents: Documents) -> Needed:
        """All files that the subject's document names."""
        return {self.subject: named_files(check_document(documents[self.subject]))}


class ScalingRequest(OfRecordings):
    """Scale a subject's model by one or several methods and compare them."""

    methods: ChosenMethods = Field(
        default=None,
        description=f"Of {', '.join(METHODS)}; all that the recordings allow unless given.",
        examples=[["MB", "MB_am"]],
    )


class LandmarksRequest(OfOneSubject):
    """Find joint centres, axes and bony landmarks on surfaces of bones."""

    bones: dict[str, str] | None = Field(
        default=None,
        description=f"Of {', '.join(BONES)} to the name of an uploaded mesh; the subject's unless given.",
        examples=[{"femur_r": "femur_r.stl"}],
    )
    units: Literal["mm", "cm", "m", "detect"] = Field(default="detect", description="Unit of all meshes.")

    @field_validator("bones")
    @classmethod
    def _known(cls, bones: dict[str, str] | None) -> dict[str, str] | None:
        for bone in bones or ():
            if bone not in BONES:
                raise ValueError(f"'{bone}' is not a bone that has landmarks; they are {', '.join(BONES)}")
        return bones

    def meshes(self, document: Mapping[str, Any]) -> dict[str, str]:
        """Bone to file, as asked for or as the subject's document says."""
        told = dict(document.get("bones") or {})
        told.pop("units", None)
        return self.bones if self.bones is not None else {k: v for k, v in told.items() if v is not None}

    def needed(self, documents: Documents) -> Needed:
        """The meshes."""
        found = self.meshes(documents[self.subject])
        if not found:
            raise SubjectInvalid(
                "no bone is given",
                field="bones",
                remedy="Name uploaded meshes under `bones` in the request or in the subject's document",
            )
        return {
            self.subject: {f"bones.{bone}": plain_name(file, f"bones.{bone}") for bone, file in found.items()}
        }


def named_files(document: SubjectDocument) -> dict[str, str]:
    """Field to the file that stands there; uploaded files have plain names.

    Raises
    ------
    InputError
        A name is a path or has special characters.
    """
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
    return {field: plain_name(name, field) for field, name in named.items() if name is not None}


def _numbers(settings: Any, path: str = "") -> Iterator[tuple[str, float]]:
    """Every number among settings, with its name."""
    for field in fields(settings):
        value = getattr(settings, field.name)
        if is_dataclass(value):
            yield from _numbers(value, f"{path}{field.name}.")
        elif isinstance(value, int | float) and not isinstance(value, bool):
            yield f"{path}{field.name}", value
