"""Skin markers over bones whose pose was measured: how far found bones turn from the true ones."""

from __future__ import annotations

import csv
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from scaling_service.files.sto import read_sto

Array = NDArray[np.float64]
JOINTS = {"femur": "hip", "tibia": "knee", "humerus": "shoulder"}
"""Bone to the joint above it, as the data's models name its coordinates JOINT_z, JOINT_x, JOINT_y."""

INTERVAL = 1.96
"""Standard deviations on each side of a normal distribution's 95 % interval."""


def read_bones(file: Path) -> dict[str, Array]:
    """True rotation of every bone in every frame, (n, 3, 3)."""
    with file.open(encoding="utf-8", newline="") as stream:
        head, *rows = csv.reader(stream)
    values = np.array([[float(x or "nan") for x in row] for row in rows])
    bones = [name.removesuffix("_r11") for name in head if name.endswith("_r11")]
    return {b: values[:, head.index(f"{b}_r11") :][:, :9].reshape(-1, 3, 3) for b in bones}


def read_poses(file: Path, bones: Sequence[str]) -> dict[str, Array]:
    """Found rotation of every bone in every frame, (n, 3, 3), from ``--poses``."""
    table = read_sto(file)
    found = {}
    for bone in bones:
        angles = np.column_stack([table.column(f"{bone}_O{axis}") for axis in "xyz"])
        found[bone] = Rotation.from_euler("XYZ", angles, degrees=True).as_matrix()
    return found


def angle_error_deg(found: Mapping[str, Array], true: Mapping[str, Array]) -> float:
    """RMS angle between found and true turn of every bone against the bone before it."""
    errors = []
    for above, below in zip(true, list(true)[1:], strict=False):
        n = min(len(found[below]), len(true[below]))
        turns = [np.swapaxes(r[above][:n], 1, 2) @ r[below][:n] for r in (found, true)]
        cosine = (np.einsum("nij,nij->n", *turns) - 1.0) / 2.0
        errors.append(np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0))))
    return float(np.sqrt(np.nanmean(np.square(errors))))


def share_covered(folder: Path, trial: str, true: Mapping[str, Array]) -> float:
    """Share of frames and angles in which the 95 % interval of ``ik`` holds the true angle."""
    found, deviation = read_sto(folder / f"{trial}_ik.mot"), read_sto(folder / f"{trial}_ik_sd.mot")
    hits = []
    for above, below in zip(true, list(true)[1:], strict=False):
        turn = np.swapaxes(true[above], 1, 2) @ true[below]
        wanted = {
            "z": np.arctan2(-turn[:, 0, 1], turn[:, 1, 1]),
            "x": np.arcsin(np.clip(turn[:, 2, 1], -1.0, 1.0)),
            "y": np.arctan2(-turn[:, 2, 0], turn[:, 2, 2]),
        }
        for axis, angle in wanted.items():
            name = f"{JOINTS[below]}_{axis}"
            ours, spread = (np.radians(table.column(name)) for table in (found, deviation))
            n = min(len(ours), len(angle))
            off = (ours[:n] - angle[:n] + np.pi) % (2.0 * np.pi) - np.pi
            hits.append(np.nanmean(np.abs(off) <= INTERVAL * spread[:n]))
    return float(np.mean(hits))
