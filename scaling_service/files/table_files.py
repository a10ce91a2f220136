"""Tables of numbers as binary files: all frames, and few of them for a first look."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

import numpy as np

from scaling_service.core.arrays import Array
from scaling_service.documents import base
from scaling_service.model.forces import GroundForces

MOST_FRAMES = 2000
"""Of a first look. Chosen: more than a screen has columns, and a megabyte for a whole body's markers."""


class ArrayFiles:
    """Writes tables below one folder of a job's files.

    ``outputs``: the folder of all files. ``below``: the folder of the tables in it; made when the first one
    is written. ``brief``: whether numbers keep 16 of 24 binary digits, 0.02 mm of 2 m, and so pack better.
    """

    def __init__(self, outputs: Path, below: str, *, brief: bool = False) -> None:
        self._outputs, self._below, self._brief = outputs, below, brief

    def write(
        self, name: str, values: Array, unit: str, *, first_look: Literal["frames", "largest"] = "frames"
    ) -> base.ArrayEntry:
        """Write one table.

        ``name``: without suffix; plain. ``values`` (n_frames, ...): NaN where unknown. ``first_look``
        'frames' or 'largest': whether the few frames are some of all, or hold the largest value of each
        stretch.
        """
        content = np.ascontiguousarray(values, dtype="<f4")
        if self._brief:
            content = ((content.view("<u4") + np.uint32(0x80)) & np.uint32(0xFFFFFF00)).view("<f4")
        step = -(-len(content) // MOST_FRAMES)
        overview = None
        if step > 1:
            few = content[::step]
            if first_look != "frames":  # the largest known value of every stretch of frames, NaN without one
                few = np.asarray(np.fmax.reduceat(content, np.arange(0, len(content), step), axis=0))
            file = self._save(f"{name}.overview.f32", few)
            overview = base.Overview(file=file, shape=list(few.shape), step=step)
        return base.ArrayEntry(
            file=self._save(f"{name}.f32", content), shape=list(content.shape), unit=unit, overview=overview
        )

    def _save(self, name: str, content: np.ndarray[tuple[int, ...], np.dtype[np.float32]]) -> str:
        file = self._outputs / self._below / name
        file.parent.mkdir(parents=True, exist_ok=True)
        content.tofile(file)
        return f"{self._below}/{name}"


def list_plates(forces: GroundForces | None, corners: Array | None) -> list[base.PlateEntry]:
    """Plates with their corners, (n_plates, 4, 3) in our axes, where the file has them."""
    if forces is None:
        return []
    peaks = np.linalg.norm(np.nan_to_num(forces.force), axis=2).max(axis=0)
    return [
        base.PlateEntry(
            name=name,
            corners_m=None if corners is None else np.round(corners[k], 5).tolist(),
            peak_N=round(float(peaks[k]), 1),
        )
        for k, name in enumerate(forces.plates)
    ]


def sample_at(times: Array, values: Array, wanted: Array) -> Array:
    """Values (n, ...) at other times, by the nearest sample; NaN beyond the recording."""
    after = np.minimum(np.searchsorted(times, wanted), len(times) - 1)
    before = np.maximum(after - 1, 0)
    rows = np.where(wanted - times[before] < times[after] - wanted, before, after)
    step = float(np.median(np.diff(times))) if len(times) > 1 else 0.0
    picked = values[rows].copy()
    picked[(wanted < times[0] - step) | (wanted > times[-1] + step)] = np.nan
    return np.asarray(picked)
