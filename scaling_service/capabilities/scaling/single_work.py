"""Scale a subject's model by one method: what ``scale`` does on the command line."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from scaling_service.capabilities.scaling.single_request import OneMethodRequest
from scaling_service.capabilities.scaling.work import scaled
from scaling_service.core.progress import Progress


def work(request: OneMethodRequest, inputs: Path, outputs: Path, progress: Progress) -> Any:
    """Write the method's folder; its ``scaling.json`` is the result.

    Raises
    ------
    InputError
        Whatever in the subject, the model or the recordings cannot be used.
    """
    scaled(request, (request.method,), inputs, outputs, progress, comparison=False)
    return json.loads((outputs / request.method / "scaling.json").read_text(encoding="utf-8"))
