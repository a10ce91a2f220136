"""The study of Futamure et al. on virtual squatters, whose angles, lengths and inertia are known."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from scaling_service.capabilities.consistent import estimate, planar, recording
from scaling_service.capabilities.consistent.problem import ConsistentSettings
from scaling_service.capabilities.consistent.run import read
from scaling_service.capabilities.dynamics.settings import DynamicsSettings
from scaling_service.capabilities.kinetics.inverse_dynamics import ORDER
from scaling_service.capabilities.motion.inverse_kinematics import inverse_kinematics
from scaling_service.capabilities.shared.names import AS_IT_IS
from scaling_service.capabilities.shared.settings import UNSMOOTHED
from scaling_service.capabilities.subject.loading import open_subject
from scaling_service.core.arrays import Array
from scaling_service.core.progress import show_nothing
from scaling_service.documents.writing import code_version
from scaling_service.model.anatomy import inertia_planar
from scaling_service.model.body import BodyModel
from scaling_service.model.builtin import load_builtin
from scaling_service.model.inertia import gather_inertias
from scaling_service.numerics.signals.filters import filter_butterworth
from scaling_service.numerics.wrench import GRAVITY
from scaling_service.recording.settings import DYNAMICS_CUTOFF_HZ
from scaling_service.studies import claims
from scaling_service.studies.futamure import result as documents
from scaling_service.studies.futamure import squatters
from scaling_service.studies.futamure.claims import CLAIMS

TABLE = "winter2009"
"""What everybody's inertia is taken to be at first."""

PLACED_M = 0.007
"""As the virtual persons' markers are placed."""

SAGITTAL_ROWS = (0, 1, 5)
"""fx, fy, mz of the six components."""

_MM = 1e3

WAYS = ("classical", "consistent", "predicted")
"""Of explaining a recording. Predicted: the classical two steps with the model found, so that forces of the
recording played no part."""

FITTED_SHARE = 0.6
"""Of a real recording (chosen: three of five squats)."""


def study_squatter(seed: int, *, faults: float = 1.0) -> documents.SquatterEntry:
    """Record one person, explain the recordings, and compare with the truth.

    ``faults``: see :func:`make_virtual_squatter`.
    """
    person = squatters.make_virtual_squatter(seed, faults=faults)
    plane = planar.find_sagittal_plane(person.fitted.trial)
    model = start_model(person, plane)
    fitted, held_out = (make_recording(model, squats, plane) for squats in (person.fitted, person.held_out))
    clock = time.perf_counter()
    found = estimate.estimate_consistent(model, [fitted], [held_out], ConsistentSettings(placed_m=PLACED_M))
    seconds = time.perf_counter() - clock
    inertia = [compute_inertia_distance(m, person.model).tolist() for m in (model, found.model)]
    lengths = [_MM * (measure_lengths(m) - measure_lengths(person.model)) for m in (model, found.model)]
    rms = [
        _MM * np.sqrt((way[0].gaps.marker_gaps ** 2).sum(axis=2).mean(axis=0))
        for way in (found.classical, found.consistent)
    ]
    return documents.SquatterEntry(
        name=person.name,
        fitted=describe_recording(found, 0, person.fitted.truth.q),
        held_out=describe_recording(found, 1, person.held_out.truth.q),
        inertia_distance=(inertia[0], inertia[1]),
        length_error_mm=(lengths[0].tolist(), lengths[1].tolist()),
        marker_rms_mm={
            name: (round(a, 3), round(b, 3))
            for name, a, b in zip(fitted.motion.markers, *(r.tolist() for r in rms), strict=True)
        },
        loops=found.outer_iterations,
        converged=found.converged,
        seconds=round(seconds, 2),
    )


def describe_recording(
    found: estimate.ConsistentResult, k: int, truth: Array | None = None
) -> documents.RecordingEntry:
    """The errors of all ways in recording k, (fitted, held out).

    ``truth``: its angles, (n, 4), rad, where they are known.
    """
    ways = {}
    for name in WAYS:
        tracked = getattr(found, name)[k]
        apart = None if truth is None else np.degrees(tracked.rated.q - truth)
        ways[name] = documents.WayEntry(
            wrench_rmse=tracked.wrench_rmse[list(SAGITTAL_ROWS)].tolist(),
            marker_rms_mm=round(_MM * tracked.marker_rms_m, 3),
            angle_rmse_deg=[] if apart is None else np.sqrt((apart**2).mean(axis=0)).tolist(),
        )
    return documents.RecordingEntry(**ways)


def start_model(person: squatters.VirtualSquatter, plane: planar.SagittalPlane) -> BodyModel:
    """What a laboratory would start from: it knows the recording, the stature and what the plate bears."""
    sized = planar.scale_squat(
        load_builtin(inertia_planar.SQUAT), planar.in_plane(person.fitted.trial, plane)
    )
    borne = float(person.fitted.loads.total[:, 1].mean() / -GRAVITY[1])
    return inertia_planar.apply_to_squat(sized, TABLE, sex="M", height_m=person.height_m, mass_kg=borne).model


