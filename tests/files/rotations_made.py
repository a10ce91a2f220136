"""Files of rotations as other programs write them: Theia3D's C3D (by ezc3d) and OpenSense's STO."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation


def write_poses(
    path: Path,
    labels: Sequence[str],
    turns: Any,
    origins: Any,
    *,
    rate_hz: float = 100.0,
    unit: str = "mm",
    points: tuple[Sequence[str], Any] = ((), None),
) -> None:
    """Segment poses: ``turns`` (n, s, 3, 3), ``origins`` (n, s, 3) in ``unit``; ``points`` (n, m, 3), too."""
    import ezc3d

    n, count = np.shape(turns)[:2]
    names, positions = points
    file = ezc3d.c3d()
    about = file["parameters"]["POINT"]
    about["RATE"]["value"], about["UNITS"]["value"], about["LABELS"]["value"] = (
        [rate_hz],
        [unit],
        tuple(names),
    )
    held = np.ones((4, len(names), n))
    if positions is not None:
        held[:3] = np.moveaxis(positions, 0, -1).swapaxes(0, 1)
    file["data"]["points"] = held
    file.add_parameter("ROTATION", "RATE", [rate_hz])
    file.add_parameter("ROTATION", "LABELS", tuple(labels))
    poses = np.zeros((n, count, 4, 4))
    poses[..., :3, :3], poses[..., :3, 3], poses[..., 3, 3] = turns, origins, 1.0
    file["data"]["rotations"] = poses.transpose(2, 3, 1, 0)
    file.write(str(path))


def write_orientations(path: Path, times: Any, labels: Sequence[str], turns: Any) -> None:
    """Quaternions w, x, y, z: ``turns`` (n, s, 3, 3)."""
    lines = ["DataRate=100.000000", "DataType=Quaternion", "version=3", "OpenSimVersion=4.5", "endheader"]
    lines.append("\t".join(["time", *labels]))
    for time, frame in zip(times, turns, strict=True):
        cells = Rotation.from_matrix(frame).as_quat(scalar_first=True)
        lines.append("\t".join([f"{time:.6f}", *(",".join(f"{v:.10f}" for v in cell) for cell in cells)]))
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
