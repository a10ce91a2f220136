"""Tables of numbers as binary files: all frames, and few of them for a first look."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

import numpy as np

from scaling_service.documents.arrays import ArrayEntry, Overview
from scaling_service.model.trial import Array

MOST_FRAMES = 2000
"""Of a first look. Chosen: more than a screen has columns, and a megabyte for a whole body's markers."""


class ArrayFiles:
    """Writes tables below one folder of a job's files.

    ``outputs``: the folder of all files. ``below``: the folder of the tables in it; made when the first one
    is written.
    """

    def __init__(self, outputs: Path, below: str) -> None:
        self._outputs, self._below = outputs, below

    def write(
        self, name: str, values: Array, unit: str, *, first_look: Literal["frames", "largest"] = "frames"
    ) -> ArrayEntry:
        """Write one table.

        ``name``: without suffix; plain. ``values`` (n_frames, ...): NaN where unknown. ``first_look``
        'frames' or 'largest': whether the few frames are some of all, or hold the largest value of each
        stretch.
        """
        content = np.ascontiguousarray(values, dtype="<f4")
        step = -(-len(content) // MOST_FRAMES)
        overview = None
        if step > 1:
            few = content[::step] if first_look == "frames" else _largest(content, step)
            file = self._save(f"{name}.overview.f32", few)
            overview = Overview(file=file, shape=list(few.shape), step=step)
        return ArrayEntry(
            file=self._save(f"{name}.f32", content), shape=list(content.shape), unit=unit, overview=overview
        )

    def _save(self, name: str, content: np.ndarray[tuple[int, ...], np.dtype[np.float32]]) -> str:
        file = self._outputs / self._below / name
        file.parent.mkdir(parents=True, exist_ok=True)
        content.tofile(file)
        return f"{self._below}/{name}"


def _largest(
    values: np.ndarray[tuple[int, ...], np.dtype[np.float32]], step: int
) -> np.ndarray[tuple[int, ...], np.dtype[np.float32]]:
    """The largest known value of every stretch of frames; NaN where none is known."""
    edges = np.arange(0, len(values), step)
    return np.asarray(np.fmax.reduceat(values, edges, axis=0))
