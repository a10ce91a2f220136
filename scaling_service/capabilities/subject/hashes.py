"""Fingerprints of everything a result came from."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterator
from pathlib import Path

from scaling_service.capabilities.subject.loading import recordings
from scaling_service.documents.subject import MODEL_SUFFIXES
from scaling_service.model.subject import Subject


def input_hashes(subject: Subject, subject_file: Path | None = None) -> dict[str, str]:
    """SHA-256 of the subject file and of every file that it names.

    Returns file to hexadecimal digest. Files at or below the subject file's folder are named relative to
    it, so that the same data elsewhere give the same document.
    """
    folder = None if subject_file is None else subject_file.resolve().parent
    found: dict[str, str] = {}
    for path in _inputs(subject, subject_file):
        place = Path(os.path.abspath(path))  # noqa: PTH100 (links keep their names, ".." goes)
        inside = folder is not None and place.is_relative_to(folder)
        name = place.relative_to(folder).as_posix() if inside and folder is not None else str(place)
        found[name] = _digest(path)
    return found


def _inputs(subject: Subject, subject_file: Path | None) -> Iterator[Path]:
    if subject_file is not None:
        yield subject_file.resolve()
    if subject.model.lower().endswith(MODEL_SUFFIXES):
        yield Path(subject.model)
    yield from (p for p in (subject.marker_set, subject.scale_setup, subject.image_markers) if p is not None)
    yield from recordings(subject)
    yield from subject.forces.values()
    yield from subject.bones.values()


def _digest(path: Path) -> str:
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()
