"""Image-based scaling (EB, Puchaud 2019, section 2.2.3): what images show replaces what markers suggest.

Segment frames follow the ISB as the built-in leg model has them: the thigh's y axis runs from knee
to hip centre and its z lies in the plane of the epicondyles; the shank is carried by the thigh's
hinge to where the image shows it, so that the hinge reproduces the pose of the image. A leg without
images, and everything beside the legs, is sized as in persons with such bones, as far as markers allow.
"""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Mapping

import numpy as np

from scaling_service.capabilities.scaling.methods import (
    image_points,
    imaged_pelvis,
    osim_image_based,
    people_prior,
    placement,
)
from scaling_service.capabilities.scaling.methods.image_check import doubt_landmarks
from scaling_service.capabilities.scaling.sizes import sizing as personal_sizes
from scaling_service.capabilities.shared.settings import CalibrationSettings
from scaling_service.core.errors import SubjectInvalid
from scaling_service.core.names import say_name, say_names
from scaling_service.core.text import list_few
from scaling_service.model import body, parameters, results, trial
from scaling_service.model.anatomy.frames import Frames, build_femur_frame
from scaling_service.model.anatomy.lengths import find_segment, measure_segment_lengths
from scaling_service.model.people import read_people
from scaling_service.model.scaling import scale_model
from scaling_service.model.subject import Session
from scaling_service.numerics.multibody.rigid import rotate_about

_STRAIGHT = 0.6  # chosen: rad; beyond it a knee in the image is bent too far for a standing or lying person

_WORTH_SAYING = 0.5  # mm or deg; less is rounded to nothing


@dataclasses.dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class _Leg:
    """One leg as imaged: frames of thigh and shank, and the knee's axis in the thigh; None without ankle."""

    femur: Frames
    tibia: Frames | None
    knee: body.Vector
    ankle: body.Vector | None
    tilt: parameters.Tilt


def _measure_leg(evidence: trial.ImageEvidence, side: str) -> _Leg:
    hip, knee = (np.array(evidence.centres[f"{joint}_{side}"]) for joint in ("hip", "knee"))
    axis = evidence.axes.get(f"knee_{side}")
    lateral, medial = image_points.find_epicondyles(evidence, side, knee)
    femur = build_femur_frame(hip, lateral, medial, "r" if side == "r" else "l")
    # Turned as little as needed for its y to run from the knee to the hip centre: the midpoint of the
    # epicondyles, from which the ISB takes y, is not the knee centre of the image.
    y = (hip - knee) / np.linalg.norm(hip - knee)
    z = femur.rotation[0, :, 2] - (femur.rotation[0, :, 2] @ y) * y
    z /= np.linalg.norm(z)
    femur = Frames(np.stack([np.cross(y, z), y, z], axis=1)[None], hip[None])
    direction = femur.rotation[0].T @ np.array(axis) if axis is not None else np.array([0.0, 0.0, 1.0])
    tilt = parameters.tilt_of(direction if direction[2] > 0.0 else -direction)
    below = body.to_vector(femur.to_local(knee)[0])
    if f"ankle_{side}" not in evidence.centres:
        return _Leg(femur=femur, tibia=None, knee=below, ankle=None, tilt=tilt)
    ankle = np.array(evidence.centres[f"ankle_{side}"])
    # The shank's frame: the thigh's, turned about the knee axis until its -y points nearest to the ankle
    turned = parameters.tilt_rotation(tilt)
    shank = turned.T @ femur.rotation[0].T @ (ankle - knee)  # in the hinge's frame, about its z
    straight = turned.T @ np.array([0.0, -1.0, 0.0])
    angle = float(np.arctan2(shank[1], shank[0]) - np.arctan2(straight[1], straight[0]))
    angle = (angle + np.pi) % (2.0 * np.pi) - np.pi
    if abs(angle) > _STRAIGHT:
        raise SubjectInvalid(
            f"the knee in the image is bent by {np.degrees(abs(angle)):.0f} deg against the thigh",
            field="bones",
            remedy="Check that femur and tibia are of one side and in one image frame",
        )
    hinge = turned @ rotate_about((0.0, 0.0, 1.0), angle) @ turned.T
    tibia = Frames((femur.rotation[0] @ hinge)[None], knee[None])
    return _Leg(
        femur=femur, tibia=tibia, knee=below, ankle=body.to_vector(tibia.to_local(ankle)[0]), tilt=tilt
    )


