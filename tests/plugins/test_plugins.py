"""What another distribution adds shows up in the command line, over HTTP and on the page, and works."""

from __future__ import annotations

import csv
import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
import yaml

from scaling_service.files.recording import read_recording
from tests.safety.running import program_environment, unpack_subject

DISTRIBUTION = Path(__file__).with_name("distribution")


def run(folder: Path, *arguments: str) -> str:
    environment = program_environment()
    environment["PYTHONPATH"] = os.pathsep.join([environment["PYTHONPATH"], str(DISTRIBUTION)])
    done = subprocess.run(
        [sys.executable, *arguments],
        cwd=folder,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.fixture
def subject(tmp_path: Path) -> Path:
    """A subject whose recordings are in the added format."""
    unpack_subject("leg", tmp_path)
    file = tmp_path / "S01.yaml"
    for recording in list(tmp_path.rglob("*.trc")):
        trial = read_recording(recording)
        with recording.with_suffix(".rows").open("w", encoding="utf-8", newline="") as stream:
            rows = csv.writer(stream)
            rows.writerow(["time", *trial.labels])
            rows.writerows([t, *(1e3 * m).ravel()] for t, m in zip(trial.times, trial.markers, strict=True))
        recording.unlink()
    content = file.read_text(encoding="utf-8").replace(".trc", ".rows")
    assert ".rows" in content
    file.write_text(content, encoding="utf-8")
    return file


def test_an_added_method_scales_recordings_of_an_added_format(subject: Path) -> None:
    run(
        subject.parent, "-m", "scaling_service", "scale", subject.name, "--method", "MB_again", "--out", "out"
    )
    found = json.loads((subject.parent / "out" / "MB_again" / "scaling.json").read_text(encoding="utf-8"))
    assert found["method"] == "MB_again"
    assert found["segment_lengths_mm"]
    assert yaml.safe_load(subject.read_text(encoding="utf-8"))["trials"]


def test_it_is_among_the_choices_of_the_command_line(tmp_path: Path) -> None:
    for command in ("scale", "compare", "dynamics", "discover"):
        assert "MB_again" in run(tmp_path, "-m", "scaling_service", command, "--help")


SERVICE = """
import json
from scaling_service.service.http import laboratory
from scaling_service.service.jobs.kinds import KINDS
from scaling_service.capabilities.discovery.effects.catalogue import known_effects
print(json.dumps({
    "words": [word.name for word in laboratory.vocabulary().methods],
    "body": KINDS["scaling"].request.model_json_schema()["properties"]["methods"]["description"],
    "optimised": KINDS["optimised-scaling"].request.model_json_schema()["properties"]["method"]["enum"],
    "accepted": KINDS["scaling"].request(subject="S01", methods=["MB_again"]).methods,
    "effects": list(known_effects()),
}))
"""


def test_it_is_among_the_words_and_bodies_of_the_service(tmp_path: Path) -> None:
    found = json.loads(run(tmp_path, "-c", SERVICE))
    assert found["words"][-1] == "MB_again"  # what the page offers
    assert "MB_again" in found["body"]
    assert "MB_again" in found["optimised"]
    assert found["accepted"] == ["MB_again"]
    assert "lifted_floor" in found["effects"]
