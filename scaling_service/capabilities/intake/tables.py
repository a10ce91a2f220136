"""What a look at recordings shows: trajectories and forces as binary tables, gaps as intervals."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from scaling_service.capabilities.intake.document import LabelEntry, ProblemEntry, RecordingProof, RepairEntry
from scaling_service.capabilities.intake.plates import describe_plates
from scaling_service.capabilities.intake.recordings import Seen, axes_entry, problem_of
from scaling_service.core.errors import InputError
from scaling_service.documents.arrays import ArrayEntry, PlateEntry
from scaling_service.files.table_files import ArrayFiles, at_frames, plates_of
from scaling_service.model.anatomy.markers import looks_computed
from scaling_service.model.forces import GroundForces
from scaling_service.model.trial import Array, Trial
from scaling_service.numerics.least_squares.masks import seen as seen_in
from scaling_service.recording.orientation import Orientation, apply
from scaling_service.recording.plates import orient_forces

WALKED_M = 1.0
"""Chosen: who goes this far over the floor walks; squats and leg swings stay below."""

Vector = tuple[float, float, float]


@dataclass(frozen=True, slots=True, eq=False)
class Ground:
    """Forces of one recording at its frames, and where they came from."""

    source: str
    forces: GroundForces


def recording_proof(
    item: Seen,
    axes: Orientation,
    ground: Ground | None,
    given: tuple[str | None, str | None],
    files: ArrayFiles,
) -> tuple[RecordingProof, Trial]:
    """One recording as it travels, its tables written, and the recording in the session's axes.

    Parameters
    ----------
    item : Seen
    axes : Orientation
        The session's.
    ground : Ground, optional
        Forces in the laboratory's axes.
    given : (up, forward)
        Axes as given.
    files : ArrayFiles

    Raises
    ------
    InputError
        The unit of its positions cannot be told.
    """
    trial = apply(axes, item.trial)
    turned, problems = _turned(ground, axes, item)
    walked, direction = _walk(trial)
    entry = RecordingProof(
        name=trial.name,
        file=item.file,
        format=item.file.rpartition(".")[2].upper(),
        unit=item.unit,
        rate_hz=trial.rate_hz,
        frames=trial.n_frames,
        start_s=float(trial.times[0]),
        axes=axes_entry(item.axes, *given),
        walked_m=round(walked, 3),
        direction=direction,
        labels=[_label(trial, k) for k in range(len(trial.labels))],
        markers=files.write(f"{item.file}.markers", trial.markers, "m"),
        plates=_described(turned, item, axes, trial),
        forces_from=None if ground is None or turned is None else ground.source,
        force=None if turned is None else _written(files, f"{item.file}.force", turned, trial, "N"),
        centre_of_pressure=None
        if turned is None
        else _written(files, f"{item.file}.pressure", turned, trial, "m"),
        repairs=[
            RepairEntry(what=r.what, where=r.where, detail=r.detail, frames=r.frames)
            for r in (*trial.repairs, *(() if turned is None else turned.repairs))
        ],
        problems=[*item.problems, *problems],
    )
    return entry, trial


def _turned(
    ground: Ground | None, axes: Orientation, item: Seen
) -> tuple[GroundForces | None, list[ProblemEntry]]:
    """Forces in our axes. Those of MOT and STO files stand Y up whatever the markers do."""
    if ground is None:
        return None, []
    own = item.forces is ground.forces
    if not own and axes.up != "+y":
        problem = ProblemEntry(
            severity="warning",
            file=ground.source,
            field="forces",
            problem=f"forces of MOT and STO files are Y up, but the markers' laboratory has {axes.up} up",
            remedy="Export the markers in the same axes as the forces, or use the plates of a C3D file",
        )
        return None, [problem]
    try:
        return orient_forces(axes, ground.forces), []
    except InputError as error:
        return None, [problem_of(error, "warning", ground.source)]


def _described(forces: GroundForces | None, item: Seen, axes: Orientation, trial: Trial) -> list[PlateEntry]:
    """Plates with all that the recording says of them; corners and types are known of its own only."""
    if forces is None:
        return []
    own = item.forces is not None and len(item.kinds) == len(forces.plates)
    at_markers = forces.changed(
        times=trial.times,
        force=at_frames(forces.times, forces.force, trial.times),
        moment=at_frames(forces.times, forces.moment, trial.times),
        read=None,
    )
    entries = plates_of(forces, _corners(item, axes) if own else None)
    return describe_plates(entries, at_markers, trial, item.kinds if own else ())


def _corners(item: Seen, axes: Orientation) -> Array | None:
    return None if item.corners is None else axes.rotate(item.corners)


def _written(files: ArrayFiles, name: str, forces: GroundForces, trial: Trial, unit: str) -> ArrayEntry:
    values = forces.force if unit == "N" else forces.centre_of_pressure()
    return files.write(name, at_frames(forces.times, values, trial.times), unit)


def _label(trial: Trial, column: int) -> LabelEntry:
    shown = seen_in(trial.markers[:, column])
    gaps = intervals(~shown)
    longest = max((last - first + 1 for first, last in gaps), default=0)
    return LabelEntry(
        label=trial.labels[column],
        seen=round(float(shown.mean()), 4),
        gaps=gaps,
        longest_gap_s=round(longest / trial.rate_hz, 4),
        computed=looks_computed(trial.labels[column]),
    )


def intervals(flags: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """First and last row of each stretch that is true.

    Examples
    --------
    >>> intervals(np.array([True, False, True, True]))
    [(0, 0), (2, 3)]
    """
    edges = np.flatnonzero(np.diff(np.concatenate([[False], flags, [False]]).astype(np.int8)))
    return [(int(a), int(b) - 1) for a, b in edges.reshape(-1, 2)]


def walked(trial: Trial, axes: Orientation) -> float:
    """How far the markers' middle went over the floor from first to last frame, m."""
    distance, _ = _walk(apply(axes, trial))
    return distance


def _walk(trial: Trial) -> tuple[float, Vector | None]:
    """How far the markers' middle went over the floor, m, and which way."""
    rows = np.flatnonzero(seen_in(trial.markers).any(axis=1))
    if len(rows) < 2:
        return 0.0, None
    first, last = (np.nanmedian(trial.markers[row], axis=0) for row in (rows[0], rows[-1]))
    way = (last - first) * [1.0, 0.0, 1.0]
    walked = float(np.linalg.norm(way))
    if walked < WALKED_M:
        return walked, None
    x, y, z = (round(float(v), 4) for v in way / walked)
    return walked, (x, y, z)
