"""Muller et al. 2017 done again on virtual persons, as ``study.json``."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

from scaling_service.capabilities.dynamics.run import dynamics
from scaling_service.capabilities.dynamics.settings import UNSMOOTHED, DynamicsSettings
from scaling_service.capabilities.dynamics.uncertainty.total import UncertaintySettings
from scaling_service.capabilities.shared.names import AS_IT_IS
from scaling_service.documents.writing import code_version
from scaling_service.studies.claims import PersonDone, answer_claims, study_persons
from scaling_service.studies.muller2017.claims import CLAIMS
from scaling_service.studies.muller2017.excitation import WHOLE, ExcitationSettings
from scaling_service.studies.muller2017.study import (
    DIFFERENCES,
    SOURCE,
    SUBJECTS,
    Muller2017Document,
    PropagatedEntry,
    describe_uncertainty,
    study_person,
)


def reproduce_muller2017(
    settings: UncertaintySettings,
    *,
    subjects: int | None = None,
    recorded: ExcitationSettings = WHOLE,
    recordings: Sequence[str | Path] = (),
    worker_count: int | None = None,
    finished: PersonDone | None = None,
) -> Muller2017Document:
    """Propagate uncertainty in recordings of virtual persons, and ask what the paper claims.

    ``settings``: its seed decides who the persons are. ``recordings``: subject files of real persons whose
    model is scaled already, with forces. Results do not depend on ``worker_count``. InputError: no subject is
    asked for, or a real one cannot be used.
    """
    clock = time.perf_counter()
    real = [entry for file in recordings for entry in _real(file, settings)]
    persons = study_persons(
        study_person,
        settings.seed,
        SUBJECTS if subjects is None else subjects,
        settings,
        recorded,
        worker_count=worker_count,
        finished=finished,
    )
    chosen = {**asdict(settings), "levels": list(settings.levels)}
    del chosen["seed"]
    document = Muller2017Document(
        source=SOURCE,
        code_version=code_version(),
        settings={**chosen, "database": settings.database_size, "recorded": asdict(recorded)},
        seed=settings.seed,
        persons=persons,
        recordings=real,
        notes=list(DIFFERENCES),
        wall_s=round(time.perf_counter() - clock, 3),
    )
    return answer_claims(document, CLAIMS)


def _real(file: str | Path, settings: UncertaintySettings) -> list[PropagatedEntry]:
    """A real person's recordings, with the model as it is."""
    found = dynamics(
        file,
        DynamicsSettings(start=AS_IT_IS, samples=settings.samples),
        UNSMOOTHED.model_copy(update={"seed": settings.seed}),
    )
    subject = found.prepared.subject.id
    return [
        PropagatedEntry.model_validate(describe_uncertainty(f"{subject} {name}", trial.uncertainty))
        for name, trial in found.trials.items()
    ]
