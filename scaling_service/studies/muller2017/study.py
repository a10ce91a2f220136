"""The study of Muller et al. 2017 on virtual persons, whose true errors are known."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from scaling_service.capabilities.dynamics.inertia import identification
from scaling_service.capabilities.dynamics.inertia.evidence import ForceRecording
from scaling_service.capabilities.dynamics.inertia.parameters import PriorSpread
from scaling_service.capabilities.dynamics.run import dynamics
from scaling_service.capabilities.dynamics.settings import DynamicsSettings
from scaling_service.capabilities.dynamics.uncertainty import total
from scaling_service.capabilities.dynamics.uncertainty.markers import choose_frames, propagate_marker_errors
from scaling_service.capabilities.kinetics import inverse_dynamics
from scaling_service.capabilities.shared.names import AS_IT_IS
from scaling_service.capabilities.shared.settings import UNSMOOTHED
from scaling_service.core.arrays import Array
from scaling_service.documents.writing import code_version
from scaling_service.model import inertia
from scaling_service.model.body import BodyModel
from scaling_service.studies import claims
from scaling_service.studies.muller2017 import excitation, monte_carlo
from scaling_service.studies.muller2017 import result as documents
from scaling_service.studies.muller2017.claims import CLAIMS, INTERVAL

SUBJECTS = 10
"""Muller et al. 2017, sec. 2.3."""

FREE = 10.0
"""How many times wider than usual the prior is where an identification trusts the residual (chosen: the
tables then hardly count; inertia stays physically possible)."""

SHOWN = 10
"""Markers that are listed (chosen: they carry nearly all)."""

_MM = 1e3
_SAME = (
    *("frames", "dr", "kinematic", "plate", "total", "slopes_per_cm", "r2", "r2_centred"),
    *("calibration_supported", "verdict"),
)
"""What the document calls as the result does."""


def study_person(
    seed: int,
    settings: monte_carlo.UncertaintySettings,
    recorded: excitation.ExcitationSettings = excitation.ExcitationSettings(),
) -> documents.PersonEntry:
    """The whole study of one person, in this thread.

    ``seed``: of the person. ``settings``: its seed is replaced by the person's.
    """
    person = excitation.make_excited_person(seed, recorded)
    performance = person.performances["in_order"]
    recording = performance.recording
    found = monte_carlo.propagate_by_samples(recording, dataclasses.replace(settings, seed=seed))
    linear = total.propagate(recording, levels=settings.levels, noise_on=settings.noise_on)
    markers = propagate_marker_errors(recording)
    choice = choose_frames(recording, markers)
    # Residuals that the measurement and that the table's inertia bring, each (n, 6), N and N m
    table = inertia.with_inertias(person.truth, inertia.gather_inertias(person.model))
    missed = _compute_true_residual(table, performance)
    error, inertial = _measure_dynamics(person.model, performance).residual - missed, missed
    rows, scale = markers.frames, _scale(person)
    markers_sd = _compute_rms(markers.sd) / scale
    largest = np.argsort(-markers.shares.mean(axis=1))[:SHOWN].tolist()
    usual = PriorSpread()
    return documents.PersonEntry.model_validate(
        {
            **describe_uncertainty(f"excited_{seed}", found),
            "linear_slopes_per_cm": linear.slopes_per_cm,
            "true_measurement_error": _compute_rms(error[rows]) / scale,
            "true_inertial_error": _compute_rms(inertial[rows]) / scale,
            "markers_sd": markers_sd,
            "supported_by_markers": total.is_inertia_dominant(found.dr, markers_sd),
            "coverage": (np.abs(error[rows]) <= INTERVAL * markers.sd).mean(axis=0),
            "markers": [
                {
                    "marker": markers.markers[k],
                    "sd_mm": round(_MM * float(markers.sd_m[k]), 4),
                    "shares": markers.shares[k],
                }
                for k in largest
            ],
            "windows": [
                {
                    "start_s": round(w.start / recorded.rate_hz, 3),
                    "stop_s": round(w.stop / recorded.rate_hz, 3),
                    "gain": round(w.gain, 4),
                    "uncertainty": round(w.uncertainty, 8),
                }
                for w in choice.windows
            ],
            "windows_share": round(choice.share, 4),
            "identified_beside_tables": _identify(
                person, identification.IdentificationSettings(despite_verdict=True)
            ),
            "identified_freely": _identify(
                person,
                identification.IdentificationSettings(
                    spread=PriorSpread(FREE * usual.mass, FREE * usual.com, FREE * usual.length),
                    despite_verdict=True,
                ),
            ),
        }
    )


def describe_uncertainty(name: str, found: monte_carlo.SampledUncertainty) -> dict[str, Any]:
    """The fields of a ``PropagatedEntry``."""
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


def _scale(person: excitation.ExcitedPerson) -> Array:
    return np.asarray(
        1.0
        / inverse_dynamics.compute_residual_indicator(
            np.ones((1, 6)), inertia.sum_mass(person.model), person.height_m
        )
    )


def _compute_rms(values: Array) -> Array:
    return np.asarray(np.sqrt(np.mean(values**2, axis=0)))


def _compute_true_residual(model: BodyModel, performance: excitation.Performance) -> Array:
    """What a model's inertia leaves of the true motion and the true forces, (n, 6)."""
    rated = inverse_dynamics.differentiate_motion(model, performance.times, performance.q, cutoff_hz=None)
    return inverse_dynamics.compute_dynamics(model, rated, performance.loads).residual


