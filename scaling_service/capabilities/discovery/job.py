"""The search for missing effects as a job."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from pydantic import Field

from scaling_service.capabilities.discovery.options import AS_MEASURED, DiscoverSettings
from scaling_service.capabilities.discovery.result import DiscoveryDocument
from scaling_service.capabilities.shared.job import Kind, OfRecordings
from scaling_service.capabilities.shared.settings import Settings
from scaling_service.core.progress import Progress, report_part
from scaling_service.documents.base import DOCUMENT

_COMPUTING, _WRITING = 0.9, 0.97
"""Chosen: about the shares of the search and of writing; the rest is what is played back."""


class DiscoverRequest(OfRecordings, DiscoverSettings):
    """Find where a subject's model and recordings disagree, and name the effects that are missing."""

    settings: Settings = Field(
        default=AS_MEASURED,
        description="How recordings are processed and models fitted; for the search they are best neither "
        "smoothed nor filled.",
    )


def work(request: DiscoverRequest, inputs: Path, outputs: Path, progress: Progress) -> Any:
    """Write ``discovery.json`` (the result), the corrected model and recordings, and the report."""
    from scaling_service.capabilities.discovery.playing import write_discovery_scene
    from scaling_service.capabilities.discovery.run import discover
    from scaling_service.capabilities.discovery.saving import save_discovery
    from scaling_service.capabilities.shared.tables import make_table_writer

    write_tables = make_table_writer(request.tables, outputs)
    results = discover(
        inputs / request.subject / DOCUMENT,
        request.part(DiscoverSettings),
        request.settings,
        progress=report_part(progress, 0.0, _COMPUTING),
    )
    document = save_discovery(
        results, outputs, progress=report_part(progress, _COMPUTING, _WRITING - _COMPUTING)
    )
    write_tables(results.tables, document)
    progress("writing what is played back", _WRITING)
    write_discovery_scene(results, outputs)
    return document.model_dump(mode="json")


def list_kinds() -> dict[str, Kind]:
    """What the service offers of this capability."""
    return {
        "discovery": Kind(request=DiscoverRequest, work=work, route="discoveries", result=DiscoveryDocument)
    }
