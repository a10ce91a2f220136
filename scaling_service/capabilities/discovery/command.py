"""The command that looks for what a model does not have."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from scaling_service.capabilities.discovery.options import AS_MEASURED, DiscoverSettings
from scaling_service.capabilities.shared import flags, screen
from scaling_service.capabilities.shared.settings import Settings

if TYPE_CHECKING:
    from scaling_service.capabilities.discovery.result import DiscoveryDocument


@flags.with_flags
def discover(
    subject: flags.SubjectFile,
    out: flags.Out,
    chosen: DiscoverSettings,
    settings: Annotated[Settings, flags.Only("up", "forward", "seed")] = AS_MEASURED,
    tables: flags.Tables = "",
    report: flags.Report = True,
    everything: Annotated[
        bool, typer.Option("--all", help="Show the tables of all effects and gaps, too, not the story alone.")
    ] = False,
) -> None:
    """Find where model and recordings disagree, name the missing effect, add it, and show the gap shrink.

    People are the yardstick: skin that slides, markers put a centimetre beside a landmark, joints and masses
    that differ from any model's are ordinary, and no finding. What stands out of that is named. Recordings
    are taken as they were measured, neither smoothed nor filled; the evaluation trials of the subject file
    are held out: nothing is named that makes them worse. The static trial is a witness. Forces are compared,
    too, where recordings have them and the model has feet.

    Looked for, at every place where it could sit: markers that sit elsewhere or were exchanged, skin that
    slides or oscillates, wrong sizes, joint centres and axes, joints that glide, turn or are locked, a scaled
    volume; late forces, plates that are shifted, turned or wrong, wrong masses, carried loads, contacts that
    no plate measured, a vertical that leans.

    The model is scaled from distances between markers, which takes up least of what is looked for, unless
    --start names another method; with --start none it is taken as it is.

    The verdict is [bold]found[/bold] (at least one effect has a name), [bold]nothing[/bold] (all is ordinary)
    or [bold]unexplained[/bold] (something is not, and nothing known explains it). An effect
    that these recordings do not tell from others is listed with them, and which movement would separate them.

    Writes under --out discovery.json, report.html, model.json and model.osim with what was found, and
    corrected/ with the recordings where the fault was theirs.

    A folder of subject files, or a CSV file with a column `subject`, is searched person by person, and then
    for what recurs: effects of the generic model that persons share, with how many of them show it, in
    recurring.json, what that does to each one's recordings that did not fit, and the model without them in
    generic_model.json and .osim.

    [bold]Examples[/bold]: scaling-service discover S01.yaml --out found

    scaling-service discover scaled_model.yaml --start none --out found

    scaling-service demo --discover --out hidden
    """
    if subject.is_dir() or subject.suffix.lower() == ".csv":
        _discover_recurring(subject, out, chosen, settings, report=report, tables=tables)
        return
    with screen.running(out) as progress:
        from scaling_service.capabilities.discovery.run import discover as compute
        from scaling_service.capabilities.discovery.saving import save_discovery
        from scaling_service.capabilities.shared.tables import make_table_writer

        write_tables = make_table_writer(tables, out)
        results = compute(subject, chosen, settings, progress=progress)
        document = save_discovery(results, out, report=report, progress=progress)
        write_tables(results.tables, document)
    show(document, out, everything=everything)


def _discover_recurring(
    cohort: Path, out: Path, chosen: DiscoverSettings, settings: Settings, *, report: bool, tables: str
) -> None:
    with screen.running(out) as progress:
        from scaling_service.capabilities.discovery.recurring import FILE_NAME, discover_recurring, summarise
        from scaling_service.capabilities.shared.tables import make_table_writer
        from scaling_service.documents.writing import REPORT

        write_tables = make_table_writer(tables, out)
        found = discover_recurring(cohort, out, chosen, settings, report=report, progress=progress)
        write_tables({"recurring": found.effects}, found.document)
    console, document = screen.make_console(), found.document
    summary = summarise(document)
    screen.say(console, "Verdict", "bold", [f"{document.headline}."])
    for k, line in enumerate(summary.why, 1):
        console.print(f"{k}. {line}", markup=False, highlight=False, soft_wrap=True)
    for table in summary.tables:
        screen.print_table(console, table)
    screen.say(console, "Note", "yellow", summary.cautions)
    files = [FILE_NAME, *([REPORT] if report else []), *document.corrected]
    screen.list_files(console, out, [f"{', '.join(files)}, and a folder for each person"])


def find_hidden(out: Path, seed: int, *, report: bool) -> None:
    """Search for what is hidden in a virtual person; the answer comes after the verdict."""
    with screen.running(out) as progress:
        from scaling_service.capabilities.discovery.run import run_hidden_demo
        from scaling_service.capabilities.discovery.saving import save_discovery

        found = run_hidden_demo(seed, progress=progress)
        document = save_discovery(found, out, report=report, progress=progress)
    show(document, out)


def show(document: DiscoveryDocument, out: Path, *, everything: bool = False) -> None:
    """The verdict in a sentence and its first effects; ``everything``: all of them, the gap, what is left."""
    from scaling_service.capabilities.discovery import words
    from scaling_service.capabilities.discovery.result import FILE_NAME

    console, summary = screen.make_console(), words.summarise(document)
    screen.print_subject(console, document, words.describe_model(document))
    screen.say(console, "Verdict", "bold", [f"{document.headline}."])
    told = words.list_told(document.effects)
    for k, effect in enumerate(told, 1):
        console.print(f"{k}. {effect.name}.", markup=False, highlight=False, soft_wrap=True)
        if share := words.describe_share(effect):
            bar = screen.draw_bar(effect.evidence.gain_held_out or 0.0)
            console.print(f"   {bar} {share}", markup=False, highlight=False, soft_wrap=True)
        console.print(f"   {effect.advice}", markup=False, highlight=False, soft_wrap=True)
    if (more := len(document.effects) - len(told)) > 0 and not everything:
        rest = f"And {more} more" if told else f"{more} named, which take next to nothing off the gap,"
        screen.say(console, rest, "bold", ["in discovery.json and report.html; --all lists them here"])
    if everything:
        for table in summary.tables:
            screen.print_table(console, table)
        screen.say(console, "Class", "cyan", words.describe_alike(document.effects))
        screen.say(console, "Bones", "cyan", document.bones.sentences if document.bones else ())
    screen.say(console, "Left", "yellow", words.describe_left(document))
    screen.say(console, "Doubt", "yellow", words.list_cautions(document.effects))
    screen.say(console, "Note", "yellow", document.notes)
    screen.list_files(console, out, [", ".join([*document.files, FILE_NAME])])
    screen.say(console, "Had been hidden", "bold", words.describe_hidden(document))


COMMANDS = (discover,)
