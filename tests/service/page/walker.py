"""A small subject: the example's person, standing and walking, which is scaled in a moment."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np

from scaling_service.client import Client
from scaling_service.files.trc import read_trc, write_trc
from scaling_service.model.trial import Trial

FILES = ("static.trc", "gait_1.trc")


def put_walker(client: Client, subject: str, lab: Path, folder: Path, label: str | None = None) -> str:
    """Give the service such a subject of the example's files, with one label more on the thigh if named."""
    folder.mkdir(parents=True, exist_ok=True)
    for name in FILES:
        shutil.copy(lab / name, folder)
    person = json.loads((lab / "subject.json").read_text(encoding="utf-8"))["subject"] | {"id": subject}
    trials = {"static": "static.trc", "evaluation": ["gait_1.trc"]}
    document = {"subject": person, "model": "lower_limb_14dof", "trials": trials}
    client.put_subject(document if label is None else document | {"extra_markers": {label: "femur_r"}})
    for name in FILES:
        if label is not None:
            add_label(folder / name, label)
        client.upload(subject, folder / name)
    return subject


def add_label(file: Path, label: str) -> None:
    """One label more, 2 cm beside the right knee's."""
    trial = read_trc(file)
    beside = trial.markers[:, [trial.labels.index("V:RKNE")]] + 0.02
    markers = np.concatenate([trial.markers, beside], axis=1)
    write_trc(
        file,
        Trial(
            name=trial.name,
            times=trial.times,
            labels=(*trial.labels, label),
            markers=markers,
            rate_hz=trial.rate_hz,
        ),
    )
