"""Virtual persons to try everything on: as sessions, with something hidden in recordings, and as files.

A search that does not know what was hidden is to find it.
"""

from __future__ import annotations

import csv
import json
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from trimesh.exchange.stl import export_stl

from scaling_service.core.progress import show_nothing
from scaling_service.files.image_markers import COLUMNS
from scaling_service.files.trc import write_trc
from scaling_service.model.body import BodyModel, Vector, to_vector
from scaling_service.model.compile import compile_model, list_parameter_values
from scaling_service.model.subject import Session
from scaling_service.model.trial import Bone, ImageEvidence, Trial
from scaling_service.numerics.multibody.laws import Array
from scaling_service.numerics.multibody.tree import pose_markers
from scaling_service.virtual.artefact import glide_marker
from scaling_service.virtual.image import make_virtual_image, read_image_evidence
from scaling_service.virtual.subject import (
    VirtualSettings,
    VirtualSubject,
    make_session,
    make_virtual_subject,
    process_recording,
)

RECORDED = VirtualSettings(artefact=0.0, functional_s=5.0)
"""Chosen: the skin rests but for what is hidden, so that all there is to find is known; five seconds of each
movement are found to be enough, and are searched in seconds."""

_M_PER_MM, _RAD_PER_DEG = 1e-3, np.pi / 180.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Hidden:
    """One thing that was hidden."""

    kind: str  # as the catalogue of effects calls it
    where: tuple[str, ...]
    parameters: dict[str, float]  # with the unit in the name, as results have them
    driver: tuple[str, ...] = ()
    trial: str | None = None  # the only recording in which it is


SLIDING = Hidden(
    kind="soft_tissue_artefact",
    where=("RLFE",),
    parameters={"x_mm_per_deg": 0.12, "y_mm_per_deg": 0.16, "z_mm_per_deg": 0.0},
    driver=("knee_angle_r",),
)
"""A marker of the thigh that slides with the knee: 0.2 mm/deg in all, the usual size of a knee's share
(``THIGH_MM_PER_DEG``)."""

SWAPPED = Hidden(
    kind="marker_swap", where=("LLM", "LMM"), parameters={"start_s": 2.0, "end_s": 2.6}, trial="knee_l"
)
"""The two markers of an ankle exchanged for 0.6 s, as trackers do after one was hidden (chosen)."""


def make_demo_session(
    seed: int,
    settings: VirtualSettings | None = None,
    *,
    images: bool = False,
    progress: Callable[[str], None] | None = None,
) -> tuple[Session, VirtualSubject]:
    """A virtual subject as a session, recordings processed: functional movements fit, gait is held out.

    ``images``: whether the person's bones were imaged too; making them and reading their landmarks takes
    seconds. ``progress``: called with what is done, where bones are made.
    """
    person = make_virtual_subject(seed, settings or VirtualSettings())
    trials = {name: process_recording(trial, person.generic) for name, trial in person.trials.items()}
    session = make_session(person, person.generic, trials)
    return replace(session, images=_read_image(person, progress) if images else None), person


def _read_image(person: VirtualSubject, progress: Callable[[str], None] | None) -> ImageEvidence:
    report = progress or show_nothing
    image = make_virtual_image(person, progress=lambda bone: report(f"making the {bone}"))
    return read_image_evidence(image, progress=lambda bone: report(f"landmarks of the {bone}"))


def make_hidden_session(
    seed: int, settings: VirtualSettings = RECORDED
) -> tuple[Session, VirtualSubject, tuple[Hidden, ...]]:
    """A person's own model, recordings that hold more than it, and what was hidden.

    The model is the person's: sizes, knee axes and markers are right. Functional movements fit, walking is
    held out; recordings are neither smoothed nor filled.
    """
    person = make_virtual_subject(seed, settings)
    sliding = _with_sliding(person.model)
    trials = {
        name: trial if name == "static" else _swap_labels(_slide_marker(trial, person, sliding))
        for name, trial in person.trials.items()
    }
    return make_session(person, person.model, trials), person, (SLIDING, SWAPPED)


