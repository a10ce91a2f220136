"""What is ordinary in people, as a Gaussian prior of the numbers that the joint posterior frees.

Sizes of segments by stature and sex, hips by regressions on the bony pelvis, markers where an examiner feels
landmarks. A relation between several numbers, such as a hip and the pelvis's width, is one row of the prior.
"""

from __future__ import annotations

import dataclasses
from collections import abc

import numpy as np

from scaling_service.capabilities.scaling.sizes.sizing import find_dimension
from scaling_service.core.arrays import Array
from scaling_service.model import body
from scaling_service.model import people as population
from scaling_service.model.anatomy import lengths as anatomy_lengths
from scaling_service.model.anatomy.anthropometry import DimensionPrior
from scaling_service.model.anatomy.centres import MARKER_RADIUS_M
from scaling_service.model.anatomy.hip_centre import predict_hip_centres
from scaling_service.model.parameters import LETTERS
from scaling_service.model.results import Calibration
from scaling_service.model.trial import ImageEvidence
from scaling_service.numerics.least_squares.whitening import GaussianPrior

_UNKNOWN_M = 0.2  # SD of a tracking marker about where the standing trial shows it: as good as nothing
_LIKE = 0.01  # chosen: relative SD between segments of one dimension, such as both bones of a forearm
_SAME = 1e-3  # relative SD of a dimension's only segment about it: next to nothing
UNKNOWN_SIZE = 0.1  # chosen: relative SD of a segment of which nothing is known but the model
_MODEL_HIP_M = 0.008  # chosen: SD of a scaled model's hip, along each axis, where nothing marks the pelvis
_STEP = 1e-3  # relative, and m: of differences; the regressions are linear

SPINES = ("RASIS", "LASIS", "RPSIS", "LPSIS")

ENDS = {"inter_hip": ("hip_r", "hip_l")} | {
    f"{name}_{side}": (f"{upper}_{side}", f"{lower}_{side}")
    for side in "rl"
    for name, upper, lower in (("femur", "hip", "knee"), ("shank", "knee", "ankle"))
}
"""Lengths to the joint centres that they lie between."""

Spines = abc.Mapping[str, Array]
"""RASIS, LASIS, RPSIS and LPSIS to their places on the pelvis, (3,) m."""


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class Imaged:
    """What of a model's numbers images gave, as its image-based scaling has them."""

    pelvis: bool = False
    hips: frozenset[str] = frozenset()  # sides
    knees: frozenset[str] = frozenset()  # joints whose axis the image shows
    lengths: abc.Mapping[str, float] = dataclasses.field(default_factory=dict)  # by name of the length, m
    segments: frozenset[str] = frozenset()  # that lie in the image
    markers: frozenset[str] = frozenset()
    off: abc.Mapping[str, float] = dataclasses.field(default_factory=dict)
    """Deviations that the image's surfaces leave of centres (``hip_r`` …) along each axis, m; what is absent
    is as good as images usually are."""
    turned: abc.Mapping[str, float] = dataclasses.field(default_factory=dict)  # the same of joints' axes, rad

    def deviate_centre(self, centre: str, people: population.People) -> float:
        """Standard deviation of an imaged centre along each axis, m: the image's, at least what is usual."""
        usual = people.image_hip if centre.startswith("hip_") else people.image_centre
        return max(usual, self.off.get(centre, 0.0))

    def deviate_axis(self, joint: str, people: population.People) -> float:
        """The same of a joint's axis, rad, about each of the segment's others."""
        return max(people.image_axis_sd, self.turned.get(joint, 0.0))

    def tells(self, model: body.BodyModel, name: str) -> bool:
        """Whether images gave this parameter's value (``scale.femur_r``, ``axis.knee_r.x`` …)."""
        group, target, *_ = name.split(".")
        if group == "scale":
            sized = {"inter_hip": "pelvis"} | {
                f"{length}_{side}": f"{role}_{side}"
                for length, role in (("femur", "femur"), ("shank", "tibia"))
                for side in "rl"
            }
            parts = [sized[length].partition("_") for length in self.lengths]
            return target in [anatomy_lengths.find_segment(model, role, side) for role, _, side in parts]
        if group == "centre":
            return target.removeprefix("hip_") in self.hips
        return target in (self.knees if group == "axis" else self.markers)


