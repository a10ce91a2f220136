"""Recordings of the conventional marker set with what the laboratory's own software made of them."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from scaling_service.files.recording import read_recording
from scaling_service.model.trial import Trial


@dataclass(frozen=True)
class ClinicTrial:
    """One recording: markers in m (laboratory axes), declared sizes in m, the laboratory's curves."""

    trial: Trial
    sizes: dict[str, float]
    curves: np.ndarray

    def marker(self, label: str) -> np.ndarray:
        return self.trial.position(label)

    def centre(self, name: str) -> np.ndarray:
        """A joint centre of the laboratory, (n_frames, 3), m."""
        return self._columns(name) / 1000.0

    def angles(self, name: str) -> np.ndarray:
        """Angles of the laboratory, (n_frames, 3), deg."""
        return self._columns(name)

    def _columns(self, name: str) -> np.ndarray:
        return np.column_stack([self.curves[f"{name}_{axis}"] for axis in "xyz"])


def clinic_trials(data: Path) -> dict[str, ClinicTrial]:
    """All of them by the trial's stem, the standing ones (…01) included."""
    found = {}
    for table in sorted((data / "clinic").glob("*/*_vicon.csv")):
        stem = table.name.removesuffix("_vicon.csv")
        declared = json.loads((table.parent / "sizes.json").read_text(encoding="utf-8"))[stem]
        found[stem] = ClinicTrial(
            read_recording(table.with_name(f"{stem}.c3d")),
            {name: value / 1000.0 for name, value in declared.items() if name not in ("Bodymass",)},
            np.genfromtxt(table, delimiter=",", names=True),
        )
    return found
