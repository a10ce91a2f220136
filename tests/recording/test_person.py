"""What is no sound recording of one person is found, named and refused; whatever sound persons do is not."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from scaling_service.files.recording import read_recording
from scaling_service.model.body import BodyModel
from scaling_service.model.builtin import load_builtin, load_generic_person
from scaling_service.model.compile import compile_model, list_parameter_values
from scaling_service.model.scaling import scale_model
from scaling_service.model.trial import Relabelling, Trial
from scaling_service.numerics.multibody.tree import pose_markers
from scaling_service.recording.faults import repair_markers
from scaling_service.recording.findings import Finding, NotAPerson, Recordings, Stated, list_roles, refuse
from scaling_service.recording.orientation import apply, decide
from scaling_service.recording.person import ask, mend
from scaling_service.recording.root import ask_root

GENERIC = load_builtin("full_body_35dof")
COORDINATES = [c.name for c in GENERIC.coordinates]
STATURE_M = load_generic_person(GENERIC.name).height_m
FRAMES = 60
DEG = np.pi / 180.0

LEGS = ("RASIS", "LASIS", "RPSIS", "LPSIS", "RLFE", "LLFE", "RLM", "LLM", "RHEE", "LHEE", "RTOE", "LTOE")
TRUNK = ("C7", "T10", "CLAV", "STRN", "RSHO", "LSHO", "RELB", "LELB", "RWRA", "LWRA", "RWRB", "LWRB")
HEAD = ("RFHD", "LFHD", "RBHD", "LBHD")
PROTOCOLS = {
    "whole body": tuple(m.name for m in GENERIC.markers),
    "conventional": (*LEGS, *TRUNK, *HEAD),
    "legs": LEGS,
    "one leg": (*LEGS[:4], "RLFE", "RMFE", "RFH", "RLM", "RMM", "RHEE", "RTOE", "RMT1", "RMT5"),
    "no feet": (*LEGS[:8], "RMFE", "LMFE", "RMM", "LMM", "RFH", "LFH"),
    "upper body": (*TRUNK, *HEAD),
    "one arm": ("C7", "CLAV", "STRN", "RSHO", "LSHO", "RELB", "RMEL", "RWRA", "RWRB"),
}


def posture(kind: str, rng: np.random.Generator) -> np.ndarray:
    """Coordinates over two cycles of a movement, (FRAMES, n)."""
    phase = np.linspace(0.0, 4.0 * np.pi, FRAMES)
    half = 0.5 - 0.5 * np.cos(phase)
    q = {name: np.zeros(FRAMES) for name in COORDINATES}
    q["pelvis_ty"] += 0.95
    for side, lag in (("r", 0.0), ("l", np.pi)):
        q[f"arm_add_{side}"] -= 10 * DEG
        q[f"elbow_flex_{side}"] += (20 + 15 * np.sin(phase + lag)) * DEG
        q[f"hip_adduction_{side}"] += rng.normal(-3, 2) * DEG
        q[f"hip_rotation_{side}"] += rng.normal(0, 6) * DEG
        if kind in ("walking", "backwards", "crouched"):
            bent = 35 if kind == "crouched" else 0
            q[f"hip_flexion_{side}"] += (10 + bent + 22 * np.cos(phase + lag)) * DEG
            q[f"knee_angle_{side}"] += (22 + 1.4 * bent + 20 * np.cos(phase + lag + 1.9)) * DEG
        if kind in ("squat", "sitting"):
            deep = half if kind == "squat" else np.ones(FRAMES)
            q[f"hip_flexion_{side}"] += 95 * deep * DEG
            q[f"knee_angle_{side}"] += 100 * deep * DEG
        if kind == "handstand":
            q[f"arm_flex_{side}"] += 170 * DEG
    if kind in ("walking", "backwards", "crouched"):
        q["pelvis_tx"] += np.linspace(0.0, 2.5, FRAMES) * (-1 if kind == "backwards" else 1)
    if kind == "turning":
        q["pelvis_rotation"] += phase / 2
    if kind == "bending":
        q["lumbar_extension"] -= 40 * half * DEG
        q["pelvis_tilt"] -= 50 * half * DEG
    q["pelvis_tilt"] += {"supine": 90, "prone": -90}.get(kind, 0) * DEG
    q["pelvis_list"] += np.pi / 2 if kind == "on the side" else phase / 2 if kind == "cartwheel" else 0.0
    if kind == "handstand":
        q["pelvis_list"] += np.clip(np.linspace(-1, 4, FRAMES), 0, 1) * np.pi
    return np.stack([q[name] for name in COORDINATES], axis=1)


KINDS = (
    *("standing", "walking", "backwards", "crouched", "squat", "sitting", "turning", "bending"),
    *("supine", "prone", "on the side", "handstand", "cartwheel"),
)


def build(height_m: float, rng: np.random.Generator) -> BodyModel:
    """A person of a height, whose segments differ by 3 % from proportion."""
    own: dict[str, float] = {}
    factors = {}
    for segment in GENERIC.segment_names:
        name = segment.removesuffix("_r").removesuffix("_l")
        factor = own.setdefault(name, height_m / STATURE_M * float(np.exp(rng.normal(0.0, 0.03))))
        factors[segment] = (factor, factor, factor)
    return scale_model(GENERIC, factors)


def record(
    kind: str, seed: int, labels: Sequence[str] = PROTOCOLS["whole body"], height_m: float = 1.7
) -> Trial:
    """A person in a laboratory of any axes, markers placed to 6 mm."""
    model = build(height_m, np.random.default_rng(seed))
    rng = np.random.default_rng([seed, KINDS.index(kind)])
    tree = compile_model(model, tuple(labels))
    markers = np.asarray(pose_markers(tree, posture(kind, rng), list_parameter_values(model)))
    markers = markers + np.random.default_rng([seed, len(labels)]).normal(0.0, 0.006, (1, len(labels), 3))
    markers = markers + rng.normal(0.0, 0.001, markers.shape)
    axes = np.eye(3)[np.random.default_rng(seed).permutation(3)]
    axes[0] *= np.linalg.det(axes)
    times = np.arange(FRAMES) / 30.0
    return Trial(name=kind, times=times, labels=tuple(labels), markers=markers @ axes.T, rate_hz=30.0)


def asked(*trials: Trial, height_m: float | None = None, static: str | None = None) -> tuple[Finding, ...]:
    turned = [apply(decide(trial, roles=list_roles(trial)), trial) for trial in trials]
    return ask(Recordings(trials=turned, static=static, stated=Stated(height_m=height_m)))


def codes(findings: Sequence[Finding], severity: str = "refusal") -> set[str]:
    return {one.code for one in findings if one.severity == severity}


def exchanged(*labels: str) -> Callable[[Trial], Trial]:
    """Labels, two by two, exchanged."""
    pairs = list(zip(labels[::2], labels[1::2], strict=True))
    names = dict(pairs) | {b: a for a, b in pairs}
    return lambda trial: trial.relabel(names)


def mirrored(axis: int) -> Callable[[Trial], Trial]:
    signs = np.where(np.arange(3) == axis, -1.0, 1.0)
    return lambda trial: trial.with_markers(trial.markers * signs)


@pytest.mark.parametrize("protocol", PROTOCOLS)
@pytest.mark.parametrize("kind", KINDS)
def test_sound_persons_pass_whatever_they_do(kind: str, protocol: str) -> None:
    for seed, height_m, stated in ((1, 1.25, True), (2, 1.6, False), (3, 1.95, True)):
        trial = record(kind, seed, PROTOCOLS[protocol], height_m)
        assert codes(asked(trial, height_m=height_m if stated else None)) == set()


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("protocol", ["whole body", "conventional", "legs", "upper body", "one arm"])
def test_a_mirrored_recording_is_refused_with_both_readings(protocol: str, kind: str) -> None:
    found = asked(mirrored(KINDS.index(kind) % 3)(record(kind, 4, PROTOCOLS[protocol])))
    first = found[0]
    assert first.severity == "refusal"
    assert first.code in ("mirrored", "backwards", "sides_exchanged")
    if protocol in ("whole body", "conventional"):
        assert first.code == "mirrored"
        assert "axis was mirrored, or the labels of both sides are exchanged" in first.problem
        assert "`mirrored:`" in first.remedy
        assert "`corrections:`" in first.remedy


def test_what_the_person_says_mends_it() -> None:
    right = record("walking", 5, PROTOCOLS["conventional"])
    wrong = mirrored(1)(right)
    mended = mend(wrong, (), "y")
    np.testing.assert_array_equal(mended.markers, right.markers)
    assert [repair.what for repair in mended.repairs] == ["mirrored"]
    assert asked(mended) == ()
    (found,) = asked(wrong)
    (offer,) = found.exchanges
    labels = dict(zip(offer.labels, offer.true, strict=True))
    put_right = mend(wrong, [Relabelling(labels, offer.start_s, offer.end_s)], None)
    assert asked(put_right) == ()  # a sound person, if the other reading was true


@pytest.mark.parametrize(
    ("spoil", "named"),
    [
        (exchanged("RLFE", "LLFE"), {"RLFE", "LLFE"}),
        (exchanged("RASIS", "LASIS"), {"RASIS", "LASIS"}),
        (exchanged("RSHO", "LSHO", "RFHD", "LFHD", "RBHD", "LBHD"), {"RSHO", "LSHO"}),
        (exchanged("RHEE", "LHEE", "RTOE", "LTOE"), {"RHEE", "LHEE"}),
        (exchanged("RASIS", "RPSIS", "LASIS", "LPSIS"), {"RASIS", "RPSIS"}),
        (exchanged("RLFE", "RLM"), {"RLFE", "RLM"}),
        (exchanged("RHEE", "RTOE", "LHEE", "LTOE"), {"RHEE", "RTOE"}),
    ],
    ids=["knees", "pelvis", "shoulders and head", "feet", "front and back", "knee and ankle", "heel and toe"],
)
def test_exchanged_labels_are_named(spoil: Callable[[Trial], Trial], named: set[str]) -> None:
    found = asked(spoil(record("walking", 6, PROTOCOLS["conventional"])), height_m=1.7)
    assert codes(found)
    assert any(named <= {*one.labels} for one in found)


def test_an_upper_body_that_is_mirrored_alone_is_refused() -> None:
    trial = record("walking", 7, PROTOCOLS["conventional"])
    columns = [trial.index(label) for label in (*TRUNK, *HEAD)]
    for axis in range(3):
        markers = trial.markers.copy()
        middle = markers[:, columns].mean(axis=1, keepdims=True)[..., axis]
        markers[:, columns, axis] = 2.0 * middle - markers[:, columns, axis]
        assert codes(asked(trial.with_markers(markers)))


@pytest.mark.parametrize("suffix", ["_2", "B"])
def test_two_persons_without_prefixes_are_refused(suffix: str) -> None:
    one, other = record("walking", 8, LEGS), record("walking", 9, LEGS)
    labels = (*one.labels, *(f"{label}{suffix}" for label in other.labels))
    markers = np.concatenate([one.markers, other.markers + 1.5], axis=1)
    assert "two_persons" in codes(asked(replace(one, labels=labels, markers=markers)))
    beside = np.concatenate([one.markers, one.markers + 0.02], axis=1)  # clusters named so are no person
    assert "two_persons" not in codes(asked(replace(one, labels=labels, markers=beside)))


@pytest.mark.parametrize("factor", [0.1 * 25.4, 1 / 2.54, 0.5])
def test_lengths_in_another_unit_are_refused(factor: float) -> None:
    trial = record("standing", 10, PROTOCOLS["conventional"], 1.65)
    wrong = trial.with_markers(factor * trial.markers)
    assert codes(asked(wrong, height_m=1.65)) & {"scale", "length"}


def test_a_volume_that_is_too_large_is_asked_about_and_not_refused() -> None:
    told = {}
    for factor in (1.0, 1.05):
        findings = []
        for seed in range(20, 40):
            trial = record("standing", seed, PROTOCOLS["conventional"])
            wrong = trial.with_markers(factor * trial.markers)
            findings.append(asked(wrong, height_m=1.7, static="standing"))
        assert not any(codes(found) for found in findings)
        told[factor] = sum("scale" in codes(found, "warning") for found in findings)
    assert told[1.0] <= 2
    assert told[1.05] >= 10


@pytest.mark.parametrize(
    ("height_m", "mass_kg", "told"), [(1.68, 15.0, True), (1.68, 45.0, False), (1.0, 15.0, False)]
)
def test_a_mass_that_no_person_of_this_height_has_is_asked_about(
    height_m: float, mass_kg: float, told: bool
) -> None:
    found = ask(Recordings(trials=[], stated=Stated(height_m=height_m, mass_kg=mass_kg)))
    assert [one.code for one in found] == ["mass"] * told


def test_recordings_of_two_persons_contradict_each_other() -> None:
    standing, walking = (record(kind, 11, height_m=1.6) for kind in ("standing", "walking"))
    assert asked(standing, walking) == ()
    (found,) = asked(standing, record("walking", 12, height_m=1.85))
    assert (found.code, found.severity) == ("another_person", "refusal")
    larger = walking.with_markers(1.1 * walking.markers)
    assert "another_person" in {one.code for one in asked(standing, larger)}


def test_markers_put_on_anew_are_told_and_not_refused() -> None:
    standing, walking = (record(kind, 13, height_m=1.7) for kind in ("standing", "walking"))
    anew = walking.with_markers(
        walking.markers + np.random.default_rng(0).normal(0.0, 0.012, (1, len(walking.labels), 3))
    )
    found = [one for one in asked(standing, anew) if one.code == "another_person"]
    assert [one.severity for one in found] in ([], ["warning"])


LOWER = load_builtin("lower_limb_14dof")


def shows_root(
    labels: Sequence[str], model: BodyModel = LOWER, extra: Mapping[str, Sequence[str]] = {}
) -> bool:
    trial = record("standing", 14)
    kept = trial.select([label for label in trial.labels if label in labels])
    return not list(ask_root(kept, model, extra))


def test_a_pelvis_that_nothing_shows_is_refused_by_its_markers() -> None:
    every = PROTOCOLS["whole body"]
    without = [label for label in every if not label.endswith("SIS")]
    assert shows_root(every)
    assert not shows_root(without)
    trial = record("standing", 14).select(without)
    (found,) = ask_root(trial, LOWER, {})
    assert {*found.labels} == {"RASIS", "LASIS", "RPSIS", "LPSIS"}
    assert "right femur" in found.problem
    with pytest.raises(NotAPerson, match="pelvis is not shown"):
        refuse([found])


def test_a_pelvis_is_shown_by_a_cluster_by_joints_or_needs_not_be() -> None:
    every = PROTOCOLS["whole body"]
    without = [label for label in every if not label.endswith("SIS")]
    assert shows_root(every, extra={"pelvis": ("C7", "RSHO", "LSHO")})
    assert shows_root([*without, "RASIS", "LASIS"])  # two of them and both hips
    assert shows_root([label for label in without if label[0] == "R"])  # a leg alone hangs on nothing
    assert shows_root(PROTOCOLS["upper body"], GENERIC)


def test_hanging_head_down_is_refused_of_who_stands() -> None:
    trial = record("standing", 15)
    turned = apply(decide(trial, roles=list_roles(trial)), trial)
    hanging = turned.with_markers(turned.markers * [1.0, -1.0, -1.0])
    for static, severity in (("standing", "refusal"), (None, "warning")):
        found = ask(Recordings(trials=[hanging], static=static))
        assert codes(found, severity) == {"upside_down"}


@pytest.mark.parametrize("axis", [0, 2], ids=["sideways", "forward"])
@pytest.mark.parametrize("protocol", ["whole body", "legs"])
def test_a_tilted_laboratory_is_told_by_who_stands(protocol: str, axis: int) -> None:
    trial = record("standing", 15, PROTOCOLS[protocol])
    straight = apply(decide(trial, roles=list_roles(trial)), trial)
    turn = Rotation.from_euler("xyz"[axis], 20.0, degrees=True).as_matrix()
    tilted = straight.with_markers(straight.markers @ turn.T)
    for one, static, said in (
        (straight, "standing", set()),
        (tilted, None, set()),
        (tilted, "standing", {"leaning"}),
    ):
        assert codes(ask(Recordings(trials=[one], static=static)), "warning") == said


def test_a_squat_is_no_standing() -> None:
    trial = record("sitting", 15)
    assert codes(asked(trial, static="sitting"), "warning") == {"bent"}
    assert not codes(asked(trial), "warning")


def test_a_mirrored_person_is_not_told_to_stand_up_too() -> None:
    trial = record("standing", 15)
    turned = apply(decide(trial, roles=list_roles(trial)), trial)
    found = ask(
        Recordings(trials=[turned.with_markers(turned.markers * [1.0, -1.0, 1.0])], static="standing")
    )
    assert codes(found) == {"mirrored"}
    assert codes(found, "warning") == set()


def test_nothing_seen_is_nothing_asked() -> None:
    trial = record("standing", 16)
    assert ask(Recordings(trials=[trial.with_markers(np.full_like(trial.markers, np.nan))])) == ()
    assert ask(Recordings(trials=[trial.select(["RASIS"])])) == ()
    assert ask(Recordings(trials=[])) == ()


def test_real_recordings_are_of_persons_and_their_mirror_images_are_not(shared_data: Path) -> None:
    """Where at least three things show the front; all of these recordings are sound."""
    files = sorted(
        p
        for p in shared_data.rglob("*")
        if p.suffix.lower() in (".c3d", ".trc") and not {"wild", "hidden"} & {*p.parts}
    )
    mirrored_found = 0
    for file in files:
        trial = repair_markers(read_recording(file)).trial
        assert codes(asked(trial)) == set(), file
        if len(list_roles(trial)) >= 8:
            assert codes(asked(mirrored(0)(trial))) >= {"mirrored"}, file
            mirrored_found += 1
    assert mirrored_found >= 20