def find_imaged(start: Calibration, evidence: ImageEvidence | None) -> Imaged:
    """What images gave a model; ``start`` is its image-based scaling where there is ``evidence``."""
    if evidence is None:
        return Imaged()
    model, lying = start.model, frozenset(start.image_poses)
    parts = {
        side: tuple(anatomy_lengths.find_segment(model, role, side) for role in ("femur", "tibia"))
        for side in "rl"
    }
    pelvis = anatomy_lengths.find_segment(model, "pelvis", "") in lying
    own = {segment for segment, whose in start.bone_sized.items() if whose == "own"}
    lengths = {
        name: length
        for name, length in anatomy_lengths.measure_segment_lengths(model).items()
        if (name == "inter_hip" and pelvis and {"hip_r", "hip_l"} <= evidence.centres.keys())
        or (name[:-2] in ("femur", "shank") and parts[name[-1]][name.startswith("shank")] in own)
    }
    knees = {
        side: model.segment(shank).joint_name
        for side, (femur, shank) in parts.items()
        if femur in lying and shank is not None
    }
    return Imaged(
        pelvis=pelvis,
        hips=frozenset(side for side in "rl" if pelvis and f"hip_{side}" in evidence.centres),
        knees=frozenset(knees.values()),
        off={name: size / np.sqrt(3.0) for name, size in evidence.deviations.items()},
        turned={
            joint: evidence.axis_deviations[f"knee_{side}"] / np.sqrt(2.0)
            for side, joint in knees.items()
            if f"knee_{side}" in evidence.axis_deviations
        },
        lengths=lengths,
        segments=lying,
        markers=frozenset(name for name, (segment, _) in evidence.markers.items() if segment in lying),
    )


def measure_imaged(imaged: Imaged, people: population.People) -> dict[str, tuple[float, float]]:
    """Dimensions that images show and their standard deviations, m."""
    return {
        name: (length, float(np.linalg.norm([imaged.deviate_centre(end, people) for end in ENDS[name]])))
        for name, length in imaged.lengths.items()
    }


def expect_sizes(
    prior: GaussianPrior,
    start: Calibration,
    carrying: abc.Sequence[str],
    pelvis: str | None,
    expected: DimensionPrior,
    imaged: Imaged,
    told: abc.Mapping[str, str],
) -> None:
    """Sizes of segments over the start's, as of persons of this stature and sex.

    ``carrying``: segments whose sizes are free. ``expected``: dimensions of persons like this one, who has
    such bones where some were imaged. ``told``: marker to the landmark that it marks.
    """
    lengths = dict(anatomy_lengths.measure_segment_lengths(start.model))
    spines = find_spines(start.model, told)
    if spines is not None:
        # Pelvic width and depth, m
        front, back = (spines["RASIS"] + spines["LASIS"]) / 2.0, (spines["RPSIS"] + spines["LPSIS"]) / 2.0
        lengths["pelvis_width"], lengths["pelvis_depth"] = (
            float(np.linalg.norm(spines["RASIS"] - spines["LASIS"])),
            float(np.linalg.norm(front - back)),
        )
    wanted: dict[str, str | None] = {}
    for segment in carrying:
        if segment == pelvis and imaged.pelvis:
            # Where its hips are is known; its size means nothing beside
            prior.add_values([f"scale.{segment}.{a}" for a in "xz"], np.ones(2), _SAME**2 * np.eye(2))
        elif segment == pelvis:
            wanted |= {f"scale.{segment}.z": "pelvis_width", f"scale.{segment}.x": "pelvis_depth"}
        else:
            wanted[f"scale.{segment}"] = find_dimension(start.model.bone_of(segment))
    known = {n: d for n, d in wanted.items() if d is not None and d in expected.names and d in lengths}
    if known:
        rows = [expected.names.index(dimension) for dimension in known.values()]
        mean = np.exp(expected.mean[rows] - np.log([lengths[dimension] for dimension in known.values()]))
        twice = [list(known.values()).count(dimension) > 1 for dimension in known.values()]
        unlike = np.where(twice, _LIKE, _SAME)
        relative = expected.covariance[np.ix_(rows, rows)] + np.diag(unlike**2)
        prior.add_values(list(known), mean, relative * np.outer(mean, mean))
    for name in wanted.keys() - known.keys():
        size = start.sizes.get(name.split(".")[1])
        sd = UNKNOWN_SIZE if size is None else max(size.sd, _LIKE)
        prior.add_values([name], np.ones(1), np.array([[sd**2]]))


