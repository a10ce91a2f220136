"""What another distribution adds shows up in the command line, over HTTP and on the page, and works."""

from __future__ import annotations

import ast
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

from scaling_service import plugins
from scaling_service.files.recording import read_recording
from scaling_service.guide.notebooks import render_notebook
from scaling_service.guide.pages import describe_plugins
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


CHOICES = """
from scaling_service.cli import main
for command in ("scale", "compare", "dynamics", "discover"):
    print("help of", command, flush=True)
    main([command, "--help"])
"""


def test_it_is_among_the_choices_of_the_command_line(tmp_path: Path) -> None:
    nothing, *said = run(tmp_path, "-c", CHOICES).split("help of ")
    assert nothing == ""
    for text, command in zip(said, ("scale", "compare", "dynamics", "discover"), strict=True):
        assert text.startswith(command)
        assert "MB_again" in text


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


def test_it_imports_nothing_of_ours_but_what_is_promised(tmp_path: Path) -> None:
    install(tmp_path)
    tree = ast.parse((tmp_path / "sample_lab.py").read_text(encoding="utf-8"))
    homes = {n.module for n in ast.walk(tree) if isinstance(n, ast.ImportFrom)}
    homes |= {a.name for n in ast.walk(tree) if isinstance(n, ast.Import) for a in n.names}
    assert {home for home in homes if home and home.startswith("scaling_service")} == {plugins.__name__}


def test_every_promised_name_is_there_and_is_described() -> None:
    for name in plugins.__all__:
        assert getattr(plugins, name) is not None
    rows = re.findall(r"^\| `(\w+)` \| (.+) \|$", describe_plugins(), re.MULTILINE)
    assert [name for name, _ in rows] == plugins.__all__
    with pytest.raises(AttributeError, match="no attribute 'Nothing'"):
        plugins.Nothing  # noqa: B018


def test_a_reader_of_files_does_not_load_the_search(tmp_path: Path) -> None:
    program = (
        "import sys; from scaling_service.plugins import Recording; "
        "print([m for m in sys.modules if 'capabilities' in m])"
    )
    assert run(tmp_path, "-c", program) == "[]\n"
