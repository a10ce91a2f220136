"""C3D: what a binary recording holds, read by ezc3d.

The library parses in a process of its own: a damaged file can make it crash, hang or ask for all memory.
"""

from __future__ import annotations

import json
import os
import struct
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import numpy as np

from scaling_service.core.errors import DependencyMissing, FileUnreadable, TrialUnusable
from scaling_service.files.tables import read_bytes
from scaling_service.model.trial import Array

METRES = {"mm": 1e-3, "cm": 1e-2, "m": 1.0}

TIME_LIMIT_S = 60.0
"""Chosen: ezc3d reads ten minutes of a full-body recording in a few seconds; beyond this it does not end."""

COMPUTED = ("ANGLES", "FORCES", "MOMENTS", "POWERS", "SCALARS", "REACTIONS", "MODELED_MARKERS")
"""Parameters of POINT in which Vicon Nexus lists the points that are results, not markers."""

_KIND = "a C3D file"
_DEC, _MIPS = 85, 86  # processor types; numbers of the second have their high byte first
_SIGN_AT = {_DEC: 13, _MIPS: 12}  # the header's byte that holds the sign of the scale; 15 with Intel's order
_BLOCK = 512
_WORD = 65535  # a recording that reaches this frame keeps its true length elsewhere
_ADVICE = "If you want to ignore"  # what the library tells programmers, not laboratories
_WORKER = Path(__file__).with_name("c3d_worker.py")


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class C3dFile:
    """What a C3D file holds, in its own units.

    ``parameters``: group to name to list of values; numeric arrays as nested lists, first index first.
    """

    name: str
    points: Array  # (n_frames, n_points, 3); in ``point_unit``; NaN where not seen
    labels: tuple[str, ...]  # empty where a point has none
    computed: frozenset[str]  # labels of points that are results (angles, moments, virtual points)
    point_unit: str
    rate_hz: float
    analog: Array  # (n_samples, n_channels); scaled to the units of ``ANALOG:UNITS``
    parameters: Mapping[str, Mapping[str, Any]]
    has_rotations: bool = False  # whether it holds segment poses (markerless systems)
    stated_frames: int | None = None  # number of frames by the file's header; None where it cannot tell

    @property
    def analog_rate_hz(self) -> float:
        """Samples per second of the analog signals; NaN where there are none."""
        frames = len(self.points)
        return self.rate_hz * len(self.analog) / frames if frames and len(self.analog) else float("nan")


def read_c3d_file(path: str | os.PathLike[str]) -> C3dFile:
    """Read everything that a C3D file holds, without judging it.

    Raises FileUnreadable if it is absent, empty, damaged or not C3D. Raises DependencyMissing if ezc3d is
    not installed.
    """
    file = Path(path)
    content = read_bytes(file, _KIND)
    # The second byte of every C3D file is 80 (C3D user guide, "Header section"); a header has 512 bytes.
    if len(content) < _BLOCK or content[1] != 0x50:
        raise FileUnreadable(
            "this is not a C3D file, or it is cut off", file=file, remedy="Export it again as C3D"
        )
    _refuse_cut(content, file)
    with tempfile.TemporaryDirectory(prefix="c3d-") as scratch:
        target = Path(scratch) / "content.npz"
        _parse_apart(file, target)
        try:
            with np.load(target, allow_pickle=False) as stored:
                facts = json.loads(str(stored["facts"]))
                points, residuals, analog = stored["points"], stored["residuals"], stored["analog"]
        except (OSError, KeyError, ValueError, BadZipFile) as error:
            raise _report_damage(file, str(error)) from None
    return _assemble(file, points, residuals, analog, facts, _read_header(content)[0])


def _read_header(content: bytes) -> tuple[int | None, int, int]:
    """Number of frames (None where the header cannot tell), bytes of one, and the block where they begin.

    Points and analog numbers of a frame are words 2 and 3, the first and the last frame words 4 and 5, the
    block is word 9, and a negative scale (words 7 and 8) says that numbers are real, of 4 bytes (C3D user
    guide, "Header section").
    """
    at = _BLOCK * (content[0] - 1) + 3  # the processor type, fourth byte of the parameters
    processor = content[at] if 0 <= at < len(content) else 0
    order = ">" if processor == _MIPS else "<"
    points, analog, first, last = struct.unpack_from(f"{order}HHHH", content, 2)
    (start,) = struct.unpack_from(f"{order}H", content, 16)
    is_real = bool(content[_SIGN_AT.get(processor, 15)] & 0x80)
    frames = last - first + 1 if first <= last < _WORD else None
    return frames, (4 * points + analog) * (4 if is_real else 2), start


