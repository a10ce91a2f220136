"""Dynamically consistent motion of a subject's recordings, from the subject file to results in memory."""

from __future__ import annotations

import dataclasses
import time
from pathlib import Path

import numpy as np

from scaling_service.capabilities.consistent import planar, result, words
from scaling_service.capabilities.consistent.estimate import estimate_consistent as identify
from scaling_service.capabilities.consistent.problem import ConsistentSettings
from scaling_service.capabilities.consistent.recording import ConsistentRecording
from scaling_service.capabilities.dynamics import start
from scaling_service.capabilities.dynamics.settings import ForceSettings
from scaling_service.capabilities.dynamics.weight import weigh_motions
from scaling_service.capabilities.kinetics import inverse_dynamics
from scaling_service.capabilities.shared import settings as shared_settings
from scaling_service.capabilities.subject.loading import open_subject
from scaling_service.capabilities.subject.preparing import Loaded
from scaling_service.core import progress as progressing
from scaling_service.core.arrays import Array
from scaling_service.core.errors import TrialUnusable
from scaling_service.model import inertia
from scaling_service.model.anatomy.inertia_planar import SQUAT
from scaling_service.model.anatomy.lengths import measure_segment_lengths
from scaling_service.model.body import BodyModel
from scaling_service.model.compile import list_parameter_values
from scaling_service.model.scaling import scale_model
from scaling_service.model.subject import Subject
from scaling_service.numerics.multibody.tree import pose_links
from scaling_service.numerics.wrench import GRAVITY

_PREPARING, _FINDING = 0.3, 0.6
"""Chosen: about the shares of reading and scaling, and of the loop."""

PLACED_M = 0.007
"""SD of what is wrong with a landmark's marker, each axis, m, where markers were not fitted to movements
(Della Croce et al. 1999, 2005: 6 to 21 mm within examiners)."""


def consistent(
    subject: Subject | str | Path,
    chosen: ForceSettings = ForceSettings(),
    settings: shared_settings.Settings = shared_settings.UNSMOOTHED,
    *,
    progress: progressing.Progress | None = None,
) -> result.ConsistentResults:
    """Find the motion, geometry and inertia that a subject's markers and ground forces agree on.

    ``subject`` Subject or path of a subject file: calibration trials with forces are fitted, evaluation
        trials with forces are held out.
    ``chosen``: its start, inertia and cutoff.
    Raises InputError: whatever in the subject file, the model, the recordings or their forces cannot be used.
    """
    clock = time.perf_counter()
    report = progress or progressing.show_nothing
    loaded = open_subject(subject, settings, facing=True)
    with loaded.blame_files():
        ready = read(loaded, chosen, settings, progress=progressing.report_part(report, 0.0, _PREPARING))
        found = identify(
            ready.prepared.model,
            ready.fitted,
            ready.held_out,
            ready.settings,
            progress=lambda what: report(what, _FINDING),
        )
    report("done", 1.0)
    prepared, recordings = ready.prepared, (*ready.fitted, *ready.held_out)
    trials = {}
    for k, one in enumerate(recordings):
        ways = {way: tracked[k] for way, tracked in found.ways.items()}
        held_out = k >= len(ready.fitted)
        forces = prepared.forces.get(one.name)
        trials[one.name] = result.ConsistentTrial(
            held_out=held_out,
            forces_from=forces.source.name if forces is not None else one.name,
            frames=int(one.known.sum()),
            ground_wrench_rmse=result.WrenchErrors(
                **{n: _make_wrench(w.wrench_rmse, one) for n, w in ways.items()}
            ),
            marker_rms_mm=result.MarkerErrors(**{n: _to_mm(w.marker_rms_m) for n, w in ways.items()}),
            weight=ways["consistent"].weight,
        )
    headline, tone = words.write_headline(trials.values())
    document = result.ConsistentDocument(
        headline=headline,
        tone=tone,
        **start.record_dynamics_provenance(prepared, settings, consistent=chosen),
        mass_kg=round(inertia.sum_mass(prepared.model), 3),
        trials=trials,
        inertial=[
            result.InertialEntry.model_validate(p, from_attributes=True) for p in found.inertial.parameters
        ],
        lengths_mm=_measure_lengths(found.model),
        lengths_before_mm=_measure_lengths(found.start),
        length_factors={name: round(f, 5) for name, f in found.factors.items()},
        outer_iterations=found.outer_iterations,
        converged=found.converged,
        history=[
            result.LoopEntry(
                marker_rms_mm=_to_mm(markers), ground_wrench_rmse=_make_wrench(wrench, recordings[0])
            )
            for markers, wrench in found.history
        ],
        warnings=list(dict.fromkeys((*prepared.warnings, *ready.notes, *found.inertial.warnings))),
        files=[],
        wall_s=round(time.perf_counter() - clock, 3),
    )
    return result.ConsistentResults(prepared=prepared, recordings=recordings, result=found, document=document)


