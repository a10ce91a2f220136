"""Hip centres and knee axes from functional movements, in the posture in which a person is measured.

The pose of every segment comes from its own markers, three or more; the hip centre is the point that pelvis
and thigh share (SCoRE), the knee axis the line that thigh and shank share (SARA). Everything is
expressed in ground in one posture, the standing one: the segments' poses are motions away from it.
"""

from __future__ import annotations

import dataclasses
from collections import abc

import numpy as np

from scaling_service.capabilities.scaling.methods import placement
from scaling_service.capabilities.shared.settings import CalibrationSettings
from scaling_service.core import errors
from scaling_service.core.arrays import Array
from scaling_service.core.names import say_name
from scaling_service.core.text import list_few
from scaling_service.model import parameters
from scaling_service.model import poses as posing
from scaling_service.model.anatomy.centres import Points
from scaling_service.model.anatomy.frames import build_femur_frame
from scaling_service.model.body import BodyModel, to_vector
from scaling_service.model.subject import Session
from scaling_service.model.trial import Trial
from scaling_service.numerics.least_squares import problem
from scaling_service.numerics.multibody import functional, rigid

FOREIGN_M = 0.03
"""RMS misfit of a cluster beyond which a label is another marker's. Chosen: skin deforms a segment's
markers by 4 to 16 mm (fluoroscopy of six knees, PMC8631460); exchanged epicondyles leave 40 mm and more."""

HIP_RANGE_DEG = 20.0
"""About two directions, for a hip moved in one plane has a line of centres. The least range of motion for
which an accuracy was published (Ehrig 2006, abstract: 1.2 mm with 1 mm of noise on every marker)."""

KNEE_RANGE_DEG = 45.0
"""Half of the 90 deg at which axes were found within 1 mm (Ehrig 2007, abstract), chosen: the error of a
direction falls with the range, and from 45 deg on most methods agree on a centre (Ehrig 2006)."""

SHARPEST = 0.5
"""Chosen: ratio of the two smallest singular values beyond which no direction stands out as an axis."""


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class Cluster:
    """The markers of one segment where they are in the posture: ``local`` is (n_markers, 3), m."""

    segment: str
    labels: tuple[str, ...]
    local: Array

    def poses(self, trial: Trial) -> functional.Poses:
        """How the segment has moved since the posture.

        NaN in frames that show fewer than three of its markers, or markers that do not fit each other.

        Soderkvist & Wedin 1993, J Biomech 26:1473-1477.
        """
        measured = trial.select(self.labels).markers
        rotation, position = rigid.fit_rigid(self.local, measured)
        gaps = np.einsum("nij,mj->nmi", rotation, self.local) + position[:, None] - measured
        squared = np.where(problem.find_seen(gaps), (gaps**2).sum(axis=2), 0.0).sum(axis=1)
        foreign = squared > FOREIGN_M**2 * np.maximum(problem.find_seen(gaps).sum(axis=1), 1)
        rotation[foreign], position[foreign] = np.nan, np.nan
        return functional.Poses(rotation, position)

    def list_shown(self, trials: abc.Iterable[Trial]) -> tuple[str, ...]:
        """Those of its labels that at least one of the trials shows."""
        found = {label for trial in trials for label in trial.shown_labels}
        return tuple(label for label in self.labels if label in found)


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class Posture:
    """A person in one posture.

    ``points``: label to its place in ground, (3,), m.
    ``carriers``: segment to the labels on it.
    """

    points: abc.Mapping[str, Array]
    carriers: abc.Mapping[str, tuple[str, ...]]

    @classmethod
    def of(
        cls, model: BodyModel, extra: abc.Mapping[str, str], static: Trial | None, trials: abc.Sequence[Trial]
    ) -> Posture:
        """The mean of the static trial; without one, the frame of the others that shows most markers.

        ``extra``: further labels, and the segment that each sits on.
        """
        carriers: dict[str, list[str]] = {}
        for marker in model.markers:
            if marker.weight > 0.0:
                carriers.setdefault(marker.segment, []).append(marker.name)
        for label, segment in extra.items():
            if label not in model.marker_names:
                carriers.setdefault(segment, []).append(label)
        labels = [label for own in carriers.values() for label in own]
        if static is not None:
            places = static.select(labels).markers
        else:
            nowhere = np.full((1, len(labels), 3), np.nan)
            places = np.concatenate([nowhere, *(t.select(labels).markers for t in trials)])
            fullest = int(np.argmax(problem.find_seen(places).sum(axis=1)))
            places = places[fullest : fullest + 1]
        shown = problem.find_shown(places)
        points = {label: np.nanmean(places[:, k], axis=0) for k, label in enumerate(labels) if shown[k]}
        return cls(
            points, {name: tuple(label for label in own if label in points) for name, own in carriers.items()}
        )

    def cluster(self, segment: str) -> Cluster:
        """The markers of a segment; it may be too few of them."""
        labels = self.carriers.get(segment, ())
        return Cluster(segment, labels, np.array([self.points[label] for label in labels]).reshape(-1, 3))

    def as_trial(self) -> Trial:
        """The posture as a recording of one frame."""
        labels = tuple(self.points)
        places = np.array([self.points[label] for label in labels]).reshape(1, -1, 3)
        return Trial(name="posture", times=np.zeros(1), labels=labels, markers=places, rate_hz=1.0)


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class FunctionalJoints:
    """What functional movements say of a person's joints.

    ``posture``: in which centres and axes are given.
    ``hips``: ``r`` or ``l`` to the hip centre, (3,), m, of the pelvis.
    ``knees``: ``r`` or ``l`` to the knee axis of the thigh, unit (3,), either way round.
    ``notes``: how each was found, and why others were not.
    """

    posture: Posture
    hips: abc.Mapping[str, Array] = dataclasses.field(default_factory=dict)
    knees: abc.Mapping[str, Array] = dataclasses.field(default_factory=dict)
    notes: tuple[str, ...] = ()


