"""Find landmarks on bones: what ``landmarks`` does on the command line."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from scaling_service.capabilities.landmarks.run import landmark_bones, save_landmarks
from scaling_service.capabilities.scaling.request import LandmarksRequest
from scaling_service.core.progress import Progress
from scaling_service.documents.names import DOCUMENT


def work(request: LandmarksRequest, inputs: Path, outputs: Path, progress: Progress) -> Any:
    """Write ``landmarks.json``, which is also the result.

    Raises
    ------
    InputError
        A mesh cannot be read or used.
    """
    folder = inputs / request.subject
    document = json.loads((folder / DOCUMENT).read_text(encoding="utf-8"))
    bones = {bone: folder / file for bone, file in request.meshes(document).items()}
    found = save_landmarks(landmark_bones(bones, units=request.units, progress=progress), outputs)
    return json.loads(found.read_text(encoding="utf-8"))
