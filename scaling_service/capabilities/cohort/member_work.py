"""Scale one member of a batch, as ``batch`` on the command line does."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

from scaling_service.capabilities.cohort.request import MemberRequest, MemberResult
from scaling_service.capabilities.cohort.scaling_items import NothingPossible
from scaling_service.capabilities.cohort.subject_item import SubjectItem
from scaling_service.core.progress import Progress
from scaling_service.documents.names import DOCUMENT


def work(request: MemberRequest, inputs: Path, outputs: Path, progress: Progress) -> Any:
    """Write the subject's folder, with what the cohort's statistics take of it; the result says how it ended.

    Raises
    ------
    InputError
        Whatever in the subject, the model or the recordings cannot be used: the subject failed.
    """
    clock = time.perf_counter()
    name = request.subject
    item = SubjectItem(inputs / name / DOCUMENT, outputs / name, name)
    reason = ""
    try:
        item.work(request.methods, request.settings, progress)
    except NothingPossible as error:
        reason = error.problem
    wall_s = round(time.perf_counter() - clock, 3)
    return MemberResult(status="skipped" if reason else "done", reason=reason, wall_s=wall_s).model_dump()
