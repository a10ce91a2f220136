"""TRC: marker trajectories as text. Read leniently, with every repair noted; written strictly."""

from __future__ import annotations

import os
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from scaling_service.core import errors
from scaling_service.core.arrays import Array
from scaling_service.files import recording, tables
from scaling_service.model.trial import Repair, Trial

TIME_ROUNDING_S = 0.5e-3
"""Times are often written with three decimals; half of the last is the largest error of rounding."""

MOST_INSERTED = 1.0
"""Absent rows are restored up to this share of the rows present (chosen: beyond, it is no one clock)."""

SLOWEST_STEP_S = 1.0  # chosen: nobody records a movement with less than a frame a second

_KIND = "a TRC file"
_AXIS = re.compile(r"^[XYZ]\d*$", re.IGNORECASE)


@errors.name_file
def read_trc(path: str | os.PathLike[str]) -> recording.Recording:
    """Read a TRC file.

    Returns positions in m in the file's own axes, NaN where not seen; ``repairs`` lists what did not follow
    the format. Labels are as in the file, prefixes included; of two of one name the second gets a number.
    Raises FileUnreadable if it is absent, empty, something else, truncated or has a cell that is no number.
    Raises TrialUnusable if it has no frame, no marker, or times that do not increase.
    """
    file = Path(path)
    text, repairs = tables.read_text(file, _KIND)
    lines = tables.number_lines(text)
    header = _read_header(lines)
    columns = ["Frame#", "Time", *(f"{label} {axis}" for label in header.columns for axis in "XYZ")]
    body, cut = tables.trim_cut_line(
        text, [line for line in lines[header.first_row :] if line[1].strip()], len(columns)
    )
    data, row_repairs = tables.parse_rows(body, columns)
    if not len(data):
        raise errors.TrialUnusable("the file has a header but no frame", remedy="Record or export it again")
    if cut and _read_positive(header.stated_frames) > len(data):
        raise errors.FileUnreadable(
            f"the file is cut off: its header counts {header.stated_frames} frames, and it breaks off in "
            f"line {body[-1][0]} after {len(data)}",
            remedy="Copy or export it again",
        )
    tables.check_times(data[:, 1], [number for number, _ in body])

    named = [k for k, label in enumerate(header.columns) if label]
    labels = tuple(header.columns[k] for k in named)
    positions = data[:, 2:].reshape(len(data), -1, 3)[:, named] * header.metres_per_unit
    times, positions, rate, clock = restore_clock(data[:, 1], positions, header.rate_hz)
    positions, lost = tables.clean_positions(positions, labels)
    labels, twice = tables.separate_duplicates(labels, positions)
    counts = [
        Repair("header", field, f"the header says {stated}, the file holds {found}")
        for field, stated, found in (
            ("NumFrames", header.stated_frames, len(data)),
            ("NumMarkers", header.stated_markers, len(header.columns)),
        )
        if _read_positive(stated) != found
    ]
    return recording.Recording(
        name=file.stem,
        times=times,
        labels=labels,
        markers=positions,
        rate_hz=rate,
        repairs=(*repairs, *header.repairs, *counts, *cut, *row_repairs, *clock, *lost, *twice),
        unit=header.unit or recording.NOT_STATED,
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class _Header:
    columns: tuple[str, ...]  # one per three columns of data; empty where it has no label
    first_row: int
    rate_hz: float
    metres_per_unit: float
    unit: str  # as it stands there; empty where it does not
    stated_frames: str
    stated_markers: str
    repairs: tuple[Repair, ...]


def _read_header(lines: list[tables.Line]) -> _Header:
    first = next(text for _, text in lines if text.strip())
    if not first.strip().lower().startswith("pathfiletype"):
        words = " ".join(text for _, text in lines[:40]).lower()
        if "endheader" in words:
            other = "an OpenSim table (MOT or STO), not a TRC file"
        elif "<opensimdocument" in words or words.lstrip().startswith("<?xml"):
            other = "an XML file, not a TRC file"
        else:
            other = "not a TRC file"
        raise errors.FileUnreadable(
            f"this is {other}", field="line 1", remedy="A TRC file begins with the word PathFileType"
        )
    keys_at = _find(lines, "datarate")
    values_at = next((k for k in range(keys_at + 1, len(lines)) if lines[k][1].strip()), None)
    labels_at = _find(lines, "frame")
    if values_at is None or values_at >= labels_at:
        raise _report_truncated("the line of values under DataRate")
    keys, values = lines[keys_at][1].split(), lines[values_at][1].split()
    stated = {key.lower(): value for key, value in zip(keys, values, strict=False)}
    unit, unit_repairs = _read_unit(stated, values)
    columns, label_repairs = _read_labels(lines[labels_at][1])
    first_row, layout = _skip_axes(lines, labels_at + 1)
    return _Header(
        columns=columns,
        first_row=first_row,
        rate_hz=_read_positive(stated.get("datarate", "")),
        metres_per_unit=tables.METRES[unit],
        unit=stated.get("units", "")[:20],
        stated_frames=stated.get("numframes", ""),
        stated_markers=stated.get("nummarkers", ""),
        repairs=(*unit_repairs, *label_repairs, *layout),
    )


def _find(lines: list[tables.Line], word: str) -> int:
    for k, (_, text) in enumerate(lines[:20]):
        if text.strip().lower().startswith(word):
            return k
    raise _report_truncated(
        {"datarate": "the line with DataRate", "frame": "the line with Frame# and Time"}[word]
    )


def _report_truncated(what: str) -> errors.FileUnreadable:
    return errors.FileUnreadable(f"the header is truncated: {what} is missing", remedy="Export it again")


def _read_unit(stated: dict[str, str], values: list[str]) -> tuple[str, tuple[Repair, ...]]:
    unit = stated.get("units", "").lower()
    if unit in tables.METRES:
        return unit, ()
    elsewhere = [value.lower() for value in values if value.lower() in tables.METRES]
    if elsewhere:
        return elsewhere[0], (Repair("header", "Units", f"unit {elsewhere[0]} found out of its column"),)
    if unit and not re.fullmatch(r"[-+.\d]+", unit):
        raise errors.FileUnreadable(
            f"unit '{unit[:20]}' is not known", field="Units", remedy="Give the positions in mm or m"
        )
    return "mm", (Repair("unit", "Units", "no unit is stated; mm was taken, as is usual in TRC files"),)


def _read_labels(line: str) -> tuple[tuple[str, ...], tuple[Repair, ...]]:
    cells = tables.split_cells(re.sub(r"^\s*frame\s*#", "Frame#", line, flags=re.IGNORECASE))
    if len(cells) < 2 or not cells[1].lower().startswith("time"):
        raise _report_truncated("the column Time")
    found = [(k, cell) for k, cell in enumerate(cells[2:]) if cell]
    if not found:
        raise errors.TrialUnusable(
            "the file names no marker", field="Frame#", remedy="Export labelled markers"
        )
    spread = "\t" in line and all(k % 3 == 0 for k, _ in found)
    slots = [k // 3 for k, _ in found] if spread else list(range(len(found)))
    columns = [""] * (slots[-1] + 1)
    for slot, (_, name) in zip(slots, found, strict=True):
        columns[slot] = name
    repairs = []
    if not spread and len(found) > 1:
        repairs.append(
            Repair("label_layout", "Frame#", "labels do not stand over every third column; taken in order")
        )
    if unnamed := columns.count(""):
        repairs.append(Repair("unlabelled", "Frame#", f"{unnamed} markers without a label were dropped"))
    return tuple(columns), tuple(repairs)


def _skip_axes(lines: list[tables.Line], start: int) -> tuple[int, tuple[Repair, ...]]:
    """Where the rows begin: after the line X1 Y1 Z1 ... and the blank line, if they are there."""
    if start >= len(lines):
        return start, ()
    repairs: list[Repair] = []
    k = start
    while k < len(lines) and not lines[k][1].strip():
        k += 1
    axes = lines[k][1].split() if k < len(lines) else []
    if axes and all(_AXIS.match(cell) for cell in axes):
        if axes[0].lower() not in ("x1", "x"):
            repairs.append(
                Repair("header", f"line {k + 1}", f"coordinates are numbered from {axes[0]}, not from X1")
            )
        k += 1
    else:
        repairs.append(Repair("header", f"line {start + 1}", "the line X1 Y1 Z1 … is missing"))
    if k < len(lines) and lines[k][1].strip():
        repairs.append(Repair("header", f"line {k + 1}", "the blank line after the header is missing"))
    return k, tuple(repairs)


def _read_positive(text: str) -> float:
    try:
        value = float(text.replace(",", "."))
    except ValueError:
        return float("nan")
    return value if 0 < value < 1e9 else float("nan")


def restore_clock(
    times: Array, positions: Array, stated_hz: float
) -> tuple[Array, Array, float, tuple[Repair, ...]]:
    """Undo the rounding of times and restore frames that were left out, where the clock is regular.

    Returns times, positions, rate and what was done. A clock that fits no rate is returned as it is.
    """
    if len(times) == 1:
        if not np.isfinite(stated_hz):
            raise errors.TrialUnusable(
                "one frame and no frame rate", field="DataRate", remedy="State the rate"
            )
        return times, positions, stated_hz, ()
    times, counted = _take_seconds(times, stated_hz)
    measured_hz = 1.0 / float(np.median(np.diff(times)))
    frame = _number_frames(times, stated_hz)
    rate, repairs = stated_hz, list(counted)
    if frame is None:
        # From the times alone: by their span, then (if frames are absent) by the median step
        for rate in ((len(times) - 1) / float(times[-1] - times[0]), measured_hz):
            frame = _number_frames(times, rate)
            if frame is not None:
                break
        note = (
            "no usable rate is stated"
            if not np.isfinite(stated_hz)
            else f"stated {stated_hz:g} Hz contradicts the times"
        )
        repairs.append(Repair("rate", "DataRate", f"{note}; {rate:g} Hz was taken from them"))
    if frame is None:
        repairs.append(
            Repair("clock", "Time", "frames are unevenly spaced in time; kept as they are", frames=len(times))
        )
        return times, positions, rate, tuple(repairs)
    start = float(np.median(times - frame / rate))
    shift = float(np.abs(start + frame / rate - times).max())
    if shift > 1e-6:  # s: below this it is the file's last decimal
        detail = (
            f"times are rounded; the regular clock of {rate:g} Hz was restored ({1e3 * shift:.2f} ms at most)"
        )
        repairs.append(Repair("clock", "Time", detail, frames=len(times)))
    whole = np.arange(frame[-1] + 1)
    if absent := len(whole) - len(frame):
        repairs.append(
            Repair(
                "absent_frames",
                "Time",
                "frames left out of the file were put back as not seen",
                frames=absent,
            )
        )
        full = np.full((len(whole), *positions.shape[1:]), np.nan)
        full[frame] = positions
        positions = full
    # Times that were never rounded keep their own digits.
    clock = start + whole / rate if shift > 1e-6 or absent else times
    return clock, positions, rate, tuple(repairs)


def _take_seconds(times: Array, stated_hz: float) -> tuple[Array, tuple[Repair, ...]]:
    """Times in s, where the stated rate shows that they count something else."""
    if not np.isfinite(stated_hz):
        if np.median(np.diff(times)) < SLOWEST_STEP_S:
            return times, ()
        detail = f"no rate is stated; steps of {np.median(np.diff(times)):g} were taken as milliseconds"
        return times / 1e3, (Repair("clock", "Time", detail, frames=len(times)),)
    if _number_frames(times, stated_hz) is None:
        for unit, second in (("milliseconds", 1e3), ("frames", stated_hz)):
            if _number_frames(times / second, stated_hz) is not None:
                detail = f"at {stated_hz:g} Hz these times count {unit}; they were turned into seconds"
                return times / second, (Repair("clock", "Time", detail, frames=len(times)),)
    return times, ()


def _number_frames(times: Array, rate_hz: float) -> NDArray[np.intp] | None:
    """Frame of each time on the regular clock of a rate, from 0; None if they do not fit it."""
    if not np.isfinite(rate_hz) or (times[-1] - times[0]) * rate_hz > (1 + MOST_INSERTED) * len(times):
        return None
    frame = np.rint((times - times[0]) * rate_hz)
    misfit = times - frame / rate_hz
    step = np.diff(frame)
    tolerance = min(TIME_ROUNDING_S, 0.25 / rate_hz) + 1e-9
    if np.ptp(misfit) > 2 * tolerance or step.min() < 1 or np.median(step) != 1:
        return None
    numbers: NDArray[np.intp] = frame.astype(np.intp)
    return numbers


def write_trc(path: str | os.PathLike[str], trial: Trial, units: Literal["mm", "m"] = "mm") -> None:
    """Write a TRC file that strict readers accept.

    ``trial``: positions with NaN where not seen; written as ``nan``. ``units`` 'mm' or 'm': positions are
    rounded to 10 nm, times to 1 ns. A position that rounds to zero on all three axes would be read as a
    lost marker; its x is written as 10 nm. Raises TrialUnusable if a label cannot stand in a tab-delimited
    file, or a position is infinite.
    """
    for label in trial.labels:
        if not label.strip() or label != label.strip() or re.search(r"[\t\r\n]", label):
            raise errors.TrialUnusable(
                f"marker label {label!r} cannot be written to a TRC file",
                file=path if isinstance(path, str | Path) else None,
                field=label,
                remedy="Rename it",
            )
    if np.isinf(trial.markers).any():
        raise errors.TrialUnusable("a position is infinite", file=trial.name, remedy="Mark it as missing")
    decimals = 5 if units == "mm" else 8
    values = np.round(trial.markers / tables.METRES[units], decimals) + 0.0
    values[(values == 0).all(-1), 0] = 10.0**-decimals
    n, m = trial.n_frames, len(trial.labels)
    rate = f"{trial.rate_hz:.6f}".rstrip("0").rstrip(".")
    rows = np.concatenate(
        (np.arange(1.0, n + 1.0)[:, None], trial.times[:, None], values.reshape(n, -1)), axis=1
    )
    form = "%d\t%.9f" + f"\t%.{decimals}f" * (3 * m)
    lines = [
        f"PathFileType\t4\t(X/Y/Z)\t{Path(path).name}",
        "DataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\tOrigDataRate\tOrigDataStartFrame\tOrigNumFrames",
        f"{rate}\t{rate}\t{n}\t{m}\t{units}\t{rate}\t1\t{n}",
        "Frame#\tTime\t" + "\t".join(f"{label}\t\t" for label in trial.labels),
        "\t\t" + "\t".join(f"X{k}\tY{k}\tZ{k}" for k in range(1, m + 1)),
        "",
        "",
    ]
    with Path(path).open("w", encoding="utf-8") as stream:
        stream.write("\n".join(lines))
        stream.writelines(tables.format_rows(form, rows))
