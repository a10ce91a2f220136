"""Image-based scaling of an OpenSim model: its own segments and joints brought onto the person's bones.

Thigh and shank take one factor each, so that the distance between their joint centres is the image's, and are
laid into the image by them: the thigh by hip, knee and flexion axis, the shank by the knee's own law to where
the ankle shows. The pelvis takes a factor along each of its axes (:mod:`.imaged_pelvis`). What factors cannot
do, a joint is moved or turned for.
Segments without a bone stay as markers have them.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping

import numpy as np
import scipy

from scaling_service.capabilities.scaling.methods import imaged_pelvis
from scaling_service.capabilities.scaling.sizes.sizing import find_dimension
from scaling_service.core.errors import SubjectInvalid
from scaling_service.model import body
from scaling_service.model import poses as posing
from scaling_service.model.anatomy.bones import find_body
from scaling_service.model.anatomy.lengths import find_joint_ends, find_segment, list_chain
from scaling_service.model.results import JointMove
from scaling_service.model.scaling import scale_model
from scaling_service.model.trial import ImageEvidence, ImagePose
from scaling_service.numerics.multibody import rigid
from scaling_service.numerics.multibody.laws import Array

MOST_BENT = 0.6  # chosen: rad; beyond it a knee in the image is bent too far for a standing or lying person


@dataclasses.dataclass(slots=True)
class Registration:
    """A model on its way onto the bones of an image."""

    model: body.BodyModel
    # ratios: segment to its sizes over the model's before; poses: segment to where it lies in the image
    ratios: dict[str, body.Vector] = dataclasses.field(default_factory=dict)
    poses: dict[str, ImagePose] = dataclasses.field(default_factory=dict)
    moves: dict[str, JointMove] = dataclasses.field(default_factory=dict)

    def resize(self, ratios: Mapping[str, body.Vector]) -> None:
        """Multiply segments' sizes, and those of what belongs to them, as the patella to the thigh."""
        spread = dict(ratios)
        for segment in self.model.segments:
            own, carried = (find_dimension(self.model.bone_of(s)) for s in (segment.name, segment.parent))
            alike = own in (None, carried)
            if segment.name not in spread and segment.parent in spread and alike:
                spread[segment.name] = spread[segment.parent]
        self.model = scale_model(self.model, spread)
        self.ratios |= {
            name: body.to_vector(np.multiply(self.ratios.get(name, 1.0), ratio))
            for name, ratio in spread.items()
        }

    def shift(self, segment: body.Segment, by: Array) -> None:
        """Move the centre of the joint that carries a segment, m, in its parent's frame."""
        self._rejoint(segment, (*_make_shifts(by), *segment.joints), shift=body.to_vector(by))

    def turn_child(self, segment: body.Segment, turn: Array, pivot: Array) -> None:
        """Turn a segment against the joint that carries it, about a point of its own.

        ``turn``: a rotation vector, rad. ``pivot``: m. Both in the segment's frame.
        """
        angle = float(np.linalg.norm(turn))
        if angle == 0.0:
            return
        rotation = rigid.convert_vector_to_rotation(turn)
        about = body.Joint("rotation", body.to_vector(turn / angle), body.Law.constant(angle))
        shift = pivot - rotation @ pivot
        joints = (*segment.joints, *_make_shifts(shift), about)
        self._rejoint(segment, joints, child_turn=body.to_vector(turn), child_shift=body.to_vector(shift))

    def move_axis(self, segment: body.Segment, by: Array, values: Mapping[str, float]) -> None:
        """Move the joint that carries a segment, m, in its parent's frame; at ``values`` the segment stays.

        ``by``: (3,). ``values``: coordinate to its value, rad or m.
        """
        back = -posing.follow(segment.joints, values)[0].T @ by
        joints = (*_make_shifts(by), *segment.joints, *_make_shifts(back))
        self._rejoint(segment, joints, shift=body.to_vector(by), child_shift=body.to_vector(back))

    def turn(self, segment: body.Segment, onto: Array, values: Mapping[str, float]) -> None:
        """Turn the axes of the joint that carries a segment, so that its first one points along ``onto``.

        ``onto``: (3,), in the parent's frame.
        """
        first, last = find_turning_joints(segment)
        rotation, _ = posing.follow(segment.joints[:first], values)
        turn = rotation.T @ _turn_onto(find_axis_in_parent(segment, values), onto)
        angle = float(np.linalg.norm(turn))
        if angle == 0.0:
            return
        axis = body.to_vector(turn / angle)
        there, back = (body.Joint("rotation", axis, body.Law.constant(a)) for a in (angle, -angle))
        joints = segment.joints
        turned = (*joints[:first], there, *joints[first:last], back, *joints[last:])
        self._rejoint(segment, turned, turn=body.to_vector(turn))

    def _rejoint(self, segment: body.Segment, joints: tuple[body.Joint, ...], **moved: body.Vector) -> None:
        known = self.moves.get(segment.joint_name, JointMove())
        self.moves[segment.joint_name] = dataclasses.replace(known, **moved)
        changed = dataclasses.replace(segment, joints=joints)
        segments = tuple(changed if s.name == segment.name else s for s in self.model.segments)
        self.model = dataclasses.replace(self.model, segments=segments)


