"""The benchmark: judges against closed forms, and a wrong submission that must come last."""

from __future__ import annotations

import json
import shutil
from importlib.util import find_spec
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from scaling_service.cli import main
from scaling_service.cli.app import EXIT_INPUT
from scaling_service.core.errors import InputError
from scaling_service.files.osim.models import write_osim
from scaling_service.files.sto import read_sto, tabulate_motion, write_sto
from scaling_service.model.builtin import load_builtin
from scaling_service.model.compile import compile_model
from scaling_service.numerics.multibody.tree import pose_markers
from scaling_service.studies.benchmark.parts import (
    OPENSIM,
    OURS,
    Metric,
    NoAnswer,
    Task,
    match_times,
    trace_model,
)
from scaling_service.studies.benchmark.result import make_tables, read_document, tabulate_figures
from scaling_service.studies.benchmark.run import rank_entries, run_benchmark
from scaling_service.studies.benchmark.tasks import bones, hidden, living_bone, persons, wild_recordings

needs_opensim = pytest.mark.skipif(find_spec("opensim") is None, reason="opensim is not installed")

LONGER = 1.05
"""Of the wrong submission."""


def test_equal_figures_share_a_place_and_no_answer_is_last() -> None:
    task = Task(
        name="t", title="", truth="", metrics=(Metric(key="mm", title=""),), cases=lambda _d, _f, _s: ()
    )
    judged = {
        ("a", "one"): {"mm": 1.0},
        ("b", "one"): {"mm": 1.0},
        ("c", "one"): "no answer",
        ("a", "two"): {"mm": 3.0},
        ("b", "two"): {"mm": 2.0},
        ("c", "two"): {"mm": 9.0},
    }
    parts = rank_entries(task, ["one", "two"], ["a", "b", "c"], judged)
    assert [(part.entry, part.place) for part in parts] == [("b", 1.25), ("a", 1.75), ("c", 3.0)]
    assert [part.answered for part in parts] == [2, 2, 1]
    assert parts[2].values == {"mm": 9.0}
    assert parts[2].failures == {"one": "no answer"}


def test_bones_turned_by_ten_degrees_are_ten_degrees_off() -> None:
    rng = np.random.default_rng(0)
    pelvis, femur = (Rotation.random(50, random_state=rng).as_matrix() for _ in range(2))
    off = Rotation.from_rotvec(np.radians(10) * np.array([0.0, 0.6, 0.8])).as_matrix()
    true = {"pelvis": pelvis, "femur": femur}
    assert living_bone.measure_angle_error_deg(true, true) == pytest.approx(0.0, abs=1e-5)
    assert living_bone.measure_angle_error_deg(true | {"femur": femur @ off}, true) == pytest.approx(10.0)
    both = {name: off @ turn for name, turn in true.items()}  # of the laboratory: no joint turns
    assert living_bone.measure_angle_error_deg(both, true) == pytest.approx(0.0, abs=1e-5)


def test_times_must_cover_the_recording() -> None:
    wanted = np.arange(10) / 100
    assert list(match_times(wanted + 0.0004, wanted)) == list(range(10))  # rounded to 1 ms
    for short in (wanted[:-2], wanted[:1], wanted[:0]):
        with pytest.raises(NoAnswer):
            match_times(short, wanted)


def test_wrong_bones_must_be_refused(tmp_path: Path) -> None:
    with pytest.raises(NoAnswer):
        bones.judge_refusal(tmp_path, tmp_path)
    (tmp_path / "answer.json").write_text(json.dumps({"refused": "no femur"}), encoding="utf-8")
    assert bones.judge_refusal(tmp_path, tmp_path) == {"wrong": 0.0}
    assert wild_recordings.judge_way(False, tmp_path, tmp_path) == {"wrong": 0.0}
    assert wild_recordings.judge_way(True, tmp_path, tmp_path) == {"wrong": 100.0}
    (tmp_path / "landmarks.json").write_text("{}", encoding="utf-8")
    assert bones.judge_refusal(tmp_path, tmp_path) == {"wrong": 100.0}


