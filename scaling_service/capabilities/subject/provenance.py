"""What is written beside results: from which files, by which program, with which repairs they were made."""

from __future__ import annotations

from collections import abc
from typing import Any

from scaling_service.capabilities.subject.preparing import Loaded
from scaling_service.capabilities.subject.reading import hash_input_files
from scaling_service.documents.results import RepairNote
from scaling_service.documents.subject import SIZE_UNIT
from scaling_service.documents.writing import code_version
from scaling_service.model.subject import Subject
from scaling_service.model.trial import Repair, Trial


def record_provenance(
    loaded: Loaded, trials: abc.Iterable[Trial], settings: abc.Mapping[str, Any], seed: int = 0
) -> dict[str, Any]:
    """The fields of a ``Provenance``: what is needed to get the same results again.

    ``trials``: those whose repairs are reported. ``settings``: as resolved, defaults included.
    """
    subject = loaded.session.subject
    return {
        "code_version": code_version(),
        "subject": subject.id,
        "settings": settings,
        "input_hashes": hash_input_files(subject, loaded.file),
        "seed": seed,
        "markers_used": {name: list(labels) for name, labels in loaded.markers_used.items()},
        "repairs": {trial.name: repair_notes(trial.repairs) for trial in trials},
    }


def read_stated_sizes(subject: Subject) -> dict[str, float]:
    """Height, mass and sizes measured by hand, each with its unit in the name, as subject files have them."""
    whole = {"height_m": subject.height_m, "mass_kg": subject.mass_kg}
    lengths = {f"{name}{SIZE_UNIT}": round(value * 1e3, 2) for name, value in subject.sizes_m.items()}
    return {name: value for name, value in whole.items() if value is not None} | lengths


def repair_notes(repairs: abc.Iterable[Repair]) -> list[RepairNote]:
    """What was changed in a recording, as results tell it."""
    return [RepairNote(what=r.what, where=r.where, detail=r.detail, frames=r.frames) for r in repairs]
