"""Follow recordings with a model that exists: what ``ik`` does on the command line."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from scaling_service.capabilities.motion.recordings import ik
from scaling_service.capabilities.motion.request import MotionRequest
from scaling_service.capabilities.motion.saving import save_motions
from scaling_service.capabilities.subject.loading import read_model
from scaling_service.core.progress import Progress
from scaling_service.documents.names import DOCUMENT
from scaling_service.documents.reading import read_document
from scaling_service.documents.subject import MODEL_SUFFIXES
from scaling_service.files.recording import read_recording
from scaling_service.model.anatomy.markers import strip_prefix


def work(request: MotionRequest, inputs: Path, outputs: Path, progress: Progress) -> Any:
    """Write each trial's motion with its standard deviations; ``ik.json`` is the result.

    Raises
    ------
    InputError
        Whatever in the model or the recordings cannot be used.
    """
    folder = inputs / request.subject
    document = read_document(folder / DOCUMENT)
    name, marker_set = request.chosen_model(document), request.marker_set(document)
    model = folder / name if name.lower().endswith(MODEL_SUFFIXES) else name
    added = None if marker_set is None else folder / marker_set
    files = [folder / recording for recording in request.select_recordings(document)]
    usual = _match_markers(document.markers, read_model(model, added).marker_names, files)
    options = request.chosen.model_copy(update={"markers": usual | request.markers})
    tracked = ik(
        model,
        files,
        options,
        marker_set=added,
        subject=request.subject,
        subject_file=folder / DOCUMENT,
        progress=progress,
    )
    return save_motions(tracked, outputs).model_dump(mode="json")


def _match_markers(markers: Mapping[str, str], known: Sequence[str], files: Sequence[Path]) -> dict[str, str]:
    """Of the subject's labels those that this model and these recordings have."""
    labels = {
        plain
        for file in files
        for label in read_recording(file).labels
        for plain in (label, strip_prefix(label))
    }
    return {marker: label for marker, label in markers.items() if marker in known and label in labels}