def _with_leg(model: body.BodyModel, leg: _Leg, side: str) -> body.BodyModel:
    """The model with a leg's centres and knee axis; without a foot its ankle is a landmark."""
    model = placement.with_centre(model, f"tibia_{side}", leg.knee)
    foot = find_segment(model, "foot", side)
    if foot is not None and leg.ankle is not None:
        model = placement.with_centre(model, foot, leg.ankle)
    model = placement.with_axis(model, model.segment(f"tibia_{side}").joint_name, leg.tilt)
    return model if leg.ankle is None else placement.move_markers(model, {f"{side.upper()}AJC": leg.ankle})


def _fit_pelvis(session: Session, start: results.Calibration, image: Frames) -> imaged_pelvis.PelvisFit:
    """The start's pelvis against the image's; people's widths and depths say how directions differ."""
    assert session.images is not None
    name = str(find_segment(start.model, "pelvis", ""))
    expected, size = personal_sizes.expect_dimensions(session.subject), start.sizes.get(name)
    rows = [expected.names.index(dimension) for dimension in ("pelvis_width", "pelvis_depth")]
    ratio = np.array([1.0, -1.0]) @ expected.covariance[np.ix_(rows, rows)] @ np.array([1.0, -1.0])
    return imaged_pelvis.fit_pelvis(
        start.model,
        name,
        session.images,
        image,
        size_sd=people_prior.UNKNOWN_SIZE if size is None else size.sd,
        shape_sd=float(np.sqrt(ratio / 2.0)),
    )


def _bring_onto_bones(
    start: results.Calibration,
    evidence: trial.ImageEvidence,
    parts: image_points.ImagedParts,
    standing: trial.Trial | None,
    pelvis: imaged_pelvis.PelvisFit | None,
) -> results.Calibration:
    """An OpenSim model brought onto the bones; what has no bone stays as markers have it."""
    sides = parts.thighs
    names = {s: tuple(find_segment(start.model, role, s) for role in ("femur", "tibia")) for s in "rl"}
    found = osim_image_based.Registration(start.model)
    if pelvis is not None:
        osim_image_based.register_pelvis(found, pelvis)
    for side in sides:
        # From the left to the right epicondyle, or along the flexion axis.
        at = np.array(evidence.centres[f"knee_{side}"])
        lateral, medial = image_points.find_epicondyles(evidence, side, at)
        rightward = lateral - medial if side == "r" else medial - lateral
        osim_image_based.register_leg(found, evidence, side, rightward)
    others = [s for s in "rl" if sides and s not in sides and None not in names[s]]
    for side in others:
        osim_image_based.mirror_knee(found, str(names[sides[0]][1]), str(names[side][1]))
    imaged = {name: at for name, at in evidence.markers.items() if at[0] in found.poses}
    placed = {
        n: body.to_vector(found.poses[segment].to_local(np.array(at))) for n, (segment, at) in imaged.items()
    }
    new = [name for name in placed if name not in found.model.marker_names]
    added = [body.Marker.at(name, imaged[name][0], placed[name], anatomical=False) for name in new]
    model = placement.move_markers(found.model.with_markers((*found.model.markers, *added)), placed)
    alike = {
        f"{part}_{side}"
        for side in others
        for part, whole in (("femur", sides), ("shank", parts.shanks))
        if whole
    }
    legs = frozenset(name for name, size in start.sizes.items() if size.dimension in alike)
    if standing is not None:
        model = placement.place_on(
            model, standing, (legs | found.poses.keys()) - {s for s, _ in imaged.values()}
        )
    factors = {
        name: body.to_vector(
            np.multiply(start.scale_factors.get(name, (1.0, 1.0, 1.0)), found.ratios.get(name, 1.0))
        )
        for name in model.segment_names
    }
    return results.Calibration(
        method="EB",
        model=model,
        generic=start.generic,
        scale_factors=factors,
        warnings=(*start.warnings, *_list_osim_notes(found, parts, legs, placed)),
        image_poses=found.poses,
        bone_sized=dict.fromkeys(found.ratios, "own") | dict.fromkeys(legs, "other leg"),
        joint_moves=found.moves,
        sizes={
            n: size for n, size in start.sizes.items() if n not in found.ratios.keys() | found.poses.keys()
        },
    )


