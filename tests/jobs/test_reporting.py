"""The report of one person: complete, self-contained, and with the numbers of comparison.json."""

from __future__ import annotations

import json
import time
from dataclasses import replace

import numpy as np
import pytest

from scaling_service.capabilities.playback.drawing import find_knee_axes
from scaling_service.capabilities.scaling.comparison.curves import make_gait_curves
from scaling_service.capabilities.scaling.report.page import choose_shown_trial
from scaling_service.capabilities.scaling.result import Results
from scaling_service.capabilities.scaling.run import run_demo
from scaling_service.capabilities.scaling.scene import make_overlay
from scaling_service.documents.results import TruthDocument
from scaling_service.model.body import Marker
from scaling_service.model.builtin import load_builtin
from scaling_service.model.compile import compile_model, list_parameter_values
from scaling_service.model.parameters import fold, free_axis
from scaling_service.model.poses import pose_neutral_frames
from scaling_service.numerics.multibody.tree import pose_markers
from tests.jobs.reported import MOST_BYTES, document_of, html_of, page_of, without
from tests.report.reading import data, tables
from tests.report.test_blocks import NASTY, shown

LONGEST_S = 3.0
"""Of a core's own time; chosen: what a person waits for without asking."""


@pytest.fixture(scope="module")
def demo() -> tuple[Results, TruthDocument]:
    return run_demo()


def test_a_report_is_small_and_quick(demo: tuple[Results, TruthDocument]) -> None:
    document = document_of(*demo)
    clock = time.process_time()
    html = html_of(demo[0], document)
    assert time.process_time() - clock < LONGEST_S
    assert len(html.encode()) < MOST_BYTES


def test_numbers_are_those_of_the_document(demo: tuple[Results, TruthDocument]) -> None:
    document = document_of(*demo)
    found = tables(page_of(*demo))
    methods = list(document.methods)
    (errors,) = [rows for caption, rows in found.items() if caption.startswith("Kinematic error, mm")]
    assert errors[0] == ["", *methods]
    by_trial = {row[0]: row[1:] for row in errors if len(row) > 1}
    for k, method in enumerate(document.methods.values()):
        for trial, error in method.kinematic_error_mm.items():
            role = "held out" if error.role == "evaluation" else "used to fit"
            assert by_trial[f"{trial} ({role})"][k] == f"{error.mean:.1f} ± {error.sd:.1f} ({error.max:.0f})"
    lengths = found["Segment lengths, mm"]
    row = next(row for row in lengths if row[0] == "femur, right")
    for k, method in enumerate(document.methods.values()):
        value, estimate = method.segment_lengths_mm["femur_r"], method.length_estimates.get("femur_r")
        spread = "" if estimate is None else f" ± {estimate.sd_mm:.1f}"
        assert row[1 + k].startswith(f"{value:.1f}{spread} (")
    shifts = {row[0]: row[1:] for row in next(r for c, r in found.items() if c.startswith("Marker shifts"))}
    assert f"{document.methods['MB_am'].marker_shift_mm['RASIS']:.1f}" in shifts["RASIS"]
    assert document.truth is not None
    truth = next(rows for caption, rows in found.items() if caption == "Distance from the truth")
    assert truth[1] == ["lengths, mm", *(f"{document.truth.errors[m]['lengths_mm']:.1f}" for m in methods)]


def test_per_marker_errors_are_means_over_trials(demo: tuple[Results, TruthDocument]) -> None:
    document = document_of(*demo)
    rows = tables(page_of(*demo))["Held out: never fitted: mean distance per marker, mm"]
    cells = dict(zip(rows[0][1:], next(row for row in rows if row[0] == "RLFE")[1:], strict=True))
    for name, method in document.methods.items():
        values = [e.per_marker["RLFE"] for e in method.kinematic_error_mm.values() if e.role == "evaluation"]
        assert cells[name] == f"{np.mean(values):.1f}"


def test_every_parameter_is_listed_with_its_sd(demo: tuple[Results, TruthDocument]) -> None:
    document = document_of(*demo)
    rows = tables(page_of(*demo))["Fitted numbers of MB_lam"][1:]
    parameters = document.methods["MB_lam"].parameters
    assert len(rows) == len(parameters)
    for row, parameter in zip(rows, parameters, strict=True):
        assert row[0].startswith(parameter.name)
        assert row[3] == ("yes" if parameter.identifiable else "no")
        assert row[4] == ("yes" if parameter.at_bound else "no")


def test_the_verdict_stands_first_and_in_the_document(demo: tuple[Results, TruthDocument]) -> None:
    root, document = page_of(*demo), document_of(*demo)
    assert document.verdict is not None
    assert root.all("h2")[0].text == "Verdict"
    (callout,) = root.all("div", "callout")
    for said in (document.verdict.headline, *document.verdict.why):
        assert said in callout.text
    assert document.verdict.method in document.methods


