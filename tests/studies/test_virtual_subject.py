"""A virtual person: reproducible, consistent with its own truth, and of human size and motion."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import fields, replace

import numpy as np
import pytest

from scaling_service.capabilities.motion.inverse_kinematics import inverse_kinematics
from scaling_service.core.streams import stream
from scaling_service.model.anatomy.centres import LANDMARK_SD_M
from scaling_service.model.anatomy.lengths import measure_segment_lengths
from scaling_service.model.compile import compile_model, list_parameter_values
from scaling_service.model.poses import pose_neutral_frames
from scaling_service.numerics.multibody.tree import pose_markers
from scaling_service.virtual import motion
from scaling_service.virtual.artefact import Artefact, draw_artefact, draw_residual, with_artefact
from scaling_service.virtual.example import make_demo_session
from scaling_service.virtual.subject import CAMERA_MM, VirtualSettings, VirtualSubject, make_virtual_subject
from tests.finished import make_once

CLEAN = VirtualSettings(placement=0.0, artefact=0.0, noise=0.0, gaps=0.0)
SHORT = VirtualSettings(functional_s=1.0, static_s=0.1, gait_trials=0)
ROUNDING_M = 1e-8  # the sweeps' cost is a difference of moments of 0.01 m2, exact to about 1e-17 m2
COSTLY = pytest.mark.costly  # what a hundred and twenty persons prove
MOVING = ("hip_r", "hip_l", "knee_r", "knee_l", "gait_1", "gait_2")


@pytest.fixture(scope="module")
def people(tmp_path_factory: pytest.TempPathFactory) -> list[VirtualSubject]:
    return make_once(
        tmp_path_factory, "people", lambda: [make_virtual_subject(seed, SHORT) for seed in range(120)]
    )


@pytest.fixture(scope="module")
def person() -> VirtualSubject:
    return make_virtual_subject(7)


def column(person: VirtualSubject, trial: str, coordinate: str) -> np.ndarray:
    """True angle in degrees (or position in m)."""
    values = person.motions[trial][:, person.model.coordinate_names.index(coordinate)]
    return values if coordinate[-2:] in ("tx", "ty", "tz") else np.degrees(values)


def ankles(person: VirtualSubject, trial: str) -> np.ndarray:
    """(n_frames, right and left, 3)."""
    tree = compile_model(person.model, ("RAJC", "LAJC"))
    return pose_markers(tree, person.motions[trial], list_parameter_values(person.model))


# --- reproducible ---------------------------------------------------------------------------------


def same(a: VirtualSubject, b: VirtualSubject) -> None:
    for field in fields(VirtualSubject):
        if field.name == "motions":
            assert a.motions.keys() == b.motions.keys()
            for name, q in a.motions.items():
                np.testing.assert_array_equal(q, b.motions[name])
        elif field.name == "trials":
            for name, trial in a.trials.items():
                np.testing.assert_array_equal(trial.markers, b.trials[name].markers)
        else:
            assert getattr(a, field.name) == getattr(b, field.name), field.name


def test_the_same_seed_is_the_same_person_whatever_came_before_or_beside() -> None:
    seeds = [3, 1, 2, 3]
    one_by_one = [make_virtual_subject(seed, SHORT) for seed in seeds]
    with ThreadPoolExecutor(4) as pool:
        together = list(pool.map(lambda seed: make_virtual_subject(seed, SHORT), reversed(seeds)))
    for a, b in zip(one_by_one, reversed(together), strict=True):
        same(a, b)
    same(one_by_one[0], one_by_one[3])
    assert one_by_one[0].height_m != one_by_one[1].height_m


def test_leaving_one_fault_out_changes_nothing_else(person: VirtualSubject) -> None:
    for fault in ("placement", "artefact", "noise", "gaps"):
        other = make_virtual_subject(7, replace(person.settings, **{fault: 0.0}))
        assert other.factors == person.factors
        assert other.tilts == person.tilts
        for name, q in person.motions.items():
            np.testing.assert_array_equal(other.motions[name], q)
    without = make_virtual_subject(7, replace(person.settings, noise=0.0))
    seen = np.isfinite(person.trials["gait_1"].markers)
    np.testing.assert_array_equal(np.isfinite(without.trials["gait_1"].markers), seen)
    noise = (person.trials["gait_1"].markers - without.trials["gait_1"].markers)[seen]
    assert 1e3 * noise.std() == pytest.approx(CAMERA_MM["dynamic"], rel=0.03)


def test_more_trials_do_not_change_the_first_ones(person: VirtualSubject) -> None:
    more = make_virtual_subject(7, replace(person.settings, gait_trials=4))
    assert set(more.trials) - set(person.trials) == {"gait_3", "gait_4"}
    for name, trial in person.trials.items():
        np.testing.assert_array_equal(more.trials[name].markers, trial.markers)
    assert np.abs(more.motions["gait_3"][:50] - more.motions["gait_4"][:50]).max() > 0.01


# --- consistent with its own truth ----------------------------------------------------------------


@pytest.mark.parametrize("seed", [0, 4, 11])
def test_without_faults_the_true_model_gives_back_the_true_motion(seed: int) -> None:
    person = make_virtual_subject(seed, CLEAN)
    for name, trial in person.trials.items():
        found = inverse_kinematics(person.model, trial)
        np.testing.assert_allclose(found.q, person.motions[name], rtol=0, atol=1e-6)
        assert found.distances.max() < ROUNDING_M


def test_misplaced_markers_are_known_to_the_true_model() -> None:
    person = make_virtual_subject(5, replace(CLEAN, placement=1.0))
    assert inverse_kinematics(person.model, person.trials["hip_r"]).distances.max() < ROUNDING_M
    for name, offset in person.marker_offsets.items():
        factor = person.factors[person.model.marker(name).segment]
        expected = factor * np.array(person.generic.marker(name).nominal) + offset
        np.testing.assert_allclose(person.model.marker(name).nominal, expected, atol=1e-12)


def test_factors_and_tilts_are_those_of_the_model(person: VirtualSubject) -> None:
    generic, own = measure_segment_lengths(person.generic), measure_segment_lengths(person.model)
    segments = {"inter_hip": "pelvis", "femur_r": "femur_r", "femur_l": "femur_l"}
    segments |= {"shank_r": "tibia_r", "shank_l": "tibia_l"}
    for length, segment in segments.items():
        assert own[length] / generic[length] == pytest.approx(person.factors[segment], rel=1e-12)
    for side in ("r", "l"):
        bent = pose_neutral_frames(person.model, {f"knee_angle_{side}": 1e-3})
        straight = pose_neutral_frames(person.model)
        change = bent[f"tibia_{side}"][0] @ straight[f"tibia_{side}"][0].T
        turn = np.array(
            [change[2, 1] - change[1, 2], change[0, 2] - change[2, 0], change[1, 0] - change[0, 1]]
        )
        axis = -(straight[f"femur_{side}"][0].T @ turn) / np.linalg.norm(turn)
        x, y = person.tilts[f"knee_{side}"]
        expected = [np.sin(y) * np.cos(x), -np.sin(x), np.cos(y) * np.cos(x)]  # Ry(y) Rx(x) z
        np.testing.assert_allclose(axis, expected, atol=1e-9)
    assert person.model.parameters == ()


def test_skin_moves_linearly_and_not_at_all_when_standing_as_the_reference(person: VirtualSubject) -> None:
    model = with_artefact(person.model, person.artefact)
    names = person.model.coordinate_names
    q = np.zeros((3, len(names)))
    for name, value in person.artefact.reference.items():
        q[:, names.index(name)] = value
    q[1, names.index("knee_angle_r")] += 0.2
    q[2, names.index("knee_angle_r")] += 0.4
    p = np.zeros(0)
    moved = pose_markers(compile_model(model), q, p) - pose_markers(compile_model(person.model), q, p)
    np.testing.assert_allclose(moved[0], 0.0, atol=1e-15)
    lengths = np.linalg.norm(moved, axis=2)
    np.testing.assert_allclose(lengths[2], 2.0 * lengths[1], atol=1e-15)
    k = person.model.marker_names.index("RLM")
    assert lengths[1, k] == pytest.approx(
        0.2 * np.linalg.norm(person.artefact.coefficients["RLM"]["knee_angle_r"]), rel=1e-12
    )
    assert lengths[1, person.model.marker_names.index("LLM")] < 1e-15


# --- faults of the size that the literature gives -------------------------------------------------


def peaks(person: VirtualSubject, artefact: Artefact) -> dict[str, float]:
    """Largest skin displacement of any marker of a kind of segment over the functional movements, mm."""
    skin, still = with_artefact(person.model, artefact), person.model
    found: dict[str, float] = {}
    for trial in ("hip_r", "hip_l", "knee_r", "knee_l"):
        q = person.motions[trial]
        moved = pose_markers(compile_model(skin), q, np.zeros(0))
        moved = moved - pose_markers(compile_model(still), q, np.zeros(0))
        for k, marker in enumerate(person.model.markers):
            kind = marker.segment[:5]
            found[kind] = max(found.get(kind, 0.0), 1e3 * float(np.linalg.norm(moved[:, k], axis=1).max()))
    return found


def test_skin_moves_as_much_as_the_literature_says(person: VirtualSubject) -> None:
    """Leardini 2005, Camomilla 2017: up to about 30 mm on the thigh, 20 on the shank, 9 on the pelvis."""
    drawn = [
        peaks(person, draw_artefact(seed, person.model, person.artefact.reference, 1.0)) for seed in range(60)
    ]
    median = {kind: float(np.median([d[kind] for d in drawn])) for kind in drawn[0]}
    assert 20.0 < median["femur"] < 60.0
    assert 12.0 < median["tibia"] < 35.0
    assert 5.0 < median["pelvi"] < 16.0
    assert median["femur"] > median["tibia"] > median["pelvi"]


def test_markers_of_a_segment_move_together_more_than_apart(person: VirtualSubject) -> None:
    pairs = []
    for seed in range(300):
        drawn = draw_artefact(seed, person.model, person.artefact.reference, 1.0).coefficients
        pairs.append([drawn["RLFE"]["hip_flexion_r"][1], drawn["RMFE"]["hip_flexion_r"][1]])
    assert np.corrcoef(np.array(pairs).T)[0, 1] == pytest.approx(0.75, abs=0.1)
    sd = np.std(pairs) / (1e-3 * 180.0 / np.pi)
    assert sd == pytest.approx(0.4, rel=0.1)


def test_the_residual_has_the_size_asked_for_and_is_slow(person: VirtualSubject) -> None:
    times = np.arange(20_000) / 100.0
    signal = draw_residual(person.artefact, stream(0, "r"), times)
    rms = np.sqrt((signal**2).sum(axis=1).mean())
    assert rms == pytest.approx(person.artefact.residual_m, rel=0.05)
    assert 0.002 <= person.artefact.residual_m <= 0.003
    power = np.abs(np.fft.rfft(signal[:, 0] * np.hanning(len(times)))) ** 2
    assert power[np.fft.rfftfreq(len(times), 0.01) > 2.1].sum() < 1e-3 * power.sum()


@COSTLY
def test_placement_and_noise_have_the_spread_stated(people: list[VirtualSubject]) -> None:
    for name in ("ASIS", "PSIS", "LFE", "MFE", "FH", "LM", "MM"):
        found = np.std([p.marker_offsets[f"{side}{name}"] for p in people for side in "RL"], axis=0)
        np.testing.assert_allclose(found, LANDMARK_SD_M[name], rtol=0.12)


def test_gaps_are_occasional_and_never_at_the_ends(person: VirtualSubject) -> None:
    hidden = [np.isnan(t.markers).any(axis=2) for n, t in person.trials.items() if n != "static"]
    share = np.mean([h.mean() for h in hidden])
    assert 0.0 < share < 0.01
    assert not any(h[[0, -1]].any() for h in hidden)
    assert np.isfinite(person.trials["static"].markers).all()


# --- a human being --------------------------------------------------------------------------------


@COSTLY
def test_stature_mass_and_lengths_are_the_cohorts(people: list[VirtualSubject]) -> None:
    height = np.array([p.height_m for p in people])
    assert height.mean() == pytest.approx(1.762, abs=0.015)
    assert height.std() == pytest.approx(0.076, abs=0.012)
    assert np.mean([p.mass_kg for p in people]) == pytest.approx(67.3, abs=2.0)
    men, women = (np.mean([p.height_m for p in people if p.sex == sex]) for sex in "MF")
    assert men - women == pytest.approx(0.127, abs=0.03)
    lengths = [measure_segment_lengths(p.model) for p in people]
    for name, mean, sd in (
        ("femur_r", 0.4318, 0.0233),
        ("shank_l", 0.4147, 0.0227),
        ("inter_hip", 0.1735, 0.0097),
    ):
        values = np.array([length[name] for length in lengths])
        assert values.mean() == pytest.approx(mean, rel=0.015)
        assert values.std() == pytest.approx(sd, rel=0.25)
    femur = np.array([x["femur_r"] + x["femur_l"] for x in lengths]) / 2 - 0.2454 * height
    shank = np.array([x["shank_r"] + x["shank_l"] for x in lengths]) / 2 - 0.2356 * height
    assert np.corrcoef(femur, shank)[0, 1] == pytest.approx(
        0.76, abs=0.08
    )  # .8, thinned by the sides' own share


@COSTLY
def test_knee_axes_are_puchauds(people: list[VirtualSubject]) -> None:
    for knee, (x, y) in {"knee_r": (1.94, -2.02), "knee_l": (-0.81, 0.81)}.items():
        turns = np.degrees([p.tilts[knee] for p in people])
        np.testing.assert_allclose(turns.mean(axis=0), (x, y), atol=0.4)
        np.testing.assert_allclose(turns.std(axis=0), (1.84, 2.12), rtol=0.12)


@pytest.mark.parametrize("seed", range(6))
def test_knees_bend_backwards_and_only_so(seed: int) -> None:
    person = make_virtual_subject(seed)
    for trial in MOVING:
        for side in ("r", "l"):
            assert column(person, trial, f"knee_angle_{side}").min() >= -1e-9
    frames = pose_neutral_frames(person.model, {"knee_angle_r": 1.2})
    lifted = frames["femur_r"][0].T @ frames["tibia_r"][0] @ [0.0, -1.0, 0.0]
    assert lifted[0] < -0.9, "the shank goes to the back"


@pytest.mark.parametrize("side", ["r", "l"])
def test_functional_movements_cover_their_ranges_while_the_other_foot_stands(
    person: VirtualSubject, side: motion.Side
) -> None:
    style = motion.draw_style(stream(7, "style"), person.sex)
    for name, (low, high) in motion.HIP_RANGE_DEG.items():
        values = column(person, f"hip_{side}", f"{name}_{side}")
        values = values - np.degrees(style.stance[f"{name}_{side}"])
        assert values.max() == pytest.approx(high, abs=0.3 * (high - low))
        assert values.min() == pytest.approx(low, abs=0.3 * (high - low))
    assert column(person, f"knee_{side}", f"knee_angle_{side}").max() == pytest.approx(100.0, abs=25.0)
    for trial in (f"hip_{side}", f"knee_{side}"):
        foot = ankles(person, trial)[:, 1 if side == "r" else 0]
        np.testing.assert_allclose(foot, foot[:1].repeat(len(foot), axis=0), atol=1e-12)
        assert foot[0, 1] == pytest.approx(0.039 * person.height_m)
        hips = column(person, trial, "pelvis_ty")
        assert 0.45 * person.height_m < hips.min() <= hips.max() < 0.62 * person.height_m


@pytest.mark.parametrize("seed", range(8))
def test_walking_is_walking(seed: int) -> None:
    person = make_virtual_subject(seed)
    times = person.trials["gait_1"].times
    speed = np.polyfit(times, column(person, "gait_1", "pelvis_tx"), 1)[0]
    assert 0.8 < speed < 1.8, "m/s; adults at normal speed 1.20 to 1.65"
    both = ankles(person, "gait_1")
    velocity = np.gradient(both, times, axis=0)[:, :, 0]
    for k, side in enumerate("rl"):
        forward = velocity[:, k]
        assert 0.25 < (np.abs(forward) < 0.25 * speed).mean() < 0.7, "each foot stands part of the stride"
        assert forward.max() > 2.0 * speed, "and swings past the body"
        assert both[:, k, 1].min() > -0.01
        knee = column(person, "gait_1", f"knee_angle_{side}")
        assert 40.0 < knee.max() < 90.0
        assert velocity[knee.argmax(), k] > 0.5 * speed, "the knee is most bent in swing"
        hip = column(person, "gait_1", f"hip_flexion_{side}")
        assert 25.0 < np.ptp(hip) < 60.0
    stepping = both[:, 0, 0] - both[:, 1, 0]
    assert stepping.max() > 0.35
    assert stepping.min() < -0.35, "right and left take turns in front"
    right = both[:, 0, 2].mean() - both[:, 1, 2].mean()
    assert 0.04 < right < 0.4, "the right foot is on the right, which is +z"


def test_standing_is_upright_and_still(person: VirtualSubject) -> None:
    q = person.motions["static"]
    assert np.ptp(q, axis=0).max() < np.radians(3.0)
    both = ankles(person, "static")
    assert both[0, 0, 2] > both[0, 1, 2]
    assert np.abs(both[:, :, 1] - 0.039 * person.height_m).max() < 0.03
    trial = person.trials["static"]
    assert (trial.position("RASIS")[:, 0] > trial.position("RPSIS")[:, 0]).all(), "ASIS in front"
    assert (trial.position("RASIS")[:, 1] < trial.position("RPSIS")[:, 1] + 0.03).all(), "tilted forward"


def test_walking_angles_are_schwartz_within_a_persons_spread() -> None:
    phase = np.linspace(0.0, 1.0, 11)
    known = {
        "hip_flexion": [35.8, 32.8, 22.5, 11.4, 1.6, -5.3, -0.9, 17.9, 32.0, 36.7, 35.5],
        "knee_flexion": [5.6, 18.6, 16.5, 10.1, 6.2, 11.6, 33.9, 58.2, 49.8, 18.7, 5.4],
        "hip_adduction": [-1.6, 3.7, 5.0, 3.2, 2.4, 0.8, -5.2, -6.3, -3.1, -2.2, -1.6],
        "pelvis_obliquity_up": [0.8, 3.4, 3.4, 0.3, -0.5, -0.7, -3.3, -3.4, -0.4, 0.4, 0.6],
    }
    for name, values in known.items():
        curve = motion.read_gait_curves()[name]
        np.testing.assert_allclose(curve.mean + curve.at(phase), values, atol=0.35)
    styles = [motion.draw_style(stream(k, "style"), "M") for k in range(400)]
    spread = np.std([s.offsets["hip_flexion"] for s in styles])
    assert spread == pytest.approx(6.07, rel=0.15)


# --- the demo -------------------------------------------------------------------------------------


def test_the_demo_is_a_whole_session() -> None:
    session, person = make_demo_session(2)
    assert session.model is person.generic
    assert session.static is not None
    assert [t.name for t in session.calibration] == ["hip_r", "hip_l", "knee_r", "knee_l"]
    assert [t.name for t in session.evaluation] == ["gait_1", "gait_2"]
    assert session.subject.height_m == person.height_m
    markers = {m.name for m in person.generic.markers if m.weight > 0.0}
    for trial in (session.static, *session.dynamic):
        assert set(trial.labels) == markers
        true = np.abs(trial.markers - person.trials[trial.name].markers)
        assert np.nanmax(true) < 0.02, "processing smooths, it does not move"
    assert any(r.what.startswith("gap") for t in session.dynamic for r in t.repairs)


def test_settings_are_checked() -> None:
    with pytest.raises(ValueError, match="negative"):
        VirtualSettings(noise=-1.0)
    with pytest.raises(ValueError, match="positive"):
        VirtualSettings(rate_hz=0.0)
