"""The report of one person: complete, self-contained, and with the numbers of comparison.json."""

from __future__ import annotations

import base64
import gzip
import json
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from scaling_service.capabilities.playback.drawing import find_knee_axes
from scaling_service.capabilities.playback.scene import Detail
from scaling_service.capabilities.scaling.comparison.curves import make_gait_curves
from scaling_service.capabilities.scaling.result import Results
from scaling_service.capabilities.scaling.scene import write_results_scene
from scaling_service.documents.results import ComparisonDocument
from scaling_service.model.body import Marker
from scaling_service.model.builtin import load_builtin
from scaling_service.model.compile import compile_model, list_parameter_values
from scaling_service.model.parameters import fold, free_axis
from scaling_service.model.poses import pose_neutral_frames
from scaling_service.numerics.multibody.tree import pose_markers
from tests.finished import Demo
from tests.jobs.reported import MOST_BYTES, document_of, html_of, page_of, without
from tests.report.reading import Node, held, read, tables
from tests.report.test_tables import NASTY

LONGEST_S = 3.0
"""Of a core's own time; chosen: what a person waits for without asking."""


@pytest.fixture(scope="module")
def document(demo: Demo) -> ComparisonDocument:
    """The demo's result."""
    return document_of(*demo[:2])


@pytest.fixture(scope="module")
def root(demo: Demo, document: ComparisonDocument) -> Node:
    """The demo's report."""
    return read(html_of(demo[0], document))


def played(root: Node) -> dict[str, Any]:
    """The scene within a report."""
    inside = held(root)
    scene: dict[str, Any] = json.loads(gzip.decompress(base64.b64decode(inside["files"]["scene/scene.json"])))
    return scene


def test_a_long_recording_is_thinned_and_no_error_is_missed(results: Results, tmp_path: Path) -> None:
    whole = write_results_scene(results, tmp_path / "whole")
    few = write_results_scene(results, tmp_path / "few", Detail(most_faces=100, most_frames=7))
    for trial, thin in zip(whole.trials, few.trials, strict=True):
        assert thin.frames <= 7
        assert thin.frames / thin.rate_hz == pytest.approx(trial.frames / trial.rate_hz, rel=0.2)
        for name, motion in trial.motions.items():
            errors = [
                np.fromfile(tmp_path / folder / of.motions[name].errors.file, "<f4")
                for folder, of in (("whole", trial), ("few", thin))
            ]
            assert np.nanmax(errors[1]) == pytest.approx(np.nanmax(errors[0]), rel=1e-4)
            assert thin.motions[name].poses.shape == [thin.frames, *motion.poses.shape[1:]]


def test_a_report_is_small_and_quick(demo: Demo, document: ComparisonDocument) -> None:
    clock = time.process_time()
    html = html_of(demo[0], document)
    assert time.process_time() - clock < LONGEST_S
    assert len(html.encode()) < MOST_BYTES


def test_numbers_are_those_of_the_document(document: ComparisonDocument, root: Node) -> None:
    found = tables(root)
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
    assert document.truth is not None
    truth = next(rows for caption, rows in found.items() if caption == "Distance from the truth")
    assert truth[1] == ["lengths, mm", *(f"{document.truth.errors[m]['lengths_mm']:.1f}" for m in methods)]


def test_the_verdict_stands_first_and_in_the_document(document: ComparisonDocument, root: Node) -> None:
    assert document.verdict is not None
    (callout,) = root.all("div", "callout")
    for said in (document.verdict.headline, *document.verdict.why):
        assert said in callout.text
    assert document.verdict.method in document.methods


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


def test_gait_cycles_are_averaged(demo: Demo) -> None:
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
    assert played(root)["trials"]


def test_without_evaluation_trials(results: Results) -> None:
    root = page_of(without(results, evaluation=True))
    assert "on fitted trials" in tables(root)["How far to trust MAP"][1][2]
    assert {trial["role"] for trial in played(root)["trials"]} == {"calibration"}
    assert "held out)" not in root.all("main")[0].text


def test_without_any_movement(results: Results) -> None:
    root = page_of(without(results, calibration=True, evaluation=True))
    assert played(root)["trials"] == []


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
    assert NASTY in root.all("main")[0].text
    assert len(root.all("script")) in (0, 2)  # none without the web page
