"""The command that checks the dynamics of a model: residual wrenches and what they say."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from scaling_service.capabilities.dynamics.settings import DynamicsSettings
from scaling_service.capabilities.shared.flags import Only, Out, Report, SubjectFile, Tables, with_flags
from scaling_service.capabilities.shared.screen import (
    list_files,
    make_console,
    print_subject,
    print_table,
    print_tables,
    running,
    say,
)
from scaling_service.capabilities.shared.settings import UNSMOOTHED, Settings

if TYPE_CHECKING:
    from scaling_service.capabilities.dynamics.document import DynamicsDocument

_SHOWN = 10  # numbers of identified inertia on the screen (chosen); all are in dynamics.json


@with_flags
def dynamics(
    subject: SubjectFile,
    out: Out,
    chosen: DynamicsSettings,
    settings: Annotated[Settings, Only("up", "forward", "seed")] = UNSMOOTHED,
    tables: Tables = "",
    report: Report = True,
) -> None:
    """Check a model against the ground's forces: joint loads, residuals, their uncertainty.

    Forces come from the plates of C3D files or from the files under `forces:`. Writes under --out
    TRIAL_id.sto for every recording with forces, dynamics.json and report.html.

    [bold]Example[/bold]: scaling-service dynamics S01.yaml --out checked
    """
    with running(out) as progress:
        from scaling_service.capabilities.dynamics.run import dynamics as compute
        from scaling_service.capabilities.dynamics.saving import save_dynamics, tabulate_loads
        from scaling_service.capabilities.shared.tables import make_table_writer

        write_tables = make_table_writer(tables, out)
        results = compute(subject, chosen, settings, progress=progress)
        document = save_dynamics(results, out, report=report)
        write_tables({**results.tables, **tabulate_loads(results)}, document)
    show(document, out)


def show(document: DynamicsDocument, out: Path) -> None:
    """The table of recordings, the verdict, the warnings, and what was written."""
    from scaling_service.capabilities.dynamics import words

    console, inertial = make_console(), document.inertial
    print_subject(console, document, words.describe_model(document))
    print_tables(console, words.make_residual_tables(document.trials))
    if inertial is not None and inertial.combinations:
        for table in words.make_inertial_tables(inertial, most=_SHOWN):
            print_table(console, table)
    say(console, "Note", "yellow", words.list_cautions(document))
    say(console, "Verdict", "bold", [document.verdict])
    further = [name for name in ("dynamics.json", "report.html") if (out / name).is_file()]
    list_files(console, out, [", ".join([*document.files, *further])])


COMMANDS = (dynamics,)
