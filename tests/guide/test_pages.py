"""Every page of the guide is true: its commands run and print what it shows, its links lead somewhere."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

import scaling_service
from scaling_service.cli import main
from scaling_service.guide import pages
from scaling_service.guide.notebooks import read_output
from scaling_service.guide.site import make_site, write_site
from tests.guide import notebooks
from tests.guide.renew import MEASURES, PAPERS
from tests.guide.running import LEFT_OUT, assert_shown, blocks, commands, run
from tests.safety.running import find_data, program_environment

ROOT = Path(__file__).resolve().parents[2]
README = (ROOT / "README.md").read_text(encoding="utf-8")
RUN = [
    name
    for name in pages.list_pages()
    if name not in notebooks.NAMES
    and any(block.language in ("bash", "python") for block in blocks(pages.read_page(name)))
]
DEMO = "scaling-service demo --out demo\n"
EXAMPLE = "scaling-service example --out lab\n"
SEARCHED = "missing-effect"
"""The page whose one command searches the example: what takes long."""

LONG = (SEARCHED, "cohort", "forces", "own-recording", "verdict")
"""Pages that take ten seconds and more; what they run, other tests of the command line run as well."""

SLOW = "# half a minute"
"""Begins blocks that are run only where what takes long is."""


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[pytest.mark.costly] if name in LONG else []) for name in RUN]
)
def test_what_a_page_says_to_do_does_what_it_shows(
    name: str,
    example: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    request: pytest.FixtureRequest,
) -> None:
    monkeypatch.chdir(tmp_path)
    found = blocks(pages.read_page(name))
    (tmp_path / "lab").symlink_to(example / "lab")
    if name == "python":
        (tmp_path / "plates").symlink_to(example / "plates")
    space: dict[str, object] = {}
    for block in found:
        if block.text == DEMO and block.shown is not None:
            made: Path = request.getfixturevalue("demo_program")
            shutil.copytree(made / "demo", tmp_path / "demo")
            assert_shown(block.shown, (made / "screen.txt").read_text(encoding="utf-8"))
        elif block.text != EXAMPLE and not block.text.startswith(SLOW):
            run(block, capsys, space)


@pytest.mark.costly
@pytest.mark.parametrize("name", notebooks.NAMES)
def test_a_notebook_prints_and_draws_what_it_shows(name: str) -> None:
    found = notebooks.execute(name, draw=False)
    for cell, outputs in zip(notebooks.read(name)["cells"], found, strict=True):
        shown, printed = ("\n".join(map(read_output, each)) for each in (cell.get("outputs", []), outputs))
        assert_shown(shown, printed)
        drawn = sum("image/png" in output.get("data", ()) for output in cell.get("outputs", []))
        assert drawn == printed.splitlines().count("Figure")


@pytest.mark.costly
def test_what_takes_half_a_minute_runs(
    example: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "lab").symlink_to(example / "lab")
    slow = [b for n in RUN for b in blocks(pages.read_page(n)) if b.text.startswith(SLOW)]
    assert slow
    for block in slow:
        run(block, capsys, {"ss": scaling_service})


def test_every_public_name_is_used_or_described_by_the_page_on_python() -> None:
    text = (pages.FOLDER / "python.md").read_text(encoding="utf-8")
    reported = {"Results", "Scaling", "Subject", "Tracked"}  # what functions return
    for name in set(scaling_service.__all__) - reported:
        assert re.search(rf"\bss\.{name}\b|`{name}`", text), name


def test_what_is_shown_must_be_printed() -> None:
    assert_shown("a  1.23 mm\n...\nb 7", "b 7.0001\na 1.24 mm\n".replace("7.0001", "7"))
    for wrong in ("a 1.30 mm", "c 1.24 mm"):
        with pytest.raises(AssertionError):
            assert_shown(wrong, "a 1.24 mm\n")


def test_commands_that_need_other_machines_exist(capsys: pytest.CaptureFixture[str]) -> None:
    """Those in blocks that are not run: every command and option is one of the program's."""
    shells = [b for n in pages.list_pages() for b in blocks(pages.read_page(n)) if b.language == "sh"]
    found = [words for block in shells for words in commands(block.text)]
    assert len(found) > 10
    for words in found:
        named = words[:2] if words[0] in ("keys", "data", "settings", "datasets") else words[:1]
        assert main([*named, "--help"]) == 0
        screen = capsys.readouterr().out
        for option in (word for word in words if word.startswith("--")):
            assert option in screen, (words, option)