def find_spines(model: body.BodyModel, told: abc.Mapping[str, str]) -> Spines | None:
    """Where a model's ASIS and PSIS markers are; a sacral marker stands for both PSIS. None if one lacks.

    ``told``: marker to the landmark that it marks.
    """
    found = {
        told[marker.name]: np.array(marker.nominal)
        for marker in model.markers
        if told.get(marker.name) in (*SPINES, "SACR")
    }
    for name in ("RPSIS", "LPSIS"):
        if "SACR" in found:
            found.setdefault(name, found["SACR"])
    found.pop("SACR", None)
    return found if len(found) == 4 else None


def expect_hips(
    prior: GaussianPrior,
    model: body.BodyModel,
    pelvis: str,
    sides: tuple[str, ...],
    people: population.People,
    expected: DimensionPrior,
    imaged: Imaged,
    told: abc.Mapping[str, str],
) -> None:
    """Hips where the image shows them, else where regressions on the bony pelvis put them.

    The regressions are linear in pelvic width and depth and in leg length, hence in the sizes, which are
    unknown themselves; skin over the spines is as thick on both sides. ``sides``: those with a hip that is
    free.
    """
    if imaged.pelvis:
        for side in sides:
            own = imaged.deviate_centre(f"hip_{side}", people)
            apart = own if side in imaged.hips else _MODEL_HIP_M
            prior.add_values([f"centre.hip_{side}.{a}" for a in LETTERS], np.zeros(3), apart**2 * np.eye(3))
        return
    names = [f"centre.hip_{side}.{letter}" for side in sides for letter in LETTERS]
    signs = np.concatenate([[1.0, 1.0, 1.0 if side == "r" else -1.0] for side in sides])
    spines = find_spines(model, told)
    rows: list[dict[str, float]] = [{name: 1.0} for name in names]
    if spines is None:
        sd, mean, skin = np.full(len(names), _MODEL_HIP_M), np.zeros(len(names)), np.zeros((len(names), 1))
    else:
        legs = {
            side: [f"scale.{anatomy_lengths.find_segment(model, role, side)}" for role in ("femur", "tibia")]
            for side in sides
        }
        names_of_sizes = (
            f"scale.{pelvis}.x",
            f"scale.{pelvis}.z",
            *(n for own in legs.values() for n in own),
        )
        sizes = tuple(n for n in names_of_sizes if n in prior.names)
        lengths = anatomy_lengths.measure_segment_lengths(model)
        hips = {side: anatomy_lengths.find_joint_ends(model, "hip", side)[pelvis] for side in sides}

        def part_hips(sizes: abc.Mapping[str, float], front: float, back: float) -> Array:
            """Hips by regression less the model's scaled ones, side by side, (3 n_sides,), m.

            ``front``, ``back``: skin over ASIS and PSIS, m.
            """
            deep, wide = sizes[f"scale.{pelvis}.x"], sizes[f"scale.{pelvis}.z"]
            along = np.array([deep, (deep + wide) / 2.0, wide])
            skins = [-front if name.endswith("ASIS") else back for name in SPINES]
            bony = [
                along * spines[name] + [thick, 0.0, 0.0] for name, thick in zip(SPINES, skins, strict=True)
            ]
            found = []
            for side in sides:
                # From ASIS to ankle of a straight leg, m; without an ankle as of persons like this one
                if f"shank_{side}" not in lengths:
                    leg = expected.value(f"leg_length_{side}")
                else:
                    leg = abs(float(spines[f"{side.upper()}ASIS"][1] - hips[side][1]))
                    for part, size in zip(("femur", "shank"), legs[side], strict=True):
                        leg += lengths[f"{part}_{side}"] * sizes.get(size, 1.0)
                both = [
                    predict_hip_centres(*bony, regression=name, leg_length_r=leg, leg_length_l=leg)
                    for name in people.hip_regressions
                ]
                places = [(hips.right_ground if side == "r" else hips.left_ground)[0] for hips in both]
                found.append(np.mean(places, axis=0) - along * hips[side])
            return np.concatenate(found)

        (front, front_sd), (back, back_sd) = people.skin_over_asis, people.skin_over_psis
        ones = dict.fromkeys(sizes, 1.0)
        sd, here = np.tile(people.hip_sd, len(sides)), part_hips(ones, front, back)
        slopes = np.array([(part_hips({**ones, n: 1.0 + _STEP}, front, back) - here) / _STEP for n in sizes])
        thicker = (part_hips(ones, front + _STEP, back), part_hips(ones, front, back + _STEP))
        skin = np.column_stack(
            [(t - here) / _STEP * s for t, s in zip(thicker, (front_sd, back_sd), strict=True)]
        )
        for k, row in enumerate(rows):
            row |= dict(zip(sizes, (-slopes[:, k]).tolist(), strict=True))
        mean = here - slopes.sum(axis=0)
    alike = np.kron(np.full((len(sides),) * 2, people.hip_sides), np.eye(3))
    np.fill_diagonal(alike, 1.0)
    prior.add(rows, mean, np.outer(sd * signs, sd * signs) * alike + skin @ skin.T)


