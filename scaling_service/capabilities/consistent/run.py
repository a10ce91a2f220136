"""Dynamically consistent motion of a subject's recordings, from the subject file to results in memory."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from scaling_service.capabilities.consistent import planar
from scaling_service.capabilities.consistent.estimate import ConsistentResult, TrackedRecording
from scaling_service.capabilities.consistent.estimate import estimate_consistent as identify
from scaling_service.capabilities.consistent.problem import ConsistentSettings
from scaling_service.capabilities.consistent.recording import ConsistentRecording
from scaling_service.capabilities.dynamics import start
from scaling_service.capabilities.dynamics.settings import ForceSettings
from scaling_service.capabilities.dynamics.weight import weigh_motions
from scaling_service.capabilities.kinetics import inverse_dynamics
from scaling_service.capabilities.shared import settings as shared_settings
from scaling_service.capabilities.subject import loading
from scaling_service.core import progress as progressing
from scaling_service.core.errors import TrialUnusable
from scaling_service.model import inertia
from scaling_service.model.anatomy.inertia_planar import SQUAT
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


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class ConsistentResults:
    """What the loop made of a subject."""

    prepared: start.Prepared  # its model has the mass that the plates bear
    chosen: ForceSettings
    settings: shared_settings.Settings
    recordings: tuple[ConsistentRecording, ...]  # fitted ones, then held-out ones, in the order of ``result``
    fitted: int  # how many were fitted
    result: ConsistentResult
    warnings: tuple[str, ...]
    wall_s: float = 0.0

    @property
    def tracked(self) -> Iterator[tuple[ConsistentRecording, dict[str, TrackedRecording]]]:
        """Every recording, and how it is explained in each of the three ways."""
        for k, recording in enumerate(self.recordings):
            yield recording, {way: tracked[k] for way, tracked in self.result.ways.items()}


def consistent(
    subject: Subject | str | Path,
    chosen: ForceSettings = ForceSettings(),
    settings: shared_settings.Settings = shared_settings.UNSMOOTHED,
    *,
    progress: progressing.Progress | None = None,
) -> ConsistentResults:
    """Find the motion, geometry and inertia that a subject's markers and ground forces agree on.

    ``subject`` Subject or path of a subject file: calibration trials with forces are fitted, evaluation
        trials with forces are held out.
    ``chosen``: its start, inertia and cutoff.
    Raises InputError: whatever in the subject file, the model, the recordings or their forces cannot be used.
    """
    clock = time.perf_counter()
    report = progress or progressing.show_nothing
    loaded = loading.open_subject(subject, settings, facing=True)
    with loaded.blame_files():
        ready = read(loaded, chosen, settings, progress=progressing.report_part(report, 0.0, _PREPARING))
        result = identify(
            ready.prepared.model,
            ready.fitted,
            ready.held_out,
            ready.settings,
            progress=lambda what: report(what, _FINDING),
        )
    report("done", 1.0)
    return ConsistentResults(
        prepared=ready.prepared,
        chosen=chosen,
        settings=settings,
        recordings=(*ready.fitted, *ready.held_out),
        fitted=len(ready.fitted),
        result=result,
        warnings=tuple(dict.fromkeys((*ready.prepared.warnings, *ready.notes, *result.inertial.warnings))),
        wall_s=time.perf_counter() - clock,
    )


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Ready:
    """Recordings to fit and to hold out, the model to start from, and what was decided on the way."""

    prepared: start.Prepared
    fitted: tuple[ConsistentRecording, ...]
    held_out: tuple[ConsistentRecording, ...]
    settings: ConsistentSettings
    notes: tuple[str, ...]


def read(
    loaded: loading.Loaded,
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
    changed = replace(prepared, model=scale_model(prepared.model, {}, mass_kg=mass))
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
    result = np.tile(middle.mean(axis=0), (len(dynamics.motion.q), 1))
    result[known] = middle
    return ConsistentRecording(
        trial=trial,
        motion=motion,
        loads=forces.loads,
        supported=inverse_dynamics.find_judged_frames(dynamics, forces.contacts, cutoff_hz),
        about=result,
    )
