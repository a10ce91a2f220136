"""Search for what a model does not have: what ``discover`` does on the command line."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from scaling_service.jobs.discover import discover
from scaling_service.jobs.discover_saving import save_discovery
from scaling_service.jobs.tasks import Progress
from scaling_service.runner.discover_request import DiscoverRequest
from scaling_service.runner.names import DOCUMENT

_COMPUTING = 0.9
"""Chosen: about the share of the search; the rest is writing."""


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
        progress=lambda what, share: progress(what, _COMPUTING + (1.0 - _COMPUTING) * share),
    )
    return document.model_dump(mode="json")
