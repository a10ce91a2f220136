"""Checking a model's dynamics as a job."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from scaling_service.capabilities.dynamics.result import DynamicsDocument
from scaling_service.capabilities.dynamics.settings import DynamicsSettings
from scaling_service.capabilities.shared import job
from scaling_service.core.progress import Progress
from scaling_service.documents.base import DOCUMENT


class DynamicsRequest(job.OfForces, DynamicsSettings):
    """Compute joint loads and residuals from a subject's forces, with their uncertainty."""


def work(request: DynamicsRequest, inputs: Path, outputs: Path, progress: Progress) -> Any:
    """Write ``dynamics.json``, each trial's forces and the report; the document is the result."""
    from scaling_service.capabilities.dynamics.run import dynamics
    from scaling_service.capabilities.dynamics.saving import save_dynamics, write_residuals
    from scaling_service.capabilities.shared.tables import make_table_writer

    write_tables = make_table_writer(request.tables, outputs)
    chosen = request.part(DynamicsSettings)
    results = dynamics(inputs / request.subject / DOCUMENT, chosen, request.settings, progress=progress)
    document = save_dynamics(results, outputs)
    write_residuals(results, outputs)
    write_tables(results.tables, document)
    return document.model_dump(mode="json")


def list_kinds() -> dict[str, job.Kind]:
    """What the service offers of this capability."""
    return {
        "dynamics": job.Kind(request=DynamicsRequest, work=work, route="dynamics", result=DynamicsDocument),
    }
