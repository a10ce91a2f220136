"""The points that lengths are measured between, on a person and on a model."""

from __future__ import annotations

from collections import abc
from dataclasses import dataclass, field, replace
from itertools import pairwise
from types import MappingProxyType

import numpy as np

from scaling_service.capabilities.scaling.methods.functional import FunctionalJoints
from scaling_service.core.arrays import Array
from scaling_service.model import body
from scaling_service.model.anatomy import centres as anatomy_centres
from scaling_service.model.anatomy import lengths
from scaling_service.model.anatomy import markers as anatomy_markers
from scaling_service.model.anatomy.hip_centre import solve_chord_centre
from scaling_service.model.poses import pose_neutral_frames
from scaling_service.model.trial import Trial

_MIDDLES: abc.Mapping[str, tuple[str, str]] = MappingProxyType(
    {"knee": ("LFE", "MFE"), "ankle": ("LM", "MM")}
)
"""Joints whose centre is measured at the middle of two landmarks, lateral and medial, on model and person."""

UNKNOWN_SIZES = anatomy_centres.BodySizes()
"""Nothing but markers."""

_NOTHING: anatomy_centres.Points = MappingProxyType({})
Places = abc.Mapping[str, str | None]
"""Markers to the landmarks that they are by where the model has them; None: not what their name says."""

NO_PLACES: Places = MappingProxyType({})

HANGING = np.cos(np.radians(45.0))
"""Cosine between upper arm and trunk from which an arm hangs (chosen: beyond some 30 deg of elevation a third
of it is the shoulder blade's, Inman, Saunders & Abbott 1944, and carries the acromion along)."""

_PELVIC = ("RASIS", "LASIS", "RPSIS", "LPSIS", "SACR")

_ABOVE_M: abc.Mapping[str, float] = MappingProxyType({"knee": 0.0, "ankle": 0.013})
"""Chosen: how far up the leg the middle of epicondyles or malleoli lies from the centre of the joint: the
prominent points of the malleoli are 12 to 15 mm above the centre of the talus."""

_MODEL_LANDMARK_SD_M = 0.008
"""Chosen, along the leg: the epicondyles' middle lies 4, 8 and -8 mm above the knee in Rajagopal's, OpenCap's
and OpenSim's gait2354 model, that of the malleoli 11, 17 and 31 mm above the ankle."""

_SAME_M = 0.001  # chosen: far more than rounding


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class PersonPoints:
    """Landmarks of one recording, and the joint centres that they give.

    ``landmarks``: canonical name to trajectory, (n_frames, 3), m.
    ``regression``: of the hip centres.
    ``standing``: whether the person stands still; in movement skin moves.
    ``scale``: the person's size over that of the adults on whom palpation was studied.
    ``hips``: hip centres that are known better than by regression.
    ``centres``: ``hip_r``, ``knee_r``, ``ankle_r`` and the left ones.
    """

    landmarks: anatomy_centres.Points
    sizes: anatomy_centres.BodySizes
    regression: str
    standing: bool
    scale: float = 1.0
    hips: anatomy_centres.Points = field(default_factory=lambda: _NOTHING)
    centres: abc.Mapping[str, anatomy_centres.Centre] = field(default_factory=lambda: MappingProxyType({}))

    @property
    def points(self) -> anatomy_centres.Points:
        """Landmarks and centres alike."""
        return name_points(self.landmarks, self.centres)


def name_points(
    landmarks: anatomy_centres.Points, centres: abc.Mapping[str, anatomy_centres.Centre]
) -> anatomy_centres.Points:
    """Landmarks and centres in one mapping, with a missing PSIS as the other's mirror image.

    An ankle is there also by how it was found, such as ``ankle_r_middle``.
    """
    named = {name: centre.at for name, centre in centres.items()}
    kinds = {
        f"{name}_{c.kind}": c.at
        for name, c in centres.items()
        if name.startswith("ankle") and "chord" not in name
    }
    return {**anatomy_centres.with_mirrored_psis(landmarks), **named, **kinds}