def _make_wrench(values: Array, recording: ConsistentRecording) -> result.GroundWrench:
    named = zip(
        ("fx_N", "fy_N", "fz_N", "mx_Nm", "my_Nm", "mz_Nm"), values, recording.components, strict=True
    )
    return result.GroundWrench(**{name: round(float(value), 4) for name, value, counts in named if counts})


def _measure_lengths(model: BodyModel) -> dict[str, float]:
    return {name: round(1e3 * length, 2) for name, length in measure_segment_lengths(model).items()}


def _to_mm(metres: float) -> float:
    return round(1e3 * metres, 3)


@dataclasses.dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Ready:
    """Recordings to fit and to hold out, the model to start from, and what was decided on the way."""

    prepared: start.Prepared
    fitted: tuple[ConsistentRecording, ...]
    held_out: tuple[ConsistentRecording, ...]
    settings: ConsistentSettings
    notes: tuple[str, ...]


def read(
    loaded: Loaded,
    chosen: ForceSettings,
    settings: shared_settings.Settings,
    *,
    progress: progressing.Progress,
) -> Ready:
    """Read the forces, scale the model, follow the markers, weigh the person; errors as above."""
    if loaded.session.subject.model == SQUAT:
        prepared, found = planar.prepare_squat(loaded, chosen)
    else:
        usual = chosen.model_copy(update={"start": chosen.start or start.choose_rigid(loaded.session)})
        prepared = start.prepare(loaded, usual, settings, progress=progress)
        found = {name: _build_recording(prepared, name, chosen.cutoff_hz) for name in prepared.motions}
    names = [t.name for t in prepared.loaded.session.calibration if t.name in found]
    fitted = tuple(found[name] for name in names)
    held_out = tuple(recording for name, recording in found.items() if name not in names)
    # The model with the mass that the plates bear, and a note where that is another
    if not fitted:
        raise TrialUnusable(
            "no calibration trial has forces, so there is nothing to fit",
            field="trials.calibration",
            remedy="Name a movement with both feet on force plates under `calibration:`",
        )
    borne = np.concatenate([recording.wrench[recording.known, 1] for recording in fitted])
    mass, before = float(borne.mean() / -GRAVITY[1]), inertia.sum_mass(prepared.model)
    said = (f"the plates bear {mass:.1f} kg; the model weighed {before:.1f} kg and was brought to that",)
    changed = dataclasses.replace(prepared, model=scale_model(prepared.model, {}, mass_kg=mass))
    prepared, notes = changed, said if abs(mass / before - 1.0) > 0.01 else ()
    # fitted markers, and those of a given model, are where they are said to be
    placed_m = PLACED_M if prepared.start in ("MB", "EB", planar.STANDING) else 0.0
    own = ConsistentSettings(cutoff_hz=chosen.cutoff_hz, placed_m=placed_m)
    return Ready(prepared=prepared, fitted=fitted, held_out=held_out, settings=own, notes=notes)


def _build_recording(prepared: start.Prepared, name: str, cutoff_hz: float) -> ConsistentRecording:
    motion, forces = prepared.motions[name], prepared.forces[name]
    dynamics = inverse_dynamics.solve_inverse_dynamics(
        prepared.model, motion, forces.loads, cutoff_hz=cutoff_hz
    )
    weight = weigh_motions({name: (dynamics, forces.contacts.supported)})
    assert weight is not None  # it has one recording
    weight.check()
    trial = next(t for t in prepared.loaded.session.dynamic if t.name == name)
    # The middle of the feet's origins, (n, 3), m; where a frame is not known, that of the others.
    rows = [prepared.model.segment_names.index(name) for name in forces.loads.segments]
    known = np.isfinite(dynamics.motion.q).all(axis=1)
    tree = inertia.compile_whole_tree(prepared.model)
    poses = pose_links(
        tree, np.ascontiguousarray(dynamics.motion.q[known].T), list_parameter_values(prepared.model)
    )
    middle = poses.origins[rows].mean(axis=0).T
    about = np.tile(middle.mean(axis=0), (len(dynamics.motion.q), 1))
    about[known] = middle
    return ConsistentRecording(
        trial=trial,
        motion=motion,
        loads=forces.loads,
        supported=inverse_dynamics.find_judged_frames(dynamics, forces.contacts, cutoff_hz),
        about=about,
    )
