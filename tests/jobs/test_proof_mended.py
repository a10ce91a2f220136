"""What laboratories get wrong, made on purpose in recordings of a known person: named with its remedy."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from scaling_service.capabilities.intake.result import ProblemEntry, ProofDocument
from scaling_service.capabilities.intake.run import prove, prove_folder
from scaling_service.capabilities.scaling.sizes.points import measure_standing_legs, read_landmarks
from scaling_service.core.arrays import Array
from scaling_service.files.trc import write_trc
from scaling_service.model.builtin import load_builtin
from scaling_service.model.compile import repeat_default_pose
from scaling_service.model.trial import Trial
from scaling_service.virtual.plates import record_on_plates, write_forces
from tests.calibration.people import movement, trial

BARE = {"subject": {"id": "S01", "sex": "F", "height_m": 1.7, "mass_kg": 62.0}}
FEET = load_builtin("lower_limb_feet_18dof")
CONVENTIONAL = {
    "RASIS": "RASI",
    "LASIS": "LASI",
    "RLFE": "RKNE",
    "LLFE": "LKNE",
    "RLM": "RANK",
    "LLM": "LANK",
}


def standing(seconds: float = 1.0, name: str = "one") -> Trial:
    return trial(FEET, name, repeat_default_pose(FEET, round(100 * seconds)), 5e-4, np.random.default_rng(0))


def moving(seed: int, name: str, seconds: float = 2.0, walks_m: float = 0.0) -> Trial:
    """Legs in motion, and the whole person forward over the floor."""
    q = movement(FEET, round(100 * seconds), np.random.default_rng(seed))
    found = trial(FEET, name, q, 5e-4, np.random.default_rng(seed))
    way = np.linspace(0.0, walks_m, found.n_frames)[:, None, None] * [1.0, 0.0, 0.0]
    return found.with_markers(found.markers + way)


def looked(folder: Path, trials: Mapping[str, Trial], document: Mapping[str, Any] = BARE) -> ProofDocument:
    folder.mkdir(exist_ok=True)
    for name, one in trials.items():
        write_trc(folder / f"{name}.trc", one, "mm")
    return prove(folder, document, folder.parent / "out")


def static_of(found: ProofDocument) -> str | None:
    return next((f.name for f in found.files if f.role == "trials.static"), None)


def reported(found: ProofDocument, *words: str) -> list[ProblemEntry]:
    return [
        p for p in found.problems if all(w in f"{p.file} {p.field} {p.problem} {p.remedy}" for w in words)
    ]


def test_the_static_trial_is_who_stands_still_whatever_it_is_called(tmp_path: Path) -> None:
    found = looked(
        tmp_path / "lab", {"anat_pose_walk": moving(1, "a"), "run_3": standing(), "static": moving(2, "b")}
    )
    assert static_of(found) == "run_3.trc"
    assert reported(found, "static") == []


def test_of_two_that_stand_more_landmarks_count_before_a_name(tmp_path: Path) -> None:
    few = standing().select([n for n in standing().labels if n not in ("RMFE", "LMFE", "RMM", "LMM")])
    found = looked(tmp_path / "lab", {"static": few, "trial7": standing(), "walk": moving(1, "w")})
    assert static_of(found) == "trial7.trc"
    found = looked(tmp_path / "same", {"static": standing(), "trial7": standing(), "walk": moving(1, "w")})
    assert static_of(found) == "static.trc"
    assert "trial7.trc would do as well" in next(f.why for f in found.files if f.role == "trials.static")


def sitting(bent_deg: float = 90.0) -> Trial:
    q = repeat_default_pose(FEET, 300)
    for k, coordinate in enumerate(FEET.coordinates):
        q[:, k] += np.deg2rad(bent_deg) if coordinate.name.startswith(("hip_flexion", "knee_angle")) else 0.0
    return trial(FEET, "sit", q, 1e-4, np.random.default_rng(0))


def test_who_sits_does_not_stand(tmp_path: Path) -> None:
    found = looked(tmp_path / "lab", {"static_sitting": sitting(), "b": standing(), "walk": moving(1, "w")})
    assert static_of(found) == "b.trc"
    assert not reported(found, "upright")


def test_that_nobody_stands_in_the_static_trial_is_said(tmp_path: Path) -> None:
    found = looked(tmp_path / "lab", {"static": sitting(), "walk": moving(1, "w")})
    assert static_of(found) == "static.trc"
    assert reported(found, "static.trc", "nobody stands upright")


def test_legs_are_nearly_as_long_in_whoever_sits() -> None:
    legs = [measure_standing_legs(read_landmarks(one)) for one in (sitting(), standing())]
    assert legs[0] == pytest.approx(legs[1], rel=0.15)  # the pelvis turns, too: 32 % by the straight way


def test_a_pelvis_of_another_day_is_reported(tmp_path: Path) -> None:
    other = standing()
    pelvis = [other.index(n) for n in ("RASIS", "LASIS", "RPSIS", "LPSIS")]
    markers = other.markers.copy()
    middle = markers[:, pelvis].mean(axis=1, keepdims=True)
    markers[:, pelvis] = middle + 1.15 * (markers[:, pelvis] - middle)
    wide = replace(other, markers=markers)
    found = looked(tmp_path / "lab", {"static": wide, "walk": moving(1, "w"), "walk2": moving(2, "v")})
    (problem,) = reported(found, "static.trc", "15% wider", "trials.static")
    assert "same session" in (problem.remedy or "")
    found = looked(tmp_path / "both", {"static": wide, "again": standing(), "walk": moving(1, "w")})
    assert static_of(found) == "again.trc"
    assert reported(found, "wider") == []


def test_without_standing_that_is_said(tmp_path: Path) -> None:
    found = looked(tmp_path / "lab", {"walk": moving(1, "w"), "walk2": moving(2, "v")})
    (problem,) = reported(found, "nobody stands still", "trials.static")
    assert "Record" in (problem.remedy or "")
    assert found.proposal is not None
    assert set(found.proposal["trials"]) == {"calibration", "evaluation"}


@pytest.mark.parametrize(
    ("names", "held_out"),
    [
        (["HC05", "HC23"], ["HC23.trc"]),  # only this one walks
        (["hip", "HC23"], ["HC23.trc"]),
        (["walking", "HC23"], ["walking.trc"]),
        (["hip", "knee"], []),  # both are needed to fit
        (["trunk_a", "trunk_b"], ["trunk_a.trc"]),  # a run is no part of a trunk
        (["HC05"], []),
    ],
)
def test_one_movement_is_left_to_judge_by(tmp_path: Path, names: list[str], held_out: list[str]) -> None:
    trials = {n: moving(k, n, walks_m=2.0 if n == "HC23" else 0.0) for k, n in enumerate(names)}
    found = looked(tmp_path / "lab", {"x01": standing(), **trials})
    assert found.proposal is not None
    assert found.proposal["trials"].get("evaluation", []) == held_out
    assert bool(reported(found, "no evaluation trial")) == (not held_out)


def test_forces_go_to_movements_by_time_where_names_do_not_decide(tmp_path: Path) -> None:
    folder = tmp_path / "lab"
    folder.mkdir()
    made = {name: record_on_plates(name=name, seed=k) for k, name in enumerate(("first", "second"))}
    shift = {"first": 0.0, "second": 7.0}
    for name, one in made.items():
        times = one.trial.times + shift[name]
        write_trc(folder / f"{name}.trc", replace(one.trial, times=times), "mm")
        write_forces(folder / f"{'AB' if name == 'second' else 'CD'}.mot", times, one.plates)
    still = replace(made["first"].trial, markers=np.repeat(made["first"].trial.markers[:1], 250, axis=0))
    write_trc(folder / "static_CD.trc", still, "mm")
    found = prove(folder, BARE, tmp_path / "out")
    assert found.proposal is not None
    assert found.proposal["forces"] == {"first.trc": "CD.mot", "second.trc": "AB.mot"}


@pytest.mark.parametrize(("factor", "told"), [(1.0, False), (1e-3, True), (1.0 / 600.0, True)])
def test_forces_in_another_unit_are_told(tmp_path: Path, factor: float, told: bool) -> None:
    """In kN and in body weights nobody stood on the plates, and nothing was said."""
    folder = tmp_path / "lab"
    folder.mkdir()
    one = record_on_plates(name="squat")
    write_trc(folder / "squat.trc", one.trial, "mm")
    plates = tuple(p * np.array([factor] * 3 + [1.0] * 3 + [factor] * 3) for p in one.plates)
    write_forces(folder / "squat_grf.mot", one.trial.times, plates)
    found = prove(folder, BARE, tmp_path / "out")
    assert bool(reported(found, "squat.trc", "nobody weighs so little", "N")) is told


def test_plates_that_nobody_uses_are_no_other_unit(tmp_path: Path) -> None:
    folder = tmp_path / "lab"
    folder.mkdir()
    one = record_on_plates(name="squat")
    write_trc(folder / "squat.trc", one.trial, "mm")
    noise = np.random.default_rng(0)
    plates = tuple(np.where(np.arange(9) // 3 == 1, p, noise.normal(0.0, 0.5, p.shape)) for p in one.plates)
    write_forces(folder / "squat_grf.mot", one.trial.times, plates)
    assert not reported(prove(folder, BARE, tmp_path / "out"), "nobody weighs so little")


def test_forces_of_another_time_are_reported(tmp_path: Path) -> None:
    folder = tmp_path / "lab"
    folder.mkdir()
    one = record_on_plates(name="squat")
    write_trc(folder / "squat.trc", one.trial, "mm")
    write_forces(folder / "squat_grf.mot", one.trial.times[60:], tuple(p[60:] for p in one.plates))
    found = prove(folder, BARE, tmp_path / "out")
    assert reported(found, "squat_grf.mot", "covers 0.60", "forces.squat.trc")


def plates_at(folder: Path, extra: Array | None) -> ProofDocument:
    """A person whose feet are on two plates, and a third one that reads what is given."""
    folder.mkdir()
    one = record_on_plates(name="squat")
    plates = one.plates if extra is None else (*one.plates, extra)
    write_trc(folder / "squat.trc", one.trial, "mm")
    write_forces(folder / "squat_grf.mot", one.trial.times, plates)
    return prove(folder, BARE, folder.parent / "out")


def test_what_cameras_and_plates_do_wrong_is_reported_with_remedies(tmp_path: Path) -> None:
    folder = tmp_path / "lab"
    folder.mkdir()
    one = record_on_plates(name="squat")
    trial, plates = one.trial, tuple(plate.copy() for plate in one.plates)
    markers = trial.markers.copy()
    pair = [trial.index(label) for label in ("RLFE", "RMFE")]
    markers[10:30, pair] = markers[10:30, pair].mean(axis=1, keepdims=True)
    plates[0][[15, 40], 1] += 300.0
    write_trc(folder / "squat.trc", trial.with_markers(markers), "mm")
    write_forces(folder / "squat_grf.mot", trial.times, plates)
    found = prove(folder, BARE, tmp_path / "out")
    assert reported(found, "RLFE, RMFE", "seen as one point", "20 frames", "Correct the trajectories")
    assert reported(found, "plate 1 fy", "jumps by up to 300 N", "2 frames", "amplifier")


@pytest.mark.parametrize(("newton", "expected"), [(35.0, True), (2.0, False)])
def test_an_offset_that_no_foot_explains_is_reported(tmp_path: Path, newton: float, expected: bool) -> None:
    empty = np.tile([0.0, newton, 0.0, 2.0, 0.0, 1.0, 0.0, 0.0, 0.0], (250, 1))
    found = plates_at(tmp_path / "lab", empty)
    assert bool(reported(found, "plate 3", "no foot", "Zero the plate")) == expected
    plates = found.recordings[0].plates
    assert [p.loaded_by[0].split(" foot")[0] if p.loaded_by else "" for p in plates[:2]] == ["right", "left"]
    assert plates[2].offset_N == pytest.approx(newton)
    assert plates[2].loaded_by == []
    assert plates[0].offset_N is None


@pytest.mark.parametrize("frames", [slice(0, 40), slice(None)])
def test_a_foot_that_is_not_seen_is_not_away_from_its_plate(tmp_path: Path, frames: slice) -> None:
    one = record_on_plates(name="squat")
    markers = one.trial.markers.copy()
    foot = [k for k, label in enumerate(one.trial.labels) if label[1:] in ("HEE", "TOE", "MT1", "MT5")]
    markers[frames, foot] = np.nan
    write_trc(tmp_path / "squat.trc", one.trial.with_markers(markers), "mm")
    write_forces(tmp_path / "squat_grf.mot", one.trial.times, one.plates)
    found = prove(tmp_path, BARE, tmp_path / "out")
    assert not reported(found, "plate 1", "no foot")
    plate = found.recordings[0].plates[0]
    assert plate.offset_N is None
    assert not any("nobody" in who for who in plate.loaded_by)


def test_heels_and_toes_with_plates_call_for_feet(tmp_path: Path) -> None:
    found = plates_at(tmp_path / "lab", None)
    assert found.model == "full_body_35dof"  # all of its markers are there
    write_trc(tmp_path / "lab" / "squat.trc", moving(1, "squat", 2.5), "mm")
    found = prove(tmp_path / "lab", BARE, tmp_path / "out")
    assert found.model == "lower_limb_feet_18dof"
    assert "plates" in (found.model_why or "")
    assert looked(tmp_path / "bare", {"a": standing(), "b": moving(1, "b")}).model == "lower_limb_14dof"


def test_height_mass_and_sex_are_asked_for_together(tmp_path: Path) -> None:
    trials = {"a": standing(), "b": moving(1, "b")}
    (problem,) = reported(looked(tmp_path / "lab", trials, {"subject": {"id": "S01"}}), "not known")
    assert problem.problem.startswith("height, mass and sex")
    (problem,) = reported(looked(tmp_path / "two", trials, {"subject": {"id": "S", "sex": "F"}}), "not known")
    assert problem.problem.startswith("height and mass")
    assert reported(looked(tmp_path / "all", trials), "not known") == []


@pytest.mark.parametrize(("stated", "factor"), [("m", 1e3), ("mm", 1e-3)])
def test_a_wrong_unit_is_reported_with_its_remedy(tmp_path: Path, stated: str, factor: float) -> None:
    folder = tmp_path / "lab"
    folder.mkdir()
    walk = moving(1, "walk")
    write_trc(folder / "walk.trc", walk.with_markers(walk.markers * factor), stated)
    found = looked(folder, {"one": standing()})
    (problem,) = reported(found, "walk.trc", "Units", "multiplied by")
    assert "right unit" in (problem.remedy or "")
    assert static_of(found) == "one.trc"
    assert [p for p in found.problems if p.severity == "error"] == []


def test_a_trajectory_without_a_label_is_reported_with_what_it_fills(tmp_path: Path) -> None:
    walk = moving(1, "walk")
    column = walk.index("RLM")
    stray = np.full((walk.n_frames, 1, 3), np.nan)
    stray[50:61, 0] = walk.markers[50:61, column]
    markers = walk.markers.copy()
    markers[50:61, column] = np.nan
    holed = replace(walk, labels=(*walk.labels, "*110"), markers=np.concatenate([markers, stray], axis=1))
    found = looked(tmp_path / "lab", {"a": standing(), "walk": holed})
    assert reported(found, "walk.trc", "*110", "fills 11 frames of RLM", "Label")
    assert "*110" not in {e.label for e in found.extra_markers}


CLUSTER = {
    "RTHI1": (0.05, -0.1, 0.06),
    "RTHI2": (0.07, -0.2, 0.03),
    "RTHI3": (-0.02, -0.26, 0.08),
    "RTHI4": (0.03, -0.3, 0.07),
}


def clustered(one: Trial, order: tuple[str, ...], rows: slice) -> Trial:
    """A recording with four markers on the thigh, whose labels are in another order for a while."""
    names = list(CLUSTER)
    hip, knee, side = (one.position(n) for n in ("RASIS", "RLFE", "RMFE"))
    y = (hip - knee) / np.linalg.norm(hip - knee, axis=1, keepdims=True)
    z = knee - side - np.sum((knee - side) * y, axis=1, keepdims=True) * y
    z /= np.linalg.norm(z, axis=1, keepdims=True)
    x = np.cross(y, z)
    at = {n: knee + a * x - (b + 0.4) * -y * 0.5 + c * z for n, (a, b, c) in CLUSTER.items()}
    places = np.stack([at[n] for n in names], axis=1)
    places[rows] = places[rows][:, [names.index(n) for n in order]]
    return replace(one, labels=(*one.labels, *names), markers=np.concatenate([one.markers, places], axis=1))


@pytest.mark.parametrize(
    "order",
    [
        ("RTHI2", "RTHI1", "RTHI3", "RTHI4"),
        ("RTHI2", "RTHI3", "RTHI4", "RTHI1"),
        ("RTHI1", "RTHI2", "RTHI3", "RTHI4"),
    ],
    ids=["two", "four", "none"],
)
def test_labels_exchanged_for_a_while_are_reported_against_the_other_recordings(
    tmp_path: Path, order: tuple[str, ...]
) -> None:
    straight = tuple(CLUSTER)
    wrong = sorted(a for a, b in zip(straight, order, strict=True) if a != b)
    found = looked(
        tmp_path / "lab",
        {
            "a": clustered(standing(), straight, slice(0, 0)),
            "walk": clustered(moving(1, "w"), order, slice(60, 120)),
            "walk2": clustered(moving(2, "v"), straight, slice(0, 0)),
        },
    )
    problems = reported(found, "look exchanged")
    if not wrong:
        assert problems == []
        return
    (problem,) = problems
    assert problem.file == "walk.trc"
    assert f"the labels {' and '.join(wrong)} look exchanged from 0.60 to 1.19 s" in problem.problem
    assert "Correct the labels" in (problem.remedy or "")


def conventional(one: Trial) -> Trial:
    """As a clinic marks it: no inner knee, one sacral marker, wands on thigh and shank."""
    back = 0.5 * (one.position("RPSIS") + one.position("LPSIS"))
    new = {"SACR": back + np.array([0.0, 0.03, 0.0])}
    for side in "RL":
        out = np.array([0.0, 0.0, 0.06 if side == "R" else -0.06])
        new[f"{side}THI"] = 0.5 * (one.position(f"{side}ASIS") + one.position(f"{side}LFE")) + out
        new[f"{side}TIB"] = 0.5 * (one.position(f"{side}LFE") + one.position(f"{side}LM")) + out
        new[f"{side}TUB"] = one.position(f"{side}MFE") + np.array([0.03, -0.05, 0.0])
    kept = [n for n in one.labels if n[1:] not in ("PSIS", "MFE", "FH")]
    places = np.concatenate([one.select(kept).markers, np.stack(list(new.values()), axis=1)], axis=1)
    return replace(one, labels=(*kept, *new), markers=places).relabel(CONVENTIONAL)


def test_a_conventional_set_is_named_with_what_it_means(tmp_path: Path) -> None:
    trials = {"a": conventional(standing()), "b": conventional(moving(1, "b"))}
    document = {**BARE, "sizes": {"knee_width_r_mm": 101.0}}
    found = looked(tmp_path / "lab", trials, document)
    assert found.marker_set is not None
    assert (found.marker_set.name, found.marker_set.share) == ("plug_in_gait_lower", 1.0)
    said = " ".join(found.consequences)
    for words in (
        "SACR instead of two PSIS",
        "no inner knee marker",
        "RTHI, LTHI",
        "knee_width_l_mm: …",
        "MB_am",
    ):
        assert words in said
    assert "knee_width_r_mm" not in said
    assert found.proposal is not None
    extra = found.proposal["extra_markers"]
    assert (extra["SACR"], extra["RTHI"], extra["LTIB"], extra["RTUB"]) == (
        "pelvis",
        "femur_r",
        "tibia_l",
        "tibia_r",
    )
    assert found.proposal["sizes"] == {"knee_width_r_mm": 101.0}


def test_a_label_that_a_set_knows_is_never_guessed_by_place(tmp_path: Path) -> None:
    found = looked(tmp_path / "lab", {"a": conventional(standing()), "b": conventional(moving(1, "b"))})
    assert [(m.marker, m.label) for m in found.markers if m.source == "place"] == []
    assert {m.marker for m in found.markers if m.label is None} == {
        "RPSIS", "LPSIS", "RMFE", "LMFE", "RFH", "LFH",
    }  # fmt: skip


def test_folders_inside_are_reported_and_the_look_itself_is_none(tmp_path: Path) -> None:
    folder = tmp_path / "lab"
    (folder / "bones").mkdir(parents=True)
    (folder / "bones" / "femur_r.stl").write_bytes(b"solid")
    looked(folder, {"a": standing(), "b": moving(1, "b")})
    for _ in range(2):
        found = prove_folder(folder, folder / "looked")
        (problem,) = reported(found, "folders inside")
        assert problem.problem.endswith("looked at: bones")
    content = yaml.safe_load((folder / "looked" / "subject.yaml").read_text(encoding="utf-8"))
    assert list(content) == ["subject", "model", "trials"]
    assert list(content["trials"]) == ["static", "calibration"]
