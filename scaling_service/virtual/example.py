"""The built-in example as a laboratory would hand it over: recordings, bones, image markers, a document."""

from __future__ import annotations

import csv
import json
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from trimesh.exchange.stl import export_stl

from scaling_service.files.image_markers import COLUMNS
from scaling_service.files.trc import write_trc
from scaling_service.model.body import Vector
from scaling_service.model.images import Bone
from scaling_service.model.subject import Session
from scaling_service.model.trial import Trial
from scaling_service.virtual.hidden import hidden_session
from scaling_service.virtual.image import virtual_image

PREFIX = "V"
"""Before every label, as trackers write it where several persons can be seen."""

DOCUMENT = "subject.json"
IMAGE_MARKERS = "image_markers.csv"

LABELS: Mapping[str, str] = {
    f"{side}{marker}": f"{PREFIX}:{side}{label}"
    for side in "RL"
    for marker, label in (
        ("ASIS", "ASI"),
        ("PSIS", "PSI"),
        ("LFE", "KNE"),
        ("MFE", "KNM"),
        ("FH", "FH"),
        ("LM", "ANK"),
        ("MM", "MMA"),
    )
}
"""Model marker to its label in the recordings: as many laboratories write them."""

R_OURS_LAB = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
"""The recordings' axes: Z up, as most laboratories have it; the person walks along X."""

_MM = 1e3


def write_example(folder: Path, name: str = "example", seed: int = 0) -> dict[str, Any]:
    """Write a virtual person's files, and the document that names them as ``subject.json``.

    Functional movements fit, walking is held out; bones are imaged. In the recordings two things are hidden
    that a model does not have: a marker slides with the knee, and two labels are exchanged for a while.

    Parameters
    ----------
    folder : Path
        Is there, and empty.
    name : str
        Of the subject.
    seed : int
        Decides the person.

    Returns
    -------
    dict
        The document.
    """
    session, person, _hidden = hidden_session(seed)
    image = virtual_image(person)
    for trial in _trials(session):
        _write_recording(folder / f"{trial.name}.trc", trial)
    for segment, bone in image.bones.items():
        (folder / f"{segment}.stl").write_bytes(_stl(bone))
    _write_markers(folder / IMAGE_MARKERS, image.markers)
    document = _document(name, session, list(image.bones))
    (folder / DOCUMENT).write_text(json.dumps(document, indent=1), encoding="utf-8")
    return document


def _trials(session: Session) -> tuple[Trial, ...]:
    return ((session.static,) if session.static is not None else ()) + session.dynamic


def _write_recording(file: Path, trial: Trial) -> None:
    named = trial.relabelled(dict(LABELS))
    write_trc(file, replace(named, markers=trial.markers @ R_OURS_LAB))


def _stl(bone: Bone) -> bytes:
    return bytes(export_stl(trimesh.Trimesh(_MM * bone.vertices, bone.faces, process=False)))


def _write_markers(file: Path, markers: Mapping[str, tuple[str, Vector]]) -> None:
    with file.open("w", encoding="utf-8", newline="") as stream:
        rows = csv.writer(stream)
        rows.writerow(COLUMNS)
        for marker, (segment, at) in markers.items():
            rows.writerow([marker, segment, *(f"{_MM * value:.3f}" for value in at)])


def _document(name: str, session: Session, bones: list[str]) -> dict[str, Any]:
    known = session.subject
    return {
        "subject": {
            "id": name,
            "sex": known.sex,
            "height_m": round(known.height_m or 0.0, 3),
            "mass_kg": round(known.mass_kg or 0.0, 1),
        },
        "model": known.model,
        "trials": {
            "static": "static.trc",
            "calibration": [f"{trial.name}.trc" for trial in session.calibration],
            "evaluation": [f"{trial.name}.trc" for trial in session.evaluation],
        },
        "bones": {"units": "mm"} | {bone: f"{bone}.stl" for bone in bones},
        "image_markers": IMAGE_MARKERS,
    }
