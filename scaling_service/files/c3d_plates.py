"""Force plates of a C3D file, in SI units, as they stand: no wrench is computed here."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from scaling_service.core.errors import TrialUnusable
from scaling_service.files.c3d import METRES, C3dFile, read_c3d_file
from scaling_service.model.forces import CONTACT_N, PlateRecording, RawPlate, plate_names
from scaling_service.model.trial import Array, Repair

CHANNELS = {1: 6, 2: 6, 3: 8, 4: 6}
"""Number of channels of the plate types that are supported (C3D user guide, "Force plate types")."""

_FORCE = {"n": 1.0, "kn": 1e3}
_MOMENT = {"nmm": 1e-3, "ncm": 1e-2, "nm": 1.0}
_KINDS = {1: "FFFLLM", 2: "FFFMMM", 3: "FFFFFFFF", 4: "FFFMMM"}
"""What each channel is: force, moment or length."""


def read_c3d_plates(source: str | os.PathLike[str] | C3dFile) -> PlateRecording:
    """Read the force plates of a C3D file.

    Returns samples that are not numbers stay NaN. ``repairs`` names units that had to be assumed and
    baselines that were taken off. Raises TrialUnusable: no plate or no analog signal; a type other than 1
    to 4; channels that are not in the file; a unit that is not known; corners that are no rectangle. Raises
    FileUnreadable: as ``read_c3d_file``.
    """
    content = source if isinstance(source, C3dFile) else read_c3d_file(source)
    file = content.name if isinstance(source, C3dFile) else Path(source).name
    group = content.parameters.get("FORCE_PLATFORM", {})
    used = int(_first(group.get("USED")) or 0)
    if not used:
        raise _refused(
            "the file has no force plate", file, "FORCE_PLATFORM:USED", "Give forces as MOT or STO"
        )
    if not content.analog.size:
        raise _refused("the file has no analog signal", file, "ANALOG", "Export it with its analog signals")
    repairs: list[Repair] = []
    plates = tuple(_plate(content, group, k, file, repairs) for k in range(used))
    times = np.arange(len(content.analog)) / content.analog_rate_hz
    return PlateRecording(content.name, times, plates, tuple(repairs))


def _plate(content: C3dFile, group: Mapping[str, Any], k: int, file: str, repairs: list[Repair]) -> RawPlate:
    name = plate_names(k + 1)[k]
    kind = int(np.ravel(group.get("TYPE", []))[k]) if k < len(np.ravel(group.get("TYPE", []))) else 0
    if kind not in CHANNELS:
        raise _refused(
            f"{name} is of type {kind}, which is not supported",
            file,
            "FORCE_PLATFORM:TYPE",
            f"Types {', '.join(map(str, CHANNELS))} are; export the forces as MOT or STO",
        )
    length = _length(content, file, repairs)
    corners = _matrix(group, "CORNERS", (3, 4), k, file).T * length
    if min(np.linalg.norm(corners[0] - corners[i]) for i in (1, 3)) < 1e-3:
        raise _refused(
            f"{name} has corners that coincide", file, "FORCE_PLATFORM:CORNERS", "Measure the plate's corners"
        )
    origin = _matrix(group, "ORIGIN", (3,), k, file) * length
    signals = _signals(content, group, k, kind, file)
    signals = _without_baseline(signals, content, group, k, kind, repairs)
    factors = _factors(content, group, k, kind, length, file, repairs)
    if kind == 4:
        signals = signals @ _matrix(group, "CAL_MATRIX", (6, 6), k, file).T
    return RawPlate(kind, corners, origin, signals * factors)


def _signals(content: C3dFile, group: Mapping[str, Any], k: int, kind: int, file: str) -> Array:
    return content.analog[:, _columns(content, group, k, kind, file)].astype(float)


def _columns(content: C3dFile, group: Mapping[str, Any], k: int, kind: int, file: str) -> list[int]:
    channels = _matrix(group, "CHANNEL", (None,), k, file)[: CHANNELS[kind]].astype(int) - 1
    if len(channels) < CHANNELS[kind] or channels.min() < 0 or channels.max() >= content.analog.shape[1]:
        raise _refused(
            f"{plate_names(k + 1)[k]} names channels that the file does not hold",
            file,
            "FORCE_PLATFORM:CHANNEL",
            "Export the recording again with all channels of the plates",
        )
    columns: list[int] = channels.tolist()
    return columns


def _factors(
    content: C3dFile,
    group: Mapping[str, Any],
    k: int,
    kind: int,
    length: float,
    file: str,
    repairs: list[Repair],
) -> Array:
    """What makes each channel SI. Type 4 holds volts; its matrix gives N and N times the unit of points."""
    usual = {"F": 1.0, "M": length, "L": length}
    if kind == 4:
        return np.array([usual[what] for what in _KINDS[kind]])
    units = [str(u) for u in np.ravel(content.parameters.get("ANALOG", {}).get("UNITS", []))]
    factors, assumed = [], set()
    for what, column in zip(_KINDS[kind], _columns(content, group, k, kind, file), strict=True):
        unit = units[column].strip() if column < len(units) else ""
        plain = unit.lower().replace(".", "").replace("*", "").replace(" ", "").replace("·", "")
        known = {"F": _FORCE, "M": _MOMENT, "L": METRES}[what].get(plain)
        if known is None:
            if plain not in ("", "v", "volts"):
                raise _refused(
                    f"channel {column + 1} is in '{unit[:20]}', which is no unit of "
                    f"{ {'F': 'force', 'M': 'moment', 'L': 'length'}[what] }",
                    file,
                    "ANALOG:UNITS",
                    "State N, Nmm, Nm, mm or m",
                )
            assumed.add(unit or "no unit")
        factors.append(usual[what] if known is None else known)
    if assumed:
        detail = f"the file states {', '.join(sorted(assumed))}; N and N times the unit of points were taken"
        repairs.append(Repair("unit", plate_names(k + 1)[k], detail))
    return np.array(factors)


def _without_baseline(
    signals: Array, content: C3dFile, group: Mapping[str, Any], k: int, kind: int, repairs: list[Repair]
) -> Array:
    """Take off the mean of the frames that ZERO names, where nobody stands on the plate in them."""
    zero = np.ravel(group.get("ZERO", [0, 0]))
    first, last = (int(zero[0]), int(zero[1])) if len(zero) > 1 else (0, 0)
    if not 1 <= first < last <= len(content.points):
        return signals
    per_frame = len(signals) // len(content.points)
    part = signals[(first - 1) * per_frame : last * per_frame]
    vertical = signals[:, 4:].sum(axis=1) if kind == 3 else signals[:, 2]
    spread = np.nanmax(np.abs(vertical)) if np.isfinite(vertical).any() else 0.0
    rest = np.nanmax(np.abs(part[:, 4:].sum(axis=1) if kind == 3 else part[:, 2]), initial=0.0)
    name = plate_names(k + 1)[k]
    if rest > (CONTACT_N if kind != 4 else 0.05 * spread):
        detail = f"frames {first} to {last} are named as baseline but the plate is loaded in them; not used"
        repairs.append(Repair("baseline_refused", name, detail))
        return signals
    repairs.append(Repair("baseline", name, f"the mean of frames {first} to {last} was taken off"))
    mean = np.nanmean(part, axis=0)
    if kind == 1:
        mean[3:5] = 0.0  # a position has no offset
    result: Array = signals - mean
    return result


def _length(content: C3dFile, file: str, repairs: list[Repair]) -> float:
    unit = content.point_unit.lower()
    if unit in METRES:
        return METRES[unit]
    if unit:
        raise _refused(f"unit '{unit[:20]}' is not known", file, "POINT:UNITS", "Give positions in mm or m")
    if not any(r.where == "POINT:UNITS" for r in repairs):
        repairs.append(
            Repair("unit", "POINT:UNITS", "no unit is stated; mm was taken, as is usual in C3D files")
        )
    return METRES["mm"]


def _matrix(group: Mapping[str, Any], name: str, shape: tuple[int | None, ...], k: int, file: str) -> Array:
    """One plate's part of a parameter whose last index is the plate."""
    values = np.asarray(group.get(name, []), dtype=float)
    fits = values.ndim == len(shape) + 1 and k < values.shape[-1]
    if fits and all(want is None or want == have for want, have in zip(shape, values.shape, strict=False)):
        part: Array = values[..., k]
        if np.isfinite(part).all():
            return part
    if (
        values.ndim == len(shape)
        and k == 0
        and all(want is None or want == have for want, have in zip(shape, values.shape, strict=True))
    ):
        return values  # one plate: some writers leave the last index out
    raise _refused(
        f"{name} does not describe {plate_names(k + 1)[k]}",
        file,
        f"FORCE_PLATFORM:{name}",
        "Complete the parameter in the recording software and export again",
    )


def _first(value: Any) -> Any:
    flat = [] if value is None else np.ravel(value).tolist()
    return flat[0] if flat else None


def _refused(problem: str, file: str, where: str, remedy: str) -> TrialUnusable:
    return TrialUnusable(problem, file=file, field=where, remedy=remedy)