def _list_osim_notes(
    found: osim_image_based.Registration,
    parts: image_points.ImagedParts,
    others: frozenset[str],
    placed: Mapping[str, body.Vector],
) -> list[str]:
    """Which segments lie on bones, what scaling could not do, and what is not from images.

    ``others``: segments of a leg that was not imaged.
    """
    words = {"r": "right", "l": "left"}
    joints = {segment.name: segment.joint_name for segment in found.model.segments}
    posed = [f"{say_name(name)} (joint {say_name(joints[name])})" for name in found.poses]
    notes = [f"EB: on bones: {', '.join(posed)}"]
    for joint, move in found.moves.items():
        shift, turn, child = (float(np.linalg.norm(v)) for v in (move.shift, move.turn, move.child_turn))
        sizes = (
            (1e3 * shift, "its centre by {:.0f} mm"),
            (np.degrees(turn), "its axes by {:.0f} deg"),
            (np.degrees(child), "the segment on it by {:.0f} deg"),
        )
        said = [words.format(size) for size, words in sizes if size >= _WORTH_SAYING]
        if said:
            notes.append(f"EB: beyond scaling, the image moves {say_name(joint)}: {', '.join(said)}")
    if others:
        notes.append(
            f"EB: {say_names(sorted(others))}: of a leg that was not imaged, sized as in persons with such a "
            f"{' and '.join(words[s] for s in parts.thighs)} leg, as far as markers allow"
        )
    rest = [name for name in found.model.segment_names if name not in found.ratios.keys() | others]
    if rest:
        notes.append(f"EB: without a bone's length, sized by markers: {say_names(rest)}")
    carried = [
        m for m in found.model.markers if m.weight > 0.0 and m.segment in found.poses and m.name not in placed
    ]
    if carried:
        notes.append(
            f"EB: {len(carried)} markers on segments with bones are not in the image and follow the "
            f"segment's size: {list_few([m.name for m in carried])}"
        )
    return notes


def _list_factors(
    start: results.Calibration, model: body.BodyModel, pelvis: imaged_pelvis.PelvisFit | None
) -> dict[str, body.Vector]:
    """Size of each segment against the generic model, from the lengths that images changed."""
    generic, now = measure_segment_lengths(start.generic), measure_segment_lengths(model)
    factors = dict(start.scale_factors)
    if pelvis is not None:
        factors["pelvis"] = body.to_vector(
            np.multiply(factors.get("pelvis", (1.0, 1.0, 1.0)), pelvis.factors)
        )
    for side in "rl":
        for segment, length in ((f"femur_{side}", f"femur_{side}"), (f"tibia_{side}", f"shank_{side}")):
            if segment in factors and length in now:
                factors[segment] = (now[length] / generic[length],) * 3
    return factors


def _list_notes(
    model: body.BodyModel, parts: image_points.ImagedParts, placed: Mapping[str, body.Vector]
) -> list[str]:
    """What is not from images."""
    notes = []
    other = [s for s in "rl" if s not in parts.thighs and f"femur_{s}" in model.segment_names]
    if other and parts.thighs:
        names = " and ".join("right" if s == "r" else "left" for s in other)
        notes.append(
            f"EB: the {names} leg was not imaged whole: its lengths are those of persons with such another "
            "leg, as far as markers allow, its knee axis the other one mirrored, its markers are from the "
            "standing trial"
        )
    skin = [m.name for m in model.markers if m.weight > 0.0 and m.name not in placed]
    if skin:
        notes.append(f"EB: {len(skin)} markers are not in the image: {list_few(skin)}")
    return notes


