"""The command that uses a model again: the motion of any recordings, with its uncertainty."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.markup import escape

from scaling_service.capabilities.motion.options import MotionOptions
from scaling_service.capabilities.shared import flags, screen
from scaling_service.core.names import say_name
from scaling_service.core.text import list_few
from scaling_service.report.tables import Row, Table

COMMANDS = ("ik",)


@flags.with_flags
def ik(
    model: Annotated[
        str,
        typer.Argument(
            metavar="MODEL",
            help="A built-in name, an .osim file, or the model.json of scale, dynamics or discover.",
            show_default=False,
        ),
    ],
    recordings: Annotated[
        list[Path],
        typer.Argument(
            metavar="RECORDING…", help="C3D, TRC or STO files.", show_default=False, readable=False
        ),
    ],
    out: flags.Out,
    options: MotionOptions,
    marker_set: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="OpenSim markers to add to an .osim model.", readable=False),
    ] = None,
    standing: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="Sensors' orientations while the person stands as the model does; else the first frame.",
            readable=False,
        ),
    ] = None,
    tables: flags.Tables = "",
) -> None:
    """Use a scaled model again: the motion of any recordings, with its standard deviations.

    Writes under --out for every recording TRIAL_ik.mot and, with the same columns, TRIAL_ik_sd.mot: the
    standard deviation of each coordinate in each frame; and ik.json with the kinematic errors. With --angles
    TRIAL_clinical.csv, too: the angles of the conventional gait model and their standard deviations.
    Rotations of a markerless system (Theia3D's C3D) and of sensors (OpenSense's STO) are followed, too.

    [bold]Example[/bold]: scaling-service ik scaled/MB_am/model.json walk2.c3d walk3.c3d --out followed
    """
    with screen.running(out) as progress:
        from scaling_service.capabilities.motion.run import ik as compute
        from scaling_service.capabilities.motion.saving import save_motions
        from scaling_service.capabilities.shared.tables import make_table_writer

        write_tables = make_table_writer(tables, out)
        tracked = compute(
            model, recordings, options, marker_set=marker_set, standing=standing, progress=progress
        )
        document = save_motions(tracked, out)
        write_tables(tracked.tables, document)
    # The table of trials, the warnings, and what was written
    console = screen.make_console()
    console.print(f"Model [bold]{escape(document.model)}[/bold]", highlight=False, soft_wrap=True)
    for line in screen.describe_understood(document):
        console.print(escape(line), highlight=False, style="dim", soft_wrap=True)
    rows = []
    for name, trial in document.trials.items():
        error = trial.kinematic_error_mm
        names = [*map(say_name, trial.not_determined)]
        names += [f"{say_name(name)} at times" for name in trial.frames_not_determined]
        lost = list_few(names)
        numbers = ["–" if v is None else f"{v:.1f}" for v in (error.mean, error.rms, error.max)]
        rows.append(Row(name, [str(trial.frames), *numbers, lost or "nothing"]))
    columns = ["Kinematic error, mm", "frames", "mean", "rms", "max", "not determined"]
    screen.print_table(console, Table(caption="", columns=columns, rows=rows))
    turned = {name: t.rotation_error_deg for name, t in document.trials.items() if t.rotation_error_deg}
    if turned:
        labels = list(dict.fromkeys(label for errors in turned.values() for label in errors))
        rows = [Row(x, [f"{e[x]:.1f}" if x in e else "–" for e in turned.values()]) for x in labels]
        screen.print_table(
            console, Table(caption="", columns=["Rotation error, deg, RMS", *turned], rows=rows)
        )
    screen.say(console, "Note", "yellow", document.warnings)
    screen.list_files(console, out, [", ".join([*document.files, "ik.json"])])
