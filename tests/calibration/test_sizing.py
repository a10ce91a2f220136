"""Segment sizes as one weighted estimate: deviations are true, what is missing is said and matters little."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from scaling_service.capabilities.scaling.methods.marker_based import scale_linearly
from scaling_service.capabilities.scaling.sizes.points import find_person_points
from scaling_service.capabilities.scaling.sizes.sizing import Sizing, size_segments
from scaling_service.capabilities.shared.settings import CalibrationSettings
from scaling_service.capabilities.subject.loading import load, read_files
from scaling_service.model.anatomy.centres import read_pelvis
from scaling_service.model.anatomy.lengths import measure_segment_lengths
from scaling_service.model.anatomy.markers import find_canonical
from scaling_service.model.results import SegmentSize
from scaling_service.model.subject import Session, Subject
from scaling_service.model.trial import Trial
from scaling_service.virtual.example import make_demo_session
from tests.calibration.conventional import patient
from tests.calibration.people import person
from tests.finished import make_once

SETTINGS = CalibrationSettings()
PERSONS = 200
MEDIAL = {"RMFE", "LMFE", "RMM", "LMM"}
LEGS = ("inter_hip", "femur_r", "femur_l", "shank_r", "shank_l")


@pytest.fixture(scope="module")
def clinic(
    tmp_path_factory: pytest.TempPathFactory,
) -> list[tuple[Sizing, Mapping[str, float], dict[str, np.ndarray]]]:
    """200 virtual persons with the conventional markers, sized; their true lengths and centres."""

    def size() -> list[tuple[Sizing, Mapping[str, float], dict[str, np.ndarray]]]:
        people = (patient(seed) for seed in range(PERSONS))
        return [
            (size_segments(who.session, SETTINGS), measure_segment_lengths(who.truth), who.centres)
            for who in people
        ]

    return make_once(tmp_path_factory, "sized", size)


def by_length(sizing: Sizing) -> dict[str, SegmentSize]:
    return {size.dimension: size for size in sizing.sizes.values()}


def test_intervals_of_lengths_cover_the_truth(clinic) -> None:
    generic = measure_segment_lengths(patient(0).session.model)
    z = {
        name: np.array(
            [
                np.log(by_length(s)[name].factor * generic[name] / true[name]) / by_length(s)[name].sd
                for s, true, _ in clinic
            ]
        )
        for name in LEGS
    }
    covered = {name: float((np.abs(v) < 1.96).mean()) for name, v in z.items()}
    assert 0.93 <= np.mean(list(covered.values())) <= 0.97, covered
    assert min(covered.values()) >= 0.90, covered
    assert max(abs(v.mean()) for v in z.values()) < 0.5


def test_intervals_of_joint_centres_cover_the_truth(clinic) -> None:
    inside = []
    for sizing, _, true in clinic:
        (who,) = sizing.people
        axes = read_pelvis(who.landmarks).frame.rotation.mean(axis=0)
        for name, centre in sizing.centres.items():
            if name in true:
                off = axes.T @ (who.centres[name].at.mean(axis=0) - true[name])
                inside.append(np.abs(off) < 1.96 * np.array(centre.sd))
    assert len(inside) == 6 * PERSONS
    assert 0.93 <= np.mean(inside) <= 0.97
    assert np.mean(inside, axis=0).min() >= 0.91


def test_the_estimate_is_nearer_than_distances_alone(clinic) -> None:
    generic = measure_segment_lengths(patient(0).session.model)
    alone = SETTINGS.model_copy(update={"sizes": "measured"})
    plain, weighted = [], []
    for seed in range(40):
        sizing, true, _ = clinic[seed]
        other = size_segments(patient(seed).session, alone)
        for name in LEGS:
            weighted.append(by_length(sizing)[name].factor * generic[name] - true[name])
            plain.append(by_length(other)[name].factor * generic[name] - true[name])
    assert np.sqrt(np.mean(np.square(weighted))) < 0.8 * np.sqrt(np.mean(np.square(plain)))


def test_shares_add_up_and_say_what_was_measured() -> None:
    session = person(61).session
    half = session.static.select([n for n in session.static.labels if not n.startswith("L") or n == "LASIS"])
    only_right = replace(session, static=half, calibration=())
    sizing = size_segments(only_right, SETTINGS)
    right, left = sizing.sizes["tibia_r"], sizing.sizes["tibia_l"]
    assert right.own
    assert not left.own
    assert left.measured == 0.0
    assert left.others > 0.5  # legs resemble each other
    assert left.sd > right.sd
    assert left.factor == pytest.approx(right.factor, rel=0.01)
    assert any("left femur, left tibia" in n and "not measured" in n for n in sizing.notes)
    for size in sizing.sizes.values():
        assert size.measured + size.others + size.expected == pytest.approx(1.0)


def test_a_taller_declared_person_is_longer_where_nothing_was_measured() -> None:
    session = person(62).session
    pelvis = session.static.select(["RASIS", "LASIS", "RPSIS", "LPSIS"])

    def legs(height: float) -> float:
        subject = replace(session.subject, height_m=height, mass_kg=60.0)
        known = replace(session, subject=subject, static=pelvis, calibration=())
        return size_segments(known, SETTINGS).sizes["femur_r"].factor

    assert legs(1.4) < legs(1.6) < legs(1.8)


def test_one_psis_is_mirrored_at_the_middle_of_the_asis() -> None:
    trial = person(63).session.static
    both = find_person_points(trial, standing=True, regression="harrington2007")
    one = find_person_points(
        trial.select([n for n in trial.labels if n != "LPSIS"]), standing=True, regression="harrington2007"
    )
    np.testing.assert_allclose(one.points["LPSIS"], both.points["LPSIS"], atol=1e-12)
    np.testing.assert_allclose(one.centres["hip_l"].at, both.centres["hip_l"].at, atol=1e-12)
    assert "mirror image" in one.centres["hip_l"].source


def test_a_lateral_marker_and_half_the_width_give_the_middle_of_both() -> None:
    known = person(64)
    at = {m.name: np.array(m.nominal) for m in known.truth.markers}
    widths = {
        f"{joint}_width_{s}": float(np.linalg.norm(at[f"{s.upper()}{a}"] - at[f"{s.upper()}{b}"])) - 0.014
        for s in "rl"
        for joint, a, b in (("knee", "LFE", "MFE"), ("ankle", "LM", "MM"))
    }
    session = replace(known.session, subject=replace(known.session.subject, sizes_m=widths))
    found, full = scale_linearly(without(session, MEDIAL), SETTINGS), scale_linearly(session, SETTINGS)
    for segment in ("femur_r", "tibia_l"):
        assert found.scale_factors[segment][0] == pytest.approx(full.scale_factors[segment][0], rel=2e-3)
    taken, usual = (size_segments(s, SETTINGS).centres for s in (without(session, MEDIAL), session))
    assert "half its width" in taken["knee_r"].source
    assert "middle" in usual["knee_r"].source


def test_a_hip_states_how_far_the_model_s_is_from_the_person_s():
    """One uniform factor scales a pelvis, so its hip is not the regression's: the deviation holds the gap."""
    known, other = person(47), SETTINGS.model_copy(update={"hip_regression": "hara2016"})
    regression = size_segments(known.session, other).centres
    stated = scale_linearly(known.session, other).centres
    assert set(stated) == {"hip_r", "hip_l"}
    for name, centre in stated.items():
        assert np.all(np.array(centre.sd) >= np.array(regression[name].sd))
        assert np.any(np.array(centre.sd) > 1.02 * np.array(regression[name].sd))


