"""The sets in ``living_bone`` of the recordings beside the repository, and who recorded them."""

from __future__ import annotations

import csv
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from scaling_service.numerics.multibody.laws import Array


@dataclass(frozen=True, slots=True, kw_only=True)
class BoneSet:
    """One set; its README has the laboratories and persons."""

    name: str
    laboratory: str
    person: str
    side: int  # 1: right, -1: left
    rate_hz: float
    sound: bool = True  # whether markers and bones' frames are the same in all of its recordings


SETS = (
    BoneSet(name="cadaver_hip", laboratory="Rome", person="F1", side=1, rate_hz=120.0),
    BoneSet(name="knee_fluoroscopy", laboratory="Taipei", person="N1", side=1, rate_hz=30.0, sound=False),
    BoneSet(name="knee_fluoroscopy_step", laboratory="Taipei", person="N1", side=1, rate_hz=30.0),
    BoneSet(name="knee_implant_sit", laboratory="Taipei", person="N3", side=-1, rate_hz=30.0),
    BoneSet(name="knee_implant_steps", laboratory="Bologna", person="U1", side=1, rate_hz=6.0),
    BoneSet(name="knee_pins", laboratory="Ottawa", person="O1", side=1, rate_hz=120.0, sound=False),
    BoneSet(name="knee_pins_hop", laboratory="Ottawa", person="O1", side=1, rate_hz=120.0),
    BoneSet(name="shoulder_pins", laboratory="Montreal", person="S1", side=-1, rate_hz=300.0),
    BoneSet(name="shoulder_pins_reach", laboratory="Montreal", person="S1", side=-1, rate_hz=100.0),
)


def find_living_bone(shared_data: Path) -> Path:
    """The folder of all sets; skips where it is not."""
    root = shared_data / "living_bone"
    if not root.is_dir():
        pytest.skip("recordings over bones of known pose are not here")
    return root


def read_bones(path: Path) -> dict[str, Array]:
    """Rotation matrices of the bones, (n, 3, 3), by name in the order of the chain."""
    names, values = _read_table(path)
    starts = {n.removesuffix("_r11"): k for k, n in enumerate(names) if n.endswith("_r11")}
    return {bone: values[:, k : k + 9].reshape(-1, 3, 3) for bone, k in starts.items()}


def read_skin(path: Path) -> dict[str, Array]:
    """Markers in the axes of their bones, (n, 3), m."""
    names, values = _read_table(path)
    starts = {n.removesuffix("_x_mm"): k for k, n in enumerate(names) if n.endswith("_x_mm")}
    return {marker: 1e-3 * values[:, k : k + 3] for marker, k in starts.items()}


def measure_joint_angles(true: dict[str, Array]) -> Array:
    """Turns about Z, X, Y of every bone against its parent, (n, 3 n_joints), rad."""
    columns = []
    for parent, child in zip(true, list(true)[1:], strict=False):
        between = np.einsum("nji,njk->nik", true[parent], true[child])
        columns += [
            np.arctan2(-between[:, 0, 1], between[:, 1, 1]),
            np.arcsin(between[:, 2, 1]),
            np.arctan2(-between[:, 2, 0], between[:, 2, 2]),
        ]
    return np.array(columns).T


def list_both_ways(folder: Path) -> Iterator[tuple[list[str], list[str]]]:
    """Recordings to fit and held out, as given and exchanged."""
    text = (folder / "subject.yaml").read_text(encoding="utf-8")
    fit, held = (
        [name.strip().removesuffix(".trc") for name in found[1].split(",")]
        for role in ("calibration", "evaluation")
        if (found := re.search(rf"{role}: \[([^\]]*)\]", text)) is not None
    )
    yield fit, held
    yield held, fit


def _read_table(path: Path) -> tuple[list[str], Array]:
    with path.open(encoding="utf-8") as file:
        names, *rows = list(csv.reader(file))
    return names, np.array([[float(v) if v.strip() else np.nan for v in row] for row in rows])
