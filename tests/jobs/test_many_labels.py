"""Recordings with more labels than any person carries: they are looked at soon, or refused."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from scaling_service.capabilities.intake.result import ProofDocument
from scaling_service.capabilities.intake.run import prove
from scaling_service.core.errors import TrialUnusable
from scaling_service.files.recording import MOST_LABELS, read_recording
from scaling_service.files.trc import write_trc
from scaling_service.model.trial import Trial
from scaling_service.recording.identity.starts import assign

LONGEST_S = 3.0  # of processor time, for 2,000 labels; 100 s before labels were matched in linear time
MANY = 2_000

NAMES: dict[str, Callable[[int], str]] = {
    "of nothing": lambda k: f"M{k:04d}",
    "of one segment": lambda k: f"R_thigh{k}",
    "of both sides": lambda k: f"{'RL'[k % 2]}_thigh{k // 2}",
    "of one landmark": lambda k: f"P{k}:RASI",
    "that begin alike": lambda k: f"RKNE{k}",
    "that stand twice": lambda k: f"Q{k // 2}",
}


def write_cloud(file: Path, labels: list[str], frames: int = 1) -> None:
    """Points anywhere in the volume of a standing person."""
    rng = np.random.default_rng(1)
    points = rng.uniform([0.0, 0.0, 0.0], [0.5, 1.7, 0.5], (len(labels), 3))
    write_trc(
        file,
        Trial(
            name=file.stem,
            times=np.arange(frames) / 100.0,
            labels=tuple(labels),
            markers=np.repeat(points[None], frames, axis=0),
            rate_hz=100.0,
        ),
    )


def look_at(folder: Path) -> ProofDocument:
    return prove(folder, {"subject": {"id": "S01"}}, folder.parent / "out")


@pytest.mark.parametrize("kind", NAMES)
def test_two_thousand_labels_are_looked_at_soon(tmp_path: Path, kind: str) -> None:
    folder = tmp_path / "lab"
    folder.mkdir()
    write_cloud(folder / "static.trc", [NAMES[kind](k) for k in range(MANY)])
    begun = time.process_time()
    found = look_at(folder)
    assert time.process_time() - begun < LONGEST_S
    assert [file.kind for file in found.files] == ["recording"]
    assert any(p.field == "labels" and "more than one person carries" in p.problem for p in found.problems)


def test_more_labels_than_are_looked_at_are_refused_by_name(tmp_path: Path) -> None:
    folder = tmp_path / "lab"
    folder.mkdir()
    write_cloud(folder / "a.trc", [f"M{k}" for k in range(MOST_LABELS + 1)])
    with pytest.raises(TrialUnusable) as raised:
        read_recording(folder / "a.trc")
    assert raised.value.file is not None
    assert Path(raised.value.file).name == "a.trc"
    assert (raised.value.field, raised.value.remedy) == ("labels", "Export the markers of one person")
    (file,) = look_at(folder).files
    assert file.problem is not None
    assert "labels" in file.problem.problem
    write_cloud(folder / "a.trc", ["RASI", *(f"*{k}" for k in range(MOST_LABELS))])
    assert len(read_recording(folder / "a.trc").labels) == MOST_LABELS + 1  # nobody labelled these


@pytest.mark.parametrize(
    ("name", "labels", "frames", "stands"),
    [
        ("a", [f"M{k}" for k in range(30)], 5, False),
        ("a", [f"M{k}" for k in range(30)], 100, True),  # it says something that nothing moves so long
        ("static", [f"M{k}" for k in range(30)], 5, True),
        ("a", ["RASI", "LASI", *(f"M{k}" for k in range(28))], 5, True),
    ],
)
def test_a_few_frames_without_landmarks_are_no_static_trial(
    tmp_path: Path, name: str, labels: list[str], frames: int, stands: bool
) -> None:
    folder = tmp_path / "lab"
    folder.mkdir()
    write_cloud(folder / f"{name}.trc", labels, frames)
    (file,) = look_at(folder).files
    assert (file.role == "trials.static") == stands


def test_labels_and_landmarks_are_paired_as_by_a_search_from_the_labels() -> None:
    rng = np.random.default_rng(5)
    names = [f"L{k}" for k in range(20)]
    for n in (6, 20, 90):
        at, places = rng.uniform(0.0, 1.0, (n, 3)), rng.uniform(0.0, 1.0, (len(names), 3))
        for reach in (0.15, 0.4):
            assert assign(at, places, names, reach, {}) == pair_from_labels(at, places, reach)


def pair_from_labels(
    at: NDArray[np.float64], places: NDArray[np.float64], reach: float
) -> list[tuple[int, int]]:
    """The same least sum, with a row for each label and as many places beside: cubic in the labels."""
    squared = ((at[:, None] - places[None]) ** 2).sum(axis=2)
    costs = np.hstack([squared, np.full((len(at), len(at)), reach**2)])
    rows, columns = linear_sum_assignment(costs)
    return [
        (int(r), int(c))
        for r, c in zip(rows, columns, strict=True)
        if c < len(places) and squared[r, c] < reach**2
    ]
