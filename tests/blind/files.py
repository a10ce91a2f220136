"""TRC, MOT and C3D files of a recording."""

from __future__ import annotations

from pathlib import Path

import ezc3d
import numpy as np

from tests.blind.body import Array
from tests.blind.forces import RATE_HZ, Plates
from tests.blind.motions.motion import RATE_HZ as CAMERA_HZ
from tests.blind.recording import Recording


def write_trc(path: Path, recording: Recording) -> None:
    """Markers in mm, to the micrometre; ``nan`` where not seen."""
    n, m = recording.markers.shape[:2]
    values = 1e3 * recording.markers.reshape(n, -1)
    form = "%d\t%.5f" + "\t%.3f" * (3 * m)
    rate = f"{CAMERA_HZ:g}"
    lines = [
        f"PathFileType\t4\t(X/Y/Z)\t{path.name}",
        "DataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\tOrigDataRate\tOrigDataStartFrame\tOrigNumFrames",
        f"{rate}\t{rate}\t{n}\t{m}\tmm\t{rate}\t1\t{n}",
        "Frame#\tTime\t" + "\t".join(f"{label}\t\t" for label in recording.labels),
        "\t\t" + "\t".join(f"X{k}\tY{k}\tZ{k}" for k in range(1, m + 1)),
        "",
        *(form % (k + 1, recording.times[k], *row) for k, row in enumerate(values.tolist())),
    ]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def write_mot(path: Path, plates: Plates) -> None:
    """Forces as laboratories export them: centre of pressure and free moment, zeros below the threshold."""
    force = np.where(plates.loaded[..., None], plates.force, 0.0)
    point = np.nan_to_num(plates.pressed())
    moment = np.zeros_like(force)
    moment[..., 1] = np.where(plates.loaded, plates.free_moment(), 0.0)
    names = ["time"]
    for k in (1, 2):
        names += [f"ground_force_{k}_v{a}" for a in "xyz"] + [f"ground_force_{k}_p{a}" for a in "xyz"]
        names += [f"ground_torque_{k}_{a}" for a in "xyz"]
    table = np.concatenate([force, point, moment], axis=2).reshape(len(plates.times), -1)
    form = "%.5f" + ("\t%.4f" * 3 + "\t%.6f" * 3 + "\t%.5f" * 3) * 2
    rows = np.column_stack([plates.times, table]).tolist()
    lines = [
        path.stem, "version=1", f"nRows={len(rows)}", f"nColumns={len(names)}", "inDegrees=yes", "endheader",
        "\t".join(names), *(form % tuple(row) for row in rows),
    ]  # fmt: skip
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


PLATE_CENTRES = np.array([[0.0, 0.0, 0.25], [0.0, 0.0, -0.25]])
"""Of the two plates of the C3D files, m (chosen: one under each foot)."""

_HALF = (0.6, 0.25)  # m along x and z (chosen: a treadmill's belt)
_AXES = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
"""Rows: a plate's x, y and z axes in the laboratory; z points down."""


def write_c3d(path: Path, recording: Recording) -> None:
    """Markers and two force plates of type 2 with moments about the middle of their surfaces."""
    plates = recording.plates
    if plates is None:
        raise ValueError("a C3D file is written for recordings with forces")
    n = len(recording.times)
    per_frame = round(RATE_HZ / CAMERA_HZ)
    file = ezc3d.c3d()
    parameters = file["parameters"]
    parameters["POINT"]["RATE"]["value"] = [CAMERA_HZ]
    parameters["POINT"]["LABELS"]["value"] = list(recording.labels)
    parameters["POINT"]["UNITS"]["value"] = ["mm"]
    parameters["ANALOG"]["RATE"]["value"] = [RATE_HZ]
    channels = [f"{name}{k}" for k in (1, 2) for name in ("Fx", "Fy", "Fz", "Mx", "My", "Mz")]
    parameters["ANALOG"]["LABELS"]["value"] = channels
    parameters["ANALOG"]["UNITS"]["value"] = (["N"] * 3 + ["Nmm"] * 3) * 2
    file.add_parameter("FORCE_PLATFORM", "USED", [2])
    file.add_parameter("FORCE_PLATFORM", "TYPE", [2, 2])
    file.add_parameter("FORCE_PLATFORM", "ZERO", [0, 0])
    file.add_parameter(
        "FORCE_PLATFORM", "CORNERS", 1e3 * np.stack([_corners(c).T for c in PLATE_CENTRES], axis=2)
    )
    file.add_parameter("FORCE_PLATFORM", "ORIGIN", np.zeros((3, 2)))
    file.add_parameter("FORCE_PLATFORM", "CHANNEL", np.arange(1.0, 13.0).reshape(2, 6).T)
    points = np.full((4, len(recording.labels), n), np.nan)
    points[:3] = 1e3 * recording.markers.transpose(2, 1, 0)
    points[3] = 1.0
    file["data"]["points"] = points
    signals = np.concatenate([_signals(plates, k) for k in (0, 1)], axis=1)
    held = np.concatenate([signals, np.repeat(signals[-1:], per_frame, axis=0)])[: n * per_frame]
    file["data"]["analogs"] = held.T[None]
    file.write(str(path))


def _corners(centre: Array) -> Array:
    """Quadrants (+x +y), (-x +y), (-x -y), (+x -y) of a plate's axes."""
    x, z = _HALF
    return centre + np.array([[x, 0, z], [-x, 0, z], [-x, 0, -z], [x, 0, -z]])


def _signals(plates: Plates, plate: int) -> Array:
    """Six channels in the plate's axes: force on the person, N, and moment about the centre, N mm."""
    force = plates.force[:, plate]
    moment = plates.moment[:, plate] - np.cross(PLATE_CENTRES[plate], force)
    return np.hstack([force @ _AXES.T, 1e3 * moment @ _AXES.T])
