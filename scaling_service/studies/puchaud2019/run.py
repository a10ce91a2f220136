"""A paper's study done again on virtual persons, and written with the paper's numbers beside ours."""

from __future__ import annotations

import math
import time
from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path

from scaling_service.capabilities.cohort.custom_legs import Generic
from scaling_service.capabilities.cohort.documents import statistics_document
from scaling_service.capabilities.cohort.executors import workers
from scaling_service.capabilities.cohort.run import Watcher
from scaling_service.capabilities.cohort.scaling_items import CohortRun, VirtualPerson, run_cohort
from scaling_service.capabilities.cohort.statistics import CohortStatistics, cohort_statistics
from scaling_service.capabilities.subject.settings import Settings
from scaling_service.core.errors import InputError
from scaling_service.core.threads import cores
from scaling_service.documents.writing import REPORT, all_or_nothing, code_version, write_json
from scaling_service.studies.document import Beside, ClaimEntry, StudyDocument
from scaling_service.studies.puchaud2019 import tables
from scaling_service.studies.puchaud2019.claims import answers
from scaling_service.studies.puchaud2019.paper import METHODS, paper
from scaling_service.studies.puchaud2019.questions import Study
from scaling_service.studies.puchaud2019.report import study_page
from scaling_service.studies.puchaud2019.study import DIFFERENCES, SUBJECTS, WALKERS, person_seeds

DOCUMENT = "study.json"

_MM, _DEG = 1e3, 180.0 / math.pi


@dataclass(frozen=True, slots=True, eq=False)
class StudyResult:
    """The study: what is written, and the statistics that it is made of (SI)."""

    document: StudyDocument
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
    watcher : Watcher, optional

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
    settings = replace(settings, calibration=replace(settings.calibration, sizes="measured"))  # as the paper
    people = [
        VirtualPerson(seed, images=True, generic=generic) for seed in person_seeds(settings.seed, subjects)
    ]
    count = min(worker_count or cores(), len(people))
    if watcher is not None:
        watcher.started(len(people), count)
    with workers(count, None if watcher is None else watcher.stage) as executor:
        run = run_cohort(
            people, executor, METHODS, settings, finished=None if watcher is None else watcher.finished
        )
    _require_all(run)
    walkers = cohort_statistics(run.summaries[:WALKERS], METHODS, seed=settings.seed)
    study = Study(run.statistics, walkers, max(outcome.wall_s for outcome in run.outcomes))
    return StudyResult(_document(study, settings, generic, time.perf_counter() - clock), study)


def save_study(result: StudyResult, folder: str | Path) -> tuple[str, ...]:
    """Write a study into a folder, all or nothing, and name the files."""
    with all_or_nothing(Path(folder)) as scratch:
        write_json(scratch / DOCUMENT, result.document)
        page = study_page(result.document, result.study.cohort, result.study.walkers)
        (scratch / REPORT).write_text(page.html(), encoding="utf-8")
        return tuple(sorted(path.name for path in scratch.iterdir()))


def _require_all(run: CohortRun) -> None:
    """A study with a person missing is another study."""
    for outcome in run.outcomes:
        if outcome.status != "done":
            raise InputError(
                f"{outcome.name} could not be scaled: {outcome.reason}",
                field="--seed",
                remedy="Take another seed, and report this one",
            )


def _document(study: Study, settings: Settings, generic: Generic, wall_s: float) -> StudyDocument:
    cohort: CohortStatistics = study.cohort
    return StudyDocument(
        study="puchaud2019",
        source=paper().source,
        code_version=code_version(),
        settings={**settings.resolved(), "generic": generic},
        seed=settings.seed,
        subjects=list(cohort.subjects),
        walkers=list(study.walkers.subjects),
        segment_lengths_mm=_beside(tables.lengths(cohort), _MM),
        knee_axis_deg=_beside(tables.knee_axes(cohort), _DEG),
        kinematic_error_mm=_beside(tables.errors(cohort), _MM),
        literature_error_mm={who: round(_MM * v, 4) for who, v in paper().literature_errors.items()},
        length_difference_mm=_beside(tables.length_differences(cohort), _MM),
        marker_shift_mm=_beside(tables.marker_shifts(cohort), _MM),
        claims=[
            ClaimEntry(
                where=claim.where,
                claim=claim.text,
                paper=claim.paper,
                holds=answer.holds,
                ours=answer.figures,
            )
            for claim, answer in answers(study)
        ],
        notes=list(DIFFERENCES),
        statistics=statistics_document(cohort),
        walkers_statistics=statistics_document(study.walkers),
        slowest_subject_s=round(study.slowest_s, 3),
        wall_s=round(wall_s, 3),
    )


def _beside(cells: Iterable[tables.Cell], unit: float) -> list[Beside]:
    return [
        Beside(
            quantity=cell.quantity,
            method=cell.method,
            paper_mean=None if cell.paper is None else round(unit * cell.paper.mean, 4),
            paper_sd=None if cell.paper is None else round(unit * cell.paper.sd, 4),
            mean=round(unit * cell.ours.mean, 4),
            sd=round(unit * cell.ours.sd, 4),
            paper_stars=cell.stars,
            p_from_EB=cell.p_from_EB,
            significant=cell.significant,
        )
        for cell in cells
    ]
