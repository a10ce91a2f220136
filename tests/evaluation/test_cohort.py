"""The statistics of a cohort, on summaries made by hand: against scipy, against known differences."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import friedmanchisquare

from scaling_service.capabilities.cohort.statistics import CohortSettings, compute_cohort_statistics
from scaling_service.capabilities.cohort.summary import (
    TRUTH,
    Following,
    MethodSummary,
    SubjectSummary,
)
from scaling_service.core.streams import stream
from scaling_service.numerics.statistics.complete import list_panels
from scaling_service.numerics.statistics.waveforms import WaveformSettings

METHODS = ("MB", "MB_lam", "MB_am", "EB", "EB_am")
QUICK = CohortSettings(waveforms=WaveformSettings(rearrangements=500))
NODES = np.arange(101)
BUMP = np.exp(-0.5 * ((NODES - 50) / 6) ** 2)


def _method(k, method, rng):
    """Errors fall from method to method; MB's knee bends 0.1 rad more in mid cycle."""
    at = METHODS.index(method)
    wave = 0.3 * np.sin(NODES / 16 + 0.1 * k) + 0.01 * rng.normal()
    length = 0.43 + 0.01 * k + (0.008 if method == "MB_lam" else 0.0) + 0.002 * rng.normal()
    mean = 0.020 - 0.003 * at + 0.0005 * rng.normal()
    return MethodSummary(
        lengths={"femur_r": length},
        trials={
            "hip": Following("calibration", mean, 1.2 * mean, 2.5 * mean),
            "knee": Following("calibration", mean + 0.002, 1.2 * mean, 2.5 * mean),
            "walk": Following("evaluation", mean + 0.004, 1.2 * mean, 2.5 * mean),
        },
        knee_axes={"r": (0.01 * k, 0.0)} if method.endswith("m") else {},
        marker_shifts={"RLFE": 0.004, "RMFE": 0.008} if method.endswith("m") else {},
        curves={"knee_angle_r": tuple(wave + (0.1 * BUMP if method == "MB" else 0.0))},
    )


def _subject(k, methods=METHODS, **changes):
    rng = stream(k, "test")
    summary = SubjectSummary(
        subject=f"S{k:02d}",
        methods={m: _method(k, m, rng) for m in methods},
        strides={"r": 2},
    )
    return replace(summary, **changes)


@pytest.fixture(scope="module")
def cohort():
    return [_subject(k) for k in range(12)]


@pytest.fixture(scope="module")
def statistics(cohort):
    return compute_cohort_statistics(cohort, METHODS, settings=QUICK)


def test_lengths_have_the_mean_sd_and_friedman_of_other_libraries(cohort, statistics):
    found = statistics.quantity("segment_lengths_mm", "femur_r")
    table = np.array([[1e3 * s.methods[m].lengths["femur_r"] for m in METHODS] for s in cohort])
    np.testing.assert_allclose([found.mean[m] for m in METHODS], table.mean(axis=0), atol=1e-4)
    np.testing.assert_allclose([found.sd[m] for m in METHODS], table.std(axis=0, ddof=1), atol=1e-4)
    assert found.friedman is not None
    expected = friedmanchisquare(*table.T)
    np.testing.assert_allclose(
        [found.friedman.chi_square, found.friedman.p], [expected.statistic, expected.pvalue], rtol=1e-9
    )
    assert found.compared.excluded == {}


def test_errors_are_means_over_the_trials_of_a_role(cohort, statistics):
    trials = cohort[3].methods["EB"].trials
    fitted = statistics.quantity("kinematic_error_mm", "calibration").values["S03"]["EB"]
    held_out = statistics.quantity("kinematic_error_mm", "evaluation").values["S03"]["EB"]
    assert fitted == pytest.approx(1e3 * (trials["hip"].mean + trials["knee"].mean) / 2, abs=1e-4)
    assert held_out == pytest.approx(1e3 * trials["walk"].mean, abs=1e-4)


