"""Snapshots as text: JSON of six significant digits, a line for each innermost group, repeats told once."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

FOLDER = Path(__file__).parent / "snapshots"
_LINE = 108
_SAME = "same as"
_SHORTEST = 200
"""Characters of a group that is not written again where it has been written before."""


def load_snapshot(name: str) -> Any:
    """What is held of a case; None where nothing is yet."""
    file = snapshot_file(name)
    return restore_repeats(json.loads(file.read_text(encoding="utf-8")), "", {}) if file.exists() else None


def save_snapshot(name: str, document: Any) -> None:
    """Hold a document from now on."""
    FOLDER.mkdir(exist_ok=True)
    shared = share_repeats(round_numbers(document), "", {})
    snapshot_file(name).write_text(write_compactly(shared) + "\n", encoding="utf-8")


def snapshot_file(name: str) -> Path:
    return FOLDER / f"{name}.json"


def round_numbers(value: Any) -> Any:
    """Numbers to six significant digits."""
    if isinstance(value, dict):
        return {key: round_numbers(one) for key, one in value.items()}
    if isinstance(value, list):
        return [round_numbers(one) for one in value]
    return float(f"{value:.6g}") if isinstance(value, float) else value


def share_repeats(value: Any, path: str, seen: dict[str, str]) -> Any:
    """A document in which long groups that were there before are told by where."""
    if not isinstance(value, dict | list):
        return value
    text = json.dumps(value)
    if len(text) >= _SHORTEST and seen.setdefault(text, path) != path:
        return {_SAME: seen[text]}
    if isinstance(value, list):
        return [share_repeats(one, f"{path} / {k}", seen) for k, one in enumerate(value)]
    return {key: share_repeats(one, f"{path} / {key}", seen) for key, one in value.items()}


def restore_repeats(value: Any, path: str, seen: dict[str, Any]) -> Any:
    """The whole document again."""
    if not isinstance(value, dict | list):
        return value
    if isinstance(value, list):
        found: Any = [restore_repeats(one, f"{path} / {k}", seen) for k, one in enumerate(value)]
    elif value.keys() == {_SAME}:
        return seen[value[_SAME]]
    else:
        found = {key: restore_repeats(one, f"{path} / {key}", seen) for key, one in value.items()}
    seen[path] = found
    return found


def write_compactly(value: Any, depth: int = 0) -> str:
    """JSON with a line for each group that fits in one."""
    line = json.dumps(value, ensure_ascii=False)
    if not isinstance(value, dict | list) or not value or len(line) + depth <= _LINE:
        return line
    inside = "\n" + " " * (depth + 1)
    if isinstance(value, list):
        parts = [write_compactly(one, depth + 1) for one in value]
        return f"[{inside}{f',{inside}'.join(parts)}\n{' ' * depth}]"
    parts = [f"{json.dumps(key)}: {write_compactly(one, depth + 1)}" for key, one in value.items()]
    return f"{{{inside}{f',{inside}'.join(parts)}\n{' ' * depth}}}"