def expect_places(
    prior: GaussianPrior,
    shown: abc.Sequence[body.Marker],
    people: population.People,
    expected: DimensionPrior,
    imaged: Imaged,
    told: abc.Mapping[str, str],
) -> None:
    """Markers where the image shows them; else landmarks where an examiner feels them, others anywhere.

    On bones that were imaged, markers that were not stand where standing shows them, not where the generic
    model has them, so that their distance is the person's already.
    """
    landmarks = {told[m.name]: m for m in shown if m.name in told and m.anatomical}
    done: set[str] = set()
    for row in people.opposite:
        for side in "RL":
            ends = {
                k: marker
                for k, end in enumerate(row.ends)
                if (marker := landmarks.get(f"{side}{end}")) is not None
                and marker.segment not in imaged.segments
            }
            if ends:
                # Landmarks at both ends of a joint, or at one: their distance is the person's, not the
                # model's
                width = f"{row.width}_{side.lower()}"
                signs = np.array([(1.0, -1.0)[k] for k in ends])
                mean = np.zeros((len(ends), 3))
                shared = np.array(row.sd)
                if width in expected.names:
                    half, shared[2] = expected.value(width) / 2.0 + MARKER_RADIUS_M, expected.sd(width) / 2.0
                    across = np.array([marker.nominal[2] for marker in ends.values()])
                    mean[:, 2] = np.copysign(half, across) - across
                palpated = np.diag(np.square([people.place_sd(row.ends[k]) for k in ends]).ravel())
                apart = np.kron(np.outer(signs, signs), np.diag(shared**2))
                names = [name for marker in ends.values() for name in _list_shifts(marker)]
                prior.add_values(names, mean.ravel(), palpated + apart)
                done |= {m.name for m in ends.values()}
    # A landmark's name without its side, as the tables have it; SACR and C7 have none.
    places = {m.name: people.place_sd(name[1:] if name[0] in "RL" else name) for name, m in landmarks.items()}
    places |= dict.fromkeys(imaged.markers, (people.image_marker,) * 3)
    for marker in shown:
        if marker.name not in done:
            sd = places.get(marker.name, (_UNKNOWN_M,) * 3)
            prior.add_values(list(_list_shifts(marker)), np.zeros(3), np.diag(np.square(sd)))


def _list_shifts(marker: body.Marker) -> abc.Iterator[str]:
    return (f"marker.{marker.name}.{letter}" for letter in LETTERS)
