"""Compare what is held with what is now: words exactly, numbers within their tolerance."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from tests.safety.reading import SUMMARISED, SUMMARY
from tests.safety.sentences import mask_numbers, read_numbers
from tests.safety.tolerances import find_tolerance

MOST_SHOWN = 20
_ABSENT = "(absent)"
ROUNDING = 1e-15  # m or rad


@dataclass(frozen=True)
class Difference:
    """One place where it differs, and how many times its tolerance (infinite for words)."""

    path: str
    stored: Any
    now: Any
    excess: float = math.inf

    def __str__(self) -> str:
        size = "" if math.isinf(self.excess) else f"   ({self.excess:.3g} x tolerance)"
        return f"{self.path}\n    stored {_show(self.stored)}\n    now    {_show(self.now)}{size}"


def compare(stored: Any, now: Any, path: str = "") -> Iterator[Difference]:
    """All differences of two documents."""
    if isinstance(stored, dict) and isinstance(now, dict):
        yield from _compare_groups(stored, now, path)
    elif isinstance(stored, list) and isinstance(now, list):
        yield from _compare_lists(stored, now, path)
    elif isinstance(stored, str) and isinstance(now, str):
        yield from _compare_sentences(stored, now, path)
    elif _is_number(stored) and _is_number(now):
        yield from _compare_number(stored, now, path, abs(stored))
    elif stored != now:
        yield Difference(path, stored, now)


def _compare_groups(stored: dict[str, Any], now: dict[str, Any], path: str) -> Iterator[Difference]:
    for key in [*stored, *(key for key in now if key not in stored)]:
        inner = f"{path} / {key}" if path else key
        if key not in now or key not in stored:
            if key == "terms" and _is_rounding(stored.get(key, now.get(key))):
                continue
            yield Difference(inner, _shorten(stored.get(key, _ABSENT)), _shorten(now.get(key, _ABSENT)))
        elif key == SUMMARISED and isinstance(stored[key], list) and isinstance(now[key], list):
            yield from _compare_summaries(stored[key], now[key], path)
        else:
            yield from compare(stored[key], now[key], inner)


def _is_rounding(terms: Any) -> bool:
    """Whether a law is a constant that stands there only because a processor's kernels round otherwise."""
    return all(set(term) == {"gain"} and abs(term["gain"]) < ROUNDING for term in terms)


def _compare_summaries(stored: list[Any], now: list[Any], path: str) -> Iterator[Difference]:
    scale = abs(stored[SUMMARY.index("rms")] or 0.0)
    for name, one, other in zip(SUMMARY, stored, now, strict=True):
        if one is None or other is None or name in ("count", "missing"):
            if one != other:
                yield Difference(f"{path} / {name}", one, other)
        else:
            yield from _compare_number(one, other, f"{path} / {name}", max(scale, abs(one)))


def _compare_lists(stored: list[Any], now: list[Any], path: str) -> Iterator[Difference]:
    if stored and all(isinstance(one, str) for one in (*stored, *now)):
        yield from _compare_texts(stored, now, path)
    elif len(stored) != len(now):
        yield Difference(f"{path} / length", len(stored), len(now))
    else:
        scale = max((abs(x) for x in stored if _is_number(x) and math.isfinite(x)), default=0.0)
        for k, (one, other) in enumerate(zip(stored, now, strict=True)):
            if isinstance(one, float) and _is_number(other):
                yield from _compare_number(one, other, f"{path} / {k}", scale)
            else:
                yield from compare(one, other, f"{path} / {_name_item(one, k)}")


def _name_item(item: Any, k: int) -> str:
    return f"{k} ({item['name']})" if isinstance(item, dict) and "name" in item else str(k)


def _compare_texts(stored: list[str], now: list[str], path: str) -> Iterator[Difference]:
    """Sentences by their words, in whatever order different ones stand."""
    held, seen = _by_words(stored), _by_words(now)
    for words in [*held, *(words for words in seen if words not in held)]:
        ours, theirs = held.get(words, []), seen.get(words, [])
        for one, other in zip(ours, theirs, strict=False):
            yield from _compare_sentences(one, other, path)
        for one in ours[len(theirs) :]:
            yield Difference(path, one, _ABSENT)
        for other in theirs[len(ours) :]:
            yield Difference(path, _ABSENT, other)


def _by_words(sentences: list[str]) -> dict[str, list[str]]:
    found: dict[str, list[str]] = {}
    for sentence in sentences:
        found.setdefault(mask_numbers(sentence), []).append(sentence)
    return found


def _compare_sentences(stored: str, now: str, path: str) -> Iterator[Difference]:
    """The same words; whole numbers the same; others to one unit of the last digit shown."""
    if stored == now:
        return
    ours, theirs = read_numbers(stored), read_numbers(now)
    same_words = mask_numbers(stored) == mask_numbers(now)
    if not same_words or not all(map(_shown_alike, ours, theirs)):
        yield Difference(path, stored, now)


def _shown_alike(one: str, other: str) -> bool:
    if one == other:
        return True
    if "e" in one or "e" in other:
        return math.isclose(float(one), float(other), rel_tol=1e-3)
    decimals = min(len(text.partition(".")[2]) for text in (one, other))
    return decimals > 0 and abs(float(one) - float(other)) <= 1.01 * 10.0**-decimals


def _compare_number(stored: Any, now: Any, path: str, scale: float) -> Iterator[Difference]:
    if stored == now or (math.isnan(stored) and math.isnan(now)):
        return
    relative, absolute = find_tolerance(path)
    allowed = max(relative * scale, absolute)
    if isinstance(stored, int) and isinstance(now, int) and relative < 1e-3:
        yield Difference(path, stored, now)  # counted, not measured
    elif not abs(stored - now) <= allowed:
        excess = abs(stored - now) / allowed
        yield Difference(path, stored, now, excess if math.isfinite(excess) else math.inf)


def _show(value: Any) -> str:
    return f"{value:.6g}" if isinstance(value, float) else repr(value)


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _shorten(value: Any) -> Any:
    text = repr(value)
    return value if len(text) <= 100 else f"{text[:100]} ..."


def tell_differences(found: list[Difference], most: int = MOST_SHOWN) -> str:
    """The worst differences, to be read."""
    worst = sorted(found, key=lambda difference: -difference.excess)[:most]
    head = f"{len(found)} differences" + (f", the worst {most} of them" if len(found) > most else "")
    return "\n".join([head, *map(str, worst)])
