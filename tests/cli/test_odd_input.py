"""Models that cannot be used, requests to stop, and what is unusual but right."""

from __future__ import annotations

import os
import signal
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path

import pytest

from scaling_service.capabilities.scaling import run as tasks
from scaling_service.capabilities.scaling import saving
from scaling_service.cli import main
from tests.cli.spoilt import PERSON, assert_refused, record, recorded
from tests.jobs.laboratory import document, laboratory, write_recording, write_subject


@pytest.fixture(autouse=True)
def _quick(monkeypatch: pytest.MonkeyPatch) -> None:
    """Writing .osim files takes a second each, and is tested elsewhere."""
    monkeypatch.setattr(saving, "render_scaled", lambda found, _: ["<model/>"] * len(found))


MODELS = {
    "no XML": ("a model", ("not well-formed XML",)),
    "entities": (
        '<!DOCTYPE a [<!ENTITY b SYSTEM "file:///etc/hosts">]><a>&b;</a>',
        ("document type", "Remove"),
    ),
    "an empty file": ("", ("empty",)),
}


@pytest.mark.skipif(find_spec("opensim") is None, reason="opensim is not installed")
@pytest.mark.parametrize("name", MODELS)
def test_a_model_that_cannot_be_used(name: str, folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    content, says = MODELS[name]
    (folder / "model.osim").write_text(content, encoding="utf-8")
    file = write_subject(folder, document(model="model.osim"))
    before = set(folder.rglob("*"))
    assert main(["scale", str(file), "--method", "MB", "--out", str(folder / "out")]) == 2
    assert_refused(folder, capsys.readouterr().err, "model.osim", says, before)


def test_a_request_to_terminate_ends_as_an_interruption(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    original = tasks.open_subject

    def asked(*arguments: object, **options: object) -> object:
        os.kill(os.getpid(), signal.SIGTERM)
        return original(*arguments, **options)

    handler = signal.getsignal(signal.SIGTERM)
    monkeypatch.setattr(tasks, "open_subject", asked)
    before = set(folder.rglob("*"))
    assert main(["scale", str(folder / "S01.yaml"), "--out", str(folder / "out")]) == 130
    assert capsys.readouterr().err == "scaling-service: interrupted; nothing was written\n"
    assert set(folder.rglob("*")) == before
    assert signal.getsignal(signal.SIGTERM) is handler


def test_labels_of_other_scripts_and_paths_with_spaces(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    place = tmp_path / "Läufer 走"
    place.mkdir()
    laboratory(place, PERSON)
    record(place, lambda trial: trial.relabel({"RFH": "tête du péroné 走"}))
    file = write_subject(place, document(markers={"RFH": "tête du péroné 走"}))
    file.write_bytes(file.read_bytes().replace(b"\n", b"\r\n"))
    assert main(["scale", str(file), "--method", "MB", "--out", str(place / "Ergebnis 1")]) == 0
    assert "RFH = tête du péroné 走" in capsys.readouterr().out
    assert (place / "Ergebnis 1" / "MB" / "walk_ik.mot").is_file()


def test_trials_may_differ_in_rate_length_and_prefix(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    walk = recorded("walk")
    slow = replace(walk.frames(slice(None, None, 2)), rate_hz=0.5 * walk.rate_hz)
    write_recording(folder / "walk.trc", slow.relabel({"RFH": "Someone:RFH"}))
    record(folder, lambda trial: trial.frames(slice(0, 1)), ("standing",))
    record(folder, lambda trial: trial.frames(slice(0, 2)), ("hips",))
    assert main(["scale", str(folder / "S01.yaml"), "--method", "MB", "--out", str(folder / "out")]) == 0
    shown = capsys.readouterr().out
    assert "RFH = RFH or Someone:RFH" in shown
