"""What is ordinary of persons and their models, as covariances of columns and of markers in a frame.

Skin, palpation and cameras are those of ``reference_models/people.yaml``, as in scaling and motion.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from scaling_service.capabilities.discovery.laws.profiles import Following
from scaling_service.capabilities.discovery.laws.scene import Scene
from scaling_service.capabilities.discovery.laws.spots import JointSpot, MarkerSpot, SizeSpot, VolumeSpot
from scaling_service.capabilities.discovery.observations.tracked import MotionFit
from scaling_service.capabilities.discovery.ordinary.columns import Base, Spread
from scaling_service.core.arrays import Array
from scaling_service.model.body import Segment
from scaling_service.model.people import People, read_people
from scaling_service.model.places import tell_landmarks

PARTS: Mapping[str, tuple[str, ...]] = {
    "legs": ("femur", "thigh", "tibia", "shank", "fibula", "patella", "calcn", "foot", "toes", "talus"),
    "pelvis": ("pelvis", "sacrum"),
    "arms": ("humerus", "ulna", "radius", "hand", "scapula", "clavicle", "lunate"),
}
"""Parts of the body, each with levels of its own, to beginnings of names of bones; else it is the trunk."""

_SHOULDER = ("humerus", "scapula", "clavicle")
_THIGH = ("femur", "thigh")

_FITTED_PLACE_M, _GENERIC_PLACE_M = 0.006, 0.015
"""Of a marker's place along an axis: where it was fitted (low: what skin leaves of it), and where it was
taken from the generic model (a mean error of 27 mm in space: Puchaud et al. 2019, sec. 3.2)."""

RESTUCK_M = 0.0025  # of one that is stuck on again on its mark, along an axis (low)

_CENTRE_M = 0.008
"""Of a joint's centre in a scaled model, along an axis (low; of hips ``people.yaml`` tells it)."""

_AXIS = math.radians(4.0)
"""Of a joint's axis in a scaled model (condyles found by hand turn the knee's by up to 15 deg: Schache
2006)."""

_GIVEN = 0.75  # of both in a model that was made for the person (low; regressions of hips are as they are)
_GLIDE_M, _SHOULDER_GLIDE_M, _TURN = 0.004, 0.015, math.radians(2.0)
"""By what a joint glides and turns along with its coordinates over an ordinary movement (knee: Walker 1988;
shoulder: the scapula that many models do not have; low)."""

_SIZE, _VOLUME = 0.02, 0.002  # of a segment (low), and of a volume calibrated with a wand of known length
_OWN_SKIN = 0.5  # share of skin's variance that is another in each recording (low)


def find_part(bone: str) -> str:
    """The part of the body that a bone belongs to.

    Examples
    --------
    >>> find_part("tibia_l"), find_part("torso")
    ('legs', 'trunk')
    """
    name = bone.lower()
    return next((part for part, names in PARTS.items() if name.startswith(names)), "trunk")


@dataclass(frozen=True, slots=True, eq=False)
class Cluster:
    """Markers of one segment, and how they wander together in its axes at level one."""

    rows: NDArray[np.intp]
    covariance: Array  # (3 m, 3 m), m2
    part: str

    @property
    def numbers(self) -> NDArray[np.intp]:
        """Of their coordinates among those of all markers, (3 m,)."""
        return np.asarray((3 * self.rows[:, None] + np.arange(3)).ravel())


def make_clusters(item: MotionFit, share: float | None = None) -> list[Cluster]:
    """How the markers of every segment wander: the loose share of skin, unless another is given."""
    people, model = read_people(), item.task.model
    told = tell_landmarks(model)
    owners = [model.marker(m).segment for m in item.markers]
    found = []
    for segment in dict.fromkeys(owners):
        rows = np.flatnonzero([owner == segment for owner in owners])
        places = np.array([model.marker(item.markers[k]).nominal for k in rows])
        landmarks = [told.get(item.markers[k]) for k in rows]
        bone = model.bone_of(segment)
        covariance = people.skin_covariance(bone, landmarks, places, share or people.loose_share)
        instrument = people.noise**2 * np.eye(3 * len(rows))
        found.append(Cluster(rows, covariance + instrument, find_part(bone)))
    return found


@dataclass(frozen=True, slots=True, eq=False)
class Ordinary:
    """Covariances of the base's coefficients: of what is common to all recordings, and own to each."""

    common: Spread
    own: Spread


