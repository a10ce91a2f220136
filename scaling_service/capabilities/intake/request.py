"""The request for a look at a subject's files."""

from __future__ import annotations

from typing import ClassVar

from pydantic import Field

from scaling_service.capabilities.scaling.request import ChosenSettings, Documents, Needed, OfOneSubject
from scaling_service.capabilities.subject.settings import Settings
from scaling_service.documents.service import MarkerLabels


class ProofRequest(OfOneSubject):
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
    settings: ChosenSettings = Field(default=Settings(), description="The laboratory's axes, where known.")

    def needed(self, documents: Documents) -> Needed:  # noqa: ARG002 (whatever there is)
        """No file must be there."""
        return {self.subject: {}}