def _scale(
    session: Session, settings: CalibrationSettings, start: results.Calibration, evidence: trial.ImageEvidence
) -> results.Calibration:
    """The image-based model, without deviations."""
    standing = session.static
    parts = image_points.find_imaged_parts(start.model, evidence)
    sides = parts.thighs
    if parts.pelvis is None and not sides:
        return image_points.size_by_lengths(session, settings, start, evidence)
    base = image_points.size_beside_legs(session, settings, start, evidence)
    pelvis = None if parts.pelvis is None else _fit_pelvis(session, base, parts.pelvis)
    if session.subject.model.lower().endswith(".osim"):
        return _bring_onto_bones(base, evidence, parts, standing, pelvis)
    model, notes = base.model, [*base.warnings]
    frames: dict[str, Frames] = {}
    if pelvis is not None:
        frames["pelvis"] = pelvis.image
        model = scale_model(model, {"pelvis": pelvis.factors})
        for thigh, at in ((f"femur_{side}", at) for side, at in pelvis.hips.items()):
            if thigh in model.segment_names:
                model = placement.with_centre(model, thigh, body.to_vector(pelvis.image.to_local(at)[0]))
    tilts: dict[str, parameters.Tilt] = (
        dict.fromkeys(base.axis_tilts, (0.0, 0.0)) if sides else dict(base.axis_tilts)
    )
    for side in sides:
        leg = _measure_leg(evidence, side)
        frames[f"femur_{side}"] = leg.femur
        if leg.tibia is not None:
            frames[f"tibia_{side}"] = leg.tibia
        model = _with_leg(model, leg, side)
        tilts[model.segment(f"tibia_{side}").joint_name] = leg.tilt
    for side in [s for s in "rl" if sides and s not in sides and f"femur_{s}" in model.segment_names]:
        x, y = tilts[model.segment(f"tibia_{sides[0]}").joint_name]
        joint = model.segment(f"tibia_{side}").joint_name
        tilts[joint] = (-x, -y)
        model = placement.with_axis(model, joint, tilts[joint])
    imaged = {name: at for name, at in evidence.markers.items() if at[0] in frames}
    placed = {n: body.to_vector(frames[segment].to_local(at)[0]) for n, (segment, at) in imaged.items()}
    # Markers that the model does not have yet are placed from their segment alone.
    new = [name for name in placed if name not in model.marker_names]
    added = [body.Marker.at(name, imaged[name][0], placed[name], anatomical=False) for name in new]
    model = placement.move_markers(model.with_markers((*model.markers, *added)), placed)
    seen = {segment for segment, _ in imaged.values()}
    if standing is not None:
        model = placement.place_on(model, standing, frozenset(model.segment_names) - seen)
    notes += _list_notes(model, parts, placed)
    return results.Calibration(
        method="EB",
        model=model,
        generic=base.generic,
        scale_factors=_list_factors(base, model, pelvis),
        axis_tilts=tilts,
        warnings=tuple(notes),
        image_poses={
            name: trial.ImagePose(frame.rotation[0], frame.origin[0]) for name, frame in frames.items()
        },
        sizes={name: size for name, size in base.sizes.items() if name not in frames},
        bone_sized={
            name: "own" if name in frames else "other leg"
            for name in model.segment_names
            if name in frames or name.startswith(("femur", "tibia"))
        },
    )


def _state_deviations(found: results.Calibration, evidence: trial.ImageEvidence) -> results.Calibration:
    """With what bone surfaces leave open of lengths and hips (``reference_models/people.yaml``)."""
    people, imaged = read_people(), people_prior.find_imaged(found, evidence)
    sds = people_prior.measure_imaged(imaged, people)
    sizes = dict(found.sizes)
    for segment in found.bone_sized:
        dimension = personal_sizes.find_dimension(found.model.bone_of(segment))
        if dimension in sds:
            length, sd = sds[dimension]
            factor = length / measure_segment_lengths(found.generic)[dimension]
            sizes[segment] = results.SegmentSize(
                dimension=dimension, factor=factor, sd=sd / length, measured=1.0, others=0.0
            )
    hips = [f"hip_{side}" for side in sorted(imaged.hips)]
    centres = {
        hip: results.EstimatedCentre("image", (imaged.deviate_centre(hip, people),) * 3) for hip in hips
    }
    return dataclasses.replace(found, sizes=sizes, centres={**found.centres, **centres})


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class ImageBased:
    """Joint centres, knee axes and markers from images, the rest from markers."""

    title: str = "joint centres, knee axes and markers from images"
    needs: str | None = "MB"
    needs_images: bool = True
    needs_movements: bool = False

    def calibrate(
        self,
        session: Session,
        start: results.Calibration | None,
        settings: CalibrationSettings,
        progress: object,  # noqa: ARG002 (one step: nothing to report)
    ) -> results.Calibration:
        """Replace joint centres, knee axes and markers of a marker-based model by what images show.

        The marker-based model stays where nothing was imaged. Where the image shows no marker, those of
        imaged segments are placed from the standing trial. A pelvis with a hip, a thigh and a shank below it
        count each by itself. Where none is whole, the bones at hand size their segments, and the rest follows
        as in persons with such bones.

        Raises SubjectInvalid: there are no images, they show no length of the model, or landmarks lie apart
        as no markers of this person do.
        """
        assert start is not None
        evidence = session.images
        if evidence is None:
            raise SubjectInvalid(
                "there are no bones to scale from",
                field="bones",
                remedy="Give `bones:` in the subject file, or choose a marker-based method",
            )
        clock = time.perf_counter()
        doubts = doubt_landmarks(evidence, session.static)
        found = _state_deviations(_scale(session, settings, start, evidence), evidence)
        imaged = [segment for segment, whose in found.bone_sized.items() if whose == "own"]
        doubts += image_points.doubt_sizes(start.model, found.model, {*found.image_poses, *imaged})
        return dataclasses.replace(
            found,
            warnings=(*found.warnings, *doubts),
            contradictions=tuple(doubt.removeprefix("EB: ") for doubt in doubts),
            wall_s=time.perf_counter() - clock,
        )