def without(session: Session, landmarks: set[str], *, static: bool = True) -> Session:
    """The session as if some landmarks, or standing, had not been recorded."""

    def cut(trial: Trial | None) -> Trial | None:
        return trial and trial.select([n for n in trial.labels if find_canonical(n) not in landmarks])

    return replace(
        session,
        static=cut(session.static) if static else None,
        calibration=tuple(map(cut, session.calibration)),
        evaluation=tuple(map(cut, session.evaluation)),
    )


def _jia(data: Path) -> Session:
    folder = data / "jia_mri"
    files = {"static": folder / "Static.c3d", "calibration": (folder / "Walking02.c3d",)}
    subject = Subject(id="jia", model="lower_limb_14dof", height_m=1.62, mass_kg=63.0, **files)
    return load(subject, read_files(subject)).session


def _squat(data: Path) -> Session:
    folder = data / "opencap_squat"
    files = {"static": folder / "static1.trc", "calibration": (folder / "walking1.trc",)}
    subject = Subject(id="squat", model="lower_limb_14dof", height_m=1.68, mass_kg=62.6, **files)
    return load(subject, read_files(subject)).session


def _functional(data: Path) -> Session:
    folder = data / "functional"
    files = (folder / "right_hip.c3d", folder / "right_knee.c3d")
    subject = Subject(id="functional", model="lower_limb_14dof", calibration=files)
    return load(subject, read_files(subject)).session


