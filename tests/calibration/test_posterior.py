"""The joint posterior on persons whose bodies are known, drawn by code of its own."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from scaling_service.capabilities.motion.run import track
from scaling_service.capabilities.scaling.methods.table import calibrate
from scaling_service.capabilities.subject.loading import open_subject
from scaling_service.model.anatomy.lengths import measure_segment_lengths
from scaling_service.model.document import from_document, to_document
from scaling_service.model.results import Calibration
from scaling_service.model.subject import Session
from scaling_service.model.trial import Trial
from scaling_service.studies.benchmark.persons import World, draw_person
from tests.calibration.people import person
from tests.finished import make_once
from tests.oracle.coverage import Errors, measure, record

PERSONS = 24
COSTLY = pytest.mark.costly  # many persons, or one more


@pytest.fixture(scope="module")
def found(tmp_path_factory: pytest.TempPathFactory) -> dict[str, dict[str, Errors]]:
    """Method to quantity to errors of all persons, measured once in a run."""
    return make_once(tmp_path_factory, "oracle_persons", lambda: measure(range(PERSONS), ["MB", "MAP"]))


@pytest.fixture(scope="module")
def third(tmp_path_factory: pytest.TempPathFactory) -> Calibration:
    """The person drawn with seed 3."""
    return make_once(tmp_path_factory, "oracle_third", lambda: calibrate(record(draw_person(3)), "MAP"))


@COSTLY
@pytest.mark.parametrize("length", ["shank", "inter_hip", "femur"])
def test_nearer_than_linear_scaling(found, length):
    assert found["MAP"][length].rms < 0.9 * found["MB"][length].rms


@COSTLY
@pytest.mark.parametrize("angle", ["hip_adduction", "hip_rotation", "knee_angle", "pelvis_list"])
def test_angles_are_nearer_than_those_of_linear_scaling(found, angle):
    assert found["MAP"][angle].rms < 0.9 * found["MB"][angle].rms


QUANTITIES = ["femur", "shank", "inter_hip", "hip_flexion", "hip_adduction", "hip_rotation", "knee_angle"]
QUANTITIES += ["pelvis_tilt", "pelvis_list", "pelvis_rotation"]


@COSTLY
@pytest.mark.parametrize("per_cent", [50, 80, 95])
@pytest.mark.parametrize("quantity", QUANTITIES)
def test_stated_deviations_cover(found, quantity, per_cent):
    """As far as so many persons can tell: an angle's error is mostly one number a person."""
    share = per_cent / 100.0
    chance = 3.0 * np.sqrt(share * (1.0 - share) / PERSONS)
    assert found["MAP"][quantity].cover(per_cent) == pytest.approx(share, abs=chance)


@COSTLY
@pytest.mark.parametrize("per_cent", [50, 80, 95])
def test_stated_deviations_of_means_cover(found, per_cent):
    """Over all angles of a walk: what all frames have in common counts in full."""
    covered = [errors.cover(per_cent) for name, errors in found["MAP"].items() if name.endswith(" mean")]
    share = per_cent / 100.0
    chance = 3.0 * np.sqrt(share * (1.0 - share) / PERSONS)
    assert np.mean(covered) == pytest.approx(share, abs=chance)


@COSTLY
@pytest.mark.parametrize(("per_cent", "low", "high"), [(95, 0.88, 0.99), (50, 0.40, 0.62)])
def test_stated_deviations_cover_pooled(found, per_cent, low, high):
    assert low <= np.mean([found["MAP"][name].cover(per_cent) for name in QUANTITIES]) <= high


def test_a_model_read_from_its_file_states_the_same(third):
    again = from_document(json.loads(json.dumps(to_document(third.model))))
    walk = record(draw_person(3)).evaluation[0]
    first, second = (track(model, walk).uncertainty.sd for model in (third.model, again))
    np.testing.assert_allclose(second, first, rtol=1e-3)


