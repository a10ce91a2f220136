"""The squats of the OpenCap validation study as three trials: read, cut, and written as a subject."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import yaml

from scaling_service.files.sto import Table, read_sto, write_sto
from scaling_service.files.trc import read_trc, write_trc
from scaling_service.model.trial import Trial
from tests.blind.body import Array

FOLDER = "opencap_squat"
PERSON = {"id": "squats", "height_m": 1.68, "mass_kg": 62.6}
"""As the recordings' own notes have it."""

PARTS = 3
"""Of 4.5 s each: two to fit, the last held out."""

PLATES = {"plate_1": "calcn_r", "plate_2": "calcn_l"}
"""Which foot stands on which plate."""


@dataclass(frozen=True)
class RealTrial:
    """Markers in m and forces of one part, both in the file's own axes."""

    markers: Trial
    forces: Table

    def with_positions(self, positions: Array) -> RealTrial:
        """The same with other marker positions (n, m, 3), m."""
        return replace(self, markers=replace(self.markers, markers=positions))

    def with_forces(self, columns: tuple[str, ...], data: Array) -> RealTrial:
        """The same with another table of forces."""
        return replace(self, forces=replace(self.forces, columns=columns, data=data))

    def plate(self, name: str, letter: str) -> list[int]:
        """Columns of a plate's forces (v), points (p) or moments (m)."""
        stem = f"ground_force_{name[-1]}_{letter}"
        return [self.forces.columns.index(f"{stem}{axis}") for axis in "xyz"]


def read_squats(data: Path) -> list[RealTrial]:
    """The parts; computed points (``HJC``) are left out, and so is the empty third plate."""
    markers = read_trc(data / FOLDER / "squats1.trc")
    kept = [k for k, label in enumerate(markers.labels) if "HJC" not in label]
    forces = read_sto(data / FOLDER / "squats1_grf.mot")
    used = [k for k, name in enumerate(forces.columns) if not name.startswith("ground_force_3")]
    edges = np.linspace(0, markers.n_frames, PARTS + 1).astype(int)
    parts = []
    for k, (start, stop) in enumerate(pairwise(edges), start=1):
        times = markers.times[start:stop]
        here = (forces.times >= times[0] - 1e-6) & (forces.times <= times[-1] + 1e-6)
        table = forces.data[here][:, used].copy()
        table[:, 0] -= times[0]
        parts.append(
            RealTrial(
                Trial(name=f"squats_{k}", times=times - times[0],
                    labels=tuple(markers.labels[j] for j in kept),
                      markers=markers.markers[start:stop, kept].copy(), rate_hz=markers.rate_hz),
                Table(name=f"squats_{k}", columns=tuple(forces.columns[j] for j in used),
                    data=table, in_degrees=False),
            )
        )  # fmt: skip
    return parts


def write_subject(folder: Path, data: Path, trials: list[RealTrial]) -> Path:
    """A subject folder with the laboratory's own scaled model; the last trial is held out."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "model.osim").write_bytes((data / FOLDER / "manually_scaled.osim").read_bytes())
    for trial in trials:
        write_trc(folder / f"{trial.markers.name}.trc", trial.markers)
        write_sto(folder / f"{trial.markers.name}_forces.mot", trial.forces)
    files = [f"{t.markers.name}.trc" for t in trials]
    document = {
        "subject": PERSON,
        "model": "model.osim",
        "trials": {"calibration": files[:-1], "evaluation": files[-1:]},
        "forces": {f: f"{t.markers.name}_forces.mot" for f, t in zip(files, trials, strict=True)},
    }
    subject = folder / "subject.yaml"
    subject.write_text(yaml.safe_dump(document, sort_keys=False), encoding="utf-8")
    return subject
