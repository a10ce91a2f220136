"""The pelvis of an image and a model's: its factor along each axis and how it lies, in one estimate.

    R_image_pelvis (s ∘ a_i) + t = b_i + e_i        log s ~ N(0, size² 1 1' + shape² I)

a_i are the model's spines and hips, b_i the image's. How far apart the hips are says little of the rest of a
pelvis, so they enter with what hips of two persons differ by, as spines do with palpation and skin.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import scipy
from scipy.linalg import block_diag

from scaling_service.capabilities.scaling.methods.image_points import find_imaged_spines
from scaling_service.core.errors import SubjectInvalid
from scaling_service.model import body
from scaling_service.model import trial as trials
from scaling_service.model.anatomy import frames
from scaling_service.model.anatomy.lengths import find_joint_ends
from scaling_service.model.people import People, read_people
from scaling_service.model.places import tell_landmarks
from scaling_service.numerics.multibody.laws import Array
from scaling_service.numerics.multibody.rigid import convert_vector_to_rotation

_TWO_PERSONS = np.sqrt(2.0)  # a model's hips are a person's, too
_TURN = 0.2  # chosen: rad; SD about each axis by which spines and hips turn what their lines give
_MIRROR = np.array([1.0, 1.0, -1.0])


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class PelvisFit:
    """Factors over the model's pelvis, along its x, y and z, and where the pelvis so scaled lies."""

    factors: body.Vector
    deviations: body.Vector  # standard deviations of the factors, relative
    pose: trials.ImagePose
    image: frames.Frames  # of the image's spines
    hips: Mapping[
        str, Array
    ]  # side to its centre in the image, (3,) m; one that is not seen is a mirror image


def fit_pelvis(
    model: body.BodyModel,
    pelvis: str,
    evidence: trials.ImageEvidence,
    image: frames.Frames,
    *,
    size_sd: float,
    shape_sd: float,
) -> PelvisFit:
    """Size a pelvis along each of its axes and lay it into the image, by its spines and hips.

    ``pelvis``: the segment's name. ``image``: the frame of the spines in the image, as
    :func:`find_imaged_pelvis`. ``size_sd``: relative SD of the model's pelvis as it is sized now;
    ``shape_sd``: relative SD of each direction about one factor. Raises SubjectInvalid: the model has no hip.

    Where no spine is marked on the model the prior gives the pitch, and hips the rest.
    """
    hips = place_hips(model, pelvis)
    seen = {s: np.array(evidence.centres[f"hip_{s}"]) for s in "rl" if f"hip_{s}" in evidence.centres}
    for side, other in ("rl", "lr"):  # of half a pelvis the other hip is the mirror image
        if other in seen:
            seen.setdefault(side, image.to_ground(image.to_local(seen[other])[0] * _MIRROR)[0])
    ours, theirs, covariance = _pair_points(model, pelvis, evidence, hips, seen)
    centre, middle = ours.mean(axis=0), theirs.mean(axis=0)
    start = (
        _make_axes(seen["r"] - seen["l"], image.rotation[0, :, 0])
        @ _make_axes(hips["r"] - hips["l"], _find_model_forward(model, pelvis)).T
    )
    whiten = np.linalg.inv(np.linalg.cholesky(covariance))
    prior = np.linalg.inv(np.linalg.cholesky(size_sd**2 * np.ones((3, 3)) + shape_sd**2 * np.eye(3)))

    def lay(x: Array) -> tuple[Array, Array, Array]:
        rotation, factors = start @ convert_vector_to_rotation(x[:3]), np.exp(x[6:])
        return rotation, middle + x[3:6], factors

    def measure_gaps(x: Array) -> Array:
        rotation, at, factors = lay(x)
        gaps = (ours - centre) * factors - (theirs - at) @ rotation
        return np.concatenate([whiten @ gaps.ravel(), x[:3] / _TURN, prior @ x[6:]])

    found = scipy.optimize.least_squares(measure_gaps, np.zeros(9), x_scale="jac")
    rotation, at, factors = lay(found.x)
    spread = np.sqrt(np.diag(np.linalg.inv(found.jac.T @ found.jac)))
    return PelvisFit(
        factors=body.to_vector(factors),
        deviations=body.to_vector(spread[6:]),
        pose=trials.ImagePose(rotation, at - rotation @ (factors * centre)),
        image=image,
        hips=seen,
    )