def _make_shifts(by: Array) -> tuple[body.Joint, ...]:
    return tuple(
        body.Joint("translation", body.to_vector(axis), body.Law.constant(value))
        for axis, value in zip(np.eye(3), by.tolist(), strict=True)
        if value
    )


def find_turning_joints(segment: body.Segment) -> tuple[int, int]:
    """The slice of a segment's joints from its first driven turn to its last.

    Raises SubjectInvalid: none of them turns.
    """
    driven = [k for k, j in enumerate(segment.joints) if j.turns]
    if not driven:
        raise SubjectInvalid(
            f"the model's '{segment.joint_name}' does not turn",
            field="model",
            remedy="Leave out the bones, or give a model whose legs move",
        )
    return driven[0], driven[-1] + 1


def find_axis_in_parent(segment: body.Segment, values: Mapping[str, float]) -> Array:
    """The axis, (3,), of the first driven turn of the joint that carries a segment, in its parent's frame."""
    first, _ = find_turning_joints(segment)
    rotation, _ = posing.follow(segment.joints[:first], values)
    return np.asarray(rotation @ np.array(segment.joints[first].axis))


def register_pelvis(found: Registration, fit: imaged_pelvis.PelvisFit) -> None:
    """Size the pelvis along each of its axes, lay it by spines and hips, and move its hips to the image's."""
    name = find_segment(found.model, "pelvis", "")
    assert name is not None
    found.resize({name: fit.factors})
    pose = found.poses[name] = fit.pose
    ours = imaged_pelvis.place_hips(found.model, name)
    for side in "rl":
        femur = find_segment(found.model, "femur", side)
        if femur is not None:
            first, *_ = list_chain(found.model, name, femur)
            found.shift(first, pose.to_local(fit.hips[side]) - ours[side])


def register_leg(found: Registration, evidence: ImageEvidence, side: str, lateral: Array) -> None:
    """Size a thigh and a shank, lay them into the image, and move knee axis and ankle to what it shows.

    Where the ankle was not imaged the shank stays as it is.

    ``lateral``: (3,), from the left to the right epicondyle or near it, in the image.
    """
    centres = {
        joint: np.array(evidence.centres[f"{joint}_{side}"])
        for joint in ("hip", "knee", "ankle")
        if f"{joint}_{side}" in evidence.centres
    }
    femur, tibia = (str(find_segment(found.model, role, side)) for role in ("femur", "tibia"))
    lengths = {femur: float(np.linalg.norm(centres["hip"] - centres["knee"]))}
    if "ankle" in centres:
        lengths[tibia] = float(np.linalg.norm(centres["knee"] - centres["ankle"]))
    ends = _find_leg_ends(found.model, femur, tibia, side)
    ratios = {n: length / float(np.linalg.norm(np.subtract(*ends[n]))) for n, length in lengths.items()}
    found.resize({name: (ratio,) * 3 for name, ratio in ratios.items()})
    ends = _find_leg_ends(found.model, femur, tibia, side)
    values = posing.straighten(found.model)
    axis = evidence.axes.get(f"knee_{side}")
    flexion = lateral if axis is None else np.array(axis) * np.sign(np.array(axis) @ lateral)
    knee, carried = _find_turning_in(list_chain(found.model, femur, tibia), values)
    model_axis = carried @ find_axis_in_parent(knee, values)
    rightward = model_axis * np.sign(model_axis[2])
    hip_at, knee_at = ends[femur]
    rotation = (
        _make_axes_along(centres["hip"] - centres["knee"], flexion)
        @ _make_axes_along(hip_at - knee_at, rightward).T
    )
    thigh = ImagePose(rotation, centres["hip"] - rotation @ hip_at)
    found.poses[femur] = thigh
    onto = carried.T @ rotation.T @ flexion
    found.turn(knee, onto / np.linalg.norm(onto) * np.sign(model_axis[2]), values)
    if "ankle" in centres:
        _register_shank(found, femur, tibia, thigh, centres["ankle"], ends[tibia])
        _move_ankle(found, evidence, tibia, side, centres["ankle"])