def expect_body(
    base: Base, scene: Scene, means: Mapping[str, float], *, given: bool, placed: bool
) -> Ordinary:
    """The everyday covariance of persons and models.

    ``means``: of each coordinate over all recordings, rad or m. ``given``: whether the model was made for the
    person elsewhere; ``placed``: whether markers' places were fitted.
    """
    people, model = read_people(), scene.model
    told, ordinary = tell_landmarks(model), Ordinary(Spread(), Spread())
    place = _FITTED_PLACE_M if given or placed else _GENERIC_PLACE_M
    for segment in scene.bearing:
        markers = scene.on(segment.name)
        if not markers:
            continue
        bone = model.bone_of(segment.name)
        part = find_part(bone)
        rows = [base.number(MarkerSpot(m, k)) for m in markers for k in range(3)]
        ordinary.common.add(rows, place**2 * np.eye(len(rows)), f"place {part}", f"place {part}")
        ordinary.own.add(rows, RESTUCK_M**2 * np.eye(len(rows)), f"restuck {part}")
        places = np.array([model.marker(m).nominal for m in markers])
        landmarks = [told.get(m) for m in markers]
        wandering = people.skin_covariance(bone, landmarks, places, people.loose_share)
        ordinary.own.add(rows, wandering, part)
        # Arms and head are held otherwise from recording to recording, not only within one
        posed = np.repeat([people.girdle_sd(bone, landmark) for landmark in landmarks], 3)
        held = [(row, sd) for row, sd in zip(rows, posed.tolist(), strict=True) if sd]
        if held:
            ordinary.own.add([row for row, _ in held], np.diag([sd**2 for _, sd in held]))
        drivers = find_skin_drivers(scene, segment.name, people)
        for driver, reach in drivers.items():
            share = 1.0 / (reach * math.sqrt(len(drivers)))
            size = people.skin_covariance(bone, landmarks, places, share)
            moving = [base.number(MarkerSpot(m, k), Following(driver)) for m in markers for k in range(3)]
            for spread, part_of_it in ((ordinary.common, 1.0 - _OWN_SKIN), (ordinary.own, _OWN_SKIN)):
                spread.add_centred((moving, rows), means[driver], part_of_it * size, part, segment.name)
    for segment in scene.jointed:
        _expect_joint(base, ordinary.common, scene, segment, means, _GIVEN if given else 1.0)
    for name in list_sized(scene):
        ordinary.common.add([base.number(SizeSpot(name))], np.array([[_SIZE**2]]), "size")
    for spread in (ordinary.common, ordinary.own):
        spread.add([base.number(VolumeSpot())], np.array([[_VOLUME**2]]))
    return ordinary


def _expect_joint(
    base: Base, common: Spread, scene: Scene, segment: Segment, means: Mapping[str, float], share: float
) -> None:
    """Its centre and axes, and how it glides and turns along with its own coordinates."""
    name, bone, people = segment.name, scene.model.bone_of(segment.name), read_people()
    part = find_part(bone)
    shift, turn = (
        partial(JointSpot, name, "start", "translation"),
        partial(JointSpot, name, "before", "rotation"),
    )
    start, before = base.number_axes(shift), base.number_axes(turn)
    after = base.number_axes(partial(JointSpot, name, "after", "rotation"))
    centre = people.hip_sd if bone.lower().startswith(_THIGH) else (share * _CENTRE_M,) * 3
    common.add(start, np.diag(np.square(centre)), f"joint {part}")
    for pair in zip(before, after, strict=True):
        there_and_back = np.array([[1.0, -1.0], [-1.0, 1.0]])
        common.add(pair, (share * _AXIS) ** 2 * there_and_back, f"joint {part}")
    reach = {c: r for c, r in find_reach(segment, people).items() if c in scene.moving}
    glide = _SHOULDER_GLIDE_M if bone.lower().startswith(_SHOULDER) else _GLIDE_M
    for driver, far in reach.items():
        one = 1.0 / (far * math.sqrt(len(reach)))
        for spots, still, size in ((shift, start, glide), (turn, before, _TURN)):
            moving, covariance = base.number_axes(spots, Following(driver)), (size * one) ** 2 * np.eye(3)
            common.add_centred(
                (moving, still), means[driver], covariance, f"glide {part}", segment.joint_name
            )


def list_sized(scene: Scene) -> list[str]:
    """Segments that have a size."""
    sized = {joint.scales_with for _, joint in scene.model.joints() if joint.scales_with}
    sized |= {m.segment for m in scene.model.markers if m.follows_size}
    return [s.name for s in scene.bearing if s.name in sized]


def find_skin_drivers(scene: Scene, segment: str, people: People) -> dict[str, float]:
    """Moving angles of the joints at a segment's ends, and their reach in an ordinary movement, rad."""
    found: dict[str, float] = {}
    for item in scene.model.segments:
        if item.parent in scene.model.segment_names and segment in (item.name, item.parent):
            for coordinate, reach in find_reach(item, people).items():
                if coordinate in scene.moving:
                    found.setdefault(coordinate, reach)
    return found


def find_reach(segment: Segment, people: People) -> dict[str, float]:
    """The coordinates that turn a segment's joint, and how far each goes in an ordinary movement, rad."""
    found: dict[str, float] = {}
    for joint in segment.joints:
        if joint.kind == "rotation":
            x, y, z = map(abs, joint.axis)
            reach = people.reach_mediolateral if z > max(x, y) else people.reach_other
            for coordinate in sorted(joint.law.coordinates):
                found.setdefault(coordinate, reach)
    return found
