"""An OpenSim model brought onto a person's bones: its joints lie where the bones show them."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from scaling_service.capabilities.dynamics.saving import write_massive_model
from scaling_service.capabilities.dynamics.start import Prepared
from scaling_service.capabilities.motion.inverse_kinematics import inverse_kinematics
from scaling_service.capabilities.scaling.methods.image_points import find_imaged_pelvis, size_beside_legs
from scaling_service.capabilities.scaling.methods.imaged_pelvis import fit_pelvis, place_hips
from scaling_service.capabilities.scaling.methods.optimised import find_tiltable_knees
from scaling_service.capabilities.scaling.methods.osim_image_based import (
    find_axis_in_parent,
    find_turning_joints,
)
from scaling_service.capabilities.scaling.methods.table import METHODS, calibrate
from scaling_service.capabilities.shared.settings import PAPER, Settings
from scaling_service.capabilities.subject.loading import Loaded, open_subject
from scaling_service.core.errors import SubjectInvalid
from scaling_service.core.names import say_name
from scaling_service.files.osim.models import read_osim, write_osim
from scaling_service.files.osim.muscles import Attachment, read_attachments
from scaling_service.model.anatomy.lengths import find_joint_ends, measure_segment_lengths
from scaling_service.model.body import BodyModel, Vector, to_vector
from scaling_service.model.parameters import compute_axis
from scaling_service.model.poses import follow, straighten
from scaling_service.model.results import Calibration
from scaling_service.model.trial import ImageEvidence, ImagePose
from tests.calibration.people import Person, imaged, person
from tests.jobs.recorded import walker_document

TILTS_DEG = {"knee_r": (3.0, -5.0, 0.0), "knee_l": (-4.0, 2.0, 0.0)}
SIZES = {"pelvis": (1.06,) * 3, "femur_r": (1.05,) * 3, "femur_l": (1.03,) * 3, "tibia_r": (0.96,) * 3}


EXPERTS = {
    "addbrev_r": "add_brev_r",
    "addlong_r": "add_long_r",
    "bflh_r": "bifemlh_r",
    "recfem_r": "rect_fem_r",
    "sart_r": "sar_r",
} | {f"gl{kind}{n}_r": f"glut_{kind}{n}_r" for kind in ("med", "min") for n in (1, 2, 3)}
"""Rajagopal's names of muscles to the expert's."""
ON_HIP_BONE = (
    EXPERTS.keys() | set(EXPERTS.values()) | {"grac_r", "iliacus_r", "semimem_r", "semiten_r", "tfl_r"}
)


def list_origins(model: Path) -> list[Attachment]:
    """Where muscles of the right side begin on the pelvis."""
    points, _, _ = read_attachments(model.read_text(), model, ["pelvis"])
    return [point for point in points if point.number == 0 and point.muscle.endswith("_r")]


def as_osim(who: Person, evidence: ImageEvidence) -> Calibration:
    subject = replace(who.session.subject, model="own.osim")
    return calibrate(replace(who.session, subject=subject, images=evidence), "EB")


def centres_in_image(found: Calibration) -> dict[str, np.ndarray]:
    """Every centre as each imaged segment that knows it has it, m."""
    return {
        f"{joint}_{side} {segment}": pose.rotation @ at + pose.origin
        for joint in ("hip", "knee", "ankle")
        for side in "rl"
        for segment, at in find_joint_ends(found.model, joint, side).items()
        if (pose := found.image_poses.get(segment)) is not None
    }


def test_a_person_imaged_whole_comes_back() -> None:
    who = person(41, factors=SIZES, tilts_deg=TILTS_DEG, shift_m=0.005, seconds=3.0)
    evidence = imaged(who, TILTS_DEG)
    found = as_osim(who, evidence)
    for name, at in centres_in_image(found).items():
        assert at == pytest.approx(evidence.centres[name.split()[0]], abs=1e-6)
    for name, length in measure_segment_lengths(who.truth).items():
        assert measure_segment_lengths(found.model)[name] == pytest.approx(length, abs=1e-6)
    motion = inverse_kinematics(found.model, who.session.evaluation[0])
    assert float(motion.distances.max()) < 0.001  # the thigh's turn about its long axis is another convention


@pytest.mark.parametrize("by_direction", [(0.94, 1.0, 1.1), (1.1, 1.0, 0.94)])
@pytest.mark.parametrize("model", ["lower_limb_14dof", "own.osim"])
def test_a_pelvis_follows_its_image_along_each_axis(by_direction: Vector, model: str) -> None:
    who = person(47, factors={"pelvis": by_direction}, tilts_deg=TILTS_DEG, seconds=2.0)
    evidence = imaged(who, TILTS_DEG)
    session = replace(who.session, subject=replace(who.session.subject, model=model), images=evidence)
    image = find_imaged_pelvis(evidence)
    assert image is not None
    found, markers = calibrate(session, "EB"), calibrate(session, "MB")
    fit = fit_pelvis(markers.model, "pelvis", evidence, image, size_sd=0.05, shape_sd=0.065)
    sized = np.multiply(markers.scale_factors["pelvis"], fit.factors)
    for k in (0, 2):  # of the height only hips speak
        assert abs(np.log(sized[k] / by_direction[k])) < 1.7 * fit.deviations[k]
    ratio = found.scale_factors["pelvis"][2] / found.scale_factors["pelvis"][0]
    true = by_direction[2] / by_direction[0]
    assert 0.6 < np.log(ratio) / np.log(true) < 1.05  # one factor has 0; the prior keeps a part
    inter_hip = measure_segment_lengths(found.model)["inter_hip"]
    assert inter_hip == pytest.approx(measure_segment_lengths(who.truth)["inter_hip"], abs=1e-6)


def test_hips_further_apart_say_little_of_the_pelvis() -> None:
    who = person(47, factors=SIZES, tilts_deg=TILTS_DEG, seconds=2.0)
    evidence = imaged(who, TILTS_DEG)
    right, left = (np.array(evidence.centres[f"hip_{side}"]) for side in "rl")
    out = 0.008 * (right - left) / np.linalg.norm(right - left)
    apart = {"hip_r": to_vector(right + out), "hip_l": to_vector(left - out)}
    found = as_osim(who, replace(evidence, centres={**evidence.centres, **apart}))
    before, after = (f.scale_factors["pelvis"][2] for f in (as_osim(who, evidence), found))
    assert 1.0 < after / before < 1.0 + 0.4 * 0.016 / float(np.linalg.norm(right - left))
    assert measure_segment_lengths(found.model)["inter_hip"] == pytest.approx(
        np.linalg.norm(right - left) + 0.016
    )
    assert any("right hip: its centre by" in note for note in found.warnings)


@pytest.mark.parametrize(("side", "other"), ["rl", "lr"])
def test_a_leg_that_was_not_imaged_is_sized_as_in_persons_with_the_imaged_one(side: str, other: str) -> None:
    who = person(44, factors=SIZES, tilts_deg=TILTS_DEG, shift_m=0.002, seconds=3.0)
    found = as_osim(who, imaged(who, TILTS_DEG, side))
    femur, unseen = f"femur_{side}", f"femur_{other}"
    assert found.scale_factors[femur][0] == pytest.approx(SIZES[femur][0], abs=1e-6)
    assert found.scale_factors[unseen][0] == pytest.approx(SIZES[unseen][0], abs=0.02)
    assert any("not imaged" in note and say_name(unseen) in note for note in found.warnings)
    assert found.bone_sized == {
        f"{bone}_{leg}": whose
        for bone in ("femur", "tibia")
        for leg, whose in ((side, "own"), (other, "other leg"))
    } | {"pelvis": "own"}
    x, y = np.radians(TILTS_DEG[f"knee_{side}"][:2])
    model = found.model
    axes = {s: find_axis_in_parent(model.segment(f"tibia_{s}"), straighten(model)) for s in "rl"}
    assert axes["r"][:2] == pytest.approx(-axes["l"][:2], abs=1e-9)
    assert abs(axes[side][1]) == pytest.approx(abs(compute_axis((x, y))[1]), abs=1e-6)


@pytest.mark.parametrize("model", ["lower_limb_14dof", "own.osim"])
def test_bones_that_do_not_fit_the_markers_are_refused_or_reported(model: str) -> None:
    who = person(45, seconds=2.0)
    evidence = imaged(who, {"knee_r": (0.0,) * 3, "knee_l": (0.0,) * 3})

    def with_size(factor: float) -> Calibration:
        def grown(point: Vector) -> Vector:
            return to_vector(factor * np.array(point))

        sized = replace(
            evidence,
            centres={name: grown(at) for name, at in evidence.centres.items()},
            landmarks={name: grown(at) for name, at in evidence.landmarks.items()},
            markers={name: (segment, grown(at)) for name, (segment, at) in evidence.markers.items()},
        )
        subject = replace(who.session.subject, model=model)
        return calibrate(replace(who.session, subject=subject, images=sized), "EB")

    assert not any("by the markers" in note for note in with_size(1.05).warnings)
    assert any("right femur is" in note and "by the markers" in note for note in with_size(1.2).warnings)
    with pytest.raises(SubjectInvalid, match=r"by the bones and .* by the markers.*of one person"):
        with_size(1.4)


@pytest.fixture(
    scope="module",
    params=[
        "rajagopal_walk/Rajagopal2016",
        pytest.param("opencap_squat/unscaled_generic", marks=pytest.mark.costly),  # knees as Rajagopal's
        "gait2354",
    ],
)
def real(request: pytest.FixtureRequest, shared_data: Path, tmp_path_factory: pytest.TempPathFactory):
    """A real person's bones of the right leg, talus included, and a public model: its session and EB."""
    bones = {
        name: str(shared_data / "jia_mri" / "bones" / f"{name}.stl")
        for name in ("femur_r", "tibia_r", "talus_r")
    }
    document = walker_document(shared_data) | {
        "subject": {"id": "imaged"},
        "model": str(shared_data / f"{request.param}.osim"),
        "bones": bones
        | {"units": "mm", "pelvis": str(shared_data / "jia_mri" / "bones" / "pelvis_no_sacrum.stl")},
        "image_markers": str(shared_data / "jia_mri" / "image_markers.csv"),
    }
    document.pop("extra_markers", None)
    if request.param == "gait2354":
        folder = shared_data / "gait2354"
        document |= {
            "model": str(folder / "gait2354_simbody.osim"),
            "marker_set": str(folder / "gait2354_Scale_MarkerSet.xml"),
        }
    file = tmp_path_factory.mktemp("osim") / "subject.yaml"
    file.write_text(json.dumps(document))
    session = open_subject(file, Settings()).session
    return session, calibrate(session, "EB")


