"""Futamure et al. done again on virtual squatters, as ``study.json``."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

from scaling_service.capabilities.consistent.estimate import consistent
from scaling_service.capabilities.consistent.problem import ConsistentSettings
from scaling_service.capabilities.consistent.run import read
from scaling_service.capabilities.dynamics.settings import UNSMOOTHED, DynamicsSettings
from scaling_service.capabilities.shared.names import AS_IT_IS
from scaling_service.capabilities.subject.loading import open_subject
from scaling_service.core.progress import silent
from scaling_service.documents.writing import code_version
from scaling_service.studies.claims import PersonDone, answer_claims, study_persons
from scaling_service.studies.futamure.claims import CLAIMS
from scaling_service.studies.futamure.squatters import SUBJECTS
from scaling_service.studies.futamure.study import (
    DIFFERENCES,
    SOURCE,
    FutamureDocument,
    RealEntry,
    describe_recording,
    study_squatter,
)

FITTED_SHARE = 0.6
"""Of a real recording (chosen: three of five squats)."""


def reproduce_futamure(
    *,
    seed: int = 0,
    subjects: int | None = None,
    recordings: Sequence[str | Path] = (),
    worker_count: int | None = None,
    finished: PersonDone | None = None,
) -> FutamureDocument:
    """Explain squats of virtual persons in both ways, and ask what the paper claims.

    ``seed``: decides who the persons are. ``recordings``: subject files of real squats with forces, shown
    beside; .osim models are taken as they are. Results do not depend on ``worker_count``. InputError: no
    subject is asked for, or a real one cannot be used.
    """
    clock, count = time.perf_counter(), SUBJECTS if subjects is None else subjects
    real = [_real(Path(file)) for file in recordings]
    document = FutamureDocument(
        source=SOURCE,
        code_version=code_version(),
        settings=asdict(ConsistentSettings()),
        seed=seed,
        persons=study_persons(study_squatter, seed, count, worker_count=worker_count, finished=finished),
        recordings=real,
        notes=list(DIFFERENCES),
        wall_s=round(time.perf_counter() - clock, 3),
    )
    return answer_claims(document, CLAIMS)


def _real(file: Path) -> RealEntry:
    """A real person's first recording: its beginning fitted, its end held out."""
    loaded = open_subject(file, UNSMOOTHED)
    subject = loaded.session.subject
    given = subject.model.lower().endswith(".osim") and subject.static is None
    chosen = DynamicsSettings(start=AS_IT_IS if given else None)
    with loaded.blamed():
        ready = read(loaded, chosen, UNSMOOTHED, progress=silent)
        whole = ready.fitted[0]
        cut = int(FITTED_SHARE * len(whole.trial.times))
        parts = [whole.part(slice(0, cut), "fitted"), whole.part(slice(cut, None), "held out")]
        clock = time.perf_counter()
        found = consistent(ready.prepared.model, parts[:1], parts[1:], ready.settings)
    return RealEntry(
        name=f"{subject.id} {whole.name}",
        model=Path(subject.model).name,
        start=ready.prepared.start,
        fitted=describe_recording(found, 0),
        held_out=describe_recording(found, 1),
        loops=found.outer_iterations,
        seconds=round(time.perf_counter() - clock, 2),
    )