def test_an_effect_must_have_its_place_and_its_size(tmp_path: Path) -> None:
    def judge(name: str, *effects: tuple[str, str, dict[str, float]]) -> dict[str, float]:
        found = [
            {"kind": kind, "where": [where], "parameters": {key: {"value": v} for key, v in sizes.items()}}
            for kind, where, sizes in effects
        ]
        (tmp_path / "discovery.json").write_text(json.dumps({"effects": found}), encoding="utf-8")
        return dict(hidden.judge_names(hidden.list_hidden()[name], tmp_path, tmp_path))

    mass = ("body_mass", "world", {"factor": 0.96})
    assert judge("ordinary", mass) == {"wrong": 0.0, "others": 0.0}
    assert judge("ordinary", ("plate_gain", "plate_1", {"factor": 1.1}))["wrong"] == 100.0
    moved = {"x_mm": 25.0, "y_mm": 15.0, "z_mm": 0.0}
    assert judge("moved", ("marker_offset", "L_thigh3", moved), mass) == {"wrong": 0.0, "others": 0.0}
    assert judge("moved", ("marker_offset", "L_thigh2", moved)) == {"wrong": 100.0, "others": 1.0}
    assert judge("moved", ("marker_offset", "L_thigh3", {"x_mm": 60.0}))["wrong"] == 100.0
    assert judge("gain") == {"wrong": 100.0, "others": 0.0}


