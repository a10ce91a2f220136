"""Snapshots as text: JSON of six significant digits, a line for each innermost group."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

FOLDER = Path(__file__).parent / "snapshots"
_LINE = 108


def load_snapshot(name: str) -> Any:
    """What is held of a case; None where nothing is yet."""
    file = snapshot_file(name)
    return json.loads(file.read_text(encoding="utf-8")) if file.exists() else None


def save_snapshot(name: str, document: Any) -> None:
    """Hold a document from now on."""
    FOLDER.mkdir(exist_ok=True)
    snapshot_file(name).write_text(write_compactly(round_numbers(document)) + "\n", encoding="utf-8")


def snapshot_file(name: str) -> Path:
    return FOLDER / f"{name}.json"


def round_numbers(value: Any) -> Any:
    """Numbers to six significant digits."""
    if isinstance(value, dict):
        return {key: round_numbers(one) for key, one in value.items()}
    if isinstance(value, list):
        return [round_numbers(one) for one in value]
    return float(f"{value:.6g}") if isinstance(value, float) else value


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
