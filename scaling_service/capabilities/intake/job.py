"""The look at a subject's files before anything is computed, as a job."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, ClassVar

from pydantic import Field

from scaling_service.capabilities.intake.result import ProofDocument
from scaling_service.capabilities.shared import job
from scaling_service.capabilities.shared.settings import Settings
from scaling_service.core.progress import Progress
from scaling_service.documents.base import DOCUMENT
from scaling_service.documents.service import MarkerLabels


class ProofRequest(job.OfOneSubject):
    """Look at a subject's files before anything is computed.

    All uploaded files are looked at, whether the document names them or not; a document with `subject` alone
    will do. The result tells what each file is, proposes its place and the label of every marker, and what
    scaling would refuse. The tables that it names are among the job's files.
    """

    reads_every_file: ClassVar[bool] = True

    labels: MarkerLabels = Field(
        default={},
        description="Label to model marker, as the laboratory has them.",
        examples=[{"RKN": "RLFE"}],
    )
    settings: Settings = Field(default=Settings(), description="The laboratory's axes, where known.")

    def list_needed(self, documents: job.Documents) -> job.Needed:  # noqa: ARG002 (whatever there is)
        """No file must be there."""
        return {self.subject: {}}


def work(request: ProofRequest, inputs: Path, outputs: Path, progress: Progress) -> Any:
    """Write the tables of all recordings; the document is the result."""
    from scaling_service.capabilities.intake.run import prove

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


def list_kinds() -> dict[str, job.Kind]:
    """What the service offers of this capability."""
    return {
        "proof": job.Kind(request=ProofRequest, work=work, route="proofs", result=ProofDocument, brief=True),
    }
