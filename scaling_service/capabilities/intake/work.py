"""Look at a subject's files before anything is computed."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from scaling_service.capabilities.intake.request import ProofRequest
from scaling_service.capabilities.intake.run import prove
from scaling_service.core.progress import Progress
from scaling_service.documents.names import DOCUMENT


def work(request: ProofRequest, inputs: Path, outputs: Path, progress: Progress) -> Any:
    """Write the tables of all recordings; the document is the result.

    Raises
    ------
    InputError
        The axes in the settings are none.
    """
    folder = inputs / request.subject
    document = json.loads((folder / DOCUMENT).read_text(encoding="utf-8"))
    found = prove(
        folder,
        document,
        outputs,
        skip=(DOCUMENT,),
        labels=request.labels,
        settings=request.settings,
        progress=progress,
    )
    return found.model_dump(mode="json")