def test_axes_and_shifts_are_of_the_methods_that_fit_them(statistics):
    fitting = ["MB_lam", "MB_am", "EB_am"]
    axis = statistics.quantity("knee_axis_deg", "r_x")
    shift = statistics.quantity("marker_shift_mm", "mean_over_markers")
    assert axis.compared.methods == shift.compared.methods == fitting
    assert shift.mean == pytest.approx(dict.fromkeys(fitting, 6.0))
    assert axis.mean == pytest.approx(dict.fromkeys(fitting, np.degrees(0.055)), abs=1e-4)
    assert axis.friedman is not None
    assert axis.friedman.p == 1.0  # all methods tie in every subject


def test_the_order_of_subjects_changes_nothing(cohort, statistics):
    turned = compute_cohort_statistics(cohort[::-1], METHODS, settings=QUICK)
    assert turned == statistics


def test_one_person_under_two_names_is_told(cohort, statistics):
    assert not [note for note in statistics.notes if "one person" in note]
    twice = replace(cohort[0], subject="S00 again")
    found = compute_cohort_statistics([*cohort[:3], twice], METHODS, settings=QUICK)
    assert [note for note in found.notes if note.startswith("S00, S00 again are one person")]


def test_a_known_difference_along_the_cycle_is_found_where_it_is(statistics):
    found = statistics.curve("knee_angle_r")
    assert found.reference == "EB_am"
    assert found.anova is not None
    assert found.anova.significant
    assert {pair.methods for pair in found.pairs} == {(m, "EB_am") for m in METHODS[:-1]}
    ((start, end),) = found.pair("MB", "EB_am").test.spans
    assert 25 < start < 50 < end < 75
    assert not found.pair("EB", "EB_am").test.significant
    apart = np.subtract(found.mean_deg["MB"], found.mean_deg["EB_am"])
    np.testing.assert_allclose(np.radians(apart[50]), 0.1, atol=0.04)


def test_without_images_angles_are_compared_to_mb_am_and_that_is_said():
    some = [_subject(k, METHODS[:3]) for k in range(6)]
    found = compute_cohort_statistics(some, METHODS, settings=QUICK)
    assert [gate.method for gate in found.opensim_limits.methods] == list(METHODS[:3])
    assert found.curve("knee_angle_r").reference == "MB_am"
    assert any("compared with MB_am" in note for note in found.notes)


def test_those_who_lack_methods_are_named_and_counted_where_they_can_be(cohort):
    mixed = [*cohort, *(_subject(k, METHODS[:3]) for k in (20, 21))]
    found = compute_cohort_statistics(mixed, METHODS, settings=QUICK)
    five, three = found.segment_lengths_mm
    assert five.compared.methods == list(METHODS)
    assert five.compared.excluded == {"S20": "no EB, EB_am", "S21": "no EB, EB_am"}
    assert (len(five.compared.subjects), len(three.compared.subjects)) == (12, 14)
    assert three.compared.methods == list(METHODS[:3])
    assert three.compared.excluded == {}
    own = np.mean([s.methods["MB"].lengths["femur_r"] for s in mixed])
    assert three.mean["MB"] == pytest.approx(1e3 * own, abs=1e-4)
    assert {(g.method, g.subjects) for g in found.opensim_limits.methods} == {
        (m, 14 if m in METHODS[:3] else 12) for m in METHODS
    }


def test_those_who_did_not_walk_are_left_out_with_the_reason(cohort):
    sat = {m: replace(method, curves={}) for m, method in cohort[0].methods.items()}
    resting = replace(cohort[0], methods=sat, strides={"r": 0}, no_strides={"r": "walk: the person sat"})
    found = compute_cohort_statistics([resting, *cohort[1:]], METHODS, settings=QUICK).curve("knee_angle_r")
    assert found.compared.excluded == {"S00": "walk: the person sat"}
    assert set(found.strides) == {f"S{k:02d}" for k in range(1, 12)}


def test_nobody_walked():
    still = [
        replace(s, methods={m: replace(x, curves={}) for m, x in s.methods.items()})
        for s in (_subject(k) for k in range(3))
    ]
    found = compute_cohort_statistics(still, METHODS, settings=QUICK)
    assert found.joint_angles == []
    assert any("not compared" in note for note in found.notes)


