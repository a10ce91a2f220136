"""One story, one place: documents, screen and report tell people the same, and in plain words.

Asked of the snapshots, which ``test_numbers`` holds to what the program writes and says. The page shows the
sentences of documents as they stand; ``tests/report/test_in_browser.py`` looks at it.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from functools import cache
from typing import Any

import pytest

from scaling_service.model.builtin import BUILTIN_NAMES, load_builtin
from tests.safety.cases import CASES
from tests.safety.sentences import clean_sentence
from tests.safety.snapshots import load_snapshot

NUMBERS_OF_MODELS = r"(?:scale|axis|centre|marker|skin)\.[A-Za-z]\w*"
"""Parameters, by the names that documents find them by."""

LENGTHS = ("inter_hip", *(f"{name}_{side}" for name in ("shank", "upper_arm", "forearm") for side in "rl"))
WRITTEN = re.compile(r"`[^`]*`|'[^']*'")
"""What is to be written into a file, or stands in one, is quoted as it is."""


@cache
def list_raw_names() -> frozenset[str]:
    """What the built-in models call their parts, where that is no word."""
    names = {*LENGTHS}
    for model in map(load_builtin, BUILTIN_NAMES):
        names |= {*model.segment_names, *model.coordinate_names}
        names |= {segment.joint_name for segment in model.segments}
    return frozenset(name for name in names if "_" in name)


def list_sentences(value: Any) -> Iterator[str]:
    """All texts of several words in a document."""
    if isinstance(value, str):
        if " " in value:
            yield value
    elif isinstance(value, dict | list):
        for one in value.values() if isinstance(value, dict) else value:
            yield from list_sentences(one)


def list_recordings(value: Any) -> Iterator[str]:
    """Recordings that a document tells of: they may be called like a joint."""
    if isinstance(value, dict):
        for key, one in value.items():
            if key in ("repairs", "trials") and isinstance(one, dict):
                yield from one
            yield from list_recordings(one)


def list_told(snapshot: dict[str, Any]) -> dict[str, list[str]]:
    """Where people are told something, and what."""
    told = {f"screen of {name}": said for name, said in snapshot["screen"].items()}
    for name, content in snapshot.items():
        if name.endswith("report.html"):
            told[name] = content
        elif name.endswith(".json") and not name.endswith("model.json"):
            told[name] = list(list_sentences(content))
    return told


@pytest.mark.parametrize("name", [case.name for case in CASES])
def test_no_sentence_for_people_holds_a_raw_name(name: str) -> None:
    snapshot = load_snapshot(name)
    names = list_raw_names() - {*list_recordings(snapshot)}
    either = "|".join([NUMBERS_OF_MODELS, r"plate_\d+", *sorted(names, key=len, reverse=True)])
    raw = re.compile(rf"(?<![\w./-])(?:{either})(?![\w/]|\.\w)")
    found = [
        f"{place}: {sentence}"
        for place, sentences in list_told(snapshot).items()
        for sentence in sentences
        if raw.search(WRITTEN.sub("", sentence))
    ]
    assert not found, "\n".join(found)


@pytest.mark.parametrize(
    ("name", "run", "file"),
    [
        ("demo", "demo", "demo/comparison.json"),
        ("compare", "compare", "compare/comparison.json"),
        ("demo_discover", "demo", "demo/discovery.json"),
        ("discover", "discover", "discover/discovery.json"),
    ],
)
def test_screen_and_report_say_a_documents_sentences_word_for_word(name: str, run: str, file: str) -> None:
    snapshot = load_snapshot(name)
    document = snapshot[file]
    verdict = document.get("verdict")
    said = [
        *document.get("warnings", ()),
        *(text for method in document.get("methods", {}).values() for text in method["warnings"]),
        *document.get("notes", ()),
        *(effect["name"] for effect in document.get("effects", ()) if effect["carries"]),
        document["headline"] if "headline" in document else verdict["headline"],
    ]
    assert said
    for place in (snapshot["screen"][run], snapshot[file.replace(file.rpartition("/")[2], "report.html")]):
        for sentence in said:
            wanted = clean_sentence(sentence, {}).removesuffix(".")
            assert any(wanted in shown for shown in place), sentence
