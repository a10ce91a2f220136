"""Futamure et al. done again on virtual squatters, as ``study.json``."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Literal, cast

import numpy as np
from pydantic import Field

from scaling_service.capabilities.cohort.document import Part
from scaling_service.capabilities.cohort.executors import gathered
from scaling_service.capabilities.consistent.estimate import TrackedRecording
from scaling_service.capabilities.consistent.estimate import consistent as identify
from scaling_service.capabilities.consistent.problem import ConsistentSettings
from scaling_service.capabilities.consistent.run import read
from scaling_service.capabilities.dynamics.settings import UNSMOOTHED, DynamicsSettings
from scaling_service.capabilities.shared.names import AS_IT_IS
from scaling_service.capabilities.subject.reading import blamed_on, load_subject, recordings
from scaling_service.core.errors import InputError
from scaling_service.core.threads import cores
from scaling_service.documents.writing import code_version
from scaling_service.numerics.multibody.laws import Array
from scaling_service.studies.claims import StudyDocument, answer_claims, person_seeds
from scaling_service.studies.futamure.claims import CLAIMS
from scaling_service.studies.futamure.squatters import SUBJECTS
from scaling_service.studies.futamure.study import (
    DIFFERENCES,
    SAGITTAL_ROWS,
    SOURCE,
    SquatterStudied,
    Way,
    study_squatter,
)

Three = tuple[float, float, float]
"""fx, N; fy, N; mz, N m, about the ankle or the middle of the feet."""


class WayEntry(Part):
    """One way of explaining one recording."""

    wrench_rmse: Three
    marker_rms_mm: float
    angle_rmse_deg: list[float] = Field(
        description="Ankle, knee, hip, shoulder; empty where no truth is known."
    )


class RecordingEntry(Part):
    """One recording in three ways."""

    classical: WayEntry
    consistent: WayEntry
    predicted: WayEntry


class SquatterEntry(Part):
    """One virtual person."""

    name: str
    fitted: RecordingEntry
    held_out: RecordingEntry
    inertia_distance: tuple[Three, Three] = Field(
        description="Masses, centres of mass, moments of inertia, in SDs of tables; before, after."
    )
    length_error_mm: tuple[Three, Three] = Field(description="Shank, thigh, trunk; before, after.")
    marker_rms_mm: dict[str, tuple[float, float]] = Field(description="Classical, consistent.")
    loops: int
    converged: bool
    seconds: float


class RealEntry(Part):
    """A real recording: its first part fitted, the rest held out."""

    name: str
    model: str
    start: str
    fitted: RecordingEntry
    held_out: RecordingEntry
    loops: int
    seconds: float


class FutamureDocument(StudyDocument):
    """``study.json``."""

    study: Literal["futamure"] = "futamure"
    persons: list[SquatterEntry]
    recordings: list[RealEntry] = Field(description="Real ones, if given; claims leave them out.")

    @property
    def size(self) -> int:
        """How many virtual persons there are."""
        return len(self.persons)


FITTED_SHARE = 0.6
"""Of a real recording (chosen: three of five squats)."""


def reproduce_futamure(
    *,
    seed: int = 0,
    subjects: int = SUBJECTS,
    recordings: Sequence[str | Path] = (),
    worker_count: int | None = None,
    finished: Callable[[str, int], None] | None = None,
) -> FutamureDocument:
    """Explain squats of virtual persons in both ways, and ask what the paper claims.

    Parameters
    ----------
    seed : int
        Decides who the persons are.
    recordings : sequence of paths
        Subject files of real squats with forces, shown beside: .osim models are taken as they are.
    worker_count : int, optional
        Processes; results do not depend on it.
    finished : callable, optional
        Called with a person's name and how many are done.

    Raises
    ------
    InputError
        No subject is asked for, or a real one cannot be used.
    """
    if subjects < 1:
        raise InputError("no subject is asked for", field="--subjects", remedy="Take 8, as the paper did")
    clock = time.perf_counter()
    real = [_real(Path(file)) for file in recordings]
    persons = gathered(
        study_squatter,
        [(one,) for one in person_seeds(seed, subjects)],
        min(worker_count or cores(), subjects),
        lambda person, done: None if finished is None else finished(person.name, done),
    )
    return FutamureDocument(
        source=SOURCE,
        code_version=code_version(),
        settings=asdict(ConsistentSettings()),
        seed=seed,
        persons=[_person(person) for person in persons],
        recordings=real,
        claims=answer_claims(CLAIMS, persons),
        notes=list(DIFFERENCES),
        wall_s=round(time.perf_counter() - clock, 3),
    )


def _person(person: SquatterStudied) -> SquatterEntry:
    return SquatterEntry(
        name=person.name,
        fitted=_recording([_way(w) for w in person.fitted]),
        held_out=_recording([_way(w) for w in person.held_out]),
        inertia_distance=(_three(person.inertia[0]), _three(person.inertia[1])),
        length_error_mm=(_three(1e3 * person.lengths[0]), _three(1e3 * person.lengths[1])),
        marker_rms_mm={n: (round(1e3 * a, 3), round(1e3 * b, 3)) for n, (a, b) in person.marker_rms.items()},
        loops=person.loops,
        converged=person.converged,
        seconds=round(person.seconds, 2),
    )


def _way(way: Way) -> WayEntry:
    return WayEntry(
        wrench_rmse=_three(way.wrench),
        marker_rms_mm=round(1e3 * way.markers_m, 3),
        angle_rmse_deg=[round(float(a), 4) for a in np.degrees(way.angles)],
    )


def _recording(ways: Sequence[WayEntry]) -> RecordingEntry:
    classical, consistent, predicted = ways
    return RecordingEntry(classical=classical, consistent=consistent, predicted=predicted)


def _real(file: Path) -> RealEntry:
    """A real person's first recording: its beginning fitted, its end held out."""
    subject = load_subject(file)
    given = subject.model.lower().endswith(".osim") and subject.static is None
    chosen = DynamicsSettings(start=AS_IT_IS if given else None)
    with blamed_on(file), blamed_on(None, recordings(subject)):
        ready = read(subject, chosen, UNSMOOTHED, progress=lambda _what, _share: None)
        whole = ready.fitted[0]
        cut = int(FITTED_SHARE * len(whole.trial.times))
        parts = [whole.part(slice(0, cut), "fitted"), whole.part(slice(cut, None), "held out")]
        clock = time.perf_counter()
        found = identify(ready.prepared.model, parts[:1], parts[1:], ready.settings)
    ways = [
        [_followed(way[k]) for way in (found.classical, found.consistent, found.predicted)] for k in (0, 1)
    ]
    return RealEntry(
        name=f"{subject.id} {whole.name}",
        model=Path(subject.model).name,
        start=ready.prepared.start,
        fitted=_recording(ways[0]),
        held_out=_recording(ways[1]),
        loops=found.outer_iterations,
        seconds=round(time.perf_counter() - clock, 2),
    )


def _followed(found: TrackedRecording) -> WayEntry:
    return WayEntry(
        wrench_rmse=_three(found.wrench_rmse[list(SAGITTAL_ROWS)]),
        marker_rms_mm=round(1e3 * found.marker_rms_m, 3),
        angle_rmse_deg=[],
    )


def _three(values: Array) -> Three:
    return cast("Three", tuple(round(float(v), 4) for v in values))