def test_joints_lie_where_real_bones_show_them(real, tmp_path: Path) -> None:
    session, found = real
    evidence = session.images
    assert {"pelvis", "femur_r", "tibia_r", "talus_r"} == found.image_poses.keys()
    for name, at in centres_in_image(found).items():
        assert 1e3 * np.linalg.norm(at - evidence.centres[name.split()[0]]) < 1.0, name
    model: BodyModel = found.model
    values = straighten(model)
    chain = ("femur_r", "tibia_r", "talus_r", "calcn_r")
    for joint, parent, child in zip(("knee_r", "ankle_r", "subtalar_r"), chain, chain[1:], strict=False):
        axis = find_axis_in_parent(model.segment(child), values)
        shown = found.image_poses[parent].rotation.T @ np.array(evidence.axes[joint])
        assert np.degrees(np.arccos(min(1.0, abs(float(axis @ shown))))) < 0.1
    heel = model.segment("calcn_r").joints
    centre = follow(heel[: find_turning_joints(model.segment("calcn_r"))[0]], values)[1]
    off = found.image_poses["talus_r"].to_local(np.array(evidence.centres["subtalar_r"])) - centre
    assert 1e3 * np.linalg.norm(np.cross(off, axis)) < 1.0
    sized = size_beside_legs(session, PAPER, calibrate(session, "MB"), evidence)
    by_markers = follow(sized.model.segment("calcn_r").joints, values)
    for theirs, ours in zip(by_markers, follow(heel, values), strict=True):
        assert ours == pytest.approx(theirs, abs=1e-9)  # the neutral foot stays where it is
    assert any("without a bone's length" in note and "right heel bone" in note for note in found.warnings)
    source, path = Path(session.subject.model), tmp_path / "model.osim"
    write_osim(
        path,
        found.model,
        source=source,
        factors=found.scale_factors,
        joint_moves=found.joint_moves,
        marker_set=session.subject.marker_set,
    )
    assert path.read_text().count("PathPoint name=") == source.read_text().count("PathPoint name=")
    written = measure_segment_lengths(read_osim(path))
    assert written == pytest.approx(measure_segment_lengths(found.model), abs=1e-6)


