"""Image-based scaling: a body seen in an image frame of its own comes back as it is."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from scaling_service.capabilities.motion.inverse_kinematics import inverse_kinematics
from scaling_service.capabilities.scaling.methods.people_prior import Imaged, find_imaged, measure_imaged
from scaling_service.capabilities.scaling.methods.table import calibrate
from scaling_service.core.errors import SubjectInvalid
from scaling_service.model.anatomy.lengths import measure_segment_lengths
from scaling_service.model.body import to_vector
from scaling_service.model.parameters import compose_tilts, compute_axis, tilt_of
from scaling_service.model.people import read_people
from scaling_service.model.results import Calibration
from scaling_service.model.subject import Session
from scaling_service.model.trial import ImageEvidence
from tests.calibration.people import Person, imaged, person

TILTS_DEG = {"knee_r": (3.0, -5.0, 0.0), "knee_l": (-4.0, 2.0, 0.0)}
SIZES = {"pelvis": (1.06,) * 3, "femur_r": (1.05,) * 3, "femur_l": (1.03,) * 3, "tibia_r": (0.96,) * 3}


def known(seed: int = 41) -> Person:
    """A person of unequal legs whose knee axes are turned and whose markers are misplaced."""
    return person(seed, factors=SIZES, tilts_deg=TILTS_DEG, shift_m=0.005, seconds=3.0)


def test_a_body_imaged_whole_comes_back() -> None:
    who = known()
    found = calibrate(replace(who.session, images=imaged(who, TILTS_DEG)), "EB")
    for name, tilt in found.axis_tilts.items():
        assert np.degrees(tilt) == pytest.approx(TILTS_DEG[name][:2], abs=1e-9)
    motion = inverse_kinematics(found.model, who.session.evaluation[0])
    assert float(motion.distances.max()) < 1e-7
    lengths = {m.name: m.nominal for m in found.model.markers}
    assert lengths["RAJC"] == pytest.approx(who.truth.marker("RAJC").nominal, abs=1e-12)


def test_where_the_image_lies_changes_nothing() -> None:
    who = known(42)
    evidence = imaged(who, TILTS_DEG)
    turn = Rotation.from_rotvec([1.0, 2.0, -0.5]).as_matrix()

    def moved(point: tuple[float, float, float]) -> tuple[float, float, float]:
        x, y, z = turn @ np.array(point) + [5.0, -1.0, 2.0]
        return (float(x), float(y), float(z))

    other = ImageEvidence(
        centres={k: moved(v) for k, v in evidence.centres.items()},
        axes={k: tuple(turn @ np.array(v)) for k, v in evidence.axes.items()},
        landmarks={k: moved(v) for k, v in evidence.landmarks.items()},
        markers={k: (s, moved(v)) for k, (s, v) in evidence.markers.items()},
    )
    first, second = (calibrate(replace(who.session, images=e), "EB").model for e in (evidence, other))
    for a, b in zip(first.markers, second.markers, strict=True):
        assert a.nominal == pytest.approx(b.nominal, abs=1e-12)


def test_without_epicondyles_the_axis_gives_the_thigh_its_direction() -> None:
    who = known(43)
    found = calibrate(replace(who.session, images=imaged(who, TILTS_DEG, epicondyles=False)), "EB")
    x, y = found.axis_tilts["knee_r"]
    assert np.degrees(x) == pytest.approx(TILTS_DEG["knee_r"][0], abs=1e-9)
    assert y == pytest.approx(0.0, abs=1e-12)  # the thigh's z then is the axis seen along it
    motion = inverse_kinematics(found.model, who.session.evaluation[0])
    assert float(motion.distances.max()) < 1e-7


def test_one_leg_imaged_and_markers_size_the_other_with_a_deviation() -> None:
    """The legs differ by 2 %, which is as much as two such deviations."""
    who = known(44)
    found = calibrate(replace(who.session, images=imaged(who, TILTS_DEG, "r")), "EB")
    truth = who.truth
    assert found.model.marker("RLM").nominal == pytest.approx(truth.marker("RLM").nominal, abs=1e-9)
    length = {s: found.scale_factors[f"femur_{s}"][0] for s in "rl"}
    assert length["r"] == pytest.approx(1.05, abs=1e-6)
    assert length["l"] == pytest.approx(1.03, abs=2.5 * found.sizes["femur_l"].sd)
    assert found.sizes["femur_l"].sd < 0.01
    bone = measure_segment_lengths(found.model)["femur_r"] * found.sizes["femur_r"].sd
    assert 0.002 < bone < 0.003  # centres to 1 and 2 mm
    assert {name: max(centre.sd) for name, centre in found.centres.items()}["hip_r"] == pytest.approx(0.001)
    assert any("left leg was not imaged whole" in w for w in found.warnings)


def test_the_leg_that_was_not_imaged_does_not_bend_the_imaged_one() -> None:
    who = known(44)
    found = calibrate(replace(who.session, images=imaged(who, TILTS_DEG, "r")), "EB")
    assert who.session.static is not None
    standing = inverse_kinematics(found.model, who.session.static)
    assert float(np.nanmax(standing.distances)) < 1e-4


def test_without_markers_in_the_image_they_come_from_the_standing_trial() -> None:
    who = known(45)
    found = calibrate(replace(who.session, images=imaged(who, TILTS_DEG, markers=False)), "EB")
    assert any("not in the image" in w for w in found.warnings)
    motion = inverse_kinematics(found.model, who.session.evaluation[0])
    marker_based = inverse_kinematics(calibrate(who.session, "MB").model, who.session.evaluation[0])
    assert motion.distances.mean() < marker_based.distances.mean()


def test_the_optimised_image_model_adds_its_turn_to_the_images() -> None:
    who = known(46)
    session = replace(who.session, images=imaged(who, TILTS_DEG))
    found = calibrate(session, "EB_am")
    assert found.cost < 1e-10
    for joint, tilt in found.axis_tilts.items():
        assert np.degrees(tilt) == pytest.approx(TILTS_DEG[joint][:2], abs=1e-3)


def test_no_bones_is_refused() -> None:
    with pytest.raises(SubjectInvalid, match="bones"):
        calibrate(known(47).session, "EB")


def test_a_femur_and_a_tibia_of_different_sides_are_refused() -> None:
    who = known(48)
    evidence = imaged(who, TILTS_DEG, "r")
    centres = {**evidence.centres, "ankle_r": tuple(2 * np.array(evidence.centres["knee_r"]) - 1.0)}
    with pytest.raises(SubjectInvalid, match="bent by"):
        calibrate(replace(who.session, images=replace(evidence, centres=centres)), "EB")


def test_turns_of_an_axis_compose() -> None:
    first, second = (0.1, -0.2), (0.05, 0.3)
    assert compose_tilts(first, (0.0, 0.0)) == pytest.approx(first)
    assert compose_tilts((0.0, 0.0), second) == pytest.approx(second)
    assert tilt_of(2.0 * compute_axis(second)) == pytest.approx(second)


@pytest.mark.parametrize("model", ["lower_limb_14dof", "own.osim"])
def test_a_femur_alone_sizes_its_segment_and_tells_of_the_rest(model: str) -> None:
    who = person(47, factors={"femur_r": (1.06,) * 3, "tibia_r": (1.05,) * 3}, seconds=2.0)
    whole = imaged(who, {"knee_r": (0.0,) * 3, "knee_l": (0.0,) * 3}, "r")
    alone = ImageEvidence(
        centres={name: whole.centres[name] for name in ("hip_r", "knee_r")}, axes=whole.axes
    )
    subject = replace(who.session.subject, model=model)
    session = replace(who.session, subject=subject, images=alone)
    markers, found = calibrate(session, "MB"), calibrate(session, "EB")
    true, ours = measure_segment_lengths(who.truth), measure_segment_lengths(found.model)
    assert ours["femur_r"] == pytest.approx(true["femur_r"], abs=0.002)
    assert found.bone_sized == {"femur_r": "own"}
    assert found.sizes["femur_r"].sd < 0.006
    for segment in ("tibia_r", "femur_l"):
        assert found.sizes[segment].sd < markers.sizes[segment].sd
    assert any("other sizes are those of persons with such bones" in note for note in found.warnings)


def test_bones_that_show_no_length_are_refused() -> None:
    who = person(48, seconds=1.0)
    alone = ImageEvidence(centres={"ankle_r": (0.0, 0.0, 0.0)})
    with pytest.raises(SubjectInvalid, match="nor a length of a bone"):
        calibrate(replace(who.session, images=alone), "EB")
    posterior, plain = (calibrate(replace(who.session, images=e), "MAP") for e in (alone, None))
    assert measure_segment_lengths(posterior.model) == measure_segment_lengths(plain.model)
    assert any("not used" in note for note in posterior.warnings)


def test_what_a_poor_image_leaves_open_widens_lengths() -> None:
    people = read_people()
    plain = Imaged(lengths={"shank_r": 0.4})
    poor = Imaged(lengths={"shank_r": 0.4}, off={"ankle_r": 0.006, "hip_r": 0.001})
    usual = people.image_centre
    assert measure_imaged(plain, people)["shank_r"] == pytest.approx((0.4, np.hypot(usual, usual)))
    assert measure_imaged(poor, people)["shank_r"] == pytest.approx((0.4, np.hypot(usual, 0.006)))
    assert poor.deviate_centre("hip_l", people) == people.image_hip


def test_deviations_of_centres_and_axes_of_one_name_stay_apart() -> None:
    who = known(43)
    image = replace(
        imaged(who, TILTS_DEG), deviations={"knee_r": 0.003 * np.sqrt(3)}, axis_deviations={"knee_r": 0.1}
    )
    found = find_imaged(calibrate(replace(who.session, images=image), "EB"), image)
    people = read_people()
    assert found.deviate_centre("knee_r", people) == pytest.approx(0.003)
    assert found.deviate_axis("knee_r", people) == pytest.approx(0.1 / np.sqrt(2))


PIECES = {
    "pelvis": ({"hip_r", "hip_l"}, {"pelvis"}),
    "pelvis and thigh": ({"hip_r", "hip_l", "knee_r"}, {"pelvis", "femur_r"}),
    "leg without pelvis": ({"hip_r", "knee_r", "ankle_r"}, {"femur_r", "tibia_r"}),
}


@cache
def beside_pieces(model: str) -> tuple[Calibration, Calibration]:
    """By the whole image, and by markers alone: the same for every piece."""
    session = who_has(model)
    whole = replace(session, images=imaged(known(), TILTS_DEG, markers=False))
    return calibrate(whole, "EB"), calibrate(session, "MAP")


def who_has(model: str) -> Session:
    session = known().session
    return replace(session, subject=replace(session.subject, model=model))


@pytest.mark.parametrize("model", ["lower_limb_14dof", "own.osim"])
@pytest.mark.parametrize("piece", PIECES)
def test_pieces_of_an_image_count_each_by_itself(piece: str, model: str) -> None:
    """What a piece shows is as in the whole image, whatever else was imaged; nothing else lies in it."""
    shown, lying = PIECES[piece]
    whole = imaged(known(), TILTS_DEG, markers=False)
    spines = {"RASIS", "LASIS", "RPSIS", "LPSIS"} if "pelvis" in lying else set()
    evidence = ImageEvidence(
        centres={name: at for name, at in whole.centres.items() if name in shown},
        axes={"knee_r": whole.axes["knee_r"]} if "femur_r" in lying else {},
        landmarks={n: at for n, at in whole.landmarks.items() if n in spines | {"RLFE", "RMFE"}},
    )
    session = replace(who_has(model), images=evidence)
    beside, markers = beside_pieces(model)
    alone = calibrate(session, "EB")
    assert set(alone.image_poses) == lying
    assert {segment for segment, whose in alone.bone_sized.items() if whose == "own"} >= lying - {"pelvis"}
    ours, theirs = measure_segment_lengths(alone.model), measure_segment_lengths(beside.model)
    for name, segment in (("inter_hip", "pelvis"), ("femur_r", "femur_r"), ("shank_r", "tibia_r")):
        assert (abs(ours[name] - theirs[name]) < 1e-6) == (segment in lying)
    joint = alone.model.segment("tibia_r").joint_name
    if "femur_r" in lying and model != "own.osim":
        assert alone.axis_tilts[joint] == pytest.approx(beside.axis_tilts[joint], abs=1e-9)
    sds = [{p.name: p.sd for p in found.parameters} for found in (calibrate(session, "MAP"), markers)]
    told = {"pelvis": "centre.hip_r.y", "femur_r": "scale.femur_r", "tibia_r": "scale.tibia_r"}
    for segment, name in told.items():
        assert (sds[0][name] < 0.7 * sds[1][name]) == (segment in lying), name


@pytest.mark.parametrize(("size", "contradicted"), [(1.0, False), (1.15, True)])
def test_bones_of_another_size_leave_the_verdict_open(size: float, contradicted: bool) -> None:
    """Whatever weighs both is sure of a body that nobody has: it says so instead of how sure it is."""
    who = person(1, tilts_deg=TILTS_DEG, noise_m=5e-4, seconds=1.0)
    shown = imaged(who, TILTS_DEG, markers=False)
    larger = {
        field: {name: to_vector(size * x for x in at) for name, at in getattr(shown, field).items()}
        for field in ("centres", "landmarks")
    }
    found = calibrate(replace(who.session, images=replace(shown, **larger)), "MAP")
    assert bool(found.contradictions) == contradicted
    assert all(any(said in warning for warning in found.warnings) for said in found.contradictions)
