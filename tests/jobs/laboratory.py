"""A laboratory in a folder: a person of known size, recorded in other axes and names, and a subject file."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from scaling_service.files.trc import write_trc
from scaling_service.model.trial import Trial
from tests.calibration.people import Person, person

LABELS = {
    "RASIS": "S01:RASI",
    "LASIS": "S01:LASI",
    "RPSIS": "S01:RPSI",
    "LPSIS": "S01:LPSI",
    "RLFE": "S01:RKNE",
}
"""Model marker to what this laboratory calls it, where that differs."""

R_OURS_LAB = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, 1.0], [-1.0, 0.0, 0.0]])
"""Its axes: z up, the person faces -y, and -x is to the person's right."""

FACTORS = {
    s: (f, f, f) for s, f in {"pelvis": 1.05, "femur_r": 0.96, "femur_l": 0.97, "tibia_r": 1.04}.items()
}


def known_person(seconds: float = 1.2) -> Person:
    """A person scaled against the generic one, with shifted markers, seen without noise."""
    return person(7, factors=FACTORS, shift_m=0.003, seconds=seconds)


def write_recording(path: Path, trial: Trial, *, units: str = "mm") -> None:
    """A trial as the laboratory would export it."""
    named = trial.relabel(LABELS)
    write_trc(path, replace(named, markers=trial.markers @ R_OURS_LAB), units)


def document(**changes: Any) -> dict[str, Any]:
    """The laboratory's subject document, with top-level keys replaced; None removes one."""
    content: dict[str, Any] = {
        "subject": {"id": "S01", "sex": "F", "height_m": 1.70, "mass_kg": 62.0},
        "model": "lower_limb_14dof",
        "trials": {"static": "standing.trc", "calibration": ["hips.trc"], "evaluation": ["walk.trc"]},
    }
    return {key: value for key, value in (content | changes).items() if value is not None}


def write_subject(folder: Path, content: dict[str, Any]) -> Path:
    """The subject file."""
    file = folder / "S01.yaml"
    file.write_text(yaml.safe_dump(content, sort_keys=False), encoding="utf-8")
    return file


def laboratory(folder: Path, someone: Person | None = None, **changes: Any) -> Path:
    """The recordings and the subject file in a folder; returns the subject file."""
    session = (someone or known_person()).session
    assert session.static is not None
    for name, trial in (
        ("standing", session.static),
        ("hips", session.calibration[0]),
        ("walk", session.evaluation[0]),
    ):
        write_recording(folder / f"{name}.trc", trial)
    return write_subject(folder, document(**changes))
