"""The command that finds the motion, geometry and inertia which markers and ground forces agree on."""

from __future__ import annotations

from typing import Annotated

from scaling_service.capabilities.dynamics.settings import ForceSettings
from scaling_service.capabilities.shared import flags, screen
from scaling_service.capabilities.shared import settings as shared_settings

COMMANDS = ("consistent",)


@flags.with_flags
def consistent(
    subject: flags.SubjectFile,
    out: flags.Out,
    chosen: ForceSettings,
    settings: Annotated[shared_settings.Settings, flags.Only("up", "forward")] = shared_settings.UNSMOOTHED,
    tables: flags.Tables = "",
    report: flags.Report = True,
) -> None:
    """Find the motion, geometry and inertia that markers and ground forces agree on.

    Calibration trials with both feet on plates are fitted, evaluation trials with forces are held out. Writes
    under --out TRIAL_ik.mot, model.json and model.osim, consistent.json and report.html.

    [bold]Example[/bold]: scaling-service consistent S01.yaml --out consistent
    """
    with screen.running(out) as progress:
        from scaling_service.capabilities.consistent.run import consistent as compute
        from scaling_service.capabilities.consistent.saving import save_consistent, tabulate_consistent
        from scaling_service.capabilities.shared.tables import make_table_writer

        write_tables = make_table_writer(tables, out)
        results = compute(subject, chosen, settings, progress=progress)
        document = save_consistent(results, out, report=report)
        write_tables(tabulate_consistent(results, document), document)
    # The errors of the three ways, the warnings, and what was written
    from scaling_service.capabilities.consistent.words import describe_start, tabulate_errors

    console = screen.make_console()
    screen.print_subject(console, document, f"{describe_start(document)}, {document.outer_iterations} loops")
    screen.print_table(console, tabulate_errors(document))
    screen.say(console, "Gain", "bold", [f"{document.headline}."])
    screen.say(console, "Note", "yellow", document.warnings)
    written = [*document.files, *(n for n in ("consistent.json", "report.html") if (out / n).is_file())]
    screen.list_files(console, out, [", ".join(written)])