def _find_leg_ends(
    model: body.BodyModel, femur: str, tibia: str, side: str
) -> dict[str, tuple[Array, Array]]:
    """The upper and the lower joint's centre of thigh and shank, each in its own frame."""
    hip, knee, ankle = (find_joint_ends(model, joint, side) for joint in ("hip", "knee", "ankle"))
    for ends, joint, segment in ((hip, "hip", femur), (knee, "knee", tibia), (ankle, "ankle", tibia)):
        if segment not in ends:
            raise imaged_pelvis.refuse_without_joint(joint, segment)
    return {femur: (hip[femur], knee[femur]), tibia: (knee[tibia], ankle[tibia])}


def _register_shank(
    found: Registration,
    femur: str,
    tibia: str,
    thigh: ImagePose,
    ankle: Array,
    ends: tuple[Array, Array],
) -> None:
    """The shank where the model's knee carries it: bent until its ankle comes nearest to the image's.

    What bending does not reach, a leg that is straighter or more bowed in the frontal plane than the model's,
    is a turn of the shank against the joint about the knee's centre, so that the whole shank follows.

    ``ends``: centres of knee and ankle in the shank's frame.
    """
    knee_at, ankle_at = ends
    chain = list_chain(found.model, femur, tibia)
    values = posing.straighten(found.model)
    knee, _ = _find_turning_in(chain, values)
    terms = knee.joints[find_turning_joints(knee)[0]].law.terms
    coordinate = next(t.coordinate for t in terms if t.coordinate is not None)
    joints = [j for s in chain for j in s.joints]
    target = thigh.to_local(ankle)

    def place(angle: float) -> posing.Frame:
        return posing.follow(joints, {**values, coordinate: angle})

    def measure_gap(angle: float) -> float:
        turn, origin = place(angle)
        return float(np.linalg.norm(origin + turn @ ankle_at - target))

    angle = float(
        scipy.optimize.minimize_scalar(
            measure_gap, bounds=(-MOST_BENT, MOST_BENT), method="bounded", options={"xatol": 1e-9}
        ).x
    )
    if abs(angle) > 0.99 * MOST_BENT:
        raise SubjectInvalid(
            f"the knee in the image is bent by {np.degrees(abs(angle)):.0f} deg or more against the thigh",
            field="bones",
            remedy="Check that femur and tibia are of one side and in one image frame",
        )
    turn, origin = place(angle)
    ours, theirs = ankle_at - knee_at, turn.T @ (target - origin) - knee_at
    found.turn_child(found.model.segment(tibia), _turn_onto(ours, theirs), knee_at)
    joints = [j for s in list_chain(found.model, femur, tibia) for j in s.joints]
    turn, origin = place(angle)
    found.poses[tibia] = thigh.carry((turn, origin))


def _move_ankle(found: Registration, evidence: ImageEvidence, tibia: str, side: str, ankle: Array) -> None:
    """The ankle's centre where the image shows it, and its axis where the talus was imaged."""
    foot = find_segment(found.model, "foot", side)
    if foot is None:
        return
    pose, chain = found.poses[tibia], list_chain(found.model, tibia, foot)
    found.shift(chain[0], pose.to_local(ankle) - find_joint_ends(found.model, "ankle", side)[tibia])
    axis = evidence.axes.get(f"ankle_{side}")
    if axis is not None:
        values = posing.straighten(found.model)
        joint, carried = _find_turning_in(list_chain(found.model, tibia, foot), values)
        onto = carried.T @ pose.rotation.T @ np.array(axis)
        found.turn(joint, onto * np.sign(onto @ find_axis_in_parent(joint, values)), values)
        _register_subtalar(found, evidence, tibia, side)