class _NotFound(Exception):
    """Why a joint's centre or axis was not taken."""


def _find_both_sides(
    joint: str, posture: Posture, trials: abc.Sequence[Trial]
) -> tuple[abc.Mapping[str, Array], list[str]]:
    """What is found by side, and how; refused where neither side gives anything."""
    find, what, instead = (
        (_find_hip, "functional centre", "the regression")
        if joint == "hip"
        else (_find_knee, "functional axis", "the epicondyles")
    )
    found: dict[str, Array] = {}
    notes, reasons = list[str](), list[str]()
    for side in "rl":
        try:
            found[side], trials_used = find(posture, trials, side)
            notes.append(f"MB: {say_name(f'{joint}_{side}')}: {what} from {trials_used}")
        except _NotFound as why:
            reasons.append(f"{say_name(f'{joint}_{side}')}: {why}")
            notes.append(f"MB: {say_name(f'{joint}_{side}')}: no {what}, {instead} in its place: {why}")
    if not found:
        raise errors.TrialUnusable(
            f"no {what} of a {joint} can be found: {'; '.join(reasons)}",
            field="trials.calibration",
            remedy=f"Give functional movements of the {joint} and three markers on each segment "
            f"(`extra_markers:`), or take {instead}",
        )
    return found, notes


def _find_hip(posture: Posture, trials: abc.Sequence[Trial], side: str) -> tuple[Array, str]:
    limits = (HIP_RANGE_DEG, HIP_RANGE_DEG)
    first, second, trials_used = _select_moving(posture, trials, "pelvis", f"femur_{side}", limits)
    found = functional.find_rotation_centre(first, second)
    return found.proximal, (
        f"{trials_used}; both images of it lie {1e3 * found.rms:.1f} mm apart (RMS), "
        f"standard deviation at least {1e3 * found.sd:.1f} mm"
    )


def _find_knee(posture: Posture, trials: abc.Sequence[Trial], side: str) -> tuple[Array, str]:
    first, second, trials_used = _select_moving(
        posture, trials, f"femur_{side}", f"tibia_{side}", (KNEE_RANGE_DEG,)
    )
    found = functional.find_rotation_axis(first, second)
    if not found.sharpness < SHARPEST:
        raise _NotFound(f"no axis stands out in {trials_used}")
    return found.proximal, (
        f"{trials_used}; its direction in thigh and shank differs by {np.degrees(found.spread):.1f} deg (RMS)"
    )


def _select_moving(
    posture: Posture, trials: abc.Sequence[Trial], proximal: str, distal: str, limits_deg: abc.Sequence[float]
) -> tuple[functional.Poses, functional.Poses, str]:
    """Poses of both segments in the trials in which the joint moves enough, and which these are."""
    clusters = []
    for segment in (proximal, distal):
        cluster = posture.cluster(segment)
        shown = cluster.list_shown(trials)
        if len(shown) < rigid.MIN_POINTS:
            said = f" ({', '.join(shown)})" if shown else ""
            raise _NotFound(
                f"{say_name(cluster.segment)} carries {len(shown)} markers that the static trial (or its "
                f"stand-in) and the movements both show{said}, and its pose needs {rigid.MIN_POINTS}"
            )
        clusters.append(cluster)
    names, kept, best = [], [], np.zeros(len(limits_deg))
    for trial in trials:
        poses = clusters[0].poses(trial), clusters[1].poses(trial)
        turned = np.degrees(np.nan_to_num(functional.measure_ranges_of_motion(*poses)))[: len(limits_deg)]
        best = np.maximum(best, turned)
        if (turned >= limits_deg).all():
            used = int((poses[0].known & poses[1].known).sum())
            names.append(f"'{trial.name}' ({_describe_angles(turned)}, {used} of {trial.n_frames} frames)")
            kept.append(poses)
    if not kept:
        raise _NotFound(
            f"it turns by at most {_describe_angles(best)} in a calibration trial, "
            f"and {_describe_angles(limits_deg)} are needed"
        )
    return (
        functional.join_poses([p for p, _ in kept]),
        functional.join_poses([d for _, d in kept]),
        list_few(names),
    )


