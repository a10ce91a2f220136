"""The command line: what it writes and prints, and that mistakes end with 2 and one clear message."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from pathlib import Path

import pytest

from scaling_service.capabilities.scaling import run as tasks
from scaling_service.capabilities.scaling import saving
from scaling_service.capabilities.scaling.methods.table import METHODS
from scaling_service.cli import main
from tests.jobs.laboratory import document, laboratory, write_subject


@pytest.fixture(autouse=True)
def _quick(monkeypatch: pytest.MonkeyPatch) -> None:
    """Writing .osim files takes a second each, and is tested elsewhere."""
    monkeypatch.setattr(saving, "render_scaled", lambda found, _: ["<model/>"] * len(found))


@pytest.fixture(scope="module")
def subject_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return laboratory(tmp_path_factory.mktemp("laboratory"))


def test_compare_prints_a_table_and_what_it_wrote(
    subject_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["compare", str(subject_file), "--out", str(tmp_path / "out")]) == 0
    shown = capsys.readouterr()
    written = json.loads((tmp_path / "out" / "comparison.json").read_text(encoding="utf-8"))
    assert list(written["methods"]) == [name for name in METHODS if not METHODS[name].needs_images]
    for method, result in written["methods"].items():
        assert method in shown.out
        assert f"{result['kinematic_error_mm']['walk']['mean']:.1f} ±" in shown.out
        assert f"{result['segment_lengths_mm']['femur_r']:.1f}" in shown.out
    assert "walk (held out)" in shown.out
    assert "hips (used to fit)" in shown.out
    assert "RLFE = S01:RKNE" in shown.out
    assert "up is +z of the laboratory" in shown.out
    assert "comparison.json" in shown.out
    assert shown.err == ""
    assert "\x1b" not in shown.out


def test_scale_writes_one_method(
    subject_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["scale", str(subject_file), "--method", "MB_lam", "--out", str(tmp_path)]) == 0
    assert {p.name for p in tmp_path.iterdir()} == {"MB_lam"}
    assert "comparison.json" not in capsys.readouterr().out


def test_options_reach_the_settings(subject_file: Path, tmp_path: Path) -> None:
    options = [
        "--strategy=alternating",
        "--frames=40",
        "--seed=5",
        "--up=+z",
        "--forward=-y",
        "--smooth-hz=10",
    ]
    assert (
        main(["compare", str(subject_file), "--methods", "MB, MB_lam", "--out", str(tmp_path), *options]) == 0
    )
    written = json.loads((tmp_path / "comparison.json").read_text(encoding="utf-8"))
    assert list(written["methods"]) == ["MB", "MB_lam"]
    assert written["seed"] == 5
    settings = written["settings"]
    assert (settings["up"], settings["forward"]) == ("+z", "-y")
    assert settings["calibration"]["strategy"] == "alternating"
    assert settings["calibration"]["n_frames"] == 40
    assert settings["processing"]["smoothing"] == "butterworth"
    assert settings["processing"]["cutoff_hz"] == 10.0


def test_smoothing_can_be_switched_off(subject_file: Path, tmp_path: Path) -> None:
    assert (
        main(["scale", str(subject_file), "--method", "MB", "--smooth-hz", "0", "--out", str(tmp_path)]) == 0
    )
    written = json.loads((tmp_path / "MB" / "scaling.json").read_text(encoding="utf-8"))
    assert written["settings"]["processing"]["smoothing"] == "none"


@pytest.mark.parametrize(
    "arguments", [["--help"], ["scale", "--help"], ["compare", "-h"], ["demo", "--help"]]
)
def test_help_teaches(arguments: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert main(arguments) == 0
    shown = capsys.readouterr().out
    assert "scaling-service" in shown
    assert "--out" in shown


def test_version(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--version"]) == 0
    assert re.fullmatch(r"scaling-service \S+\n", capsys.readouterr().out)


USAGE = [
    (["scale"], "SUBJECT"),
    (["scale", "S01.yaml"], "--out"),
    (["scale", "S01.yaml", "--out", "o", "--frames", "0"], "--frames"),
    (["scale", "S01.yaml", "--out", "o", "--frames", "many"], "--frames"),
    (["compare", "S01.yaml", "--out", "o", "--strategy", "both"], "--strategy"),
    (["scale", "S01.yaml", "--out", "o", "--metod", "MB"], "--method"),
    (["sclae"], "scale"),
]


@pytest.mark.parametrize(("arguments", "named"), USAGE)
def test_wrong_arguments_end_with_2_and_one_line(
    arguments: list[str], named: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(arguments) == 2
    shown = capsys.readouterr()
    assert shown.out == ""
    assert named in shown.err
    assert shown.err.count("\n") == 1


MISTAKES = [
    ({"trails": {}}, "trails", "Did you mean 'trials'?"),
    ({"subject": {"id": "S01", "height_m": 170}}, "subject.height_m", "metres"),
    ({"trials": {"static": "absent.trc"}}, "trials.static", "relative to the subject file"),
    (
        {"trials": {"static": "standing.trc", "evaluation": ["standing.trc"]}},
        "trials.evaluation",
        "Remove it",
    ),
    ({"markers": {"RFH": "NOBODY"}}, "markers.RFH", "Their labels are"),
    ({"extra_markers": {"RTHI": "thigh"}}, "extra_markers.RTHI", "Its segments are"),
    ({"model": "legs"}, "model", "Use one of"),
    ({"bones": {"units": "cm"}}, "bones.units", "Use mm or m"),
]


@pytest.mark.parametrize(("changes", "field", "remedy"), MISTAKES)
@pytest.mark.parametrize("command", ["scale", "compare"])
def test_wrong_input_ends_with_2_names_all_and_writes_nothing(
    command: str,
    changes: dict[str, object],
    field: str,
    remedy: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    file = laboratory(tmp_path, **changes)
    before = set(tmp_path.iterdir())
    assert main([command, str(file), "--out", str(tmp_path / "deep" / "out")]) == 2
    shown = capsys.readouterr()
    assert shown.out == ""
    assert shown.err.count("\n") == 1
    assert str(file) in shown.err
    assert field in shown.err
    assert remedy in shown.err
    assert set(tmp_path.iterdir()) == before


def test_a_missing_marker_is_named_with_the_file_and_what_there_is(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    laboratory(tmp_path)
    file = write_subject(tmp_path, document(model="squat_4dof"))
    assert main(["scale", str(file), "--out", str(tmp_path / "out")]) == 2
    assert "S01.yaml" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_an_unknown_method_names_those_there_are(
    subject_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["compare", str(subject_file), "--methods", "MB,XB", "--out", str(tmp_path / "out")]) == 2
    shown = capsys.readouterr().err
    assert "XB" in shown
    assert "MB_am" in shown
    assert not (tmp_path / "out").exists()


def test_out_that_is_a_file_is_refused_first(
    subject_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "out").write_text("mine", encoding="utf-8")
    assert main(["demo", "--out", str(tmp_path / "out")]) == 2
    assert "--out" in capsys.readouterr().err
    assert (tmp_path / "out").read_text(encoding="utf-8") == "mine"


def test_an_interruption_writes_nothing(
    subject_file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def interrupted(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(tasks, "open_subject", interrupted)
    assert main(["scale", str(subject_file), "--out", str(tmp_path / "out")]) == 130
    assert "interrupted" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_a_defect_is_no_input_error(
    subject_file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(*_: object, **__: object) -> None:
        raise ZeroDivisionError

    monkeypatch.setattr(tasks, "open_subject", broken)
    with pytest.raises(ZeroDivisionError):
        main(["scale", str(subject_file), "--out", str(tmp_path / "out")])
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("arguments", "code"), [(["--version"], 0), (["scale", "absent.yaml", "--out", "o"], 2), ([], 2)]
)
def test_the_module_runs_as_a_program(arguments: list[str], code: int, tmp_path: Path) -> None:
    command = [sys.executable, "-m", "scaling_service", *arguments]
    done = subprocess.run(command, capture_output=True, text=True, cwd=tmp_path, check=False)
    assert done.returncode == code, done.stderr
    assert "Traceback" not in done.stderr
    assert list(tmp_path.iterdir()) == []
