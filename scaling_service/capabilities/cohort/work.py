"""The work of a batch's jobs: each subject scaled by its own, then all put together."""

from __future__ import annotations

import json
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from scaling_service.capabilities.cohort.job import BatchRequest, MemberRequest, MemberResult
from scaling_service.capabilities.cohort.outcomes import NothingPossible, Outcome
from scaling_service.capabilities.cohort.run import explain_none_possible, summarise_cohort
from scaling_service.capabilities.cohort.saving import check_names, save_cohort
from scaling_service.capabilities.cohort.subject import SubjectMember, read_summary
from scaling_service.core.progress import Progress
from scaling_service.documents.jobs import Failure, State
from scaling_service.documents.names import DOCUMENT, PARTS

_COHORT = "cohort.csv"
"""What stands for the list of members, which the request names itself."""


def scale_member(request: MemberRequest, inputs: Path, outputs: Path, progress: Progress) -> Any:
    """Scale one subject as ``batch`` does on the command line; the result says how it ended.

    InputError: whatever in the subject, the model or the recordings cannot be used: the subject failed.
    """
    clock = time.perf_counter()
    name = request.subject
    member = SubjectMember(name, inputs / name / DOCUMENT, outputs / name)
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
    clock = time.perf_counter()
    progress("comparing the methods over all subjects", 0.0)
    check_names(((name, name, Path(name, DOCUMENT)) for name in request.subjects), _COHORT)
    outcomes = read_outcomes(request, inputs)
    if all(outcome.status == "skipped" for outcome in outcomes):
        reasons = (reason for outcome in outcomes for reason in outcome.reason.split("; "))
        raise explain_none_possible(reasons, request.methods, _COHORT)
    result = summarise_cohort(outcomes, request.methods, request.settings, cohort=_COHORT, started=clock)
    save_cohort(result.document, outcomes, outputs)
    return result.document.model_dump(mode="json")


def read_outcomes(request: BatchRequest, inputs: Path) -> list[Outcome]:
    """How every subject ended, in the request's order, as its own job says."""
    ended = json.loads((inputs / PARTS).read_text(encoding="utf-8"))
    ends = {end["request"]["subject"]: end for end in ended}
    labels = sorted({label for given in request.groups.values() for label in given})
    return [
        _read_outcome(
            name, ends[name], {label: request.groups.get(name, {}).get(label, "") for label in labels}, inputs
        )
        for name in request.subjects
    ]


def _read_outcome(name: str, end: Mapping[str, Any], groups: Mapping[str, str], inputs: Path) -> Outcome:
    shown = f"{name}/{DOCUMENT}"
    if end["state"] != State.DONE:
        return Outcome(name, groups, "failed", str(Failure.model_validate(end["failure"])), shown=shown)
    result = MemberResult.model_validate(end["result"])
    summary = read_summary(inputs / name) if result.status == "done" else None
    return Outcome(name, groups, result.status, result.reason, summary, wall_s=result.wall_s, shown=shown)
