"""The command that checks the dynamics of a model: residual wrenches and what they say."""

from __future__ import annotations

from typing import Annotated

from scaling_service.capabilities.dynamics.settings import DynamicsSettings
from scaling_service.capabilities.shared import flags, screen
from scaling_service.capabilities.shared import settings as shared_settings

COMMANDS = ("dynamics",)

_SHOWN = 10  # numbers of identified inertia on the screen (chosen); all are in dynamics.json


@flags.with_flags
def dynamics(
    subject: flags.SubjectFile,
    out: flags.Out,
    chosen: DynamicsSettings,
    settings: Annotated[
        shared_settings.Settings, flags.Only("up", "forward", "seed")
    ] = shared_settings.UNSMOOTHED,
    tables: flags.Tables = "",
    report: flags.Report = True,
) -> None:
    """Check a model against the ground's forces: joint loads, residuals, their uncertainty.

    Forces come from the plates of C3D files or from the files under `forces:`. Writes under --out
    TRIAL_id.sto for every recording with forces, dynamics.json and report.html.

    [bold]Example[/bold]: scaling-service dynamics S01.yaml --out checked
    """
    with screen.running(out) as progress:
        from scaling_service.capabilities.dynamics.run import dynamics as compute
        from scaling_service.capabilities.dynamics.saving import save_dynamics, tabulate_loads
        from scaling_service.capabilities.shared.tables import make_table_writer

        write_tables = make_table_writer(tables, out)
        results = compute(subject, chosen, settings, progress=progress)
        document = save_dynamics(results, out, report=report)
        write_tables({**results.tables, **tabulate_loads(results)}, document)
    # The table of recordings, the verdict, the warnings, and what was written
    from scaling_service.capabilities.dynamics import words

    console, inertial = screen.make_console(), document.inertial
    screen.print_subject(console, document, words.describe_model(document))
    screen.print_tables(console, words.make_residual_tables(document.trials))
    if inertial is not None and inertial.combinations:
        for table in words.make_inertial_tables(inertial, most=_SHOWN):
            screen.print_table(console, table)
    screen.say(console, "Note", "yellow", words.list_cautions(document))
    screen.say(console, "Verdict", "bold", [document.verdict])
    further = [name for name in ("dynamics.json", "report.html") if (out / name).is_file()]
    screen.list_files(console, out, [", ".join([*document.files, *further])])
