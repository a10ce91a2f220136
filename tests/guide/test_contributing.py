"""What contributors read is true of the code."""

from __future__ import annotations

import ast
import re
import tomllib

import yaml

from tests.guide.draw import FIGURE, HTTP, PAGE, ROOT, describe_http, draw_benchmark, draw_layers

CONTRIBUTING = (ROOT / ".github" / "CONTRIBUTING.md").read_text(encoding="utf-8")
PYPROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))


def test_the_drawing_is_of_the_layers() -> None:
    assert draw_layers() in PAGE.read_text(encoding="utf-8"), "run `python -m tests.guide.draw`"


def test_the_page_on_http_is_of_the_routes() -> None:
    assert describe_http() == HTTP.read_text(encoding="utf-8"), "run `python -m tests.guide.draw`"


def test_the_figure_is_of_the_measured_benchmark() -> None:
    assert draw_benchmark() == FIGURE.read_text(encoding="utf-8"), "run `python -m tests.guide.draw`"


def test_the_walk_of_a_recording_goes_where_it_says() -> None:
    steps = re.findall(r"`([\w/]+\.py): (\w+)`", PAGE.read_text(encoding="utf-8"))
    assert len(steps) > 5
    for file, name in steps:
        module = ast.parse((ROOT / "scaling_service" / file).read_text(encoding="utf-8"))
        assert name in {n.name for n in ast.walk(module) if isinstance(n, ast.FunctionDef)}, (file, name)


def test_every_folder_and_option_named_is_there() -> None:
    for folder in re.findall(r"^\| ((?:`\w+` ?)+)", CONTRIBUTING, re.MULTILINE):
        for name in re.findall(r"`(\w+)`", folder):
            assert (ROOT / "tests" / name).is_dir(), name
    assert "dev" in PYPROJECT["project"]["optional-dependencies"]


def test_files_for_github_can_be_read() -> None:
    for file in [*(ROOT / ".github").rglob("*.yml"), ROOT / ".pre-commit-config.yaml"]:
        assert yaml.safe_load(file.read_text(encoding="utf-8")), file
    check = yaml.safe_load((ROOT / ".github/workflows/check.yml").read_text(encoding="utf-8"))
    job = check["jobs"]["check"]
    assert {"run": ".ci/run ${{ matrix.half }}"} in job["steps"]
    assert job["strategy"]["matrix"]["half"] == ["", "costly"]


def test_the_citation_is_of_this_version() -> None:
    cited = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    assert cited["version"] == PYPROJECT["project"]["version"]
    assert cited["license"] == PYPROJECT["project"]["license"]
    released = f"## {cited['version']} ({cited['date-released']})"
    assert released in (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")


def test_links_of_contributors_pages_lead_somewhere() -> None:
    for page in (ROOT / ".github").rglob("*.md"):
        for target in re.findall(r"\]\((?!http)([^)#]+)", page.read_text(encoding="utf-8")):
            assert (page.parent / target).exists(), (page, target)
