"""Blocks that say where results come from: warnings, repairs, labels, settings, input files."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from scaling_service.core.text import list_few
from scaling_service.documents.results import Provenance, RepairNote
from scaling_service.report.blocks import Block, Bullets, Details, Row, Table, Text


def build_origin_blocks(document: Provenance, warnings: Sequence[str]) -> Iterator[Block]:
    """Warnings, repairs, labels, settings and input files."""
    yield from build_warning_blocks(warnings)
    yield from repair_blocks(document)
    yield from build_input_blocks(document)


def build_warning_blocks(warnings: Sequence[str]) -> Iterator[Block]:
    """All warnings, or that there were none."""
    if warnings:
        yield Text("Warnings:")
        yield Bullets(warnings)
    else:
        yield Text("There were no warnings.")


def build_input_blocks(document: Provenance) -> Iterator[Block]:
    """Labels that were taken, settings as resolved, and the input files, each hidden until asked for."""
    used = document.markers_used
    if used:
        named = [Row(marker, [", ".join(labels)]) for marker, labels in used.items()]
        yield Details(
            "Labels taken for the model's markers",
            [Table(caption="Markers", columns=["marker", "label in the files"], rows=named, words=True)],
        )
    yield Details("Settings", [_tabulate_settings(document)])
    if document.input_hashes:
        hashes = [Row(name, [sha]) for name, sha in document.input_hashes.items()]
        yield Details(
            "Input files",
            [Table(caption="SHA-256 of each file", columns=["file", "SHA-256"], rows=hashes, words=True)],
        )


def repair_blocks(document: Provenance) -> Iterator[Block]:
    """What was done, the same in several places said once."""
    found: dict[tuple[str, str], list[tuple[str, RepairNote]]] = {}
    for trial, repairs in document.repairs.items():
        for repair in repairs:
            found.setdefault((repair.what, repair.detail), []).append((trial, repair))
    if not found:
        yield Text("Nothing was repaired.")
        return
    rows = [
        Row(what.replace("_", " "), [detail, list_few(_list_places(places)), _describe_frames(places)])
        for (what, detail), places in found.items()
    ]
    yield Details(
        f"What was repaired or decided while reading ({sum(map(len, found.values()))})",
        [
            Table(
                caption="Repairs and decisions",
                columns=["what", "detail", "where", "frames"],
                rows=rows,
                words=True,
            )
        ],
    )


def _list_places(places: Sequence[tuple[str, RepairNote]]) -> list[str]:
    named = (r.where and not r.where.startswith(trial) for trial, r in places)
    said = [f"{t} {r.where}" if own else t for own, (t, r) in zip(named, places, strict=True)]
    return list(dict.fromkeys(said))


def _describe_frames(places: Sequence[tuple[str, RepairNote]]) -> str:
    total = sum(repair.frames for _, repair in places)
    return str(total) if total else ""


def _tabulate_settings(document: Provenance) -> Table:
    rows = [Row(name, [value]) for name, value in _flatten(document.settings)]
    return Table(
        caption="Settings as resolved",
        columns=["setting", "value"],
        rows=[*rows, Row("seed", [str(document.seed)]), Row("version", [document.code_version])],
        words=True,
    )


def _flatten(settings: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, str]]:
    for name, value in settings.items():
        if isinstance(value, dict):
            yield from _flatten(value, f"{prefix}{name}.")
        else:
            yield f"{prefix}{name}", json.dumps(value, ensure_ascii=False)