def test_a_pelvis_on_its_bone_carries_muscles_nearer_to_the_experts(real, shared_data: Path) -> None:
    """Origins by the expert's hand, in the image's frame, against one factor laid between the hips."""
    session, found = real
    expert = shared_data / "jia_mri" / "manual_model.osim"
    theirs = {p.muscle: p.at for p in list_origins(expert)}
    generic = Path(session.subject.model)
    ours = {p.muscle: p.at for p in list_origins(generic)}
    pairs = [(at, theirs[EXPERTS.get(name, name)]) for name, at in ours.items() if name in ON_HIP_BONE]
    assert len(pairs) >= 9
    own, at = (np.array(side) for side in zip(*pairs, strict=True))

    def measure(factors: Vector, pose: ImagePose) -> float:
        placed = (own * factors) @ pose.rotation.T + pose.origin
        return float(np.linalg.norm(placed - at, axis=1).mean())

    by_markers, pose = calibrate(session, "MB"), found.image_poses["pelvis"]
    hips = {side: np.array(session.images.centres[f"hip_{side}"]) for side in "rl"}
    scaled = place_hips(by_markers.model, "pelvis")
    between = (hips["r"] + hips["l"] - pose.rotation @ (scaled["r"] + scaled["l"])) / 2.0
    one = measure(by_markers.scale_factors["pelvis"], ImagePose(pose.rotation, between))
    ours_now = measure(found.scale_factors["pelvis"], pose)
    assert ours_now < 0.02
    if "gait2354" not in session.subject.model:  # whose front markers stand 40 mm before its own bone
        assert ours_now < one - 0.003


