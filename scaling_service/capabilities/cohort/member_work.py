"""Scale one member of a batch, as ``batch`` on the command line does."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

from scaling_service.capabilities.cohort.job import MemberRequest, MemberResult
from scaling_service.capabilities.cohort.outcomes import NothingPossible
from scaling_service.capabilities.cohort.subject import SubjectMember
from scaling_service.core.progress import Progress
from scaling_service.documents.names import DOCUMENT


def work(request: MemberRequest, inputs: Path, outputs: Path, progress: Progress) -> Any:
    """Write the subject's folder, with what the cohort's statistics take of it; the result says how it ended.

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
