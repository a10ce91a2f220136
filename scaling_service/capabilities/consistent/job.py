"""Dynamically consistent motion as a job."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from scaling_service.capabilities.consistent.result import ConsistentDocument
from scaling_service.capabilities.dynamics.settings import ForceSettings
from scaling_service.capabilities.shared import job
from scaling_service.core.progress import Progress
from scaling_service.documents.base import DOCUMENT


class ConsistentRequest(job.OfForces, ForceSettings):
    """Find the motion, geometry and inertia that a subject's markers and ground forces agree on.

    The planar squat_4dof is scaled by its standing.
    """


def work(request: ConsistentRequest, inputs: Path, outputs: Path, progress: Progress) -> Any:
    """Write ``consistent.json``, motions, models and the report; the document is the result."""
    from scaling_service.capabilities.consistent import saving
    from scaling_service.capabilities.consistent.run import consistent
    from scaling_service.capabilities.shared.tables import make_table_writer

    write_tables = make_table_writer(request.tables, outputs)
    chosen = request.part(ForceSettings)
    results = consistent(inputs / request.subject / DOCUMENT, chosen, request.settings, progress=progress)
    document = saving.save_consistent(results, outputs)
    saving.write_wrenches(results, outputs)
    write_tables(saving.tabulate_consistent(results, document), document)
    return document.model_dump(mode="json")


def list_kinds() -> dict[str, job.Kind]:
    """What the service offers of this capability."""
    return {
        "consistent": job.Kind(
            request=ConsistentRequest, work=work, route="consistent-motions", result=ConsistentDocument
        ),
    }
