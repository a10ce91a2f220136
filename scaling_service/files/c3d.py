"""C3D: a recording's markers, force plates and measured sizes from what its file holds."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal

import numpy as np

from scaling_service.core import errors
from scaling_service.core.arrays import Array
from scaling_service.documents.subject import RANGES_M
from scaling_service.files import c3d_file, c3d_parameters, recording, tables
from scaling_service.model import forces, trial

_EVENTS: Mapping[str, Literal["strike", "off"]] = {
    "foot strike": "strike",
    "heel strike": "strike",
    "foot off": "off",
    "toe off": "off",
}
"""What systems call events of gait (Vicon, Motion Analysis)."""

_SIDES: Mapping[str, Literal["r", "l"]] = {"right": "r", "left": "l"}

CHANNELS = {1: 6, 2: 6, 3: 8, 4: 6}
"""Number of channels of the plate types that are supported (C3D user guide, "Force plate types")."""

SMALLEST_M2, LARGEST_M2 = 1e-3, 50.0
"""Area of a plate. Chosen: a button to a room; corners that coincide or are in another unit lie beyond."""

NO_PLATES = ("FORCE_PLATFORM:USED", "ANALOG")
"""Fields of the errors which mean that a file holds no forces at all."""

_FORCE = {"n": 1.0, "kn": 1e3}
_MOMENT = {"nmm": 1e-3, "ncm": 1e-2, "nm": 1.0}
_UNITS = {"F": ("force", _FORCE), "M": ("moment", _MOMENT), "L": ("length", tables.METRES)}
_KINDS = {1: "FFFLLM", 2: "FFFMMM", 3: "FFFFFFFF", 4: "FFFMMM"}
"""What each channel is: force, moment or length."""

GROUPS = ("PROCESSING", "SUBJECTS", "SUBJECT", "ANTHROPOMETRY")
"""Groups that may hold sizes (Vicon's, and others that use its names); the first that states one counts."""

POSE_SUFFIX = "_4x4"  # lower case: what a segment's label ends in where it names a pose

_SQUARE = 0.02  # chosen: most that the products of a rotation's columns may be off; files hold seven digits
_THIGH_M = (0.1, 0.8)  # chosen: infants to the tallest

_HEIGHT_M, _MASS_KG = (0.4, 2.5), (2.0, 400.0)  # chosen: infants to the tallest and heaviest

_SIDED = {
    "leglength": "leg_length",
    "kneewidth": "knee_width",
    "anklewidth": "ankle_width",
    "asistrocanterdistance": "asis_trochanter",  # Vicon's own spelling
    "asistrochanterdistance": "asis_trochanter",
    "elbowwidth": "elbow_width",
    "wristwidth": "wrist_width",
    "handthickness": "hand_thickness",
    "shoulderoffset": "shoulder_offset",
}
_NAMES = {
    "interasisdistance": "asis_width",
    "asisdistance": "asis_width",
    "markerdiameter": "marker_diameter",
    **{f"{side}{name}": f"{size}_{side}" for side in "rl" for name, size in _SIDED.items()},
}
_HEIGHTS, _MASSES = ("height", "bodyheight"), ("bodymass", "mass", "weight", "bodyweight")


@errors.name_file
def read_c3d(path: str | os.PathLike[str]) -> recording.Recording:
    """Read the markers, segment poses, force plates and measured sizes of a C3D file.

    Positions are m in the laboratory's axes, NaN where not seen (residual below zero or exact zeros); time
    starts at 0 with the first frame of the file. ``repairs`` names the points that were left out (computed
    ones and those without a label), and what header, parameters and length disagree on. Raises
    FileUnreadable if it is absent, empty, damaged or not C3D; TrialUnusable if it has neither a marker nor
    a segment's pose, no frame or no frame rate.
    """
    file = Path(path)
    content = c3d_file.read_c3d_file(file)
    # Indices of the points that are markers and of those that nobody labelled, and notes on all others
    results = [label for label in content.labels if label in content.computed]
    others = [k for k, label in enumerate(content.labels) if label not in content.computed]
    kept = [k for k in others if content.labels[k] and not trial.is_unlabelled(content.labels[k])]
    if not kept and content.poses is None:
        raise errors.TrialUnusable(
            "the file holds no labelled marker", field="POINT", remedy="Export markers"
        )
    if not len(content.points):
        raise c3d_parameters.report_no_frame()
    if not 0 < content.rate_hz < 1e6:
        raise errors.TrialUnusable(
            "the frame rate is not stated", field="POINT:RATE", remedy="State it in Hz"
        )
    repairs = []
    if results:
        shown = ", ".join(results[:8]) + (", …" if len(results) > 8 else "")
        detail = f"{len(results)} points that are results were left out: {shown}"
        repairs.append(trial.Repair("computed_points", "POINT", detail))
    if nameless := len(others) - len(kept):
        repairs.append(
            trial.Repair("unlabelled", "POINT", f"{nameless} points without a label were left out")
        )
    unlabelled = [k for k in others if content.labels[k] and k not in kept]
    labels = tuple(content.labels[k] for k in kept)
    scale, of_unit = _find_unit(content)
    markers, lost = tables.clean_positions(content.points[:, kept] * scale, labels)
    descriptions = [content.descriptions[k] for k in kept] if content.descriptions else ()
    labels, twice = tables.separate_duplicates(labels, markers, descriptions)
    times = np.arange(len(markers)) / content.rate_hz
    rotations, of_poses = _read_rotations(content, scale)
    nobodys = tuple(content.labels[k] for k in unlabelled)
    theirs, _ = tables.clean_positions(content.points[:, unlabelled] * scale, nobodys)
    try:
        plates: forces.PlateRecording | errors.TrialUnusable | None = read_c3d_plates(content)
    except errors.TrialUnusable as error:
        plates = None if error.field in NO_PLATES else error
    except (ValueError, TypeError, IndexError, OverflowError) as error:
        plates = errors.TrialUnusable(
            f"its force plates cannot be understood ({error})",
            file=content.name,
            field="FORCE_PLATFORM",
            remedy="Complete the parameters in the recording software and export again",
        )
    return recording.Recording(
        name=file.stem,
        times=times,
        labels=labels,
        markers=markers,
        rate_hz=content.rate_hz,
        repairs=(*content.repairs, *repairs, *of_unit, *lost, *twice, *of_poses),
        rotations=rotations,
        events=_read_events(content),
        sizes=read_stated_sizes(content.parameters),
        unit=content.point_unit or recording.NOT_STATED,
        plates=plates,
        unlabelled=trial.Trial(
            name=file.stem, times=times, labels=nobodys, markers=theirs, rate_hz=content.rate_hz
        ),
    )


def _read_events(content: c3d_file.C3dFile) -> tuple[trial.GaitEvent, ...]:
    """Heel strikes and toe-offs that somebody marked, by time; those beyond the file are left out.

    Their times count from the recording's first frame, of which the file may hold a later part (C3D user
    guide, "The EVENT group": minutes and seconds of each).
    """
    group = content.parameters.get("EVENT", {})
    names, sides, times = (group.get(name) or [] for name in ("LABELS", "CONTEXTS", "TIMES"))
    if len(times) != 2 or not isinstance(times[0], list):
        return ()
    begun, end = (content.first - 1) / content.rate_hz, len(content.points) / content.rate_hz
    found = []
    for name, context, minutes, seconds in zip(names, sides, *times, strict=False):
        kind = _EVENTS.get(str(name).strip().lower())
        side = _SIDES.get(str(context).strip().lower())
        at = 60.0 * minutes + seconds - begun
        if kind is not None and side is not None and 0.0 <= at < end:
            found.append(trial.GaitEvent(side, kind, at))
    return tuple(sorted(found, key=lambda event: event.time_s))


def _read_rotations(
    content: c3d_file.C3dFile, scale: float
) -> tuple[trial.Rotations | None, tuple[trial.Repair, ...]]:
    """Segments' rotations and origins, m, where the file has any, and what was left out.

    ``scale``: what a unit of length of the file's points is in m. Where thighs' and shanks' origins then lie
    no thigh's length apart, and would in mm or m, that is the unit.
    """
    if content.poses is None:
        return None, ()
    matrices = content.poses[:, :, :16].reshape(*content.poses.shape[:2], 4, 4).swapaxes(2, 3)
    labels = content.pose_labels
    if len(labels) != matrices.shape[1] or len(set(labels)) < len(labels) or "" in labels:
        raise errors.TrialUnusable(
            f"{matrices.shape[1]} segment poses have {len(set(labels) - {''})} different labels",
            field="ROTATION:LABELS",
            remedy="Export it again",
        )
    turns, origins = matrices[:, :, :3, :3], matrices[:, :, :3, 3]
    with np.errstate(invalid="ignore"):
        square = np.abs(turns.swapaxes(2, 3) @ turns - np.eye(3)).max(axis=(2, 3)) < _SQUARE
        square &= np.nan_to_num(np.linalg.det(np.where(square[..., None, None], turns, np.nan))) > 0.0
    seen = square & np.isfinite(origins).all(axis=2)
    if not seen.any():
        raise errors.TrialUnusable(
            "no segment pose of the file holds a rotation", field="ROTATION", remedy="Export it again"
        )
    notes = list(
        trial.repair_each(~seen, labels, "lost_pose", "no rotation there, which counts as not measured")
    )
    row = {label.lower().removesuffix(POSE_SUFFIX): k for k, label in enumerate(labels)}
    thighs = [
        np.nanmedian(np.linalg.norm(origins[:, row[f"{s}_thigh"]] - origins[:, row[f"{s}_shank"]], axis=1))
        for s in "rl"
        if {f"{s}_thigh", f"{s}_shank"} <= row.keys()
    ]
    fitting = [
        unit
        for unit in dict.fromkeys((scale, tables.METRES["mm"], tables.METRES["m"]))
        if all(_THIGH_M[0] < unit * length < _THIGH_M[1] for length in thighs)
    ]
    if fitting and fitting[0] != scale:
        unit = "mm" if fitting[0] == tables.METRES["mm"] else "m"
        said = f"segment origins are in {unit}, by a thigh's length"
        notes.append(trial.Repair("unit", "ROTATION", said))
        scale = fitting[0]
    whole = np.where(seen[..., None, None], turns, np.nan)
    placed = np.where(seen[..., None], scale * origins, np.nan) if fitting else None
    return trial.Rotations(labels=labels, matrices=whole, of="segments", origins=placed), tuple(notes)


def _find_unit(content: c3d_file.C3dFile) -> tuple[float, tuple[trial.Repair, ...]]:
    """What one unit of length of the file is in m, and what had to be assumed."""
    unit = content.point_unit.lower()
    if unit in tables.METRES:
        return tables.METRES[unit], ()
    if unit:
        raise errors.FileUnreadable(
            f"unit '{content.point_unit[:20]}' is not known",
            field="POINT:UNITS",
            remedy="Give positions in mm or m",
        )
    said = "no unit is stated; mm was taken, as is usual in C3D files"
    return tables.METRES["mm"], (trial.Repair("unit", "POINT:UNITS", said),)


def read_c3d_plates(content: c3d_file.C3dFile) -> forces.PlateRecording:
    """The force plates of a C3D file, in SI units, as they stand: no wrench is computed here.

    Samples that are not numbers stay NaN. ``repairs`` names units that had to be assumed and baselines that
    were taken off. Raises TrialUnusable: no plate or no analog signal; a type other than 1 to 4; channels
    that are not in the file; a unit that is not known; corners that are no rectangle.
    """
    used = int(c3d_parameters.take_first_value(content.parameters.get("FORCE_PLATFORM", {}).get("USED")) or 0)
    if not used:
        raise errors.TrialUnusable(
            "the file has no force plate",
            file=content.name,
            field="FORCE_PLATFORM:USED",
            remedy="Give forces as MOT or STO",
        )
    if not content.analog.size:
        raise errors.TrialUnusable(
            "the file has no analog signal",
            file=content.name,
            field="ANALOG",
            remedy="Export it with its analog signals",
        )
    length, assumed = _find_unit(content)
    repairs = list(assumed)
    plates = tuple(_Plate(content, k, repairs).read(length) for k in range(used))
    times = np.arange(len(content.analog)) / content.analog_rate_hz
    return forces.PlateRecording(content.name, times, plates, tuple(repairs))


class _Plate:
    """One plate's part of a file; what is assumed or taken off is added to ``repairs``."""

    def __init__(self, content: c3d_file.C3dFile, k: int, repairs: list[trial.Repair]) -> None:
        self._content, self._k, self._repairs = content, k, repairs
        self._group = content.parameters["FORCE_PLATFORM"]
        self._name = forces.list_plate_names(k + 1)[k]
        kinds = np.ravel(self._group.get("TYPE", []))
        self._kind = int(kinds[k]) if k < len(kinds) else 0

    def read(self, length: float) -> forces.RawPlate:
        """The plate, with what a unit of length of the file is in m."""
        if self._kind not in CHANNELS:
            raise self._refuse(
                f"{self._name} is of type {self._kind}, which is not supported",
                "TYPE",
                f"Types {', '.join(map(str, CHANNELS))} are; export the forces as MOT or STO",
            )
        corners = self._matrix("CORNERS", (3, 4)).T * length
        area = np.linalg.norm(np.cross(corners[2] - corners[0], corners[3] - corners[1])) / 2.0
        if not SMALLEST_M2 <= area <= LARGEST_M2:
            problem = f"{self._name} has corners that span {area:.3g} m², which no plate does"
            raise self._refuse(problem, "CORNERS", "Measure the plate's corners")
        origin = self._matrix("ORIGIN", (3,)) * length
        count, have = CHANNELS[self._kind], self._content.analog.shape[1]
        channels = self._matrix("CHANNEL", (None,))[:count].astype(int) - 1
        if len(channels) < count or channels.min() < 0 or channels.max() >= have:
            raise self._refuse(
                f"{self._name} names channels that the file does not hold",
                "CHANNEL",
                "Export the recording again with all channels of the plates",
            )
        columns = channels.tolist()
        signals = self._without_baseline(self._content.analog[:, columns].astype(float))
        factors = self._factors(columns, length)
        if self._kind == 4:
            signals = signals @ self._matrix("CAL_MATRIX", (6, 6)).T
        return forces.RawPlate(self._kind, corners, origin, signals * factors)

    def _factors(self, columns: list[int], length: float) -> Array:
        """What makes each channel SI. Type 4 holds volts: its matrix gives N and N times the length unit."""
        usual = {"F": 1.0, "M": length, "L": length}
        if self._kind == 4:
            return np.array([usual[what] for what in _KINDS[self._kind]])
        units = [str(u) for u in np.ravel(self._content.parameters.get("ANALOG", {}).get("UNITS", []))]
        factors, assumed = [], set()
        for what, column in zip(_KINDS[self._kind], columns, strict=True):
            unit = units[column].strip() if column < len(units) else ""
            plain = unit.lower().replace(".", "").replace("*", "").replace(" ", "").replace("·", "")
            quantity, known = _UNITS[what]
            if plain not in known and plain not in ("", "v", "volts"):
                raise errors.TrialUnusable(
                    f"channel {column + 1} is in '{unit[:20]}', which is no unit of {quantity}",
                    file=self._content.name,
                    field="ANALOG:UNITS",
                    remedy="State N, Nmm, Nm, mm or m",
                )
            if plain not in known:
                assumed.add(unit or "no unit")
            factors.append(known.get(plain, usual[what]))
        if assumed:
            stated = ", ".join(sorted(assumed))
            detail = f"the file states {stated}; N and N times the unit of points were taken"
            self._repairs.append(trial.Repair("unit", self._name, detail))
        return np.array(factors)

    def _without_baseline(self, signals: Array) -> Array:
        """Take off the mean of the frames that ZERO names, where nobody stands on the plate in them."""
        zero, frames = np.ravel(self._group.get("ZERO", [0, 0])), len(self._content.points)
        first, last = (int(zero[0]), int(zero[1])) if len(zero) > 1 else (0, 0)
        if not 1 <= first < last <= frames:
            return signals
        per_frame = len(signals) // frames
        rows = slice((first - 1) * per_frame, last * per_frame)
        vertical = signals[:, 4:].sum(axis=1) if self._kind == 3 else signals[:, 2]
        spread = np.nanmax(np.abs(vertical)) if np.isfinite(vertical).any() else 0.0
        rest = np.nanmax(np.abs(vertical[rows]), initial=0.0)
        if rest > (forces.CONTACT_N if self._kind != 4 else 0.05 * spread):
            detail = (
                f"frames {first} to {last} are named as baseline but the plate is loaded in them; not used"
            )
            self._repairs.append(trial.Repair("baseline_refused", self._name, detail))
            return signals
        detail = f"the mean of frames {first} to {last} was taken off"
        self._repairs.append(trial.Repair("baseline", self._name, detail))
        mean = np.nanmean(signals[rows], axis=0)
        if self._kind == 1:
            mean[3:5] = 0.0  # a position has no offset
        result: Array = signals - mean
        return result

    def _matrix(self, name: str, shape: tuple[int | None, ...]) -> Array:
        """Its part of a parameter whose last index is the plate."""
        values = np.asarray(self._group.get(name, []), dtype=float)
        k, fits = self._k, all(w in (None, h) for w, h in zip(shape, values.shape, strict=False))
        if fits and values.ndim == len(shape) + 1 and k < values.shape[-1]:
            part: Array = values[..., k]
            if np.isfinite(part).all():
                return part
        if fits and values.ndim == len(shape) and k == 0:
            return values  # one plate: some writers leave the last index out
        raise self._refuse(
            f"{name} does not describe {self._name}",
            name,
            "Complete the parameter in the recording software and export again",
        )

    def _refuse(self, problem: str, parameter: str, remedy: str) -> errors.TrialUnusable:
        field = f"FORCE_PLATFORM:{parameter}"
        return errors.TrialUnusable(problem, file=self._content.name, field=field, remedy=remedy)


def read_stated_sizes(parameters: Mapping[str, Mapping[str, Any]]) -> trial.MeasuredSizes:
    """The sizes that a file's parameters state, from group to name to value.

    A length's unit is the one of mm, cm and m in which a person can have it; zeros, which stand for what
    was not entered, and values that no person has are left out.

    Examples
    --------
    >>> read_stated_sizes({"PROCESSING": {"Height": [1480.0], "RKneeWidth": [104.0], "LKneeWidth": [0.0]}})
    MeasuredSizes(height_m=1.48, mass_kg=None, lengths_m={'knee_width_r': 0.104})
    """
    stated: dict[str, float] = {}
    for group in reversed(GROUPS):
        for name, value in parameters.get(group, {}).items():
            number = c3d_parameters.take_first_value(value)
            if isinstance(number, int | float) and not isinstance(number, bool):
                stated[name.replace("_", "").replace(" ", "").casefold()] = float(number)
    heights = [_read_length(stated[name], _HEIGHT_M) for name in _HEIGHTS if name in stated]
    masses = [stated[n] for n in _MASSES if n in stated and _MASS_KG[0] <= stated[n] <= _MASS_KG[1]]
    lengths = {
        size: length
        for name, size in _NAMES.items()
        if name in stated and (length := _read_length(stated[name], RANGES_M[size])) is not None
    }
    return trial.MeasuredSizes(
        next((h for h in heights if h is not None), None), next(iter(masses), None), lengths
    )


def _read_length(value: float, limits: tuple[float, float]) -> float | None:
    units = set(tables.METRES.values())
    fitting = [round(value * unit, 6) for unit in units if limits[0] <= value * unit <= limits[1]]
    return fitting[0] if len(fitting) == 1 else None