def make_recording(
    model: BodyModel, squats: squatters.Squats, plane: planar.SagittalPlane
) -> recording.ConsistentRecording:
    """Markers and filtered forces in the plane, and what inverse kinematics makes of the markers."""
    trial = planar.in_plane(squats.trial, plane)
    count = len(trial.times)
    loads = planar.project_loads(squats.loads, plane)

    def smooth(values: Array) -> Array:
        flat = values.reshape(len(values), -1)
        return filter_butterworth(
            flat, rate_hz=squatters.RATE_HZ, cutoff_hz=DYNAMICS_CUTOFF_HZ, order=ORDER
        ).values.reshape(values.shape)

    return recording.ConsistentRecording(
        trial=trial,
        motion=inverse_kinematics(model, trial),
        loads=dataclasses.replace(loads, force=smooth(loads.force), moment=smooth(loads.moment)),
        supported=np.ones(count, dtype=bool),
        about=np.zeros((count, 3)),
        components=recording.SAGITTAL,
    )


def compute_inertia_distance(model: BodyModel, truth: BodyModel) -> Array:
    """RMS distance of masses, centres of mass and moments of inertia from the truth, (3,), in tables' SDs."""
    ours, true = gather_inertias(model), gather_inertias(truth)
    moving = slice(1, None)
    gyration = np.sqrt(true.tensor[:, 2, 2] / true.mass)
    parts = (
        (ours.mass / true.mass - 1.0) / squatters.MASS_SD,
        (ours.com - true.com)[:, :2] / (squatters.COM_SD * gyration[:, None]),
        (ours.tensor[:, 2, 2] / true.tensor[:, 2, 2] - 1.0) / (2.0 * squatters.RADIUS_SD),
    )
    return np.array([np.sqrt(np.mean(part[moving] ** 2)) for part in parts])


def measure_lengths(model: BodyModel) -> Array:
    """Shank, thigh, trunk, (3,), m: how far each joint lies from the one before."""
    return np.array(
        [
            sum(j.law.constant_part for j in model.segment(child).joints if j.kind == "translation")
            for child in ("thigh", "torso", "arm")
        ]
    )


def reproduce_futamure(
    *,
    seed: int = 0,
    subjects: int | None = None,
    recordings: Sequence[str | Path] = (),
    worker_count: int | None = None,
    finished: claims.PersonDone | None = None,
) -> documents.FutamureDocument:
    """Explain squats of virtual persons in both ways, and ask what the paper claims.

    ``seed``: decides who the persons are. ``recordings``: subject files of real squats with forces, shown
    beside; .osim models are taken as they are. Results do not depend on ``worker_count``. InputError: no
    subject is asked for, or a real one cannot be used.
    """
    clock, count = time.perf_counter(), squatters.SUBJECTS if subjects is None else subjects
    real = [_study_real(Path(file)) for file in recordings]
    document = documents.FutamureDocument(
        source=CLAIMS.said["source"],
        code_version=code_version(),
        settings=dataclasses.asdict(ConsistentSettings()),
        seed=seed,
        persons=claims.study_persons(
            study_squatter, seed, count, worker_count=worker_count, finished=finished
        ),
        recordings=real,
        notes=[note.format(order=ORDER, cutoff_hz=DYNAMICS_CUTOFF_HZ) for note in CLAIMS.said["notes"]],
        wall_s=round(time.perf_counter() - clock, 3),
    )
    return CLAIMS.answer(document)


def _study_real(file: Path) -> documents.RealEntry:
    """A real person's first recording: its beginning fitted, its end held out."""
    loaded = open_subject(file, UNSMOOTHED)
    subject = loaded.session.subject
    given = subject.model.lower().endswith(".osim") and subject.static is None
    chosen = DynamicsSettings(start=AS_IT_IS if given else None)
    with loaded.blame_files():
        ready = read(loaded, chosen, UNSMOOTHED, progress=show_nothing)
        whole = ready.fitted[0]
        cut = int(FITTED_SHARE * len(whole.trial.times))
        parts = [whole.part(slice(0, cut), "fitted"), whole.part(slice(cut, None), "held out")]
        clock = time.perf_counter()
        found = estimate.estimate_consistent(ready.prepared.model, parts[:1], parts[1:], ready.settings)
    return documents.RealEntry(
        name=f"{subject.id} {whole.name}",
        model=Path(subject.model).name,
        start=ready.prepared.start,
        fitted=describe_recording(found, 0),
        held_out=describe_recording(found, 1),
        loops=found.outer_iterations,
        seconds=round(time.perf_counter() - clock, 2),
    )