def place_hips(model: body.BodyModel, pelvis: str) -> dict[str, Array]:
    """Both hip centres in the pelvis's frame, (3,) m; of one leg alone the other's is its mirror image."""
    found = {side: ends[pelvis] for side in "rl" if pelvis in (ends := find_joint_ends(model, "hip", side))}
    for side, other in ("rl", "lr"):
        if other in found:
            found.setdefault(side, found[other] * _MIRROR)
    if not found:
        raise refuse_without_joint("hip", pelvis)
    return found


def refuse_without_joint(joint: str, segment: str) -> SubjectInvalid:
    """What is said of a model whose segment lacks a joint that bones show."""
    return SubjectInvalid(
        f"the model has no {joint} on its '{segment}', which the bones could be brought to",
        field="model",
        remedy="Give a model whose pelvis, thigh, shank and foot hang on one another, or leave out `bones:`",
    )


def _pair_points(
    model: body.BodyModel,
    pelvis: str,
    evidence: trials.ImageEvidence,
    hips: Mapping[str, Array],
    seen: Mapping[str, Array],
) -> tuple[Array, Array, Array]:
    """Points of the model's pelvis, in its frame, and of the image, (n, 3) m, and their covariance.

    (3 n, 3 n), m2, in the pelvis's axes.
    """
    people, marked = read_people(), _find_marked_spines(model, pelvis)
    shown, bony = find_imaged_spines(evidence)
    spines = {**shown, "SACR": (shown["RPSIS"] + shown["LPSIS"]) / 2.0}
    ours, theirs, blocks = [], [], []
    for names, skin, outward in (
        (("RASIS", "LASIS"), people.skin_over_asis, 1.0),
        (("RPSIS", "LPSIS", "SACR"), people.skin_over_psis, -1.0),
    ):
        here = [name for name in names if name in marked]
        thick, sd = skin if bony else (0.0, 0.0)
        ours += [marked[name] - [outward * thick, 0.0, 0.0] for name in here]
        theirs += [spines[name] for name in here]
        own = [_measure_variance(name, evidence, people, bony) for name in here]
        alike = np.kron(np.ones((len(here), len(here))), np.diag([sd**2, 0.0, 0.0]))
        blocks.append(np.diag(np.concatenate([np.zeros(0), *own])) + alike)
    apart = np.square(_TWO_PERSONS * np.array(people.hip_sd))
    both = np.diag(np.concatenate([apart, apart]))
    both[:3, 3:] = both[3:, :3] = np.diag(people.hip_sides * apart * _MIRROR)
    ours += [hips["r"], hips["l"]]
    theirs += [seen["r"], seen["l"]]
    return np.array(ours), np.array(theirs), np.asarray(block_diag(*blocks, both))


def _measure_variance(name: str, evidence: trials.ImageEvidence, people: People, bony: bool) -> Array:
    """Of a spine's place by palpation and by the image, (3,), m2."""
    landmark = name if name == "SACR" else name[1:]
    by_image = evidence.deviations.get(name, 0.0) ** 2 / 3.0 if bony else people.image_marker**2
    return np.square(people.place_sd(landmark)) + by_image


def _find_marked_spines(model: body.BodyModel, pelvis: str) -> dict[str, Array]:
    """The model's markers over its spines, (3,) m in the pelvis's frame; a sacral one only in their stead."""
    told = tell_landmarks(model)
    marks = {told.get(m.name): np.array(m.nominal) for m in model.markers if m.segment == pelvis}
    names: tuple[str, ...] = ("RASIS", "LASIS", "RPSIS", "LPSIS")
    if not {"RPSIS", "LPSIS"} & marks.keys():
        names = ("RASIS", "LASIS", "SACR")
    return {name: marks[name] for name in names if name in marks}


def _find_model_forward(model: body.BodyModel, pelvis: str) -> Array:
    """The direction from the PSIS (or the sacrum) to the ASIS in the pelvis's frame, (3,)."""
    marks = _find_marked_spines(model, pelvis)
    back = [marks[name] for name in ("RPSIS", "LPSIS", "SACR") if name in marks]
    if not {"RASIS", "LASIS"} <= marks.keys() or not back:
        return np.array([1.0, 0.0, 0.0])
    middle = np.mean(back, axis=0)
    return frames.build_pelvis_frame(marks["RASIS"], marks["LASIS"], middle, middle).rotation[0, :, 0]


def _make_axes(z: Array, forward: Array) -> Array:
    """The frame, (3, 3), whose z points along one direction and whose x lies nearest to another."""
    z = z / np.linalg.norm(z)
    y = np.cross(z, forward)
    y /= np.linalg.norm(y)
    return np.stack([np.cross(y, z), y, z], axis=1)
