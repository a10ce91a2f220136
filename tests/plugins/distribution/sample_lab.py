"""A small distribution that adds a scaling method, an effect and a recording format."""

from __future__ import annotations

import csv
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from scaling_service.capabilities.discovery.effects.catalogue import Effect
from scaling_service.capabilities.discovery.laws.candidates import Candidate, Column
from scaling_service.capabilities.discovery.laws.loads import PlateShift
from scaling_service.capabilities.discovery.laws.scene import Scene
from scaling_service.files.recording import Recording


@dataclass(frozen=True, slots=True)
class AsMarkersSay:
    """MB under a name of its own."""

    title: str = "what marker distances say, once more"
    needs: str | None = "MB"
    needs_images: bool = False
    needs_movements: bool = False
    fits_lengths: bool = False

    def calibrate(self, session: Any, start: Any, settings: Any, progress: Any) -> Any:
        return replace(start, method="MB_again")


METHOD = AsMarkersSay()


def lifted_floors(scene: Scene) -> Iterator[Candidate]:
    """All plates higher or lower by a height of their own, in all recordings and in each."""
    columns = tuple(
        Column(f"{plate}_y_mm", 1e-3, load=PlateShift(plate, 1), low=-100.0, high=100.0)
        for plate in scene.plates
    )
    for trials in scene.scopes_with_forces:
        yield Candidate("lifted_floor", tuple(scene.plates), columns, trials=trials)


EFFECT = Effect(
    kind="lifted_floor",
    meaning="the floor lies higher than the laboratory says",
    candidates=lifted_floors,
    seen_in="wrench",
)


def read_rows(path: Path) -> Recording:
    """Rows of time, then x, y, z of every marker in mm; the labels stand in the first row."""
    with path.open(encoding="utf-8", newline="") as stream:
        head, *rows = csv.reader(stream)
    values = np.array(rows, dtype=float)
    times = values[:, 0]
    return Recording(
        name=path.stem,
        times=times,
        labels=tuple(head[1:]),
        markers=values[:, 1:].reshape(len(values), -1, 3) / 1e3,
        rate_hz=float(1.0 / np.median(np.diff(times))),
        unit="mm",
    )
