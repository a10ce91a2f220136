"""Many subjects' models and their comparison as jobs: one for each subject, and one for the whole."""

from __future__ import annotations

import itertools
import json
import time
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import pydantic

from scaling_service.capabilities.cohort import result as documents
from scaling_service.capabilities.cohort.members import COLUMN
from scaling_service.capabilities.scaling.job import ChosenMethods, ScalingRequest
from scaling_service.capabilities.shared import job
from scaling_service.capabilities.shared.names import list_method_names
from scaling_service.capabilities.shared.settings import Settings
from scaling_service.core.progress import Progress
from scaling_service.documents import base, jobs
from scaling_service.documents.reading import check_document
from scaling_service.documents.subject import Identifier

if TYPE_CHECKING:
    from scaling_service.capabilities.cohort.outcomes import Outcome

_COHORT = "cohort.csv"
"""What stands for the list of members, which the request names itself."""

MOST_SUBJECTS = 1000
"""Of a batch. Chosen: studies have tens; the inputs of all are copied for one job."""


def _require_each_once(names: tuple[str, ...]) -> tuple[str, ...]:
    if len({name.casefold() for name in names}) < len(names):
        raise ValueError("name each subject once")
    return names


def _refuse_subject_column(groups: dict[str, dict[str, str]]) -> dict[str, dict[str, str]]:
    if COLUMN in set(itertools.chain.from_iterable(groups.values())):
        raise ValueError(f"a group cannot be called '{COLUMN}'")
    return groups


_Label = Annotated[
    str, pydantic.StringConstraints(pattern=r"^[\p{L}\p{N}_][\p{L}\p{N}_ .\-]*$", max_length=100)
]


class MemberRequest(ScalingRequest):
    """Scale one subject's model as a member of a batch; the same member of two batches is one job."""


class MemberResult(base.Part):
    """How a member of a batch ended that did not fail."""

    status: Literal["done", "skipped"]
    reason: str = pydantic.Field(description="Why it was skipped; empty where it is done.")
    wall_s: float


class BatchRequest(job.WithTables):
    """Scale many subjects' models, and compare the methods over all of them.

    One subject's failure does not stop the others; the result says how each ended.
    """

    model_config = pydantic.ConfigDict(serialize_by_alias=True)

    batch_subjects: Annotated[tuple[Identifier, ...], pydantic.AfterValidator(_require_each_once)] = (
        pydantic.Field(
            alias="subjects",
            min_length=1,
            max_length=MOST_SUBJECTS,
            description="Names of the subjects, as uploaded.",
            examples=[["S01"]],
        )
    )
    groups: Annotated[
        dict[Identifier, dict[_Label, _Label]], pydantic.AfterValidator(_refuse_subject_column)
    ] = pydantic.Field(
        default={}, description="Subject to labels that are kept in the results, such as sex or side."
    )
    methods: ChosenMethods = pydantic.Field(
        default=None,
        description=f"Of {', '.join(list_method_names())}; all that each subject allows unless given.",
        examples=[["MB", "MB_am"]],
    )
    settings: Settings = pydantic.Field(
        default=Settings(), description="How recordings are processed and models fitted."
    )

    @property
    def subjects(self) -> tuple[str, ...]:
        """All of them."""
        return self.batch_subjects

    def list_needed(self, documents: job.Documents) -> job.Needed:
        """All files that the subjects' documents name."""
        return {name: job.list_named_files(check_document(documents[name])) for name in self.subjects}

    def members(self) -> list[MemberRequest]:
        """One request for each subject."""
        return [
            MemberRequest(subject=name, methods=self.methods, settings=self.settings)
            for name in self.subjects
        ]


def scale_member(request: MemberRequest, inputs: Path, outputs: Path, progress: Progress) -> Any:
    """Scale one subject as ``batch`` does on the command line; the result says how it ended."""
    from scaling_service.capabilities.cohort.outcomes import NothingPossible, SubjectMember

    clock = time.perf_counter()
    name = request.subject
    member = SubjectMember(name=name, file=inputs / name / base.DOCUMENT, folder=outputs / name)
    reason = ""
    try:
        member.work(request.methods, request.settings, progress)
    except NothingPossible as error:
        reason = error.problem
    wall_s = round(time.perf_counter() - clock, 3)
    return MemberResult(status="skipped" if reason else "done", reason=reason, wall_s=wall_s).model_dump()


def summarise(request: BatchRequest, inputs: Path, outputs: Path, progress: Progress) -> Any:
    """Write ``cohort.json``, its tables and the report; the document is the result.

    Every subject was scaled by a job of its own, which wrote the subject's folder.

    InputError: nobody can be done by any of the methods, or a subject is called like a file of results.
    """
    from scaling_service.capabilities.cohort.run import explain_none_possible, summarise_cohort
    from scaling_service.capabilities.cohort.saving import check_names, save_cohort
    from scaling_service.capabilities.shared.tables import make_table_writer

    write_tables = make_table_writer(request.tables, outputs)
    clock = time.perf_counter()
    progress("comparing the methods over all subjects", 0.0)
    check_names(((name, name, Path(name, base.DOCUMENT)) for name in request.subjects), _COHORT)
    # How every subject ended, in the request's order, as its own job says
    ended = json.loads((inputs / base.PARTS).read_text(encoding="utf-8"))
    ends = {end["request"]["subject"]: end for end in ended}
    labels = sorted({label for given in request.groups.values() for label in given})
    outcomes = [
        _read_outcome(
            name, ends[name], {label: request.groups.get(name, {}).get(label, "") for label in labels}, inputs
        )
        for name in request.subjects
    ]
    if all(outcome.status == "skipped" for outcome in outcomes):
        reasons = (reason for outcome in outcomes for reason in outcome.reason.split("; "))
        raise explain_none_possible(reasons, request.methods, _COHORT)
    result = summarise_cohort(outcomes, request.methods, request.settings, cohort=_COHORT, started=clock)
    save_cohort(result.document, outcomes, outputs)
    write_tables(result.tables, result.document)
    return result.document.model_dump(mode="json")


def _read_outcome(name: str, end: Mapping[str, Any], groups: Mapping[str, str], inputs: Path) -> Outcome:
    from scaling_service.capabilities.cohort.outcomes import Outcome, read_summary

    outcome = Outcome(name=name, groups=groups, status="failed", shown=f"{name}/{base.DOCUMENT}")
    if end["state"] != jobs.State.DONE:
        return replace(outcome, reason=str(jobs.Failure.model_validate(end["failure"])))
    result = MemberResult.model_validate(end["result"])
    summary = read_summary(inputs / name) if result.status == "done" else None
    return replace(outcome, summary=summary, **result.model_dump())


def list_kinds() -> dict[str, job.Kind]:
    """What the service offers of this capability."""
    return {
        "batch": job.Kind(
            request=BatchRequest,
            work=summarise,
            route="batches",
            result=documents.CohortDocument,
            parts=job.Parts(kind="batch-member", requests=BatchRequest.members, file=documents.RECORD),
        ),
        "batch-member": job.Kind(request=MemberRequest, work=scale_member, route=None, result=MemberResult),
    }
