"""Snapshots as text: JSON of six significant digits, a line for each innermost group, repeats told once."""

from __future__ import annotations

import gzip
import json
from pathlib import Path
from typing import Any

from tests.safety.cases import BY_NAME

FOLDER = Path(__file__).parent / "snapshots"
_LINE = 108
_SAME = "same as"
_SHORTEST = 200
"""Characters of a group that is not written again where it has been written before."""


def load_snapshot(name: str) -> Any:
    """What is held of a case; None where nothing is yet."""
    file = snapshot_file(name)
    if not file.exists():
        return None
    content = file.read_bytes()
    text = gzip.decompress(content) if file.suffix == ".gz" else content
    return restore_repeats(json.loads(text), "", {})


def save_snapshot(name: str, document: Any) -> None:
    """Hold a document from now on."""
    FOLDER.mkdir(exist_ok=True)
    text = write_compactly(share_repeats(round_numbers(document), "", {})) + "\n"
    file, content = snapshot_file(name), text.encode()
    file.write_bytes(gzip.compress(content, mtime=0) if file.suffix == ".gz" else content)


def snapshot_file(name: str) -> Path:
    """Plain text, to be read in a change; packed where it is of a costly case, for these are large."""
    costly = name in BY_NAME and BY_NAME[name].costly
    return FOLDER / (f"{name}.json.gz" if costly else f"{name}.json")


def list_snapshots() -> set[str]:
    """The names of all that are held."""
    return {file.name.partition(".")[0] for file in FOLDER.iterdir()}


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