def _with_sliding(model: BodyModel) -> BodyModel:
    """The model with the marker that slides."""
    (name,), (driver,) = SLIDING.where, SLIDING.driver
    gains = [_M_PER_MM / _RAD_PER_DEG * SLIDING.parameters[f"{axis}_mm_per_deg"] for axis in "xyz"]
    moved = glide_marker(model.marker(name), {driver: to_vector(gains)})
    return model.with_markers(tuple(moved if m.name == name else m for m in model.markers))


def _slide_marker(trial: Trial, person: VirtualSubject, sliding: BodyModel) -> Trial:
    """The recording with the marker where its skin took it; noise and gaps stay."""
    q, names = person.motions[trial.name], trial.labels
    away = _place_marker(sliding, names, q) - _place_marker(person.model, names, q)
    return replace(trial, markers=trial.markers + away)


def _place_marker(model: BodyModel, names: tuple[str, ...], q: Array) -> Array:
    return pose_markers(compile_model(model, names), q, list_parameter_values(model))


def _swap_labels(trial: Trial) -> Trial:
    """The recording with two labels exchanged for a while, where it is the one."""
    if trial.name != SWAPPED.trial:
        return trial
    pair = [trial.index(name) for name in SWAPPED.where]
    start, end = SWAPPED.parameters["start_s"], SWAPPED.parameters["end_s"]
    rows = np.flatnonzero((trial.times >= start - 1e-9) & (trial.times <= end + 1e-9))
    markers = trial.markers.copy()
    markers[rows[:, None], pair] = markers[rows[:, None], pair[::-1]]
    return replace(trial, markers=markers)


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


def write_example(
    folder: Path,
    name: str = "example",
    seed: int = 0,
    *,
    imaged: bool = True,
    strides: float = RECORDED.strides,
) -> dict[str, Any]:
    """Write a virtual person's files, and the document that names them as ``subject.json``.

    Functional movements fit, walking is held out; bones are imaged. In the recordings two things are hidden
    that a model does not have: a marker slides with the knee, and two labels are exchanged for a while.

    ``folder``: is there, and empty. ``name``: of the subject. ``seed``: decides the person.
    ``imaged``: whether there are bones. ``strides``: of each walk. Returns the document.
    """
    session, person, _hidden = make_hidden_session(seed, replace(RECORDED, strides=strides))
    for trial in _list_trials(session):
        _write_recording(folder / f"{trial.name}.trc", trial)
    document = _make_document(name, session)
    if imaged:
        image = make_virtual_image(person)
        for segment, bone in image.bones.items():
            (folder / f"{segment}.stl").write_bytes(_write_stl(bone))
        _write_markers(folder / IMAGE_MARKERS, image.markers)
        document["bones"] = {"units": "mm"} | {bone: f"{bone}.stl" for bone in image.bones}
        document["image_markers"] = IMAGE_MARKERS
    (folder / DOCUMENT).write_text(json.dumps(document, indent=1), encoding="utf-8")
    return document


def _list_trials(session: Session) -> tuple[Trial, ...]:
    return ((session.static,) if session.static is not None else ()) + session.dynamic


def _write_recording(file: Path, trial: Trial) -> None:
    named = trial.relabel(dict(LABELS))
    write_trc(file, replace(named, markers=trial.markers @ R_OURS_LAB))


def _write_stl(bone: Bone) -> bytes:
    return bytes(export_stl(trimesh.Trimesh(_MM * bone.vertices, bone.faces, process=False)))


def _write_markers(file: Path, markers: Mapping[str, tuple[str, Vector]]) -> None:
    with file.open("w", encoding="utf-8", newline="") as stream:
        rows = csv.writer(stream)
        rows.writerow(COLUMNS)
        for marker, (segment, at) in markers.items():
            rows.writerow([marker, segment, *(f"{_MM * value:.3f}" for value in at)])


def _make_document(name: str, session: Session) -> dict[str, Any]:
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
    }


if __name__ == "__main__":
    write_example(Path(sys.argv[1]), sys.argv[2], int(sys.argv[3]))
