"""The command that checks the dynamics of a model: residual wrenches and what they say."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from rich.table import Table

from scaling_service.capabilities.dynamics.settings import UNSMOOTHED, DynamicsSettings
from scaling_service.capabilities.shared.arguments import Out, Report, SubjectFile
from scaling_service.capabilities.shared.flags import Only, with_flags
from scaling_service.capabilities.shared.names import AS_IT_IS, OWN
from scaling_service.capabilities.shared.screen import (
    console_of_results,
    introduce,
    list_files,
    running,
    say,
)
from scaling_service.capabilities.shared.settings import Settings

if TYPE_CHECKING:
    from scaling_service.capabilities.dynamics.document import DynamicsDocument, TrialDynamicsDocument

_SHOWN = 10  # numbers of identified inertia on the screen (chosen); all are in dynamics.json
_FORCES, _MOMENTS = ("fx", "fy", "fz"), ("mx", "my", "mz")


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
    console = console_of_results()
    how = "as given" if document.start == AS_IT_IS else f"scaled by {document.start}"
    own = "its own inertia" if document.inertia == OWN else f"inertia of {document.inertia}"
    introduce(console, document, f"model {how}, {own}, {document.mass_kg:.1f} kg")
    console.print(_table(document))
    if document.inertial is not None and document.inertial.combinations:
        console.print(_inertial_table(document))
    say(console, "Note", "yellow", _warnings(document))
    say(console, "Verdict", "bold", [document.verdict])
    further = [name for name in ("dynamics.json", "report.html") if (out / name).is_file()]
    list_files(console, out, [", ".join([*document.files, *further])])


def _warnings(document: DynamicsDocument) -> list[str]:
    from scaling_service.capabilities.dynamics.report import told

    inertial = document.inertial.warnings if document.inertial is not None else []
    return list(dict.fromkeys((*document.warnings, *told(document), *inertial)))


def _table(document: DynamicsDocument) -> Table:
    table = Table(box=None, pad_edge=False, header_style="bold")
    table.add_column("")
    for name, trial in document.trials.items():
        table.add_column(f"{name}\n({trial.role})", justify="right")
    for title, rows in (
        ("Frames", _frames),
        ("Residual, RMS", _residuals),
        ("Residual and its uncertainty, % of weight, of weight x height", _indicator),
        ("Limits of Hicks et al. 2015 and OpenSim", _gates),
    ):
        table.add_row(f"[bold]{title}[/bold]", *("" for _ in document.trials))
        for cells in zip(*(list(rows(trial)) for trial in document.trials.values()), strict=True):
            table.add_row(f"  {cells[0][0]}", *(value for _, value in cells))
    return table


def _frames(trial: TrialDynamicsDocument) -> Iterator[tuple[str, str]]:
    yield "that count", str(trial.frames)
    yield "left out", str(trial.left_out)


def _residuals(trial: TrialDynamicsDocument) -> Iterator[tuple[str, str]]:
    values = trial.residual_rms
    for name, unit in (*((n, "N") for n in _FORCES), *((n, "Nm") for n in _MOMENTS)):
        yield f"{name}, {unit.replace('Nm', 'N m')}", f"{getattr(values, f'{name}_{unit}'):.1f}"


def _indicator(trial: TrialDynamicsDocument) -> Iterator[tuple[str, str]]:
    for name, value, total in zip((*_FORCES, *_MOMENTS), trial.dr, trial.uncertainty.total, strict=True):
        yield name, f"{100 * value:.1f} ({100 * total:.1f})"
    yield "marker error, mm", f"{trial.reconstruction_error_mm:.1f}"


def _gates(trial: TrialDynamicsDocument) -> Iterator[tuple[str, str]]:
    for gate in trial.gates:
        mark = "kept" if gate.passed else "broken"
        yield f"{gate.name}, {gate.unit} ({gate.source})", f"{gate.value:.0f} of {gate.limit:.0f}, {mark}"


def _inertial_table(document: DynamicsDocument) -> Table:
    """What moved most."""
    assert document.inertial is not None  # asked before
    table = Table(box=None, pad_edge=False, header_style="bold")
    for column in ("Inertia identified", "before", "after", "sd", "moved, prior sd"):
        table.add_column(column, justify="left" if column.startswith("I") else "right")
    moved = sorted(document.inertial.parameters, key=lambda p: -abs(p.moved))[:_SHOWN]
    for p in moved:
        numbers = (f"{p.before:.4g}", f"{p.after:.4g}", f"{p.sd:.2g}", f"{p.moved:+.1f}")
        table.add_row(f"  {p.segment} {p.quantity}, {p.unit}", *numbers)
    for name, fit in document.inertial.trials.items():
        kind = "held out" if fit.held_out else "used to fit"
        for component in fit.before.model_dump():
            before, after = getattr(fit.before, component), getattr(fit.after, component)
            table.add_row(f"  {name} ({kind}) residual {component}", f"{before:.1f}", f"{after:.1f}")
    return table


COMMANDS = (dynamics,)