def test_one_subject_has_means_and_no_test_and_that_is_said():
    found = compute_cohort_statistics([_subject(0)], METHODS, settings=QUICK)
    length = found.quantity("segment_lengths_mm", "femur_r")
    assert length.friedman is None
    assert length.sd == {}
    assert set(length.mean) == set(METHODS)
    assert "no test" in length.note
    assert found.curve("knee_angle_r").anova is None
    assert found.agreement == []


def test_too_few_subjects_to_decide_is_said():
    found = compute_cohort_statistics(
        [_subject(k, ("MB", "EB_am")) for k in range(4)], METHODS, settings=QUICK
    )
    assert "too few" in found.curve("knee_angle_r").note  # 2^3 sign changes: p is 1/8 at least


def test_agreement_with_images_and_with_the_truth():
    places = [0.080 + 0.002 * k for k in range(6)]
    people = []
    for k, z in enumerate(places):
        lengths = {"EB": 0.430 + 0.01 * k, "MB": 0.435 + 0.01 * k}
        people.append(
            SubjectSummary(
                subject=f"S{k}",
                methods={m: MethodSummary(lengths={"femur_r": v}) for m, v in lengths.items()},
                true_lengths={"femur_r": 0.428 + 0.01 * k},
                centres={
                    "EB": {
                        "EB": {"hip_r": (0.0, 0.0, z)},
                        "MB": {"hip_r": (0.001 * (-1) ** k, 0.0, z - 0.01)},
                    }
                },
            )
        )
    found = {
        (a.quantity, a.method, a.reference): a
        for a in compute_cohort_statistics(people, METHODS, settings=QUICK).agreement
    }
    femur = found["femur_r", "MB", "EB"]
    assert femur.bias_mm.value == pytest.approx(5.0)
    assert femur.icc_consistency.value == pytest.approx(1.0)
    assert femur.icc_agreement.value < 1.0
    assert found["femur_r", "EB", TRUTH].bias_mm.value == pytest.approx(2.0)
    hip = found["hip_r.z", "MB", "EB"]
    assert hip.bias_mm.value == pytest.approx(-10.0)
    assert hip.icc_agreement is not None
    still = found["hip_r.x", "MB", "EB"]  # zero in every image
    assert still.icc_agreement is None
    assert still.rmse_mm == pytest.approx(1.0)
    assert not any(method == reference for _, method, reference in found)


def test_too_few_for_agreement_are_named():
    two = [_subject(k) for k in range(2)]
    others = [_subject(k, METHODS[:3]) for k in range(2, 6)]
    found = compute_cohort_statistics([*two, *others], METHODS, settings=QUICK)
    assert found.agreement == []
    assert any("only S00, S01 can be compared with EB" in note for note in found.notes)


def test_opensims_limits_count_subjects_and_trials():
    good, bad = Following("evaluation", 0.005, 0.006, 0.02), Following("evaluation", 0.005, 0.006, 0.05)
    people = [
        SubjectSummary(subject="A", methods={"MB": MethodSummary(trials={"one": good, "two": good})}),
        SubjectSummary(subject="B", methods={"MB": MethodSummary(trials={"one": good, "two": bad})}),
    ]
    (gate,) = compute_cohort_statistics(people, METHODS, settings=QUICK).opensim_limits.methods
    assert (gate.subjects, gate.subjects_passed, gate.trials, gate.trials_passed) == (2, 1, 4, 3)


def test_panels_are_the_sets_that_subjects_have():
    has = {"A": "xyz", "B": "xy", "C": "xz", "D": "x", "E": ""}
    found = {p.methods: p for p in list_panels(has, "xyz")}
    assert list(found) == [("x", "y", "z"), ("x", "y"), ("x", "z")]
    assert found["x", "y"].subjects == ("A", "B")
    assert found["x", "y"].excluded == {"C": "no y", "D": "no y", "E": "no value"}
    assert list_panels({"A": "x", "B": "x"}, "xyz")[0].subjects == ("A", "B")
    assert list_panels({"A": ""}, "xyz") == ()