def _register_subtalar(found: Registration, evidence: ImageEvidence, tibia: str, side: str) -> None:
    """The subtalar axis where the talus shows it; the foot stays where it is in the neutral pose.

    The talus is laid by the ankle's centre and axis and bent until the model's subtalar axis comes nearest to
    the image's, for what a neutral ankle is no image tells. What is left is a turn and a move of the axis.
    """
    name = f"subtalar_{side}"
    talus, calcn = (find_body(found.model, f"{bone}_{side}") for bone in ("talus", "calcn"))
    if name not in evidence.axes or talus is None or calcn is None:
        return
    values = posing.straighten(found.model)
    chain = list_chain(found.model, talus, calcn)
    if not any(j.turns for s in chain for j in s.joints):
        return
    joint, carried = _find_turning_in(chain, values)
    ankle, onto = np.array(evidence.centres[f"ankle_{side}"]), np.array(evidence.axes[name])
    hinge = np.array(evidence.axes[f"ankle_{side}"])
    before = posing.follow([j for s in list_chain(found.model, tibia, talus) for j in s.joints], values)
    pose = found.poses[tibia].carry(before)
    ours = pose.rotation @ carried @ find_axis_in_parent(joint, values)
    theirs = onto * np.sign(onto @ ours)
    # As far about the hinge as brings our axis nearest to theirs.
    turn = np.arctan2(np.cross(ours, theirs) @ hinge, ours @ theirs - (ours @ hinge) * (theirs @ hinge))
    bend = rigid.rotate_about(hinge, float(turn))
    placed = ImagePose(bend @ pose.rotation, ankle + bend @ (pose.origin - ankle))
    found.poses[talus] = placed
    first, _ = find_turning_joints(joint)
    upto = [j for s in chain[: chain.index(joint)] for j in s.joints]
    centre = posing.follow([*upto, *joint.joints[:first]], values)[1]
    axis = placed.rotation.T @ theirs
    off = placed.to_local(np.array(evidence.centres[name])) - centre
    found.move_axis(joint, carried.T @ (off - (off @ axis) * axis), values)
    found.turn(found.model.segment(joint.name), carried.T @ axis, values)


def _find_turning_in(chain: list[body.Segment], values: Mapping[str, float]) -> tuple[body.Segment, Array]:
    """The first segment of a chain that turns, and the rotation, (3, 3), that leads to its parent."""
    before: list[body.Joint] = []
    for segment in chain:
        if any(j.turns for j in segment.joints):
            return segment, posing.follow(before, values)[0]
        before += segment.joints
    find_turning_joints(chain[-1])
    return chain[-1], posing.follow(before, values)[0]


def mirror_knee(found: Registration, imaged: str, other: str) -> None:
    """Turn the knee's axes of the leg that was not imaged as the imaged one's, mirrored.

    ``imaged``, ``other``: their shanks.
    """
    values = posing.straighten(found.model)
    ours, theirs = (found.model.segment(name) for name in (imaged, other))
    first, _ = find_turning_joints(ours)
    move = found.moves.get(ours.joint_name, JointMove())
    # What is wanted is the axis as it stands now, seen in a mirror: an axis has no sign of its own.
    now = posing.follow(ours.joints[:first], values)[0] @ np.array(move.turn)
    angle = float(np.linalg.norm(now))
    if angle == 0.0:
        return
    mirrored = now * (-1.0, -1.0, 1.0)
    axis = find_axis_in_parent(theirs, values)
    onto = axis * np.cos(angle) + np.cross(mirrored / angle, axis) * np.sin(angle)
    found.turn(theirs, onto, values)


def _turn_onto(start: Array, end: Array) -> Array:
    """The smallest rotation, as a vector, that points one direction along another."""
    cross = np.cross(start, end)
    sine = float(np.linalg.norm(cross))
    return np.zeros(3) if sine == 0.0 else cross / sine * np.arctan2(sine, start @ end)


def _make_axes_along(y: Array, rightward: Array) -> Array:
    """The frame, (3, 3), whose y points along one direction and whose z lies nearest to another."""
    y = y / np.linalg.norm(y)
    x = np.cross(y, rightward)
    x /= np.linalg.norm(x)
    return np.stack([x, y, np.cross(x, y)], axis=1)
