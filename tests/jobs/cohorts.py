"""Cohorts in a folder: small laboratories side by side, and a table that names them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from scaling_service.capabilities.shared.settings import CalibrationSettings, Settings
from scaling_service.recording.settings import ProcessingSettings
from tests.calibration.people import person
from tests.jobs.laboratory import laboratory

FAST = Settings(calibration=CalibrationSettings(n_frames=20), processing=ProcessingSettings(smoothing="none"))


def someone(root: Path, name: str, **changes: Any) -> Path:
    """A laboratory of its own for a person of a size of their own; returns the subject file."""
    folder = root / name
    folder.mkdir(parents=True)
    rng = np.random.default_rng(sum(name.encode()))
    factors = {
        s: (f, f, f) for s in ("pelvis", "femur_r", "femur_l", "tibia_r") for f in [rng.uniform(0.93, 1.07)]
    }
    built = person(3, factors=factors, shift_m=0.004, noise_m=0.001, seconds=0.5)
    file = laboratory(folder, built, **({"subject": {"id": name, "height_m": 1.7}} | changes))
    return file.rename(folder / "subject.yaml")


def table(root: Path, *names: str, header: str = "subject,site", row: str = "{0}/subject.yaml,north") -> Path:
    """A cohort file that names the subjects of :func:`someone`."""
    file = root / "cohort.csv"
    file.write_text("\n".join([header, *(row.format(name) for name in names)]) + "\n", encoding="utf-8")
    return file