def test_knees_whose_axes_are_not_fitted_are_named(real) -> None:
    session, found = real
    kept = [s.joint_name for s in found.model.segments if s.name.startswith("tibia")]
    tiltable = find_tiltable_knees(found.model)
    fitted = calibrate(session, "EB_am", known={"EB": found})
    said = " ".join(note for note in fitted.warnings if note.startswith("EB_am") and "turn in three" in note)
    assert [joint for joint in kept if joint in said] == [joint for joint in kept if joint not in tiltable]
    assert {p.target for p in fitted.parameters if p.group == "axis"} == set(tiltable)


def test_identified_inertia_is_written_into_a_model_on_bones(real, tmp_path: Path) -> None:
    session, found = real
    shank = found.model.segment("tibia_r")
    heavier = replace(shank, mass=shank.mass + 0.5, com=to_vector(np.add(shank.com, (0.0, -0.01, 0.0))))
    segments = tuple(heavier if s.name == shank.name else s for s in found.model.segments)
    model = replace(found.model, segments=segments)
    prepared = Prepared(
        loaded=Loaded(session=session),
        start="EB",
        inertia="model",
        model=found.model,
        motions={},
        forces={},
        calibration=found,
    )
    assert write_massive_model(tmp_path, model, prepared, found.scale_factors) == ()
    written = read_osim(tmp_path / "model.osim")
    assert written.segment("tibia_r").mass == pytest.approx(heavier.mass, abs=1e-9)
    assert written.segment("tibia_r").com == pytest.approx(heavier.com, abs=1e-9)
    assert measure_segment_lengths(written) == pytest.approx(measure_segment_lengths(found.model), abs=1e-6)


def test_a_model_of_one_leg_is_brought_onto_its_bones() -> None:
    who = person(46, factors=SIZES, tilts_deg=TILTS_DEG, seconds=2.0)
    start = calibrate(replace(who.session, subject=replace(who.session.subject, model="own.osim")), "MB")
    right = tuple(s for s in start.model.segments if not s.name.endswith("_l"))
    kept = {s.name for s in right}
    used = {t.coordinate for s in right for j in s.joints for t in j.law.terms}
    model = replace(
        start.model,
        segments=right,
        coordinates=tuple(c for c in start.model.coordinates if c.name in used),
        markers=tuple(m for m in start.model.markers if m.segment in kept),
    )
    evidence = imaged(who, TILTS_DEG, "r")
    subject = replace(who.session.subject, model="own.osim")
    session = replace(who.session, model=model, subject=subject, images=evidence)
    found = METHODS["EB"].calibrate(session, replace(start, model=model, generic=model), PAPER, None)
    for name, at in centres_in_image(found).items():
        assert at == pytest.approx(evidence.centres[name.split()[0]], abs=1e-6)
    footless = model.with_markers(tuple(m for m in model.markers if m.name[-3:] not in ("AJC", "RLM", "RMM")))
    session = replace(session, model=footless)
    with pytest.raises(SubjectInvalid, match="no ankle"):
        METHODS["EB"].calibrate(session, replace(start, model=footless, generic=footless), PAPER, None)
