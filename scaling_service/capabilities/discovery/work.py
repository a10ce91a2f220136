"""Search for what a model does not have: what ``discover`` does on the command line."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from scaling_service.capabilities.discovery.request import DiscoverRequest
from scaling_service.capabilities.discovery.run import discover
from scaling_service.capabilities.discovery.saving import save_discovery
from scaling_service.capabilities.discovery.scene import scene_of_discovery
from scaling_service.core.progress import Progress
from scaling_service.documents.names import DOCUMENT

_COMPUTING, _WRITING = 0.9, 0.07
"""Chosen: about the shares of the search and of writing; the rest is what is played back."""


def work(request: DiscoverRequest, inputs: Path, outputs: Path, progress: Progress) -> Any:
    """Write ``discovery.json``, the corrected model and recordings, and the report; the first is the result.

    Raises
    ------
    InputError
        Whatever in the subject, the model, the recordings or their forces cannot be used; or the model does
        not fit the recordings at all.
    """
    results = discover(
        inputs / request.subject / DOCUMENT,
        request.chosen,
        request.settings,
        progress=lambda what, share: progress(what, _COMPUTING * share),
    )
    document = save_discovery(
        results,
        outputs,
        progress=lambda what, share: progress(what, _COMPUTING + _WRITING * share),
    )
    progress("writing what is played back", _COMPUTING + _WRITING)
    scene_of_discovery(results, outputs)
    return document.model_dump(mode="json")
