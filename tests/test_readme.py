"""The README's examples run as they stand, in one folder, from top to bottom."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import pytest

from scaling_service.cli import main
from tests.jobs.laboratory import laboratory

README = (Path(__file__).resolve().parents[1] / "README.md").read_text(encoding="utf-8")
BLOCKS = re.findall(r"^```(\w+)\n(.*?)^```$", README, re.MULTILINE | re.DOTALL)
COMMANDS = [
    line
    for language, text in BLOCKS
    if language == "bash"
    for line in text.replace("\\\n", " ").splitlines()
    if line.startswith("scaling-service ")
]
SHOWN = next(command for command in COMMANDS if "demo --out" in command)
SEARCH = next(command for command in COMMANDS if "demo --discover" in command)
"""The two whose output is shown."""

PROGRAMS = [text for language, text in BLOCKS if language == "python"]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where the README's reader would be: beside a subject file and its recordings."""
    place = tmp_path_factory.mktemp("readme")
    for name, text in re.findall(r"^```yaml\n# (\S+)\n(.*?)^```$", README, re.MULTILINE | re.DOTALL):
        (place / name).write_text(text, encoding="utf-8")
    subject = (place / "S01.yaml").read_text(encoding="utf-8")
    laboratory(place)  # writes a subject file of its own under the same name
    (place / "S01.yaml").write_text(subject, encoding="utf-8")
    return place


def test_the_output_shown_is_what_comes_out(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(folder)
    assert main(shlex.split(SHOWN)[1:]) == 0
    printed = _rows(capsys.readouterr().out)
    shown = _rows(next(text for language, text in BLOCKS if language == "text"))
    advice = "run `scaling-service demo --out demo` and paste its output into the README"
    assert list(shown) == list(printed), advice
    # The first column, MB, is computed in closed form; the fits' last digit may differ between machines.
    for label, value in shown.items():
        assert value == pytest.approx(printed[label], abs=0.11), advice  # one unit of the last digit shown


def _rows(text: str) -> dict[str, float]:
    """Label and first number of every row of the table."""
    found = re.findall(r"^ {2}(\S.{2,}?) {2,}(-?\d+\.\d)", text, re.MULTILINE)
    return {label: float(value) for label, value in found}


def test_the_search_shown_is_what_comes_out(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The same words in every line shown; numbers to what the last digits may differ by between machines."""
    monkeypatch.chdir(folder)
    assert main(shlex.split(SEARCH, comments=True)[1:]) == 0
    printed = {_words(line): _numbers(line) for line in capsys.readouterr().out.splitlines()}
    shown = next(text for language, text in BLOCKS if language == "text" and "Had been hidden" in text)
    advice = "run `scaling-service demo --discover --out hidden` and paste its output into the README"
    for line in shown.splitlines():
        if line != "...":
            assert _words(line) in printed, advice
            assert _numbers(line) == pytest.approx(printed[_words(line)], rel=0.02, abs=0.002), advice


_NUMBER = r"(?<![\w.])-?\d+(?:\.\d+)?(?![\w.])"


def _words(line: str) -> str:
    return " ".join(re.sub(_NUMBER, "#", line).split())


def _numbers(line: str) -> list[float]:
    return [float(number) for number in re.findall(_NUMBER, line)]


def test_there_are_examples() -> None:
    assert len(COMMANDS) >= 3
    assert PROGRAMS


@pytest.mark.parametrize("command", [command for command in COMMANDS if command not in (SHOWN, SEARCH)])
def test_commands(command: str, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(folder)
    for earlier in COMMANDS[: COMMANDS.index(command)]:
        if f" {_written_by(earlier)}/" in command and not (folder / _written_by(earlier)).exists():
            assert main(shlex.split(earlier, comments=True)[1:]) == 0
    assert main(shlex.split(command, comments=True)[1:]) == 0


def _written_by(command: str) -> str:
    return re.search(r"--out (\S+)", command)[1]


@pytest.mark.parametrize("program", PROGRAMS)
def test_programs(program: str, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(folder)
    exec(compile(program, "README.md", "exec"), {"__name__": "readme"})