def learn_skin(moves: float) -> float:
    """What is learnt of how much skin moves, of a person whose skin moves so much, in usual amounts."""
    return calibrate(record(draw_person(3, World(skin=moves, noise_m=0.0005))), "MAP").model.posterior.skin


@pytest.fixture(scope="module")
def usual_skin(tmp_path_factory: pytest.TempPathFactory) -> float:
    return make_once(tmp_path_factory, "oracle_skin", lambda: learn_skin(1.0))


@pytest.mark.parametrize("skin", [0.3, pytest.param(1.8, marks=COSTLY)])
def test_how_much_skin_moves_is_learnt(skin, usual_skin):
    """Where cameras are as noisy as the estimate takes them to be; less noise is taken for less skin."""
    assert learn_skin(skin) / usual_skin == pytest.approx(skin, rel=0.15)


def test_where_skin_hardly_moves_bones_are_found():
    person = draw_person(3, World(skin=0.02))
    model = calibrate(record(person), "MAP").model
    for name in ("femur_r", "femur_l"):
        assert abs(measure_segment_lengths(model)[name] - person.lengths[name]) < 0.003


def test_landmarks_with_names_of_their_own_are_the_same_landmarks(third):
    """A laboratory's names on model and recordings: what people are like holds for places, not for names.

    But for the malleoli: this model has no foot, and without them no ankle.
    """
    session = record(draw_person(3))
    known = [m.name for m in session.model.markers if m.name[1:] not in ("LM", "MM")]
    own = {name: f"Q{k}" for k, name in enumerate(known)}

    def rename(trial: Trial) -> Trial:
        return replace(trial, labels=tuple(own.get(label, label) for label in trial.labels))

    markers = tuple(replace(m, name=own.get(m.name, m.name)) for m in session.model.markers)
    renamed = replace(
        session,
        model=session.model.with_markers(markers),
        static=rename(session.static),
        calibration=tuple(map(rename, session.calibration)),
        evaluation=tuple(map(rename, session.evaluation)),
    )
    ours, theirs = map(measure_segment_lengths, (third.model, calibrate(renamed, "MAP").model))
    assert theirs == pytest.approx(ours, abs=0.003)  # a head of the fibula is told by its name alone


def test_recordings_say_more_than_people_do(third):
    known = {p.name: p for p in third.parameters}
    assert known["scale.tibia_r"].identifiable
    assert known["scale.tibia_r"].sd < 0.02


def test_real_patient_of_whom_there_are_images(jia_without_images, shared_data):
    """Markers alone, against the expert's joint centres on her MRI: within two stated deviations."""
    done: dict[str, Calibration] = {}
    found = calibrate(jia_without_images, "MAP", known=done)
    expert = json.loads((shared_data / "jia_mri" / "reference_joints.json").read_text())["manual"]
    at = {joint: np.array(entry["centre_mm"]) for joint, entry in expert.items()}
    ours, start = (measure_segment_lengths(c.model) for c in (found, done["MB"]))
    sds = {p.name: p.sd for p in found.parameters}
    for name, segment, ends in (
        ("femur_r", "femur_r", ("hip_r", "knee_r")),
        ("shank_r", "tibia_r", ("knee_r", "ankle_r")),
    ):
        true = float(np.linalg.norm(at[ends[0]] - at[ends[1]]))
        assert abs(1e3 * ours[name] - true) < 2.0 * 1e3 * sds[f"scale.{segment}"] * start[name]
    assert abs(1e3 * ours["shank_r"] - np.linalg.norm(at["knee_r"] - at["ankle_r"])) < 6.0