def find_person_points(
    trial: Trial,
    *,
    standing: bool,
    regression: str,
    sizes: anatomy_centres.BodySizes = UNKNOWN_SIZES,
    joints: FunctionalJoints | None = None,
    scale: float = 1.0,
    places: Places = NO_PLACES,
) -> PersonPoints:
    """Landmarks of a recording by canonical name, with the joint centres.

    ``places``: labels to landmarks, where names do not tell them.
    ``standing``: only a standing trial gives the leg length that the fuller regressions use, where it was not
        measured.
    ``regression``: gives the hip centres that ``joints`` does not.
    ``scale``: see :class:`PersonPoints`.
    """
    landmarks = without_raised_shoulders(read_landmarks(trial, places))
    if standing:
        sizes = sizes.with_leg_lengths(measure_standing_legs(landmarks))
    hips: dict[str, Array] = {}
    if joints is not None:  # hip centres carried by the pelvis' markers through the trial
        pelvis = joints.posture.cluster("pelvis").poses(trial)
        hips = {f"hip_{side}": pelvis.place(hip) for side, hip in joints.hips.items()}
    centres = anatomy_centres.construct_centres(landmarks, sizes, regression, hips=hips)
    return PersonPoints(
        landmarks=landmarks,
        sizes=sizes,
        regression=regression,
        standing=standing,
        scale=scale,
        hips=hips,
        centres=centres,
    )


def read_landmarks(trial: Trial, places: Places = NO_PLACES) -> dict[str, Array]:
    """A recording's landmarks by canonical name; other labels by their own, in capitals, no prefix."""
    points: dict[str, Array] = {}
    for label in trial.labels:
        if (name := places.get(label, _name(label))) is not None:
            points.setdefault(name, trial.position(label))
    return points


def without_raised_shoulders(points: anatomy_centres.Points) -> dict[str, Array]:
    """The landmarks, an acromion only while its arm hangs: with raised arms it rises and draws inwards.

    In one person's T pose the acromia stand 61 to 74 mm nearer to each other than in walking, and 50 to 65 mm
    nearer to the elbows. Where elbows or pelvis are not marked, nothing is taken away.
    """
    shoulders = [points[name] for name in ("RSHO", "LSHO") if name in points]
    pelvic = [points[name] for name in _PELVIC if name in points]
    kept = dict(points)
    if not (shoulders and pelvic):
        return kept
    down = np.mean(pelvic, axis=0) - np.mean(shoulders, axis=0)
    for side in "RL":
        shoulder, elbow = points.get(f"{side}SHO"), points.get(f"{side}ELB")
        if shoulder is not None and elbow is not None:
            arm = elbow - shoulder
            reach = np.linalg.norm(arm, axis=1) * np.linalg.norm(down, axis=1)
            raised = np.einsum("ni,ni->n", arm, down) < HANGING * reach
            kept[f"{side}SHO"] = np.where(raised[:, None], np.nan, shoulder)
    return kept


def _name(label: str) -> str:
    return anatomy_markers.find_canonical(label) or anatomy_markers.strip_prefix(label).upper()


def measure_standing_legs(points: anatomy_centres.Points) -> dict[str, float]:
    """ASIS to medial malleolus by side, means over the frames that show both (m).

    Past the middle of the knee where both epicondyles are there, for not everybody can stand straight.
    """
    found = {}
    for side in "rl":
        asis, lateral, medial, malleolus = (
            points.get(f"{side.upper()}{name}") for name in ("ASIS", "LFE", "MFE", "MM")
        )
        if asis is None or malleolus is None:
            continue
        bend = [] if lateral is None or medial is None else [(lateral + medial) / 2.0]
        way = pairwise([asis, *bend, malleolus])
        distance = np.sum([np.linalg.norm(one - other, axis=1) for one, other in way], axis=0)
        if np.isfinite(distance).any():
            found[side] = float(np.nanmean(distance))
    return found


def find_model_points(model: body.BodyModel, places: Places = NO_PLACES) -> anatomy_centres.Points:
    """The same points on the model in its neutral pose, one frame."""
    points: dict[str, Array] = {}
    frames = pose_neutral_frames(model)
    for marker in model.markers:
        rotation, origin = frames[marker.segment]
        if (name := places.get(marker.name, _name(marker.name))) is not None:
            points.setdefault(name, (origin + rotation @ np.array(marker.nominal))[None])
    if "SACR" not in points and {"RPSIS", "LPSIS"} <= points.keys():
        points["SACR"] = (points["RPSIS"] + points["LPSIS"]) / 2.0
    own = lengths.find_joint_centres(model)
    for side in "rl":
        femur = lengths.find_segment(model, "femur", side)
        if femur is not None:
            points[f"hip_{side}"] = frames[femur][1][None]
        for joint, landmarks in _MIDDLES.items():
            ends = [points.get(f"{side.upper()}{landmark}") for landmark in landmarks]
            if ends[0] is not None and ends[1] is not None:
                points[f"{joint}_{side}"] = (ends[0] + ends[1]) / 2.0
            elif f"{joint}_{side}" in own:
                segment, at = own[f"{joint}_{side}"]
                rotation, origin = frames[segment]
                points[f"{joint}_{side}"] = (origin + rotation @ np.array(at))[None]
        points |= _place_ankles(points, side)
    return points


