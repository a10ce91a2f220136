"""The command `discover`: what it prints and writes, and what it refuses first."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import yaml

from scaling_service.capabilities.discovery import run as discover_run
from scaling_service.capabilities.discovery.command import show
from scaling_service.capabilities.discovery.result import (
    DiscoverResults,
    DiscoveryDocument,
    HiddenDocument,
    PlacedEffect,
)
from scaling_service.capabilities.discovery.words import write_headline
from scaling_service.capabilities.subject.loading import Loaded
from scaling_service.cli import main
from scaling_service.cli.app import EXIT_INPUT
from scaling_service.documents.results import RepairNote
from scaling_service.files.trc import write_trc
from scaling_service.model.trial import Trial
from scaling_service.virtual.subject import make_virtual_subject
from tests.jobs.hidden_case import SHORT, found, session

_ONE = HiddenDocument(kind="marker_swap", where=["LLM", "LMM"], parameters={"start_s": 2.0})


@pytest.fixture(scope="module")
def document() -> DiscoveryDocument:
    return found().document.model_copy(update={"hidden": [_ONE], "files": ["model.json"]})


def said(document: DiscoveryDocument, capsys: pytest.CaptureFixture[str], *, everything: bool = True) -> str:
    show(document, Path("somewhere"), everything=everything)
    return capsys.readouterr().out


def test_effects_sizes_and_the_gap_are_shown(
    document: DiscoveryDocument, capsys: pytest.CaptureFixture[str]
) -> None:
    assert "held out: all together" not in said(document, capsys, everything=False)
    out = said(document, capsys)
    row = next(line for line in out.splitlines() if line.startswith("soft tissue artefact"))
    assert "RLFE" in row
    assert "mm/deg" in row
    assert "→" in row
    assert "held out: all together, times what is ordinary" in out
    assert "Verdict  2 missing effects were found" in out


def test_the_story_is_three_lines_each_with_its_share_and_what_to_do(
    document: DiscoveryDocument, capsys: pytest.CaptureFixture[str]
) -> None:
    one = document.effects[0]
    half = one.evidence.model_copy(update={"gain_held_out": 0.5})
    one = one.model_copy(update={"evidence": half, "advice": "Level the floor."})
    out = said(document.model_copy(update={"effects": [one] * 5}), capsys, everything=False)
    assert out.count("Level the floor.") == out.count("█" * 10 + "░" * 10 + " takes 50 %") == 3
    assert [line[:2] for line in out.splitlines() if one.name in line] == ["1.", "2.", "3."]
    assert "And 2 more" in out
    assert "--all" in out


def test_what_to_do_follows_from_where_the_fault_is(document: DiscoveryDocument) -> None:
    advice = {effect.kind: effect.advice for effect in document.effects}
    assert "corrected/" in advice["marker_swap"]
    assert (
        "not in the model" in advice["soft_tissue_artefact"] or "model.json" in advice["soft_tissue_artefact"]
    )


def test_the_answer_comes_after_the_verdict(
    document: DiscoveryDocument, capsys: pytest.CaptureFixture[str]
) -> None:
    out = said(document, capsys)
    assert out.index("Verdict") < out.index("Had been hidden")
    assert "Had been hidden" not in said(document.model_copy(update={"hidden": None}), capsys)


def test_a_class_is_reported_with_what_would_separate_it(
    document: DiscoveryDocument, capsys: pytest.CaptureFixture[str]
) -> None:
    twins = [PlacedEffect(kind="joint_axis_tilt", where=[f"knee_{k}"]) for k in range(5)]
    effect = document.effects[-1].model_copy(
        update={"confusable_with": twins, "would_separate": "standing hip rotation"}
    )
    out = said(document.model_copy(update={"effects": [effect]}), capsys)
    line = next(line for line in out.splitlines() if line.startswith("Class"))
    assert "joint axis tilt at knee_0" in line
    assert "and 2 more" in line
    assert "standing hip rotation" in line


def test_where_no_member_of_a_class_stands_out_the_class_is_reported(
    document: DiscoveryDocument, capsys: pytest.CaptureFixture[str]
) -> None:
    effect = document.effects[-1]
    assert effect.belief is not None
    doubtful = effect.belief.model_copy(update={"member": 0.05})
    effect = effect.model_copy(update={"belief": doubtful, "name": "one of 20 not told apart here: a; b"})
    out = said(document.model_copy(update={"effects": [effect]}), capsys)
    assert "or another of its class" in out
    assert any(line.startswith("Class") and "one of 20" in line for line in out.splitlines())
    assert "named only as a class" in write_headline("found", [effect], None, [], held_out=True)
    assert "named only as a class" not in write_headline(
        "found", document.effects[:1], None, [], held_out=True
    )


def test_what_takes_nothing_off_stands_in_no_headline(
    document: DiscoveryDocument, capsys: pytest.CaptureFixture[str]
) -> None:
    one, two = document.effects[0], document.effects[-1].model_copy(update={"carries": False})
    headline = write_headline("found", [one, two], None, [], held_out=True)
    assert headline.startswith("One missing effect")
    out = said(document.model_copy(update={"effects": [one, two]}), capsys)
    assert f"1. {one.name}" in out
    assert two.name not in out
    alone = write_headline("nothing", [two], None, [], held_out=True)
    assert alone == "Ordinary for people; nothing that takes 0.5 % or more off the squared gap stands out"


def test_how_the_files_were_read_is_said(
    document: DiscoveryDocument, capsys: pytest.CaptureFixture[str]
) -> None:
    mended = RepairNote(what="unit", where="walk", detail="positions said to be in m are in mm", frames=9)
    out = said(document.model_copy(update={"repairs": {"walk": [mended]}}), capsys)
    assert "walk: positions said to be in m are in mm" in out


def laboratory(folder: Path, trials: dict[str, Trial], content: dict[str, object]) -> Path:
    """Recordings in a folder, with a subject file."""
    for name, trial in trials.items():
        write_trc(folder / f"{name}.trc", trial)
    file = folder / "S01.yaml"
    file.write_text(yaml.safe_dump({"subject": {"id": "S01"}, "model": "lower_limb_14dof"} | content))
    return file


def test_a_recording_that_fits_nobody_is_said_first(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """All labels in the places of others: nothing is named, and nothing is written."""
    walk = session().evaluation[0]
    order = np.random.default_rng(0).permutation(walk.labels)
    other = dict(zip(walk.labels, map(str, order), strict=True))
    file = laboratory(tmp_path, {"walk": walk.relabel(other)}, {"trials": {"calibration": ["walk.trc"]}})
    axes = ["--up", "+y", "--forward", "+x"]
    code = main(["discover", str(file), "--start", "none", *axes, "--out", str(tmp_path / "out")])
    error = capsys.readouterr().err
    assert code == EXIT_INPUT
    assert "walk.trc" in error
    assert "Correct the labels" in error or "labels of both sides are exchanged" in error
    assert not (tmp_path / "out").exists()


def test_one_short_recording_says_what_cannot_be_decided(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    whole = session()
    walk = whole.evaluation[0].frames(slice(0, 40))
    file = laboratory(tmp_path, {"walk": walk}, {"trials": {"evaluation": ["walk.trc"]}})
    out = tmp_path / "out"
    assert main(["discover", str(file), "--start", "none", "--no-report", "--out", str(out)]) == 0
    content = json.loads((out / "discovery.json").read_text(encoding="utf-8"))
    assert content["held_out_trials"] == []
    assert any("no trial was held out" in note for note in content["notes"])
    assert any("no recording has forces" in note for note in content["notes"])
    assert "report.html" not in content["files"]
    assert "no trial was held out" in capsys.readouterr().out


def test_the_demo_searches_what_it_hid(monkeypatch: pytest.MonkeyPatch) -> None:
    """The search gets recordings with both faults and the person's own model, and is not told of them."""
    given: list[Loaded] = []

    def search(loaded: Loaded, *_: object, **__: object) -> DiscoverResults:
        given.append(loaded)
        return found()

    monkeypatch.setattr(discover_run, "run", search)
    results = discover_run.run_hidden_demo(2, SHORT)
    assert results.document.hidden is not None
    assert [h.kind for h in results.document.hidden] == ["soft_tissue_artefact", "marker_swap"]
    recorded = given[0].session
    plain = make_virtual_subject(2, SHORT)
    assert recorded.model == plain.model
    moved = {
        name: np.nanmax(np.linalg.norm(trial.markers - plain.trials[name].markers, axis=2), axis=0)
        for name, trial in ((t.name, t) for t in recorded.dynamic)
    }
    labels = recorded.calibration[0].labels
    assert {labels[k] for k in np.flatnonzero(moved["gait_1"])} == {"RLFE"}
    assert {labels[k] for k in np.flatnonzero(moved["knee_l"] > 0.03)} == {"LLM", "LMM"}
    bent = np.degrees(plain.motions["knee_r"][:, plain.model.coordinate_names.index("knee_angle_r")])
    assert moved["knee_r"][labels.index("RLFE")] == pytest.approx(0.4e-3 * np.abs(bent).max(), rel=0.02)


def test_help_teaches(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["discover", "--help"]) == 0
    text = " ".join(capsys.readouterr().out.split())
    for words in ("held out", "unexplained", "corrected/", "demo --discover"):
        assert words in text