def test_links_lead_somewhere() -> None:
    site = make_site()
    for name in pages.list_pages():
        html = site[f"{name}.html"].decode()
        assert html.count("<h1") == 1
        for target in re.findall(r'(?:href|src)="([^"]+)"', html):
            file, _, anchor = target.partition("#")
            if target.startswith(("https://", "data:")):
                continue
            assert not file or file in site, (name, target)
            if anchor:
                assert f'id="{anchor}"' in (site[file].decode() if file else html), (name, target)


def test_no_figure_is_missing_and_no_mark_is_left() -> None:
    for name in pages.list_pages():
        assert "{{" not in pages.read_page(name)


@pytest.mark.costly
@pytest.mark.parametrize("name", list(MEASURES))
def test_figures_are_what_is_measured(name: str) -> None:
    if name not in PAPERS and find_data() is None:
        pytest.skip("the real recordings are not here: set SCALING_SERVICE_DATA")
    stored, measured = (without_times(figures) for figures in (pages.read_figures()[name], MEASURES[name]()))
    assert stored == measured, f"run `python -m tests.guide.renew {name}`"


def without_times(figures: Any) -> str:
    """Figures in words, numbers to five digits, without seconds, which no two runs share."""
    exact = json.dumps(figures, sort_keys=True)
    rounded = re.sub(r"\d+\.\d{5,}", lambda number: f"{float(number[0]):.5g}", exact)
    return re.sub(r"(slowest subject|at most) [\d.]+ s\b", r"\1 … s", rounded)


@pytest.mark.parametrize(
    ("words", "page"),
    [("Plug-in Gait", "own-recording"), ("residual", "forces"), ("soft tissue", "missing-effect")],
)
def test_search_finds(words: str, page: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert page in [section.page for section in pages.search(words)][:3]
    assert main(["guide", "--search", words]) == 0
    assert page in capsys.readouterr().out


def test_the_guide_on_a_terminal(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["guide"]) == 0
    assert "first-steps" in capsys.readouterr().out
    assert main(["guide", "cohort"]) == 0
    assert "what is done and unchanged is kept" in " ".join(capsys.readouterr().out.split())
    assert main(["guide", "nothing"]) == 2
    assert "Choose one of first-steps" in capsys.readouterr().err


def test_the_guide_loads_nothing_that_computes() -> None:
    code = (
        "import sys; from scaling_service.guide import site; site.make_site(); print('numpy' in sys.modules)"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], env=program_environment(), capture_output=True, text=True, check=True
    )
    assert done.stdout.strip() == "False"


@pytest.fixture(scope="module")
def visitor(browser: Any, tmp_path_factory: pytest.TempPathFactory) -> Iterator[object]:
    """A browser without a network, at the guide's first page in a folder."""
    folder = tmp_path_factory.mktemp("guide")
    write_site(folder)
    context = browser.new_context(offline=True, viewport={"width": 360, "height": 740})
    page = context.new_page()
    page.goto((folder / "index.html").as_uri())
    yield page
    context.close()


def test_it_opens_and_searches_offline(visitor: object) -> None:
    page = visitor
    for words, expected in (("plug-in gait", "Your first own recording"), ("soft tissue", "missing effect")):
        page.fill("#words", words)
        assert expected in page.inner_text("#found li:first-child")
    page.press("#words", "Enter")
    page.wait_for_url("**/missing-effect.html*")
    assert page.inner_text("h1") == "Finding the missing effect"


def test_it_fits_a_phone(visitor: object) -> None:
    page = visitor
    for name in pages.list_pages():
        page.goto(page.url.rpartition("/")[0] + f"/{name}.html")
        assert page.evaluate("document.documentElement.scrollWidth") <= 360, name


def test_the_readme_is_short_and_shows_what_the_guide_shows() -> None:
    assert len(README.split()) <= 700
    (shown,) = (text for text in re.findall(r"^```text\n(.*?)^```$", README, re.MULTILINE | re.DOTALL))
    page = pages.read_page("first-steps").splitlines()
    assert all(line in page for line in shown.splitlines() if line != LEFT_OUT)
    for target in re.findall(r"\]\((?!http)([^)#]+)", README):
        assert (ROOT / target).exists(), target