@pytest.fixture
def jia_without_images(tmp_path, shared_data) -> Session:
    folder = shared_data / "jia_mri"
    clusters = {
        s + n: f"{b}_{s.lower()}"
        for s in "RL"
        for n, b in (("THI", "femur"), ("TUB", "tibia"), ("SHN", "tibia"))
    }
    file = tmp_path / "subject.yaml"
    trials = {"static": "Static.c3d", "calibration": ["Walking02.c3d"], "evaluation": ["Walking01.c3d"]}
    paths = {
        k: [str(folder / f) for f in v] if isinstance(v, list) else str(folder / v) for k, v in trials.items()
    }
    document = {
        "subject": {"id": "patient", "height_m": 1.62, "mass_kg": 63.0},
        "model": "lower_limb_14dof",
        "extra_markers": clusters,
        "trials": paths,
    }
    file.write_text(json.dumps(document))
    return open_subject(file).session


def drop_markers(session: Session, labels: set[str]) -> Session:
    """The session as a laboratory without these markers has it."""

    def without(trial: Trial) -> Trial:
        return trial.select([label for label in trial.labels if label not in labels])

    return replace(
        session,
        static=without(session.static),
        calibration=tuple(map(without, session.calibration)),
        evaluation=tuple(map(without, session.evaluation)),
    )


@COSTLY
def test_fewer_markers_tell_no_more():
    """What a joint's range holds instead is one word about a person, not one in each frame."""
    whole = person(1, model="lower_limb_feet_18dof", noise_m=5e-4, seconds=4.0).session
    sds = []
    for session in (whole, drop_markers(whole, {"RMT1", "RTOE"})):
        model = calibrate(session, "MAP").model
        foot = model.coordinate_names.index("ankle_inversion_r")
        sds.append(np.nanmean(track(model, session.evaluation[0]).uncertainty.sd[:, foot]))
    assert sds[1] > sds[0]


def test_a_leg_that_no_marker_shows_is_a_guess_with_its_deviation():
    whole = person(1, noise_m=5e-4, seconds=2.0).session
    hidden = drop_markers(whole, {"LLFE", "LMFE", "LFH", "LLM", "LMM"})
    sizes = calibrate(hidden, "MAP").sizes
    for segment in ("femur_l", "tibia_l"):
        assert not sizes[segment].own
        assert sizes[segment].sd >= max(sizes["femur_r"].sd, 0.015)


def test_feet_that_move_against_the_pelvis_say_how_long_unseen_legs_are():
    """What lies between markers is not known because it bears none: its size is estimated with the others."""
    long = dict.fromkeys(("femur_r", "femur_l", "tibia_r", "tibia_l"), (1.06,) * 3)
    found = []
    for factors in ({}, long):
        who = person(1, model="lower_limb_feet_18dof", factors=factors, noise_m=5e-4, seconds=3.0)
        between = {side + name for side in "RL" for name in ("LFE", "MFE", "FH", "LM", "MM")}
        found.append(measure_segment_lengths(calibrate(drop_markers(who.session, between), "MAP").model))
    assert found[1]["femur_r"] / found[0]["femur_r"] > 1.03


@pytest.mark.parametrize(("unknown", "left_out"), [("LFE MFE FH LM MM", True), ("LFE MFE", False)])
def test_a_cluster_is_placed_where_landmarks_show_the_bone(unknown: str, left_out: bool) -> None:
    """Who has none on thigh and shank sees the thigh move, and not how straight the leg is."""
    whole = person(1, model="lower_limb_feet_18dof", noise_m=5e-4, seconds=1.0).session
    on = {m.name: m.segment for m in whole.model.markers}
    clusters = {side + name: f"Q{side}{k}" for k, name in enumerate(unknown.split()) for side in "RL"}

    def rename(trial: Trial) -> Trial:
        return replace(trial, labels=tuple(clusters.get(label, label) for label in trial.labels))

    extra = {cluster: on[name] for name, cluster in clusters.items()}
    session = replace(
        whole,
        subject=replace(whole.subject, extra_markers=extra),
        static=rename(whole.static),
        calibration=tuple(map(rename, whole.calibration)),
        evaluation=(),
    )
    found = calibrate(session, "MB")
    assert any("left out" in warning for warning in found.warnings) == left_out
    assert (extra.keys() <= set(found.model.marker_names)) != left_out
