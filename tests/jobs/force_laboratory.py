"""A laboratory with two force plates and a person of known inertia: what the plates show is exactly right."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import yaml

from scaling_service.files.trc import write_trc
from scaling_service.model.body import BodyModel
from scaling_service.model.builtin import load_builtin
from scaling_service.model.inertia import sum_mass
from scaling_service.virtual.plates import MARKER_NOISE_M, record_on_plates, write_forces


def document(**changes: Any) -> dict[str, Any]:
    """The laboratory's subject document, with top-level keys replaced."""
    mass = round(sum_mass(load_builtin("full_body_35dof")), 3)
    return {
        "subject": {"id": "S01", "sex": "M", "height_m": 1.762, "mass_kg": mass},
        "model": "full_body_35dof",
        "trials": {"calibration": ["sway.trc"], "evaluation": ["swing.trc"]},
        "forces": {"sway.trc": "sway_grf.mot", "swing.trc": "swing_grf.mot"},
    } | changes


def write_subject(folder: Path, content: dict[str, Any]) -> Path:
    file = folder / "S01.yaml"
    file.write_text(yaml.safe_dump(content, sort_keys=False), encoding="utf-8")
    return file


def force_laboratory(
    folder: Path, *, truth: BodyModel | None = None, noise_m: float = MARKER_NOISE_M
) -> Path:
    """Two recordings with their forces, and the subject file, in a folder; returns the subject file."""
    for seed, name in enumerate(("sway", "swing")):
        found = record_on_plates(truth, name=name, seed=seed, noise_m=noise_m)
        write_trc(folder / f"{name}.trc", found.trial, "mm")
        write_forces(folder / f"{name}_grf.mot", found.trial.times, found.plates)
    return write_subject(folder, document())
