"""Muller et al. 2017 done again on virtual persons, as ``study.json``."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import AfterValidator, BeforeValidator, Field

from scaling_service.capabilities.cohort.document import Part
from scaling_service.capabilities.cohort.executors import gathered
from scaling_service.capabilities.dynamics.run import dynamics
from scaling_service.capabilities.dynamics.settings import UNSMOOTHED, DynamicsSettings
from scaling_service.capabilities.dynamics.uncertainty.total import UncertaintySettings, WrenchUncertainty
from scaling_service.capabilities.shared.names import AS_IT_IS
from scaling_service.core.errors import InputError
from scaling_service.core.threads import cores
from scaling_service.documents.writing import code_version
from scaling_service.numerics.multibody.laws import Array
from scaling_service.studies.claims import StudyDocument, answer_claims, person_seeds
from scaling_service.studies.muller2017.claims import CLAIMS
from scaling_service.studies.muller2017.excitation import WHOLE, ExcitationSettings
from scaling_service.studies.muller2017.study import (
    DIFFERENCES,
    SOURCE,
    SUBJECTS,
    Held,
    PersonStudied,
    study_person,
)

_DIGITS = 8


def _plain(values: Any) -> Any:
    """Arrays as tuples."""
    return tuple(values.tolist()) if isinstance(values, np.ndarray) else values


def _rounded(value: float) -> float:
    """Eight digits after the point; smaller numbers, such as the plates', to four that count."""
    return float(f"{value:.4g}") if abs(value) < 1e-4 else round(value, _DIGITS)


_Number = Annotated[float, AfterValidator(_rounded)]
Six = Annotated[tuple[_Number, _Number, _Number, _Number, _Number, _Number], BeforeValidator(_plain)]
"""fx, fy, fz over body weight, mx, my, mz over body weight times stature; X forward, Y up, Z right."""

SixFlags = Annotated[tuple[bool, bool, bool, bool, bool, bool], BeforeValidator(_plain)]


class IdentificationEntry(Part):
    """Residual indicators on the held-out performance before and after an identification."""

    residual_before: Six
    residual_after: Six
    true_error_before: Six = Field(description="What the inertia leaves of the true motion and forces.")
    true_error_after: Six


class LevelEntry(Part):
    """One level of added reconstruction error."""

    added_mm: float
    dispersion: Six
    distinct_motions: int


class MarkerEntry(Part):
    """One marker's error and its share of the uncertainty."""

    marker: str
    sd_mm: float = Field(description="Of its own error per direction, after the filter.")
    shares: Six = Field(description="Of the variance of each component.")


class WindowEntry(Part):
    """One window of frames worth calibrating with."""

    start_s: float
    stop_s: float
    gain: float = Field(description="Information on inertia that it adds, nats.")
    uncertainty: float = Field(description="Mean SD of the residual force over body weight.")


class PropagatedEntry(Part):
    """One recording's residual and its uncertainty, by samples."""

    name: str
    reconstruction_error_mm: float
    frames: int
    dr: Six
    kinematic: Six
    plate: Six
    total: Six
    slopes_per_cm: Six
    r2: Six
    r2_centred: Six
    levels: list[LevelEntry]
    calibration_supported: SixFlags
    verdict: str


class PersonEntry(PropagatedEntry):
    """One virtual person."""

    linear_slopes_per_cm: Six
    true_measurement_error: Six
    true_inertial_error: Six
    markers_sd: Six = Field(description="Standard deviation by the markers' errors.")
    supported_by_markers: SixFlags = Field(
        description="Where dr exceeds that by the root of two: inertia then has the larger part."
    )
    coverage: Six = Field(description="Share of frames whose true error lies within 1.96 of it.")
    markers: list[MarkerEntry] = Field(description="Those with the largest shares, largest first.")
    windows: list[WindowEntry]
    windows_share: float = Field(description="Of the whole recording's information.")
    identified_beside_tables: IdentificationEntry
    identified_freely: IdentificationEntry


class Muller2017Document(StudyDocument):
    """``study.json``."""

    study: Literal["muller2017"] = "muller2017"
    persons: list[PersonEntry]
    recordings: list[PropagatedEntry] = Field(description="Real ones, if given; claims leave them out.")

    @property
    def size(self) -> int:
        """How many virtual persons there are."""
        return len(self.persons)


SHOWN = 10
"""Markers that are listed (chosen: they carry nearly all)."""

_MM = 1e3
_SAME = (
    *("frames", "dr", "kinematic", "plate", "total", "slopes_per_cm", "r2", "r2_centred"),
    *("calibration_supported", "verdict"),
)
"""What the document calls as the result does."""


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
        claims=answer_claims(CLAIMS, persons),
        notes=list(DIFFERENCES),
        wall_s=round(time.perf_counter() - clock, 3),
    )


def _person(person: PersonStudied, rate_hz: float) -> PersonEntry:
    shares = person.markers.shares
    largest = np.argsort(-shares.mean(axis=1))[:SHOWN].tolist()
    return PersonEntry.model_validate(
        {
            **_propagated(person.name, person.uncertainty),
            "linear_slopes_per_cm": person.linear_slopes,
            "true_measurement_error": person.measurement,
            "true_inertial_error": person.inertial,
            "markers_sd": person.markers_sd,
            "supported_by_markers": person.supported_by_markers,
            "coverage": person.coverage,
            "markers": [
                {
                    "marker": person.markers.markers[k],
                    "sd_mm": round(_MM * float(person.markers.sd_m[k]), 4),
                    "shares": shares[k],
                }
                for k in largest
            ],
            "windows": [
                {
                    "start_s": round(w.start / rate_hz, 3),
                    "stop_s": round(w.stop / rate_hz, 3),
                    "gain": round(w.gain, 4),
                    "uncertainty": round(w.uncertainty, 8),
                }
                for w in person.choice.windows
            ],
            "windows_share": round(person.choice.share, 4),
            "identified_beside_tables": _held(person.cautious),
            "identified_freely": _held(person.free),
        }
    )


def _real(file: str | Path, settings: UncertaintySettings) -> list[PropagatedEntry]:
    """A real person's recordings, with the model as it is."""
    found = dynamics(
        file,
        DynamicsSettings(start=AS_IT_IS, samples=settings.samples),
        UNSMOOTHED.model_copy(update={"seed": settings.seed}),
    )
    subject = found.prepared.subject.id
    return [
        PropagatedEntry.model_validate(_propagated(f"{subject} {name}", trial.uncertainty))
        for name, trial in found.trials.items()
    ]


def _propagated(name: str, found: WrenchUncertainty) -> dict[str, Any]:
    return {
        "name": name,
        "reconstruction_error_mm": round(_MM * found.reconstruction_error_m, 4),
        **{key: getattr(found, key) for key in _SAME},
        "levels": [
            {
                "added_mm": round(_MM * level.added_m, 4),
                "dispersion": level.dispersion,
                "distinct_motions": level.distinct,
            }
            for level in found.levels
        ],
    }


def _held(held: Held) -> dict[str, Array]:
    return {
        "residual_before": held.held_out[0],
        "residual_after": held.held_out[1],
        "true_error_before": held.true[0],
        "true_error_after": held.true[1],
    }