def test_what_is_hidden_in_forces_is_what_is_said(shared_data: Path, tmp_path: Path) -> None:
    def change(name: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Times, and the first plate's force before and after, (n, 3)."""
        box = tmp_path / name
        box.mkdir()
        for file in (f"{trial}{end}" for trial in ("squats1", "walking1") for end in (".trc", "_grf.mot")):
            shutil.copyfile(shared_data / "opencap_squat" / file, box / file)
        of_name = hidden.list_hidden()[name]
        assert of_name is not None
        of_name.change(box)
        tables = [read_sto(folder / "walking1_grf.mot") for folder in (shared_data / "opencap_squat", box)]
        columns = [f"ground_force_1_v{axis}" for axis in "xyz"]
        forces = [np.stack([table.column(c) for c in columns], axis=1) for table in tables]
        return tables[0].column("time"), forces[0], forces[1]

    times, before, after = change("late")
    rows = np.rint(0.040 / np.median(np.diff(times))).astype(int)
    np.testing.assert_allclose(after[rows:], before[:-rows], atol=1e-5)
    _, before, after = change("bias")
    np.testing.assert_allclose(after - before, np.tile([0.0, 60.0, 0.0], (len(before), 1)), atol=1e-5)
    _, before, after = change("lean")
    turn, _ = Rotation.align_vectors(after, before)
    assert np.degrees(turn.magnitude()) == pytest.approx(3.0, abs=1e-4)
    np.testing.assert_allclose(turn.apply(before), after, atol=1e-4)


@needs_opensim
def test_models_are_traced_where_our_own_kinematics_have_them(tmp_path: Path) -> None:
    """OpenSim reads the model and the motion as files; a column of NaN is at its default."""
    model = load_builtin("lower_limb_14dof")
    q = np.random.default_rng(1).uniform(-0.4, 0.4, (5, len(model.coordinates)))
    q[:, -1] = model.coordinates[-1].default
    shown = q.copy()
    shown[:, -1] = np.nan
    kinds = [c.kind for c in model.coordinates]
    write_osim(tmp_path / "model.osim", model)
    times = np.arange(5) / 10
    write_sto(tmp_path / "walk.mot", tabulate_motion("walk", times, model.coordinate_names, kinds, shown))
    traced = trace_model(tmp_path / "model.osim", tmp_path / "walk.mot")
    ours = pose_markers(compile_model(model), q, np.zeros(0))
    for k, marker in enumerate(model.markers):
        np.testing.assert_allclose(traced.markers[marker.name], ours[:, k], atol=1e-7)
    with pytest.raises(NoAnswer, match=r"absent\.osim is absent"):
        trace_model(tmp_path / "absent.osim")


@pytest.mark.costly
@needs_opensim
def test_lengths_five_per_cent_too_long_rank_below(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """On one person, scaled by the quickest method; the motion stays as it is."""
    monkeypatch.setattr(persons, "PERSONS", 1)
    monkeypatch.setattr(persons, "METHOD", "MB")
    out, wrong = tmp_path / "judged", tmp_path / "wrong"
    (task,) = run_benchmark(tmp_path, out, tasks=["persons"], workers=1).tasks
    assert {entry.entry: entry.answered for entry in task.entries} == {OURS: 1, OPENSIM: 1}
    ours = next(entry for entry in task.entries if entry.entry == OURS)
    assert 0.0 < ours.values["centres"] < 40.0
    assert 0.0 <= ours.values["held"] <= 100.0
    shutil.copytree(out / "entries" / OURS, wrong)
    for model in sorted((wrong / "persons").glob("*/model.osim")):
        _lengthen(model)
    again = run_benchmark(tmp_path, out, tasks=["persons"], entries=[wrong], keep_answers=True, workers=1)
    by_name = {entry.entry: entry for entry in again.tasks[0].entries}
    assert by_name[OURS].values == ours.values
    assert by_name["wrong"].values["lengths"] > by_name[OURS].values["lengths"]
    assert by_name["wrong"].place > by_name[OURS].place
    assert list(again.places)[-1] != OURS
    assert [row.header for row in list(make_tables(again))[-1].rows] == list(again.places)
    assert len(tabulate_figures(again)["benchmark"].rows) == sum(
        len(found) for entry in again.tasks[0].entries for found in entry.cases.values()
    )


def _lengthen(model: Path) -> None:
    """Every joint's place on its parent farther out."""
    tree = ElementTree.parse(model)
    for frame in tree.getroot().iter("PhysicalOffsetFrame"):
        place = frame.find("translation")
        assert place is not None
        place.text = " ".join(f"{LONGER * float(v):.9g}" for v in (place.text or "").split())
    tree.write(model)


def test_what_cannot_be_run_is_said(tmp_path: Path) -> None:
    pytest.importorskip("opensim")
    with pytest.raises(InputError, match=r"no task .person..*persons"):
        run_benchmark(tmp_path, tmp_path / "out", tasks=["person"])
    with pytest.raises(InputError, match="no folder"):
        run_benchmark(tmp_path, tmp_path / "out", tasks=["images"], entries=[tmp_path / "absent"])
    document = run_benchmark(tmp_path, tmp_path / "out", tasks=["images", "hidden"])
    assert document.tasks == []
    assert set(document.left_out) == {"images", "hidden"}
    assert "jia_mri" in document.left_out["images"]


@needs_opensim
def test_the_command_says_what_it_left_out(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    given = ["benchmark", "--data", str(tmp_path), "--tasks", "images,wild_models", "--tables", "csv"]
    assert main([*given, "--out", str(tmp_path / "out")]) == 0
    said = capsys.readouterr().out
    assert "left out  images: jia_mri/bones not in" in said
    assert "left out  wild_models: wild/models not in" in said
    document = read_document(tmp_path / "out" / "benchmark.json")
    assert set(document.left_out) == {"images", "wild_models"}
    assert (tmp_path / "out/tables/benchmark.csv").read_text(
        encoding="utf-8"
    ) == "task,case,entry,metric,value\n"
    assert (
        main([*given[:-2], "--entry", str(tmp_path / "absent"), "--out", str(tmp_path / "out")]) == EXIT_INPUT
    )
