"""The command that checks the dynamics of a model: residual wrenches and what they say."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from scaling_service.capabilities.dynamics.settings import DynamicsSettings
from scaling_service.capabilities.shared.flags import Only, Out, Report, SubjectFile, with_flags
from scaling_service.capabilities.shared.names import AS_IT_IS, OWN
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
    report: Report = True,
) -> None:
    """Check a model against the ground's forces: joint loads, residuals, their uncertainty.

    Forces come from the plates of C3D files or from the files under `forces:`. Writes under --out
    TRIAL_id.sto for every recording with forces, dynamics.json and report.html.

    [bold]Example[/bold]: scaling-service dynamics S01.yaml --out checked
    """
    with running(out) as progress:
        from scaling_service.capabilities.dynamics.run import dynamics as compute
        from scaling_service.capabilities.dynamics.saving import save_dynamics

        results = compute(subject, chosen, settings, progress=progress)
        document = save_dynamics(results, out, report=report)
    show(document, out)


def show(document: DynamicsDocument, out: Path) -> None:
    """The table of recordings, the verdict, the warnings, and what was written."""
    from scaling_service.capabilities.dynamics.document import merge_warnings
    from scaling_service.capabilities.dynamics.report import make_inertial_tables, make_residual_tables

    console, inertial = make_console(), document.inertial
    how = "as given" if document.start == AS_IT_IS else f"scaled by {document.start}"
    own = "its own inertia" if document.inertia == OWN else f"inertia of {document.inertia}"
    print_subject(console, document, f"model {how}, {own}, {document.mass_kg:.1f} kg")
    print_tables(console, make_residual_tables(document.trials))
    if inertial is not None and inertial.combinations:
        for table in make_inertial_tables(inertial, most=_SHOWN):
            print_table(console, table)
    warnings = (
        *document.warnings,
        *merge_warnings(document),
        *(inertial.warnings if inertial is not None else ()),
    )
    say(console, "Note", "yellow", dict.fromkeys(warnings))
    say(console, "Verdict", "bold", [document.verdict])
    further = [name for name in ("dynamics.json", "report.html") if (out / name).is_file()]
    list_files(console, out, [", ".join([*document.files, *further])])


COMMANDS = (dynamics,)