def _measure_dynamics(
    model: BodyModel, performance: excitation.Performance
) -> inverse_dynamics.InverseDynamics:
    recording = performance.recording
    return inverse_dynamics.solve_inverse_dynamics(model, recording.motion, recording.loads)


def _identify(
    person: excitation.ExcitedPerson, settings: identification.IdentificationSettings
) -> documents.IdentificationEntry:
    """Identify from one performance, despite whatever verdict, and look at the other."""
    fit, other = person.performances["in_order"], person.performances["shuffled"]
    scale, inner = _scale(person), other.recording.frames
    evidence = ForceRecording(_measure_dynamics(person.model, fit), fit.recording.frames)
    found = identification.identify_inertia(person.model, [evidence], settings=settings)
    entry = {}
    for when, model in (("before", person.model), ("after", found.model)):
        true = inertia.with_inertias(person.truth, inertia.gather_inertias(model))
        entry[f"residual_{when}"] = _compute_rms(_measure_dynamics(model, other).residual[inner]) / scale
        entry[f"true_error_{when}"] = _compute_rms(_compute_true_residual(true, other)[inner]) / scale
    return documents.IdentificationEntry.model_validate(entry)


def reproduce_muller2017(
    settings: monte_carlo.UncertaintySettings,
    *,
    subjects: int | None = None,
    recorded: excitation.ExcitationSettings = excitation.ExcitationSettings(),
    recordings: Sequence[str | Path] = (),
    worker_count: int | None = None,
    finished: claims.PersonDone | None = None,
) -> documents.Muller2017Document:
    """Propagate uncertainty in recordings of virtual persons, and ask what the paper claims.

    ``settings``: its seed decides who the persons are. ``recordings``: subject files of real persons whose
    model is scaled already, with forces. Results do not depend on ``worker_count``. InputError: no subject is
    asked for, or a real one cannot be used.
    """
    clock = time.perf_counter()
    real = [entry for file in recordings for entry in _study_real(file, settings)]
    persons = claims.study_persons(
        study_person,
        settings.seed,
        SUBJECTS if subjects is None else subjects,
        settings,
        recorded,
        worker_count=worker_count,
        finished=finished,
    )
    chosen = {**dataclasses.asdict(settings), "levels": list(settings.levels)}
    del chosen["seed"]
    document = documents.Muller2017Document(
        source=CLAIMS.said["source"],
        code_version=code_version(),
        settings={**chosen, "database": settings.database_size, "recorded": dataclasses.asdict(recorded)},
        seed=settings.seed,
        persons=persons,
        recordings=real,
        notes=CLAIMS.said["notes"],
        wall_s=round(time.perf_counter() - clock, 3),
    )
    return CLAIMS.answer(document)


def _study_real(
    file: str | Path, settings: monte_carlo.UncertaintySettings
) -> list[documents.PropagatedEntry]:
    """A real person's recordings, with the model as it is."""
    found = dynamics(
        file,
        DynamicsSettings(start=AS_IT_IS),
        UNSMOOTHED.model_copy(update={"seed": settings.seed}),
    )
    subject = found.prepared.subject.id
    return [
        documents.PropagatedEntry.model_validate(
            describe_uncertainty(
                f"{subject} {name}", monte_carlo.propagate_by_samples(trial.recording, settings)
            )
        )
        for name, trial in found.trials.items()
    ]