def test_the_overlay_shows_markers_where_inverse_kinematics_has_them(
    demo: tuple[Results, TruthDocument],
) -> None:
    """Measured minus model, marker by marker, are the residuals of the motion."""
    results = demo[0]
    trial = choose_shown_trial(results)
    assert trial is not None
    assert trial in results.session.evaluation
    scene = make_overlay(results, trial, "EB")
    assert scene is not None
    rows = np.searchsorted(trial.times, scene.times)
    for body in scene.bodies:
        motion = results.scalings[body.name].motions[trial.name]
        for point, label, measured in body.markers:
            gap = scene.measured[:, measured] - body.points[:, point]
            expected = motion.residuals[rows, motion.markers.index(label)]
            np.testing.assert_allclose(gap, expected, atol=1e-9)


def test_bones_stand_on_the_joint_centres(demo: tuple[Results, TruthDocument]) -> None:
    """The imaged hip centre, carried with the thigh's bone, is the model's hip in every frame."""
    results = demo[0]
    trial, images = choose_shown_trial(results), results.session.images
    assert trial is not None
    assert images is not None
    scene = make_overlay(results, trial, "EB")
    assert scene is not None
    for body in scene.bodies:
        if not body.bones:
            assert not body.name.startswith("EB")
            continue
        for side, word in (("r", "right"), ("l", "left")):
            pose = body.bones[f"femur_{side}"]
            at = np.array(images.centres[f"hip_{side}"])
            carried = pose[:, :9].reshape(-1, 3, 3) @ at + pose[:, 9:]
            (hip,) = [k for k, label in body.centres if label == f"hip, {word}"]
            np.testing.assert_allclose(carried, body.points[:, hip], atol=1e-9)


def test_a_knee_does_not_move_its_own_axis() -> None:
    """Points on the axis, carried by the shank, stay while the knee bends."""
    model = load_builtin("lower_limb_14dof")
    model = fold(free_axis(model, "knee_r", 1.0, 1.0), {"axis.knee_r.x": 0.2, "axis.knee_r.y": -0.1})
    ends = find_knee_axes(model)["femur_r"]
    carrier = model.with_markers(tuple(Marker.at(f"p{k}", "femur_r", at) for k, at in enumerate(ends)))
    still = pose_markers(compile_model(carrier), np.zeros((1, 14)), list_parameter_values(model))[0]
    straight, bent = (pose_neutral_frames(model, {"knee_angle_r": angle})["tibia_r"] for angle in (0.0, 1.2))
    home = pose_neutral_frames(model, {c.name: 0.0 for c in model.coordinates})["tibia_r"]
    local = (still - home[1]) @ home[0]
    moved = [local @ R.T + o for R, o in (straight, bent)]
    np.testing.assert_allclose(moved[0], moved[1], atol=1e-12)
    assert np.linalg.norm(still[1] - still[0]) > 0.1


def test_gait_cycles_are_averaged(demo: tuple[Results, TruthDocument]) -> None:
    gait = make_gait_curves(demo[0], "EB")
    assert gait.trials == ("gait_1", "gait_2")
    names = [curve.name for curve in gait.curves]
    assert {"hip_flexion_r", "knee_angle_l"} <= set(names)
    for curve in gait.curves:
        assert curve.n_cycles >= 2
        assert set(curve.mean) == set(demo[0].scalings)
        assert all(len(mean) == 101 for mean in curve.mean.values())
    knee = gait.curves[names.index("knee_angle_r")].mean["EB"]
    assert 40.0 < knee.max() - knee.min() < 80.0  # degrees; free walking: 55 (Schwartz 2008)


def test_one_method_without_images(results: Results) -> None:
    one = replace(results, scalings={"MB": results.scalings["MB"]})
    root = page_of(one)
    assert "compute MAP to know" in root.all("div", "callout")[0].text
    assert root.all("figure", "scene")


def test_without_evaluation_trials(results: Results) -> None:
    root = page_of(without(results, evaluation=True))
    assert "on fitted trials" in tables(root)["How far to trust MAP"][1][2]
    (caption,) = [f.all("figcaption")[0].text for f in root.all("figure", "scene")]
    assert "used to fit" in caption
    assert "Held out" not in shown(root)


def test_without_any_movement(results: Results) -> None:
    root = page_of(without(results, calibration=True, evaluation=True))
    assert not root.all("figure", "scene")
    assert "No movement was recorded" in shown(root)


def test_names_from_files_stay_text(results: Results) -> None:
    """A trial, a subject and a warning that would be scripts if they were not escaped."""
    subject = replace(results.session.subject, id=NASTY)
    named = [replace(t, name=NASTY) if t.name == "walk" else t for t in results.session.evaluation]
    session = replace(results.session, subject=subject, evaluation=tuple(named))

    def renamed(mapping: dict[str, object]) -> dict[str, object]:
        return {NASTY if key == "walk" else key: value for key, value in mapping.items()}

    scalings = {
        name: replace(s, motions=renamed(dict(s.motions)), errors=renamed(dict(s.errors)))
        for name, s in results.scalings.items()
    }
    hostile = replace(
        results, loaded=replace(results.loaded, session=session), scalings=scalings, warnings=(NASTY,)
    )
    root = page_of(hostile)
    assert NASTY in root.all("h1")[0].text
    assert NASTY in shown(root)
    assert len([s for s in root.all("script") if "type" not in s.attributes]) == 2
    assert all("<script" not in json.dumps(content).replace("\\", "") for content in data(root)[:1])
