"""The look at a folder from the command line: what it prints is what scaling then takes."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from scaling_service.cli import main


def test_the_proposed_subject_file_can_be_scaled(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (folder / "S01.yaml").unlink()
    assert main(["proof", str(folder), "--out", str(tmp_path / "looked")]) == 0
    printed = capsys.readouterr().out
    for word in ("trials.static", "S01:RKNE", "known alias", "up is +z", "subject.yaml"):
        assert word in printed
    document = json.loads((tmp_path / "looked" / "proof.json").read_text(encoding="utf-8"))
    for recording in document["recordings"]:
        assert (tmp_path / "looked" / recording["markers"]["file"]).is_file()
    subject = tmp_path / "looked" / "subject.yaml"
    assert main(["scale", str(subject), "--method", "MB", "--out", str(tmp_path / "scaled")]) == 0
    assert (tmp_path / "scaled" / "MB" / "scaling.json").is_file()


def test_problems_are_printed_with_their_remedies(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (folder / "walk.trc").write_text("no recording", encoding="utf-8")
    assert main(["proof", str(folder), "--out", str(tmp_path / "looked")]) == 0
    printed = " ".join(capsys.readouterr().out.split())
    assert "error walk.trc, line 1" in printed
    assert "A TRC file begins with the word PathFileType" in printed


def test_a_folder_that_is_not_there_is_reported(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["proof", str(tmp_path / "none"), "--out", str(tmp_path / "looked")]) == 2
    assert "there is no such folder" in capsys.readouterr().err
    assert not (tmp_path / "looked").exists()
