"""Orientations of sensors as OpenSim's OpenSense stores them: one quaternion a cell (DataType=Quaternion).

The quaternion is w, x, y, z and turns the sensor's axes to those of the world of the sensors (OpenSim 4.5,
``OrientationsReference``, ``STOFileAdapter_<SimTK::Quaternion>``).
"""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from scaling_service.core import errors
from scaling_service.files import sto, tables
from scaling_service.files.recording import Recording
from scaling_service.model import trial

QUATERNION = "quaternion"
"""What DataType says of such a file, in lower case."""

_UNIT = 0.05  # chosen: most that a quaternion's length may be off one; sensors write four digits or more

_HEAD = 4096  # letters that are looked at; a header has ten lines


def is_orientation_file(path: str | os.PathLike[str]) -> bool:
    """Whether a STO file says in its header that it holds orientations; False where it cannot be read."""
    try:
        with Path(path).open(encoding="utf-8", errors="replace") as stream:
            head = stream.read(_HEAD)
    except OSError:
        return False
    kind = sto.look_up(sto.read_header(head.lower().partition("endheader")[0].splitlines()), "datatype")
    return kind == QUATERNION


@errors.name_file
def read_orientations(path: str | os.PathLike[str]) -> Recording:
    """Read the orientations of sensors over time, in the world of the sensors; no markers.

    Cells that are empty, not numbers or no unit quaternion are NaN, and noted. Raises FileUnreadable: it is
    absent, empty, or no table of quaternions. Raises TrialUnusable: it has no row, or times that do not
    increase.
    """
    file = Path(path)
    text, repairs = tables.read_text(file, "an OpenSim table")
    lines = tables.number_lines(text)
    end = next((k for k, (_, line) in enumerate(lines) if line.strip().lower() == "endheader"), None)
    header = sto.read_header([line for _, line in lines[:end]]) if end is not None else {}
    kind = sto.look_up(header, "datatype")
    if end is None or (kind or "").lower() != QUATERNION:
        raise errors.FileUnreadable(
            f"it holds {'no orientations' if kind is None else kind[:20]}, and recordings in STO files are "
            "orientations of sensors",
            field="DataType",
            remedy="Give a table with DataType=Quaternion, as OpenSense writes; forces go under `forces:`",
        )
    rows = [line for line in lines[end + 1 :] if line[1].strip()]
    columns = sto.read_columns(rows)
    if len(rows) < 2:
        raise errors.TrialUnusable("the table has a header but no row", remedy="Export it again")
    numbers = np.full((len(rows) - 1, len(columns) - 1, 4), np.nan)
    times = np.empty(len(numbers))
    for k, (line, content) in enumerate(rows[1:]):
        cells = content.split()
        try:
            times[k] = float(cells[0])
        except ValueError:
            raise errors.FileUnreadable(
                f"'{cells[0][:20]}' is no time", field=f"line {line}", remedy="Export it again"
            ) from None
        for j, cell in enumerate(cells[1 : len(columns)]):
            try:
                parts = [float(part) for part in cell.split(",")]
            except ValueError:
                continue
            numbers[k, j] = parts if len(parts) == 4 else np.nan
    tables.check_times(times, [number for number, _ in rows[1:]])
    known = np.abs(np.linalg.norm(numbers, axis=2) - 1.0) < _UNIT
    if not known.any():
        raise errors.TrialUnusable(
            "no cell holds a unit quaternion w,x,y,z", field="DataType", remedy="Export it again"
        )
    whole = np.where(known[..., None], numbers, [1.0, 0.0, 0.0, 0.0])
    turns = Rotation.from_quat(whole.reshape(-1, 4), scalar_first=True).as_matrix()
    turns = np.where(known[..., None, None], turns.reshape(*known.shape, 3, 3), np.nan)
    labels = columns[1:]
    lost = trial.repair_each(
        ~known, labels, "lost_orientation", "no unit quaternion there, which counts as not measured"
    )
    try:
        rate = float(sto.look_up(header, "datarate") or "")
    except ValueError:
        rate = float("nan")
    if not 0.0 < rate < np.inf:
        rate = (len(times) - 1) / (times[-1] - times[0]) if len(times) > 1 else 1.0
    return Recording(
        name=file.stem,
        times=times,
        labels=(),
        markers=np.empty((len(times), 0, 3)),
        rate_hz=rate,
        repairs=(*repairs, *lost),
        rotations=trial.Rotations(labels=labels, matrices=turns, of="sensors"),
    )