def _refuse_cut(content: bytes, file: Path) -> None:
    """Raise if the file ends before the frames that its header counts, or counts and holds none."""
    frames, size, start = _read_header(content)
    if not start or not size:
        return
    whole = max(0, len(content) - _BLOCK * (start - 1)) // size
    if frames is None and not whole:
        raise report_no_frame(file)
    if frames is not None and whole < frames:
        raise FileUnreadable(
            f"the file is cut off: its header counts {frames} frames, and it ends after {whole}",
            file=file,
            remedy="Copy or export it again",
        )


def _parse_apart(file: Path, target: Path) -> None:
    """Let ezc3d parse in another process, which may crash or hang."""
    if find_spec("ezc3d") is None:
        raise DependencyMissing(
            "reading C3D files needs ezc3d", file=file, remedy="Install it: pip install ezc3d"
        )
    command = [sys.executable, "-P", str(_WORKER), str(file.resolve()), str(target)]
    try:
        done = subprocess.run(command, capture_output=True, timeout=TIME_LIMIT_S, check=False)
    except subprocess.TimeoutExpired:
        raise _report_damage(file, f"parsing did not end within {TIME_LIMIT_S:g} s") from None
    if done.returncode == 0:
        return
    lines = done.stderr.decode("utf-8", "replace").strip().splitlines()
    said = lines[-1].partition(_ADVICE)[0] if lines and done.returncode > 0 else ""
    raise _report_damage(file, said.strip()[:200] or "the parser crashed")


def _report_damage(file: Path, reason: str) -> FileUnreadable:
    return FileUnreadable(
        f"the C3D file is damaged ({reason.rstrip('.')})", file=file, remedy="Copy or export it again"
    )


def _assemble(
    file: Path,
    points: Array,
    residuals: Array,
    analog: Array,
    facts: Mapping[str, Any],
    stated_frames: int | None,
) -> C3dFile:
    parameters: dict[str, dict[str, Any]] = facts["parameters"]
    about = parameters.get("POINT", {})
    n = points.shape[1]
    names = [str(name).strip() for name in _join_numbered(about, "LABELS")][:n]
    labels = tuple(names + [""] * (n - len(names)))
    if residuals.shape == points.shape[:2]:
        points = np.where((residuals < 0)[..., None], np.nan, points)
    rate = take_first_value(about.get("RATE"))
    usable = isinstance(rate, (int, float)) and np.isfinite(rate) and rate > 0
    return C3dFile(
        name=file.stem,
        points=points,
        labels=labels,
        computed=frozenset(str(name).strip() for kind in COMPUTED for name in _join_numbered(about, kind))
        - {""},
        point_unit=str(take_first_value(about.get("UNITS")) or "").strip(),
        rate_hz=float(rate if usable else facts["header_rate"]),
        analog=analog,
        parameters=parameters,
        has_rotations="ROTATION" in parameters or facts["n_rotations"] > 0,
        stated_frames=stated_frames,
    )


def _join_numbered(group: Mapping[str, Any], name: str) -> list[Any]:
    """A list that continues under NAME2, NAME3 … because one parameter holds at most 255 items."""
    values: list[Any] = []
    for key in (name, *(f"{name}{k}" for k in range(2, 256))):
        if key not in group:
            break
        value = group[key]
        values += value if isinstance(value, list) else [value]
    return values


def take_first_value(value: Any) -> Any:
    """The first of a parameter's values, however they are nested; None where there is none."""
    while isinstance(value, list):
        value = value[0] if value else None
    return value


def report_no_frame(file: Path) -> TrialUnusable:
    """What is said of a file with labels and no frame."""
    return TrialUnusable(
        "the file holds no frame", file=file, field="POINT:FRAMES", remedy="Record or export it again"
    )