def _describe_angles(values_deg: abc.Sequence[float] | Array) -> str:
    return f"{' and '.join(f'{v:.0f}' for v in values_deg)} deg"


def find_functional_joints(session: Session, settings: CalibrationSettings) -> FunctionalJoints | None:
    """Hip centres and knee axes from the session's movements, None where the settings do not ask for them.

    A side that its recordings do not determine is left out, with the reason among the notes.

    Raises SubjectInvalid: an ``.osim`` file or another model that keeps its own joints.
    Raises TrialUnusable: nothing of what was asked for can be found on either side.
    """
    if not settings.uses_movements:
        return None
    names = session.model.segment_names
    own_file = session.subject.model.lower().endswith(".osim")
    if own_file or not any({"pelvis", f"femur_{s}", f"tibia_{s}"} <= set(names) for s in "rl"):
        raise errors.SubjectInvalid(
            "functional hip centres and knee axes are for built-in leg models: the joints of another model "
            "stay where it has them",
            field="model",
            remedy="Choose a built-in leg model, or take regression and epicondyles",
        )
    posture = Posture.of(session.model, session.subject.extra_markers, session.static, session.calibration)
    found: dict[str, abc.Mapping[str, Array]] = {"hip": {}, "knee": {}}
    notes = list[str]()
    for joint, how in (("hip", settings.hip_centre), ("knee", settings.knee_axis)):
        if how == "functional":
            found[joint], more = _find_both_sides(joint, posture, session.calibration)
            notes += more
    return FunctionalJoints(posture, found["hip"], found["knee"], tuple(notes))


def with_functional(
    model: BodyModel, joints: FunctionalJoints, points: Points, settings: CalibrationSettings
) -> tuple[BodyModel, dict[str, parameters.Tilt], tuple[str, ...]]:
    """The scaled model with its joints where the movements have them.

    A hip centre is put where it lies among the pelvis' markers, fitted as inverse kinematics fits
    them. A knee axis is taken in the thigh's frame of the ISB, which is the built-in models'.

    ``points``: landmarks and hip centres in the posture, (1, 3) each, m.
    Returns ``tilts``: knee to the turns of its axis about x and y of the thigh, rad; ``notes``: axes that
        were not believed.
    """
    notes = []
    for side, centre in joints.hips.items():
        cluster, values = joints.posture.cluster("pelvis"), posing.list_model_values(model)
        known = [name for name in cluster.labels if name in model.marker_names]
        local = [posing.evaluate_marker(model.marker(name), values) for name in known]
        rotation, position = rigid.fit_rigid(
            np.array(local), np.array([joints.posture.points[n] for n in known])
        )
        model = placement.with_centre(model, f"femur_{side}", to_vector(rotation.T @ (centre - position)))
    tilts: dict[str, parameters.Tilt] = {}
    for side, axis in joints.knees.items():
        joint = model.segment(f"tibia_{side}").joint_name
        try:
            tilts[joint] = _tilt(points, axis, side, settings)
            model = placement.with_axis(model, joint, tilts[joint])
        except _NotFound as doubt:
            notes.append(f"MB: {say_name(joint)}: the epicondyles in its place: {doubt}")
    return model, tilts, tuple(notes)


def _tilt(points: Points, axis: Array, side: str, settings: CalibrationSettings) -> parameters.Tilt:
    """The axis' turns about x and y of the thigh, if they are believed."""
    names = [f"hip_{side}", f"{side.upper()}LFE", f"{side.upper()}MFE"]
    missing = [name for name in names if name not in points or not np.isfinite(points[name]).all()]
    if missing:
        raise _NotFound(f"{', '.join(missing)} not known in the posture, so the thigh has no frame")
    hip, lateral, medial = (points[name] for name in names)
    femur = build_femur_frame(hip, lateral, medial, "r" if side == "r" else "l")
    direction = femur.rotation[0].T @ axis
    tilt = parameters.tilt_of(direction if direction[2] > 0.0 else -direction)
    x, y = np.degrees(tilt)
    if abs(x) > settings.axis_bound_x_deg or abs(y) > settings.axis_bound_y_deg:
        raise _NotFound(
            f"the functional axis is turned by {x:.0f} deg about x and {y:.0f} deg about y, more than any "
            "person's"
        )
    return tilt
