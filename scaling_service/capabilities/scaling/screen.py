"""What people see of a comparison: the tables of methods, the warnings, the verdict, and the files."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from scaling_service.capabilities.shared.screen import (
    console_of_results,
    introduce,
    list_files,
    print_tables,
    say,
)

if TYPE_CHECKING:
    from scaling_service.documents.results import ComparisonDocument


def show(document: ComparisonDocument, out: Path) -> None:
    """Tables, warnings, verdict, and what was written, one line for each folder."""
    from scaling_service.capabilities.scaling.report.tables import comparison_tables

    console = console_of_results()
    introduce(console, document)
    print_tables(console, comparison_tables(document))
    say(console, "Note", "yellow", document.all_warnings)
    if document.verdict is not None and (out / "comparison.json").is_file():
        say(console, "Verdict", "bold", [document.verdict.headline])
    files = [f"{m.method}/  {', '.join([*m.files, 'scaling.json'])}" for m in document.methods.values()]
    files += [name for name in ("comparison.json", "report.html") if (out / name).is_file()]
    list_files(console, out, files)
