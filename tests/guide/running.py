"""What a page tells its reader to do, done in the reader's place, and its output compared."""

from __future__ import annotations

import re
import shlex
from collections.abc import Iterator
from dataclasses import dataclass

import pytest

from scaling_service.cli import main

_BLOCK = re.compile(r"^```(\w*)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
_NUMBER = r"(?<![\w.])-?\d+(?:\.\d+)?(?![\w.])"
_RELATIVE = 0.02  # chosen: fits' last digits differ between machines
LEFT_OUT = "..."
"""A line that stands for others."""


@dataclass(frozen=True)
class Block:
    """A fenced block; ``shown`` is the output that the page puts below it."""

    language: str
    text: str
    shown: str | None


def blocks(page: str) -> list[Block]:
    """All blocks of a page, each output with what makes it."""
    found = _BLOCK.findall(page)
    after = [*(text if language == "text" else None for language, text in found[1:]), None]
    return [
        Block(language, text, shown)
        for (language, text), shown in zip(found, after, strict=False)
        if language != "text"
    ]


def commands(text: str) -> Iterator[list[str]]:
    """The words of every command of ours in a block for a shell."""
    for line in text.replace("\\\n", " ").splitlines():
        if line.startswith("scaling-service "):
            yield shlex.split(line.removesuffix("& trap 'kill %1; wait' EXIT"), comments=True)[1:]


def run(block: Block, capsys: pytest.CaptureFixture[str], space: dict[str, object]) -> None:
    """Do what a block says, and compare what it prints with what the page shows.

    ``space``: what earlier blocks of the page bound.
    """
    capsys.readouterr()
    if block.language == "bash":
        for words in commands(block.text):
            assert main(words) == 0, words
    elif block.language == "python":
        exec(compile(block.text, "page", "exec"), space)
    if block.shown is not None:
        assert_shown(block.shown, capsys.readouterr().out)


def assert_shown(shown: str, printed: str) -> None:
    """Every line shown was printed: the same words, and numbers to what their last digits may differ by."""
    known: dict[str, list[list[str]]] = {}
    for line in printed.splitlines():
        known.setdefault(_words(line), []).append(re.findall(_NUMBER, line))
    for line in shown.splitlines():
        if line != LEFT_OUT:
            assert _words(line) in known, f"{line!r} is shown, and this was printed:\n{printed}"
            numbers = re.findall(_NUMBER, line)
            assert any(_alike(numbers, found) for found in known[_words(line)]), (line, known[_words(line)])


def _words(line: str) -> str:
    return " ".join(re.sub(_NUMBER, "#", line).split())


def _alike(shown: list[str], printed: list[str]) -> bool:
    digits = (10.0 ** -len(number.partition(".")[2]) for number in shown)
    return all(
        abs(float(a) - float(b)) <= max(1.1 * unit, _RELATIVE * abs(float(b)))
        for a, b, unit in zip(shown, printed, digits, strict=True)
    )