def find_doubtful_joints(model: body.BodyModel, points: anatomy_centres.Points) -> dict[str, float]:
    """Knees and ankles (``knee_r``) that a model does not have in the middle of its landmarks; deviations, m.

    ``points``: the model's. Landmarks are put on a model by eye: they show the lengths of its bones to some
    millimetres along the leg, and no better than they lie where a person's do.
    """
    frames, found = pose_neutral_frames(model), {}
    for name, (segment, at) in lengths.find_joint_centres(model).items():
        above = _ABOVE_M.get(name.partition("_")[0])
        if above is not None and name in points:
            rotation, origin = frames[segment]
            apart = points[name][0] - (origin + rotation @ np.array(at))
            if np.linalg.norm(apart) > _SAME_M:
                found[name] = max(_MODEL_LANDMARK_SD_M, abs(float(apart[1]) - above))
    return found


def _place_ankles(points: anatomy_centres.Points, side: str) -> anatomy_centres.Points:
    """A model's ankle as it would be found between the malleoli, and from the lateral one."""
    ankle, knee = points.get(f"ankle_{side}"), points.get(f"knee_{side}")
    if ankle is None:
        return {}
    lateral = points.get(f"{side.upper()}LM")
    chord = None
    if lateral is not None and knee is not None:
        chord = solve_chord_centre(
            knee, lateral, 2.0 * lateral - ankle, np.linalg.norm(lateral - ankle, axis=1)
        )
        chord = anatomy_centres.lift_ankle(chord, knee)
    return {
        f"ankle_{side}_middle": ankle,
        f"ankle_{side}_chord": ankle if chord is None or not np.isfinite(chord).all() else chord,
    }


def with_sacrum(model: body.BodyModel, trials: abc.Iterable[Trial]) -> body.BodyModel:
    """The model with a sacral marker half-way between its PSIS, where recordings show one and no PSIS.

    It takes the name of the label; a model that has such a marker is left as it is.
    """
    shown = {label for trial in trials for label in trial.shown_labels}
    landmarks = {anatomy_markers.find_canonical(label) for label in shown}
    marked = {anatomy_markers.find_canonical(m.name): m for m in model.markers}
    labels = [label for label in shown if anatomy_markers.find_canonical(label) == anatomy_markers.SACRUM]
    if (
        not labels
        or landmarks & {"RPSIS", "LPSIS"}
        or anatomy_markers.SACRUM in marked
        or not {"RPSIS", "LPSIS"} <= marked.keys()
    ):
        return model
    right, left = marked["RPSIS"], marked["LPSIS"]
    between = body.to_vector(np.add(right.nominal, left.nominal) / 2.0)
    new = body.Marker.at(sorted(labels)[0], right.segment, between, weight=right.weight)
    return model.with_markers((*model.markers, new))


def with_virtual_landmarks(trial: Trial, centres: abc.Mapping[str, anatomy_centres.Centre]) -> Trial:
    """The trial as a model is posed by it: landmarks that it does not show added, raised shoulders left out.

    Medial epicondyles and malleoli are the lateral ones, mirrored at the joint's centre.

    ``trial``: a standing trial.
    ``centres``: ``knee_r`` … in the frames of this trial.
    """
    at = without_raised_shoulders(read_landmarks(trial))
    # The trial with some landmarks where these points are
    points: dict[str, Array] = {name: at[name] for name in ("RSHO", "LSHO") if name in at}
    markers = trial.markers.copy()
    for k, label in enumerate(trial.labels):
        if _name(label) in points:
            markers[:, k] = points[_name(label)]
    trial = replace(trial, markers=markers)
    seen_once = {_name(label) for label in trial.shown_labels}
    at = {name: position for name, position in at.items() if name in seen_once}
    added: dict[str, Array] = {}
    for joint, (lateral, medial) in _MIDDLES.items():
        for side in "rl":
            outer, inner = f"{side.upper()}{lateral}", f"{side.upper()}{medial}"
            centre = centres.get(f"{joint}_{side}")
            if centre is not None and len(centre.at) == trial.n_frames and outer in at and inner not in at:
                added[inner] = 2.0 * centre.at - at[outer]
    if not added:
        return trial
    kept = [k for k, label in enumerate(trial.labels) if label not in added]
    return replace(
        trial,
        labels=(*(trial.labels[k] for k in kept), *added),
        markers=np.concatenate([trial.markers[:, kept], np.stack([*added.values()], axis=1)], axis=1),
    )
