"""Images of virtual persons: what landmarking and image-based scaling make of a known truth."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from scaling_service.capabilities.motion.inverse_kinematics import inverse_kinematics
from scaling_service.capabilities.scaling.comparison.geometry import (
    compute_centre_errors,
    compute_length_errors,
)
from scaling_service.capabilities.scaling.methods.table import calibrate
from scaling_service.model.anatomy.lengths import measure_segment_lengths
from scaling_service.model.trial import Bone
from scaling_service.virtual.example import (
    MARKER_MM,
    SURFACE_MM,
    VirtualImage,
    make_demo_session,
    make_virtual_image,
    read_image_evidence,
)
from scaling_service.virtual.subject import VirtualSettings, make_virtual_subject
from tests.studies.imaged import EXACT, SEEDS, SHORT, Imaged

CENTRE_MM = {"hip": 0.05, "knee": 0.1, "ankle": 0.4}
"""Reached; asked are 0.5 and 4 mm. Tips of malleoli are sought along the shaft, 1-2 degrees off y."""
POINT_MM = {"ASIS": 2.5, "PSIS": 3.0, "LFE": 2.0, "MFE": 2.0, "FH": 0.4, "LM": 0.4, "MM": 0.4}
"""Reached: spines are found once they stand level, which is a degree or so off on a rounded spine."""


def apart_mm(a: object, b: object) -> float:
    return 1e3 * float(np.linalg.norm(np.subtract(a, b)))


def degrees(a: object, b: object) -> float:
    return float(np.degrees(np.arccos(min(1.0, abs(float(np.dot(a, b)))))))


@pytest.mark.parametrize("seed", SEEDS)
def test_landmarking_finds_the_truth_on_an_exact_image(exact: dict[int, Imaged], seed: int) -> None:
    image, found = exact[seed].image, exact[seed].found
    assert found.centres.keys() == image.centres.keys()
    for name, at in image.centres.items():
        assert apart_mm(found.centres[name], at) < CENTRE_MM[name[:-2]], name
    for name, axis in image.axes.items():
        assert degrees(found.axes[name], axis) < 0.2, name  # asked: 2.5
    assert found.landmarks.keys() == image.landmarks.keys()
    for name, at in image.landmarks.items():
        assert apart_mm(found.landmarks[name], at) < POINT_MM[name[1:]], name
    ours, true = (np.add(x.landmarks["RASIS"], x.landmarks["LASIS"]) / 2 for x in (found, image))
    assert apart_mm(ours, true) < 2.0  # asked: 4


@pytest.mark.costly
def test_the_frame_of_the_image_changes_nothing(exact: dict[int, Imaged]) -> None:
    image, found = exact[1].image, exact[1].found
    turn, _ = np.linalg.qr(np.random.default_rng(3).normal(size=(3, 3)))
    turn *= np.sign(np.linalg.det(turn))
    shift = np.array([0.4, -2.0, 1.0])
    bones = {name: Bone(bone.vertices @ turn.T + shift, bone.faces) for name, bone in image.bones.items()}
    other = read_image_evidence(replace(image, bones=bones))
    for name, at in {**found.centres, **found.landmarks}.items():
        there = (other.centres | other.landmarks)[name]
        assert apart_mm((np.array(there) - shift) @ turn, at) < 0.05, name


def test_centres_and_markers_are_those_of_the_standing_person(exact: dict[int, Imaged]) -> None:
    """Lengths of the image's truth are the model's; markers sit where the model carries them."""
    for body in exact.values():
        lengths, centres = measure_segment_lengths(body.person.model), body.image.centres
        for side in ("r", "l"):
            for bone, ends in (("femur", ("hip", "knee")), ("shank", ("knee", "ankle"))):
                apart = apart_mm(*(centres[f"{end}_{side}"] for end in ends))
                assert apart == pytest.approx(1e3 * lengths[f"{bone}_{side}"], abs=1e-6)
        for name, (segment, at) in body.image.markers.items():
            marker = body.person.model.marker(name)
            assert marker.segment == segment
            local = body.image.poses[segment].to_local(np.array(at))
            np.testing.assert_allclose(local, marker.nominal, atol=1e-12)


def test_equal_seeds_are_equal_images_and_the_errors_size_changes_no_truth(
    exact: dict[int, Imaged], blurred: dict[int, VirtualImage]
) -> None:
    first, again = blurred[4], make_virtual_image(make_virtual_subject(4, SHORT))
    assert first.markers == again.markers
    for name, bone in first.bones.items():
        np.testing.assert_array_equal(bone.vertices, again.bones[name].vertices)
    true = exact[4].image
    assert (first.centres, first.axes, first.landmarks) == (true.centres, true.axes, true.landmarks)
    gaps = [np.subtract(first.markers[name][1], true.markers[name][1]) for name in true.markers]
    assert 1e3 * np.std(gaps) == pytest.approx(MARKER_MM, rel=0.25)  # of 42 numbers


def test_surfaces_are_off_by_the_reconstructions_error(
    exact: dict[int, Imaged], blurred: dict[int, VirtualImage]
) -> None:
    off = []
    for seed, image in blurred.items():
        for name, bone in exact[seed].image.bones.items():
            corners = bone.vertices[bone.faces]
            normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
            area = np.linalg.norm(normals, axis=1)
            moved = (image.bones[name].vertices - bone.vertices)[bone.faces].mean(axis=1)
            along = np.abs(np.einsum("ij,ij->i", moved, normals)) / area
            off.append(1e3 * float(area @ along / area.sum()))
    assert np.mean(off) == pytest.approx(SURFACE_MM, rel=0.15)
    assert max(off) < 2.0 * SURFACE_MM


def test_an_image_with_errors_is_off_by_millimetres(blurred: dict[int, VirtualImage]) -> None:
    image = blurred[4]
    found = read_image_evidence(image)
    errors = {name: apart_mm(found.centres[name], at) for name, at in image.centres.items()}
    assert 0.3 < np.mean(list(errors.values())) < 3.0
    assert max(errors.values()) < 6.0
    assert all(degrees(found.axes[knee], axis) < 8.0 for knee, axis in image.axes.items())


def test_a_person_without_faults_comes_back_from_the_image() -> None:
    """Only landmarking stands between truth and model: EB then is the person."""
    faultless = VirtualSettings(
        artefact=0.0, noise=0.0, gaps=0.0, image=0.0, functional_s=2.0, gait_trials=1, strides=1.0
    )
    session, person = make_demo_session(5, faultless, images=True)
    found = calibrate(session, "EB")
    assert max(map(abs, compute_length_errors(found.model, person.model).values())) < 3e-4
    motion = inverse_kinematics(found.model, person.trials["gait_1"])  # as recorded: smoothing moves ankles
    assert float(np.nanmean(motion.distances)) < 5e-4
    for name, gap in compute_centre_errors(found.model, [motion], person.model, person.motions).items():
        assert gap < 1e-3, name
    for joint, tilt in found.axis_tilts.items():
        # The thigh's z lies in the plane of the epicondyles, each found within 2 mm at 40 mm.
        np.testing.assert_allclose(np.degrees(tilt), np.degrees(person.tilts[joint]), atol=1.5)


def test_progress_names_the_bones() -> None:
    reported: list[str] = []
    image = make_virtual_image(make_virtual_subject(4, EXACT), progress=reported.append)
    assert reported == list(image.bones) == ["pelvis", "femur_r", "tibia_r", "femur_l", "tibia_l"]
    assert make_virtual_subject(4, EXACT).settings.image == 0.0
    with pytest.raises(ValueError, match="negative"):
        VirtualSettings(image=-1.0)
