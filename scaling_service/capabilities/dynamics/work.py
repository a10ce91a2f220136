"""Check a model's dynamics: what ``dynamics`` does on the command line."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from scaling_service.capabilities.dynamics.request import DynamicsRequest
from scaling_service.capabilities.dynamics.run import dynamics
from scaling_service.capabilities.dynamics.saving import save_dynamics
from scaling_service.capabilities.dynamics.scene import write_residuals
from scaling_service.core.progress import Progress
from scaling_service.documents.names import DOCUMENT


def work(request: DynamicsRequest, inputs: Path, outputs: Path, progress: Progress) -> Any:
    """Write ``dynamics.json``, each trial's forces and the report; the document is the result.

    Raises
    ------
    InputError
        Whatever in the subject, the model, the recordings or their forces cannot be used.
    """
    results = dynamics(
        inputs / request.subject / DOCUMENT, request.chosen, request.settings, progress=progress
    )
    document = save_dynamics(results, outputs)
    write_residuals(results, outputs)
    return document.model_dump(mode="json")
