"""A laboratory's folder, and the ways in which one is spoilt by mistake."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np

from scaling_service.model.trial import Trial
from tests.files.c3d_writing import write_c3d
from tests.jobs.laboratory import document, known_person, write_recording, write_subject

Spoil = Callable[[Path], None]
"""Changes a laboratory's folder."""

NAMES = ("standing", "hips", "walk")
PERSON = known_person(0.5)


def recorded(name: str) -> Trial:
    session = PERSON.session
    trial = {"standing": session.static, "hips": session.calibration[0]}.get(name, session.evaluation[0])
    assert trial is not None
    return trial


def record(folder: Path, change: Callable[[Trial], Trial], names: tuple[str, ...] = NAMES) -> None:
    for name in names:
        write_recording(folder / f"{name}.trc", change(recorded(name)))


def without(*labels: str) -> Callable[[Trial], Trial]:
    return lambda trial: trial.select([label for label in trial.labels if label not in labels])


def at(trial: Trial, positions: np.ndarray, *labels: str) -> Trial:
    """Some markers (all unless named) at given positions in every frame."""
    markers = trial.markers.copy()
    for label in labels or trial.labels:
        markers[:, trial.index(label)] = positions
    return trial.with_markers(markers)


def on(label: str, *others: str) -> Callable[[Trial], Trial]:
    return lambda trial: at(trial, trial.position(label), *others)


def unseen(*labels: str) -> Callable[[Trial], Trial]:
    return lambda trial: at(trial, np.full(3, np.nan), *labels)


def replaced(name: str, old: str, new: str) -> Spoil:
    def spoil(folder: Path) -> None:
        content = (folder / name).read_text(encoding="utf-8")
        assert old in content
        (folder / name).write_text(content.replace(old, new), encoding="utf-8")

    return spoil


def holding(name: str, content: bytes) -> Spoil:
    return lambda folder: (folder / name).write_bytes(content) and None


def cut(name: str, share: float) -> Spoil:
    def spoil(folder: Path) -> None:
        whole = (folder / name).read_bytes()
        (folder / name).write_bytes(whole[: round(share * len(whole))])

    return spoil


def as_c3d(after: Spoil = lambda _: None) -> Spoil:
    """The functional movement as hips.c3d, then spoilt."""

    def spoil(folder: Path) -> None:
        write_c3d(folder / "hips.c3d", recorded("hips"))
        (folder / "hips.trc").unlink()
        trials = {"static": "standing.trc", "calibration": ["hips.c3d"], "evaluation": ["walk.trc"]}
        write_subject(folder, document(trials=trials))
        after(folder)

    return spoil


def subject(**changes: object) -> Spoil:
    return lambda folder: write_subject(folder, document(**changes)) and None


def trials(**changes: object) -> Spoil:
    return subject(trials={"static": "standing.trc", "calibration": ["hips.trc"]} | changes)


def copied(source: str, target: str, then: Spoil) -> Spoil:
    def spoil(folder: Path) -> None:
        shutil.copy(folder / source, folder / target)
        then(folder)

    return spoil


def in_recordings(change: Callable[[Trial], Trial], *names: str) -> Spoil:
    return lambda folder: record(folder, change, names or NAMES)


def assert_refused(folder: Path, said: str, file: str, says: tuple[str, ...], before: set[Path]) -> None:
    assert said.count("\n") == 1, said
    assert said.startswith(f"scaling-service: {folder / file}"), said
    for part in says:
        assert part in said
    assert "Traceback" not in said
    assert set(folder.rglob("*")) == before