RECORDED = {"jia_mri": _jia, "opencap_squat": _squat, "functional": _functional}


@pytest.mark.parametrize("name", RECORDED)
def test_markers_taken_away_from_recordings_move_lengths_little(name: str, shared_data: Path) -> None:
    _take_away(RECORDED[name](shared_data))


@pytest.mark.parametrize("seed", range(3))
def test_markers_taken_away_from_virtual_persons_move_lengths_little(seed: int) -> None:
    _take_away(make_demo_session(seed)[0])


def _take_away(session: Session) -> None:
    """Lengths stay within 3 % (6 % without standing) and their deviations widen."""
    full = by_length(size_segments(session, SETTINGS))
    cases = [("medial", without(session, MEDIAL), 0.03), ("a PSIS", without(session, {"RPSIS"}), 0.03)]
    if session.static is not None:
        cases.append(("standing", without(session, set(), static=False), 0.06))
    for what, cut, limit in cases:
        less = by_length(size_segments(cut, SETTINGS))
        for length in LEGS:
            moved = abs(np.log(less[length].factor / full[length].factor))
            assert moved <= np.log1p(limit), (what, length, moved)
            assert less[length].sd >= full[length].sd * (1.0 - 1e-3), (what, length)
            # what was lost is within what the smaller deviation and the larger one leave open
            assert moved <= 3.0 * np.hypot(less[length].sd, full[length].sd), (what, length)


def test_shoulders_that_a_standing_person_raises_are_measured_in_a_movement() -> None:
    """In a T pose the acromia, here 60 mm further in each, say nothing of the trunk's breadth."""
    session = person(3, seconds=2.0, model="full_body_35dof").session
    static = session.static
    raised = static.markers.copy()
    for side, outward in (("R", 1.0), ("L", -1.0)):
        arm = [
            k
            for k, label in enumerate(static.labels)
            if label[0] == side and label[1:3] in ("EL", "ME", "WR", "MH")
        ]
        shoulder, elbow = (static.labels.index(f"{side}{name}") for name in ("SHO", "ELB"))
        raised[:, shoulder, 2] -= outward * 0.06
        raised[:, arm] += (raised[:, shoulder] + [0.0, 0.0, outward * 0.27] - raised[:, elbow])[:, None]
    in_t_pose = replace(session, static=replace(static, markers=raised))
    hanging, found = (size_segments(s, SETTINGS) for s in (session, in_t_pose))
    assert found.sizes["torso"].factor == pytest.approx(hanging.sizes["torso"].factor, rel=0.01)
    assert found.sizes["torso"].measured == pytest.approx(hanging.sizes["torso"].measured, rel=0.02)
