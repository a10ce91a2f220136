"""The route that tells the names which requests and results use."""

from __future__ import annotations

from fastapi import APIRouter

from scaling_service.documents.service import Vocabulary
from scaling_service.service.http.callers import Owner
from scaling_service.service.http.problems import described
from scaling_service.service.jobs.vocabulary import vocabulary

router = APIRouter(prefix="/v1/vocabulary", tags=["subjects"])


@router.get("", responses=described())
def get_vocabulary(owner: Owner) -> Vocabulary:  # noqa: ARG001 (a key is needed where the service has keys)
    """List the built-in models with their markers, the methods, and the bones that can be given."""
    return vocabulary()
