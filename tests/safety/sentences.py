"""What the program says to people, as sentences: of the screen and of report.html."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from html.parser import HTMLParser

NUMBER = re.compile(r"(?<![\w.])[-−+]?\d+(?:\.\d+)?(?:e[-+]?\d+)?(?!\w|\.\d)")
MOST_NUMBERS = 32
"""A sentence with more is a drawing's data."""

ABOUT_TIME = "a claim about time"
_TIMED_CLAIMS = ("A person takes at most 20 s", "A subject is scaled in less than four minutes")
"""What studies say of computing time: whether it holds, and so how many do, depends on the machine."""

_VARIES = (
    (re.compile(r"(\.\./)*\.\.DATA\b"), "DATA"),  # how deep the folder of the results lies
    (re.compile(r"\b[0-9a-f]{12,64}\b"), "HASH"),
    (re.compile(r"\b\d+(?:\.\d+)? s for (?=\d+ persons)"), "TIME for "),
    (re.compile(r"scaling-service \d+\.\d+\.\d+\w*"), "scaling-service VERSION"),
    (re.compile(r"^version \| .*"), "version | VERSION"),
    (re.compile(r"\bThe search took [\d.]+ s"), "The search took TIME"),
    (re.compile(r"^seconds in all \| .*"), "seconds in all | TIME"),
    (re.compile(rf"^.*({'|'.join(_TIMED_CLAIMS)}).*$"), rf"{ABOUT_TIME}: \1"),
    (re.compile(r"^(\S+ \| done \|.*\|) [\d.]+$"), r"\1 TIME"),
    (re.compile(r"^\d+ of (?=\d+ claims hold)"), "SOME of "),
)
"""What may differ though nothing has changed, and what stands for it."""

_TIMED_TABLES = ("Iterations and seconds",)
"""Tables of the report that hold times."""

_INLINE = frozenset(
    ("a", "abbr", "b", "br", "code", "em", "i", "small", "span", "strong", "sub", "sup", "td", "th")
)
"""Elements that do not end a sentence."""

_SILENT = frozenset(("script", "style", "svg"))


class _Page(HTMLParser):
    """Collects visible text, a sentence for each block, cells of a row between bars."""

    def __init__(self) -> None:
        super().__init__()
        self.sentences: list[str] = []
        self._text: list[str] = []
        self._silent: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        timed = tag == "table" and dict(attrs).get("aria-label") in _TIMED_TABLES
        if tag in _SILENT or timed or (self._silent and tag == self._silent[-1]):
            self._silent.append(tag)
        if tag not in _INLINE:
            self._end_sentence()
        if tag in ("td", "th") and self._text:
            self._text.append(" | ")

    def handle_endtag(self, tag: str) -> None:
        if self._silent and tag == self._silent[-1]:
            self._silent.pop()
        if tag not in _INLINE:
            self._end_sentence()

    def handle_data(self, data: str) -> None:
        if not self._silent:
            self._text.append(data)

    def _end_sentence(self) -> None:
        self.sentences.append("".join(self._text))
        self._text = []


def split_page(html: str) -> list[str]:
    """Visible sentences of a page."""
    page = _Page()
    page.feed(html)
    page.close()
    return page.sentences


def split_screen(text: str) -> list[str]:
    """Lines of what was printed."""
    return text.splitlines()


def sort_sentences(sentences: Iterable[str], replaced: Mapping[str, str]) -> list[str]:
    """Sentences without what may vary, in the order of their words; what has none is left out."""
    cleaned = [clean_sentence(sentence, replaced) for sentence in sentences]
    kept = [s for s in cleaned if re.search(r"[^\W\d_]", s) and len(NUMBER.findall(s)) <= MOST_NUMBERS]
    return sorted(kept, key=mask_numbers)  # stable: of equal words the order stays


def clean_sentence(sentence: str, replaced: Mapping[str, str]) -> str:
    """One sentence without folders, hashes, times and versions, single-spaced."""
    for folder, name in replaced.items():
        sentence = sentence.replace(folder, name)
    sentence = " ".join(sentence.split())
    for pattern, name in _VARIES:
        sentence = pattern.sub(name, sentence)
    return sentence


def mask_numbers(sentence: str) -> str:
    """The words alone."""
    return NUMBER.sub("#", sentence)


def read_numbers(sentence: str) -> list[str]:
    """The numbers as they are shown."""
    return [number.replace("−", "-") for number in NUMBER.findall(sentence)]
