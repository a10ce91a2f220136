"""A squat in the sagittal plane: recordings projected, the planar model scaled by trigonometry."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping

import numpy as np

from scaling_service.capabilities.consistent import recording
from scaling_service.capabilities.dynamics import start
from scaling_service.capabilities.dynamics.settings import ForceSettings
from scaling_service.capabilities.kinetics.forces import gather_movement_forces
from scaling_service.capabilities.motion.inverse_kinematics import inverse_kinematics
from scaling_service.capabilities.shared.names import AS_IT_IS
from scaling_service.capabilities.subject.preparing import Loaded
from scaling_service.core import errors
from scaling_service.core.arrays import Array
from scaling_service.model import body
from scaling_service.model.anatomy import markers
from scaling_service.model.forces import SegmentLoads
from scaling_service.model.scaling import scale_model
from scaling_service.model.trial import Trial
from scaling_service.recording import plates

STANDING = "standing"
"""How the planar model is scaled: by the standing at the beginning (Futamure et al., section II.C.2)."""

TABLE = "winter2009"
"""The table that has the squat's own lumped segments."""

STANDING_S = 0.5
"""Of the standing at the beginning whose mean sizes the model (Futamure et al. take the first instant;
chosen: half a second averages noise and sway)."""

NEEDED = ("ANK", "KNE", "ASI", "PSI", "SHO")
"""Markers without which lengths cannot be found."""


@dataclasses.dataclass(frozen=True, slots=True)
class SagittalPlane:
    """Where the plane lies in the session's axes."""

    origin: body.Vector  # (3,) m: the middle of the ankle markers
    heading: float  # rad: turn about the vertical from X to where the person faces

    @property
    def rotation(self) -> Array:
        """Maps the session's axes to the plane's: x forward, y up, z to the right, (3, 3)."""
        c, s = np.cos(self.heading), np.sin(self.heading)
        return np.array([[c, 0.0, -s], [0.0, 1.0, 0.0], [s, 0.0, c]])


def join_sides(trial: Trial) -> Trial:
    """The planar model's markers as means of left and right, of a body in space or of the planar markers.

    NaN where a source is not seen. Markers without any source are left out.
    """
    found, names = dict[str, Array](), markers.PLANAR_SOURCES
    for name, sources in names.items():
        shown = [s for s in ((name,) if name in trial.labels else sources) if s in trial.labels]
        if len(shown) == len(sources) or name in trial.labels:
            found[name] = np.mean([trial.position(s) for s in shown], axis=0)
    missing = [name for name in NEEDED if name not in found]
    if missing:
        raise errors.TrialUnusable(
            f"the planar squat needs marker '{missing[0]}', the mean of {' and '.join(names[missing[0]])}",
            file=trial.name,
            field=missing[0],
            remedy="Map the labels under `markers:` in the subject file",
        )
    return dataclasses.replace(trial, labels=tuple(found), markers=np.stack(list(found.values()), axis=1))


def find_sagittal_plane(trial: Trial) -> SagittalPlane:
    """The plane of a squat from its standing at the beginning, seen by the planar markers."""
    ankle = _average_standing_place(trial, "ANK")
    facing = _average_standing_place(trial, "ASI") - _average_standing_place(trial, "PSI")
    return SagittalPlane(
        (float(ankle[0]), float(ankle[1]), float(ankle[2])), float(np.arctan2(-facing[2], facing[0]))
    )


def in_plane(trial: Trial, plane: SagittalPlane) -> Trial:
    """Markers in the plane, ankle at the origin; what leaves the plane is dropped."""
    turned = (trial.markers - np.array(plane.origin)) @ plane.rotation.T
    turned[..., 2] = np.where(np.isfinite(turned[..., 2]), 0.0, np.nan)
    return trial.with_markers(turned)


def project_loads(loads: SegmentLoads, plane: SagittalPlane) -> SegmentLoads:
    """The wrench of both feet together on the planar model's foot: force forward and up, moment about z."""
    total = loads.total
    force = total[:, :3] @ plane.rotation.T
    moment = (total[:, 3:] - np.cross(np.array(plane.origin), total[:, :3])) @ plane.rotation.T
    force[:, 2] = 0.0
    moment[:, :2] = 0.0
    return SegmentLoads(loads.times, ("foot",), force[:, None], moment[:, None])


