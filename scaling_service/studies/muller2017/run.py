"""Muller et al. 2017 done again on virtual persons, and written."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from scaling_service.capabilities.cohort.executors import gathered
from scaling_service.capabilities.dynamics.run import dynamics
from scaling_service.capabilities.dynamics.settings import AS_IT_IS, UNSMOOTHED, DynamicsSettings
from scaling_service.capabilities.dynamics.uncertainty.total import UncertaintySettings, WrenchUncertainty
from scaling_service.core.errors import InputError
from scaling_service.core.threads import cores
from scaling_service.documents.writing import REPORT, all_or_nothing, code_version, write_json
from scaling_service.numerics.multibody.laws import Array
from scaling_service.studies.document import ClaimEntry
from scaling_service.studies.muller2017.claims import answers
from scaling_service.studies.muller2017.document import (
    IdentificationEntry,
    LevelEntry,
    MarkerEntry,
    Muller2017Document,
    PersonEntry,
    PropagatedEntry,
    Six,
    WindowEntry,
)
from scaling_service.studies.muller2017.excitation import WHOLE, ExcitationSettings
from scaling_service.studies.muller2017.report import study_page
from scaling_service.studies.muller2017.study import (
    DIFFERENCES,
    SOURCE,
    SUBJECTS,
    Held,
    PersonStudied,
    person_seeds,
    study_person,
)

DOCUMENT = "study.json"

SHOWN = 10
"""Markers that are listed (chosen: they carry nearly all)."""

_MM = 1e3
_DIGITS = 8


def reproduce_muller2017(
    settings: UncertaintySettings,
    *,
    subjects: int = SUBJECTS,
    recorded: ExcitationSettings = WHOLE,
    recordings: Sequence[str | Path] = (),
    worker_count: int | None = None,
    finished: Callable[[str, int], None] | None = None,
) -> Muller2017Document:
    """Propagate uncertainty in recordings of virtual persons, and ask what the paper claims.

    Parameters
    ----------
    settings : UncertaintySettings
        Its seed decides who the persons are.
    subjects : int
    recorded : ExcitationSettings
    recordings : sequence of paths
        Subject files of real persons whose model is scaled already, with forces.
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
        raise InputError("no subject is asked for", field="--subjects", remedy="Take 10, as the paper did")
    clock = time.perf_counter()
    real = [entry for file in recordings for entry in _real(file, settings)]
    persons = gathered(
        study_person,
        [(seed, settings, recorded) for seed in person_seeds(settings.seed, subjects)],
        min(worker_count or cores(), subjects),
        lambda person, done: None if finished is None else finished(person.name, done),
    )
    chosen = {**asdict(settings), "levels": list(settings.levels)}
    del chosen["seed"]
    return Muller2017Document(
        source=SOURCE,
        code_version=code_version(),
        settings={**chosen, "database": settings.database_size, "recorded": asdict(recorded)},
        seed=settings.seed,
        persons=[_person(person, recorded.rate_hz) for person in persons],
        recordings=real,
        claims=[
            ClaimEntry(
                where=claim.where,
                claim=claim.text,
                paper=claim.paper,
                holds=answer.holds,
                ours=answer.figures,
            )
            for claim, answer in answers(persons)
        ],
        notes=list(DIFFERENCES),
        wall_s=round(time.perf_counter() - clock, 3),
    )


def save_muller2017(document: Muller2017Document, folder: str | Path) -> tuple[str, ...]:
    """Write the study into a folder, all or nothing, and name the files."""
    with all_or_nothing(Path(folder)) as scratch:
        write_json(scratch / DOCUMENT, document)
        (scratch / REPORT).write_text(study_page(document).html(), encoding="utf-8")
        return tuple(sorted(path.name for path in scratch.iterdir()))


def _person(person: PersonStudied, rate_hz: float) -> PersonEntry:
    return PersonEntry(
        **_propagated(person.name, person.uncertainty),
        linear_slopes_per_cm=_six(person.linear_slopes),
        true_measurement_error=_six(person.measurement),
        true_inertial_error=_six(person.inertial),
        markers_sd=_six(person.markers_sd),
        supported_by_markers=_six_flags(person.supported_by_markers),
        coverage=_six(person.coverage),
        markers=_markers(person),
        windows=[
            WindowEntry(
                start_s=round(w.start / rate_hz, 3),
                stop_s=round(w.stop / rate_hz, 3),
                gain=round(w.gain, 4),
                uncertainty=round(w.uncertainty, _DIGITS),
            )
            for w in person.choice.windows
        ],
        windows_share=round(person.choice.share, 4),
        identified_beside_tables=_held(person.cautious),
        identified_freely=_held(person.free),
    )


def _real(file: str | Path, settings: UncertaintySettings) -> list[PropagatedEntry]:
    """A real person's recordings, with the model as it is."""
    found = dynamics(
        file,
        DynamicsSettings(start=AS_IT_IS, samples=settings.samples),
        replace(UNSMOOTHED, seed=settings.seed),
    )
    subject = found.prepared.subject.id
    return [
        PropagatedEntry(**_propagated(f"{subject} {name}", trial.uncertainty))
        for name, trial in found.trials.items()
    ]


def _propagated(name: str, found: WrenchUncertainty) -> dict[str, Any]:
    return {
        "name": name,
        "reconstruction_error_mm": round(_MM * found.reconstruction_error_m, 4),
        "frames": found.frames,
        "dr": _six(found.dr),
        "kinematic": _six(found.kinematic),
        "plate": _six(found.plate),
        "total": _six(found.total),
        "slopes_per_cm": _six(found.slopes_per_cm),
        "r2": _six(found.r2),
        "r2_centred": _six(found.r2_centred),
        "levels": [
            LevelEntry(
                added_mm=round(_MM * level.added_m, 4),
                dispersion=_six(level.dispersion),
                distinct_motions=level.distinct,
            )
            for level in found.levels
        ],
        "calibration_supported": _six_flags(found.calibration_supported),
        "verdict": found.verdict,
    }


def _markers(person: PersonStudied) -> list[MarkerEntry]:
    found = person.markers
    order = np.argsort(-found.shares.mean(axis=1))[:SHOWN].tolist()
    return [
        MarkerEntry(
            marker=found.markers[k],
            sd_mm=round(_MM * float(found.sd_m[k]), 4),
            shares=_six(found.shares[k]),
        )
        for k in order
    ]


def _held(held: Held) -> IdentificationEntry:
    return IdentificationEntry(
        residual_before=_six(held.held_out[0]),
        residual_after=_six(held.held_out[1]),
        true_error_before=_six(held.true[0]),
        true_error_after=_six(held.true[1]),
    )


def _six_flags(values: NDArray[np.bool_]) -> tuple[bool, bool, bool, bool, bool, bool]:
    return cast("tuple[bool, bool, bool, bool, bool, bool]", tuple(values.tolist()))


def _six(values: Array) -> Six:
    """Rounded to eight digits after the point; smaller numbers, such as the plates', to four that count."""
    return cast(
        "Six", tuple(float(f"{v:.4g}") if abs(v) < 1e-4 else round(float(v), _DIGITS) for v in values)
    )
