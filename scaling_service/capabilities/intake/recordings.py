"""A look at recordings: each one read by itself, so that a bad one hides nothing of the others."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from scaling_service.capabilities.intake.document import AxesEntry, ProblemEntry, Severity
from scaling_service.capabilities.subject.loading import agreed_axes
from scaling_service.core.errors import InputError
from scaling_service.files.recording import Recording, read_recording
from scaling_service.model.anatomy.markers import canonical
from scaling_service.model.forces import GroundForces, PlateRecording, RawPlate
from scaling_service.model.trial import Array, Trial
from scaling_service.recording.orientation import Orientation, decide
from scaling_service.recording.plates import ground_forces
from scaling_service.recording.plausibility import remove_strays

GUESSED = "not known"  # how the reason begins where an axis was not decided by markers or walking


@dataclass(frozen=True, slots=True, eq=False)
class RecordingFile:
    """A recording as it was read, and what it alone says."""

    file: str
    trial: Recording  # in the laboratory's axes, m as stated
    axes: Orientation
    forces: GroundForces | None = None  # of its own plates, in the laboratory's axes
    problems: tuple[ProblemEntry, ...] = ()

    @property
    def plates(self) -> tuple[RawPlate, ...]:
        """Its own plates, in the laboratory's axes."""
        return self.trial.plates.plates if isinstance(self.trial.plates, PlateRecording) else ()

    @property
    def corners(self) -> Array | None:
        """Of its own plates, where their forces can be used, (n_plates, 4, 3), m, as in the laboratory."""
        known = self.plates if self.forces is not None else ()
        return np.stack([plate.corners for plate in known]) if known else None


def problem_of(error: InputError, severity: Severity = "error", file: str | None = None) -> ProblemEntry:
    """An error as it travels, its file without the folder that it lay in."""
    named = file if error.file is None else Path(error.file).name
    return ProblemEntry(
        severity=severity, file=named, field=error.field, problem=error.problem, remedy=error.remedy
    )


def look_at(file: Path, up: str | None, forward: str | None) -> RecordingFile:
    """Read one recording; ``up`` and ``forward`` are the laboratory's axes, where they are known.

    Raises InputError: its markers cannot be used at all. What is wrong with its plates is told in the result.
    """
    trial = remove_strays(read_recording(file))
    seen = RecordingFile(file.name, trial, _axes(trial, up, forward))
    if trial.plates is None:
        return seen
    try:
        return replace(seen, forces=ground_forces(trial.plates))
    except InputError as error:
        return replace(seen, problems=(problem_of(error, "warning", file.name),))


def session_axes(
    seen: Sequence[RecordingFile], static: str | None, up: str | None, forward: str | None
) -> Orientation:
    """One decision for all recordings, as scaling takes it.

    ``seen``: at least one. ``static``: the file of standing. ``up``, ``forward``: as given.
    """
    first = next((item for item in seen if item.file == static), seen[0])
    decided = {Path(first.file): first.axes}
    for item in seen:
        if item is not first:
            decided[Path(item.file)] = _axes(item.trial, up or first.axes.up, forward)
    return agreed_axes(decided, None if static is None else Path(static))


def axes_entry(axes: Orientation, up: str | None, forward: str | None) -> AxesEntry:
    """A decision as it travels."""
    why = [r.detail for r in axes.repairs if r.what in ("up_axis", "forward_axis", "unit")]
    return AxesEntry(
        up=axes.up,
        forward=axes.forward,
        sure=not any(f"({GUESSED}" in text for text in why),
        given=up is not None and forward is not None,
        why=why,
        R_new_old=[[float(v) for v in row] for row in axes.R_new_old],
    )


def _axes(trial: Trial, up: str | None, forward: str | None) -> Orientation:
    roles = {label: role for label in trial.labels if (role := canonical(label)) is not None}
    return decide(trial, roles=_once(roles), up=up, forward=forward)


def _once(roles: Mapping[str, str]) -> dict[str, str]:
    """Labels whose role no other label has: of two persons nobody knows whose it is."""
    every = list(roles.values())
    return {label: role for label, role in roles.items() if every.count(role) == 1}