def scale_squat(generic: body.BodyModel, trial: Trial) -> body.BodyModel:
    """The planar squat at a person's size, from the standing at the beginning of a squat in its plane.

    Shank, trunk and arm by the ratio of marker distances, thigh between the knee and where the trunk's
    markers show the hip. Markers are where the standing person shows them, those not seen at their scaled
    places.
    """
    seen = {
        name: _average_standing_place(trial, name)[:2]
        for name in trial.labels
        if name in generic.marker_names
    }
    own = {m.name: np.array(m.nominal)[:2] for m in generic.markers}
    measured, given = (
        [_measure_length(way) for way in (at["KNE"] - at["ANK"], at["SHO"] - 0.5 * (at["ASI"] + at["PSI"]))]
        for at in (seen, own)
    )
    size = {"shank": measured[0] / given[0], "torso": measured[1] / given[1]}
    trunk = [m.name for m in generic.markers if m.segment == "torso" and m.name in seen]
    # Turn and shift that bring points onto others best, in the plane
    local = size["torso"] * np.array([own[n] for n in trunk])
    there = np.array([seen[n] for n in trunk])
    a, b = local - local.mean(axis=0), there - there.mean(axis=0)
    angle = np.arctan2((a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]).sum(), (a * b).sum())
    flat = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    turn, hip = flat, there.mean(axis=0) - flat @ local.mean(axis=0)
    reach = {}
    for s in generic.segments:
        # Where a segment's joint sits in its parent, (2,), m
        shifts = [j for j in generic.segment(s.name).joints if j.kind == "translation"]
        total: Array = sum((np.array(j.axis) * j.law.constant_part for j in shifts), np.zeros(3))
        reach[s.name] = total[:2]
    size["thigh"] = _measure_length(hip - seen["KNE"]) / _measure_length(reach["torso"])
    shoulder = hip + size["torso"] * turn @ reach["arm"]
    frames = {
        "foot": (np.eye(2), np.zeros(2)),
        "shank": (_turn_onto(seen["KNE"]), np.zeros(2)),
        "thigh": (_turn_onto(hip - seen["KNE"]), seen["KNE"]),
        "torso": (turn, hip),
    }
    if "ELB" in seen:
        size["arm"] = _measure_length(seen["ELB"] - shoulder) / _measure_length(own["ELB"])
        frames["arm"] = (_turn_onto(shoulder - seen["ELB"]), shoulder)
    model = scale_model(generic, {name: (k, k, k) for name, k in size.items()})
    return model.with_markers(
        tuple(_place(m, seen, frames) if m.name in seen and m.segment in frames else m for m in model.markers)
    )


def _average_standing_place(trial: Trial, name: str) -> Array:
    rows = trial.times <= trial.times[0] + STANDING_S
    values = trial.position(name)[rows]
    values = values[np.isfinite(values).all(axis=1)]
    if not len(values):
        raise errors.TrialUnusable(
            f"marker '{name}' is not seen in the first {STANDING_S:g} s, where the person stands",
            file=trial.name,
            field=name,
            remedy="Begin the recording with quiet standing",
        )
    return np.asarray(values.mean(axis=0))


def _measure_length(vector: Array) -> float:
    return float(np.hypot(vector[0], vector[1]))


def _turn_onto(axis: Array) -> Array:
    """The turn that brings y onto an axis, (2, 2)."""
    x, y = axis / _measure_length(axis)
    return np.array([[y, x], [-x, y]])


def _place(
    marker: body.Marker, seen: Mapping[str, Array], frames: Mapping[str, tuple[Array, Array]]
) -> body.Marker:
    turn, origin = frames[marker.segment]
    x, y = turn.T @ (seen[marker.name] - origin)
    placed = body.Marker.at(marker.name, marker.segment, (float(x), float(y), 0.0), weight=marker.weight)
    return dataclasses.replace(placed, anatomical=marker.anatomical)


def prepare_squat(
    loaded: Loaded, chosen: ForceSettings
) -> tuple[start.Prepared, dict[str, recording.ConsistentRecording]]:
    """Project a subject's squats, scale the planar model, and follow the markers."""
    if chosen.start not in (None, AS_IT_IS):
        raise errors.SubjectInvalid(
            f"the planar squat is scaled by the standing at its beginning, not by {chosen.start}",
            field="--start",
            remedy="Leave it out",
        )
    axes, subject = loaded.orientation, loaded.session.subject
    assert axes is not None  # a session that was read has axes
    trials = {t.name: t for t in loaded.session.dynamic}
    planar: dict[str, tuple[Trial, SegmentLoads]] = {}
    for path, (source, raw) in gather_movement_forces(subject, loaded.plates).items():
        with errors.blame_file(path, [path]):
            # Labels of a body in space under the built-in models' names; those of the planar model stay.
            whole = trials[path.stem]
            wanted = {source for sources in markers.PLANAR_SOURCES.values() for source in sources}
            taken = set(whole.labels)
            names: dict[str, str] = {}
            for label in whole.labels:
                known = markers.find_canonical(label)
                if known in wanted and known not in taken and label not in markers.PLANAR_SOURCES:
                    names[label] = known
                    taken.add(known)
            trial = join_sides(whole.relabel(names))
            plane = find_sagittal_plane(trial)
        with errors.blame_file(source, [source]):
            forces = plates.synchronise(
                plates.orient_forces(axes, raw), trial.times, cutoff_hz=chosen.cutoff_hz
            )
        # all plates together; unknown where one of them is not known
        loads = SegmentLoads(forces.times, forces.plates, forces.force, forces.moment)
        planar[path.stem] = (in_plane(trial, plane), project_loads(loads, plane))
    standing, _ = next(iter(planar.values()))
    model = loaded.session.model if chosen.start == AS_IT_IS else scale_squat(loaded.session.model, standing)
    model, inertia, notes = start.with_inertia(model, subject, chosen.inertia or TABLE, scaled=True)
    motions = {name: inverse_kinematics(model, trial) for name, (trial, _) in planar.items()}
    recordings = {
        name: recording.ConsistentRecording(
            trial=trial,
            motion=motions[name],
            loads=loads,
            supported=np.asarray(np.isfinite(loads.total).all(axis=1)),
            about=np.zeros((len(trial.times), 3)),
            components=recording.SAGITTAL,
        )
        for name, (trial, loads) in planar.items()
    }
    prepared = start.Prepared(
        loaded=loaded,
        start=chosen.start or STANDING,
        inertia=inertia,
        model=model,
        motions=motions,
        forces={},
        calibration=None,
        warnings=(*loaded.session.warnings, *notes),
    )
    return prepared, recordings
