"""Many subjects' models and their comparison as jobs: one for each subject, and one for the whole."""

from __future__ import annotations

import itertools
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, ConfigDict, Field, StringConstraints

from scaling_service.capabilities.cohort.document import CohortDocument
from scaling_service.capabilities.cohort.members import COLUMN
from scaling_service.capabilities.scaling.job import ChosenMethods, ScalingRequest
from scaling_service.capabilities.shared.job import (
    Documents,
    JobRequest,
    Kind,
    Needed,
    Parts,
    list_named_files,
)
from scaling_service.capabilities.shared.names import list_method_names
from scaling_service.capabilities.shared.settings import Settings
from scaling_service.core.progress import Progress
from scaling_service.documents.base import Part
from scaling_service.documents.reading import check_document
from scaling_service.documents.subject import Identifier

MOST_SUBJECTS = 1000
"""Of a batch. Chosen: studies have tens; the inputs of all are copied for one job."""


RECORD = "batch.json"
"""What a member keeps for the statistics, in its folder."""


def _require_each_once(names: tuple[str, ...]) -> tuple[str, ...]:
    if len({name.casefold() for name in names}) < len(names):
        raise ValueError("name each subject once")
    return names


def _refuse_subject_column(groups: dict[str, dict[str, str]]) -> dict[str, dict[str, str]]:
    if COLUMN in set(itertools.chain.from_iterable(groups.values())):
        raise ValueError(f"a group cannot be called '{COLUMN}'")
    return groups


_Label = Annotated[str, StringConstraints(pattern=r"^[\p{L}\p{N}_][\p{L}\p{N}_ .\-]*$", max_length=100)]


class MemberRequest(ScalingRequest):
    """Scale one subject's model as a member of a batch; the same member of two batches is one job."""


class MemberResult(Part):
    """How a member of a batch ended that did not fail."""

    status: Literal["done", "skipped"]
    reason: str = Field(description="Why it was skipped; empty where it is done.")
    wall_s: float


class BatchRequest(JobRequest):
    """Scale many subjects' models, and compare the methods over all of them.

    One subject's failure does not stop the others; the result says how each ended.
    """

    model_config = ConfigDict(serialize_by_alias=True)

    batch_subjects: Annotated[tuple[Identifier, ...], AfterValidator(_require_each_once)] = Field(
        alias="subjects",
        min_length=1,
        max_length=MOST_SUBJECTS,
        description="Names of the subjects, as uploaded.",
        examples=[["S01"]],
    )
    groups: Annotated[dict[Identifier, dict[_Label, _Label]], AfterValidator(_refuse_subject_column)] = Field(
        default={}, description="Subject to labels that are kept in the results, such as sex or side."
    )
    methods: ChosenMethods = Field(
        default=None,
        description=f"Of {', '.join(list_method_names())}; all that each subject allows unless given.",
        examples=[["MB", "MB_am"]],
    )
    settings: Settings = Field(
        default=Settings(), description="How recordings are processed and models fitted."
    )

    @property
    def subjects(self) -> tuple[str, ...]:
        """All of them."""
        return self.batch_subjects

    def list_needed(self, documents: Documents) -> Needed:
        """All files that the subjects' documents name."""
        return {name: list_named_files(check_document(documents[name])) for name in self.subjects}

    def members(self) -> list[MemberRequest]:
        """One request for each subject."""
        return [
            MemberRequest(subject=name, methods=self.methods, settings=self.settings)
            for name in self.subjects
        ]


def scale_member(request: MemberRequest, inputs: Path, outputs: Path, progress: Progress) -> Any:
    """Scale one subject."""
    from scaling_service.capabilities.cohort import work

    return work.scale_member(request, inputs, outputs, progress)


def summarise(request: BatchRequest, inputs: Path, outputs: Path, progress: Progress) -> Any:
    """Put the members together."""
    from scaling_service.capabilities.cohort import work

    return work.summarise(request, inputs, outputs, progress)


KINDS = {
    "batch": Kind(
        request=BatchRequest,
        work=summarise,
        route="batches",
        result=CohortDocument,
        parts=Parts(kind="batch-member", requests=BatchRequest.members, file=RECORD),
    ),
    "batch-member": Kind(request=MemberRequest, work=scale_member, route=None, result=MemberResult),
}
