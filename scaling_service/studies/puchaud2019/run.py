"""Puchaud et al. 2019 done again on virtual persons."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass

from scaling_service.capabilities.cohort.document import statistics_document
from scaling_service.capabilities.cohort.executors import workers
from scaling_service.capabilities.cohort.outcomes import Outcome, run_members
from scaling_service.capabilities.cohort.run import Watcher
from scaling_service.capabilities.cohort.statistics import cohort_statistics
from scaling_service.capabilities.cohort.summary import SubjectSummary
from scaling_service.capabilities.shared.settings import Settings
from scaling_service.core.errors import InputError
from scaling_service.core.threads import cores
from scaling_service.documents.writing import code_version
from scaling_service.studies.claims import answer_claims, person_seeds
from scaling_service.studies.puchaud2019.claims import CLAIMS, Study
from scaling_service.studies.puchaud2019.paper import (
    METHODS,
    Puchaud2019Document,
    errors,
    knee_axes,
    length_differences,
    lengths,
    marker_shifts,
    paper,
)
from scaling_service.studies.puchaud2019.persons import DIFFERENCES, SUBJECTS, WALKERS, Generic, VirtualPerson


@dataclass(frozen=True, slots=True, eq=False)
class StudyResult:
    """The study: what is written, and the statistics that it is made of (SI)."""

    document: Puchaud2019Document
    study: Study


def reproduce_puchaud2019(
    settings: Settings = Settings(),
    *,
    subjects: int = SUBJECTS,
    generic: Generic = "mean",
    worker_count: int | None = None,
    watcher: Watcher | None = None,
) -> StudyResult:
    """Scale virtual persons by the five methods of Puchaud et al. 2019, and ask what the paper claims.

    Parameters
    ----------
    settings : Settings
        Its seed decides who the persons are.
    subjects : int
        More than the six whose gait is also looked at alone.
    generic : 'mean' or 'custom'
        The model that scaling starts from.
    worker_count : int, optional
        Processes; results do not depend on it.

    Raises
    ------
    InputError
        Too few subjects, or a person that could not be scaled.
    """
    if subjects <= WALKERS:
        raise InputError(
            f"{subjects} subjects are too few", field="--subjects", remedy=f"Take at least {WALKERS + 1}"
        )
    clock = time.perf_counter()
    settings = settings.model_copy(
        update={"calibration": settings.calibration.model_copy(update={"sizes": "measured"})}
    )  # as the paper
    people = [
        VirtualPerson(seed, images=True, generic=generic) for seed in person_seeds(settings.seed, subjects)
    ]
    count = min(worker_count or cores(), len(people))
    if watcher is not None:
        watcher.started(len(people), count)
    with workers(count, None if watcher is None else watcher.stage) as executor:
        outcomes = run_members(
            people, executor, METHODS, settings, finished=None if watcher is None else watcher.finished
        )
    summaries = _all_summaries(outcomes)
    everybody, walkers = (
        cohort_statistics(some, METHODS, seed=settings.seed) for some in (summaries, summaries[:WALKERS])
    )
    study = Study(everybody, walkers, max(outcome.wall_s for outcome in outcomes))
    return StudyResult(_document(study, settings, generic, time.perf_counter() - clock), study)


def _all_summaries(outcomes: Sequence[Outcome]) -> list[SubjectSummary]:
    """A study with a person missing is another study."""
    for outcome in outcomes:
        if outcome.status != "done":
            raise InputError(
                f"{outcome.name} could not be scaled: {outcome.reason}",
                field="--seed",
                remedy="Take another seed, and report this one",
            )
    return [outcome.summary for outcome in outcomes if outcome.summary is not None]


def _document(study: Study, settings: Settings, generic: Generic, wall_s: float) -> Puchaud2019Document:
    cohort = study.cohort
    return Puchaud2019Document(
        source=paper().source,
        code_version=code_version(),
        settings={**settings.resolved(), "generic": generic},
        seed=settings.seed,
        subjects=list(cohort.subjects),
        walkers=list(study.walkers.subjects),
        segment_lengths_mm=lengths(cohort),
        knee_axis_deg=knee_axes(cohort),
        kinematic_error_mm=errors(cohort),
        literature_error_mm={who: round(1e3 * v, 4) for who, v in paper().literature_errors.items()},
        length_difference_mm=length_differences(cohort),
        marker_shift_mm=marker_shifts(cohort),
        claims=answer_claims(CLAIMS, study),
        notes=list(DIFFERENCES),
        statistics=statistics_document(cohort),
        walkers_statistics=statistics_document(study.walkers),
        slowest_subject_s=round(study.slowest_s, 3),
        wall_s=round(wall_s, 3),
    )
