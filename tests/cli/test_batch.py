"""``batch`` as people meet it: what it prints, its exit codes, and how it is stopped and goes on."""

from __future__ import annotations

import io
import json
import shutil
from pathlib import Path

import pytest
from rich.console import Console
from rich.progress import Progress

from scaling_service.capabilities.cohort import outcomes
from scaling_service.capabilities.cohort.outcomes import Outcome
from scaling_service.capabilities.cohort.screen import Screen
from scaling_service.capabilities.scaling import saving
from scaling_service.cli import main
from tests.jobs.cohorts import someone, table

FEW = ["--workers", "1", "--frames", "20", "--smooth-hz", "0"]


@pytest.fixture(autouse=True)
def _quick(monkeypatch: pytest.MonkeyPatch) -> None:
    """Writing .osim files takes a second each, and is tested elsewhere."""
    monkeypatch.setattr(saving, "render_scaled", lambda found, _: ["<model/>"] * len(found))


@pytest.fixture(scope="module")
def sound(tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp("sound")
    for name in ("A", "B"):
        someone(root, name)
    table(root, "A", "B")
    return root


@pytest.fixture
def root(sound: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(sound, tmp_path / "cohort"))


def _run(cohort: Path, out: Path, *options: str) -> int:
    return main(["batch", str(cohort), "--out", str(out), "--methods", "MB,MB_am", *FEW, *options])


def test_a_batch_prints_methods_over_subjects_and_one_line_each(
    root: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert _run(root / "cohort.csv", tmp_path / "out") == 0
    shown = capsys.readouterr()
    written = json.loads((tmp_path / "out" / "cohort.json").read_text(encoding="utf-8"))
    femur = next(q for q in written["statistics"]["segment_lengths_mm"] if q["quantity"] == "femur_r")
    for method in ("MB", "MB_am"):
        assert f"{femur['mean'][method]:.1f} ± {femur['sd'][method]:.1f}" in shown.out
    assert "2 done, 0 skipped, 0 failed" in shown.out
    assert "Necessary, not sufficient" in shown.out
    assert "no subject has a whole stride" in shown.out
    assert all(name in shown.out for name in ("cohort.json", "lengths.csv", "errors.csv", "angles.csv"))
    lines = shown.err.splitlines()
    assert [line.split()[:5] for line in lines] == [
        ["1", "of", "2", "A", "done"],
        ["2", "of", "2", "B", "done"],
    ]
    assert "\x1b" not in shown.out + shown.err
    assert _run(root / "cohort.csv", tmp_path / "out") == 0
    assert "A done: unchanged since an earlier run" in capsys.readouterr().err


def test_one_failure_ends_with_1_and_a_table(
    root: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (root / "B" / "walk.trc").write_text("no recording\n", encoding="utf-8")
    assert _run(root / "cohort.csv", tmp_path / "out") == 1
    shown = capsys.readouterr()
    assert "1 done, 0 skipped, 1 failed" in shown.out
    assert "Not done" in shown.out
    assert "walk.trc" in shown.out.replace("\n", "")
    assert "2 of 2  B failed" in shown.err
    assert (tmp_path / "out" / "A" / "comparison.json").is_file()


def test_if_all_fail_the_reasons_are_all_there_is(
    root: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for name in ("A", "B"):
        (root / name / "hips.trc").unlink()
    assert _run(root, tmp_path / "out") == 1
    shown = capsys.readouterr().out
    assert "0 done, 0 skipped, 2 failed" in shown
    assert "hips.trc" in shown
    assert "Friedman" not in shown


def test_a_broken_rule_ends_with_2_and_one_line(
    root: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bad = table(tmp_path, "A", header="person,site")
    for arguments, said in (
        ((bad, tmp_path / "out"), "no column `subject`"),
        ((tmp_path / "absent.csv", tmp_path / "out"), "no such file"),
        ((root / "A" / "subject.yaml", tmp_path / "out"), "looks like a subject file"),
        ((root / "cohort.csv", root), "Name another folder"),
        ((root / "cohort.csv", tmp_path / "out", "--methods", "EB"), "no bones"),
        ((root / "cohort.csv", tmp_path / "out", "--methods", "XB"), "no method 'XB'"),
        ((root / "cohort.csv", tmp_path / "out", "--workers", "0"), "--workers"),
        ((root / "cohort.csv", tmp_path / "out", "--up", "north"), "up"),
    ):
        assert _run(*arguments) == 2, said
        shown = capsys.readouterr()
        assert shown.out == ""
        assert shown.err.count("\n") == 1
        assert said in shown.err
    assert not (tmp_path / "out").exists()


def test_an_interruption_says_what_is_kept(
    root: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    whole = outcomes.compare

    def interrupted(file: Path, *rest: object, **options: object) -> object:
        if file.parent.name == "B":
            raise KeyboardInterrupt
        return whole(file, *rest, **options)

    monkeypatch.setattr(outcomes, "compare", interrupted)
    assert _run(root / "cohort.csv", tmp_path / "out") == 130
    said = capsys.readouterr().err.splitlines()[-1]
    assert "1 of 2 subjects had ended" in said
    assert "run the same command to go on" in said


def test_help_teaches(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["batch", "--help"]) == 0
    shown = capsys.readouterr().out
    assert "cohort.csv" in shown
    assert "--workers" in shown
    assert "Exit code 1" in " ".join(shown.split())


def test_a_terminal_shows_the_whole_and_every_subject_under_way() -> None:
    text = io.StringIO()
    console = Console(file=text, force_terminal=True, width=100)
    with Progress(console=console, auto_refresh=False) as progress:
        screen = Screen(progress, terminal=True)
        screen.start(3, 2)
        screen.stage("A", "MB: fitting", 0.5)
        screen.stage("B", "reading the recordings", 0.25)
        whole, a, b = progress.tasks
        assert "3 subjects, 2 at a time" in whole.description
        assert (whole.completed, whole.total) == (0.75, 3)
        assert "A: MB: fitting" in a.description
        assert "B: reading" in b.description
        screen.finish(Outcome(name="A", groups={}, status="done"))
        screen.stage("A", "done", 1.0)  # late: the subject is over
        screen.finish(Outcome(name="C", groups={}, status="done", kept=True))
        assert [task.description for task in progress.tasks] == [whole.description, b.description]
        # What was kept took no time and is no measure of the rest.
        assert (progress.tasks[0].completed, progress.tasks[0].total) == (1.25, 2)
        assert screen.ended == 2
        screen.finish(Outcome(name="B", groups={}, status="failed", reason="no markers"))
        assert "3 of 3  B failed: no markers" in text.getvalue()
