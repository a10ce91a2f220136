"""What another distribution adds shows up in the command line, over HTTP and on the page, and works."""

from __future__ import annotations

import csv
import json
import os
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
import yaml

from scaling_service.files.recording import read_recording
from scaling_service.guide.notebooks import render_notebook
from tests.safety.running import program_environment, unpack_subject

CONTRIBUTING = Path(__file__).resolve().parents[2] / ".github" / "CONTRIBUTING.md"


def install(folder: Path) -> None:
    """Do what CONTRIBUTING says, and then what pip does with it."""
    text = CONTRIBUTING.read_text(encoding="utf-8")
    parts = re.findall(r"^```python\n(.*?)^```$", text, re.MULTILINE | re.DOTALL)
    (folder / "sample_lab.py").write_text("\n\n".join(parts), encoding="utf-8")
    (declared,) = re.findall(r"^```toml\n(.*?)^```$", text, re.MULTILINE | re.DOTALL)
    project = tomllib.loads(declared)["project"]
    made = folder / f"sample_lab-{project['version']}.dist-info"
    made.mkdir()
    head = {"Metadata-Version": "2.1", "Name": project["name"], "Version": project["version"]}
    (made / "METADATA").write_text("".join(f"{key}: {value}\n" for key, value in head.items()))
    groups = project["entry-points"].items()
    lines = (
        f"[{group}]\n" + "".join(f"{n} = {at}\n" for n, at in points.items()) for group, points in groups
    )
    (made / "entry_points.txt").write_text("\n".join(lines))


def run(folder: Path, *arguments: str) -> str:
    installed = folder / "installed"
    if not installed.is_dir():
        installed.mkdir()
        install(installed)
    environment = program_environment()
    environment["PYTHONPATH"] = os.pathsep.join([environment["PYTHONPATH"], str(installed)])
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
from scaling_service.capabilities.discovery.effects.catalogue import find_effects
print(json.dumps({
    "words": [word.name for word in laboratory.list_vocabulary().methods],
    "body": KINDS["scaling"].request.model_json_schema()["properties"]["methods"]["description"],
    "optimised": KINDS["optimised-scaling"].request.model_json_schema()["properties"]["method"]["enum"],
    "accepted": KINDS["scaling"].request(subject="S01", methods=["MB_again"]).methods,
    "effects": list(find_effects()),
}))
"""


def test_the_effect_is_the_one_that_a_notebook_finds() -> None:
    """So that it is searched for, and found, once."""
    (program,) = (
        part
        for part in re.findall(r"```python\n(.*?)```", CONTRIBUTING.read_text(), re.DOTALL)
        if "EFFECT" in part
    )
    assert program in render_notebook("notebook-effect")


def test_it_is_among_the_words_and_bodies_of_the_service(tmp_path: Path) -> None:
    found = json.loads(run(tmp_path, "-c", SERVICE))
    assert found["words"][-1] == "MB_again"  # what the page offers
    assert "MB_again" in found["body"]
    assert "MB_again" in found["optimised"]
    assert found["accepted"] == ["MB_again"]
    assert "uneven_plate" in found["effects"]
