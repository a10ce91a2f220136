"""Find dynamically consistent motion: what ``consistent`` does on the command line."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from scaling_service.capabilities.consistent.request import ConsistentRequest
from scaling_service.capabilities.consistent.run import consistent
from scaling_service.capabilities.consistent.saving import save_consistent
from scaling_service.core.progress import Progress
from scaling_service.documents.names import DOCUMENT


def work(request: ConsistentRequest, inputs: Path, outputs: Path, progress: Progress) -> Any:
    """Write ``consistent.json``, motions, models and the report; the document is the result.

    Raises
    ------
    InputError
        Whatever in the subject, the model, the recordings or their forces cannot be used.
    """
    results = consistent(
        inputs / request.subject / DOCUMENT, request.chosen, request.settings, progress=progress
    )
    return save_consistent(results, outputs).model_dump(mode="json")
