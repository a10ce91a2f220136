"""The commands that scale: scale, compare."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from scaling_service.capabilities.scaling.options import ComparisonOptions, ScaleOptions
from scaling_service.capabilities.shared import flags, screen
from scaling_service.capabilities.shared.names import list_method_names
from scaling_service.capabilities.shared.settings import Settings

COMMANDS = ("scale", "compare")

if TYPE_CHECKING:
    from scaling_service.documents.results import ComparisonDocument


@flags.with_flags
def scale(
    subject: flags.SubjectFile,
    out: flags.Out,
    settings: Settings,
    options: ScaleOptions,
    method: Annotated[
        str, typer.Option(metavar="|".join(list_method_names()), help="How to scale.")
    ] = "MB_am",
    tables: flags.Tables = "",
) -> None:
    """Scale a subject's model by one method.

    Writes under --out: METHOD/model.osim (for OpenSim), model.json, TRIAL_ik.mot for every movement, and
    scaling.json with errors, lengths, axes and the uncertainty of every fitted number.

    [bold]Example[/bold]: scaling-service scale S01.yaml --method MB_am --out results
    """
    chosen = ComparisonOptions(**options.model_dump())
    _compare(subject, out, (method,), settings, chosen, comparison=False, tables=tables)


@flags.with_flags
def compare(
    subject: flags.SubjectFile,
    out: flags.Out,
    settings: Settings,
    options: ComparisonOptions,
    methods: Annotated[
        str | None,
        typer.Option(
            metavar="M,M,…", help=f"Of {', '.join(list_method_names())}; all that can be done unless given."
        ),
    ] = None,
    tables: flags.Tables = "",
    report: flags.Report = True,
) -> None:
    """Scale a subject's model by several methods and compare them.

    Writes under --out what `scale` writes for each method, comparison.json, and report.html: which method to
    use for this person, why, and how far to trust it.

    [bold]Examples[/bold]: scaling-service compare S01.yaml --out results

    scaling-service compare S01.yaml --methods MB,MB_am --up +z --out results
    """
    chosen = None if methods is None else tuple(flags.read_names(methods))
    _compare(subject, out, chosen, settings, options, comparison=True, report=report, tables=tables)


def _compare(
    subject: Path,
    out: Path,
    methods: tuple[str, ...] | None,
    settings: Settings,
    options: ComparisonOptions,
    *,
    comparison: bool,
    report: bool = False,
    tables: str,
) -> None:
    with screen.running(out) as progress:
        from scaling_service.capabilities.scaling.run import compare
        from scaling_service.capabilities.scaling.saving import save
        from scaling_service.capabilities.shared.tables import make_table_writer

        write_tables = make_table_writer(tables, out)
        results = compare(subject, methods, settings, options, progress=progress)
        document = save(results, out, comparison=comparison, report=report, progress=progress)
        write_tables(results.tables, document)
    show(document, out)


def show(document: ComparisonDocument, out: Path) -> None:
    """Tables, warnings, verdict, and what was written, one line for each folder."""
    from scaling_service.capabilities.scaling.words import make_comparison_tables

    console = screen.make_console()
    screen.print_subject(console, document)
    if document.verdict is not None and (out / "comparison.json").is_file():
        screen.say(console, "Verdict", "bold", [document.verdict.headline])
    screen.print_tables(console, make_comparison_tables(document))
    if document.muscles is not None:
        screen.say(console, "Muscles", "bold", document.muscles.summary)
        screen.say(console, "Note", "yellow", document.muscles.notes)
    screen.say(console, "Note", "yellow", document.all_warnings)
    files = [f"{m.method}/  {', '.join([*m.files, 'scaling.json'])}" for m in document.methods.values()]
    files += [name for name in ("comparison.json", "report.html") if (out / name).is_file()]
    screen.list_files(console, out, files)
