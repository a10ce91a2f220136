"""The command that uses a model again: the motion of any recordings, with its uncertainty."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.markup import escape
from rich.table import Table

from scaling_service.capabilities.motion.options import MotionOptions
from scaling_service.capabilities.motion.recordings import ik as compute
from scaling_service.capabilities.motion.result import MotionDocument
from scaling_service.capabilities.motion.saving import FILE_NAME, save_motions
from scaling_service.capabilities.shared import options
from scaling_service.capabilities.shared.screen import console_of_results, progress_bar, say, understood
from scaling_service.core.errors import InputError
from scaling_service.core.text import few
from scaling_service.documents.writing import check_folder


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
        typer.Argument(metavar="RECORDING…", help="C3D or TRC files.", show_default=False, readable=False),
    ],
    out: options.Out,
    poses: Annotated[
        bool,
        typer.Option("--poses", help=str(MotionOptions.model_fields["poses"].description)),
    ] = False,
    marker: Annotated[
        list[str] | None,
        typer.Option(
            metavar="MARKER=LABEL",
            help="A model marker and its label, where known aliases differ; may be given again.",
        ),
    ] = None,
    marker_set: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="OpenSim markers to add to an .osim model.", readable=False),
    ] = None,
    up: options.Up = None,
    forward: options.Forward = None,
    smooth_hz: options.SmoothHz = None,
) -> None:
    """Use a scaled model again: the motion of any recordings, with its standard deviations.

    Writes under --out for every recording TRIAL_ik.mot and, with the same columns, TRIAL_ik_sd.mot: the
    standard deviation of each coordinate in each frame; and ik.json with the kinematic errors.

    [bold]Example[/bold]: scaling-service ik scaled/MB_am/model.json walk2.c3d walk3.c3d --out followed
    """
    check_folder(out)
    chosen = MotionOptions(
        markers=_pairs(marker or []), up=up, forward=forward, smooth_hz=smooth_hz, poses=poses
    )
    with progress_bar() as progress:
        tracked = compute(model, recordings, chosen, marker_set=marker_set, progress=progress)
        document = save_motions(tracked, out)
    show(document, out)


def _pairs(given: list[str]) -> dict[str, str]:
    """``MARKER=LABEL`` texts as a mapping."""
    pairs: dict[str, str] = {}
    for text in given:
        name, sign, label = (part.strip() for part in text.partition("="))
        if not (name and sign and label) or name in pairs:
            problem = f"'{name}' is mapped twice" if name in pairs else f"'{text}' is not MARKER=LABEL"
            raise InputError(problem, field="--marker", remedy="Give it like --marker RLFE=RKNE")
        pairs[name] = label
    return pairs


def show(document: MotionDocument, out: Path) -> None:
    """The table of trials, the warnings, and what was written."""
    console = console_of_results()
    console.print(f"Model [bold]{escape(document.model)}[/bold]", highlight=False, soft_wrap=True)
    for line in understood(document):
        console.print(escape(line), highlight=False, style="dim", soft_wrap=True)
    table = Table(box=None, pad_edge=False, header_style="bold")
    for column in ("Kinematic error, mm", "frames", "mean", "rms", "max", "not determined"):
        table.add_column(column, justify="left" if column[0] in "Kn" else "right")
    for name, trial in document.trials.items():
        error = trial.kinematic_error_mm
        lost = few([*trial.not_determined, *(f"{n} at times" for n in trial.frames_not_determined)])
        numbers = (f"{value:.1f}" for value in (error.mean, error.rms, error.max))
        table.add_row(f"  {escape(name)}", str(trial.frames), *numbers, escape(lost) or "nothing")
    console.print(table)
    say(console, "Note", "yellow", document.warnings)
    console.print(f"Written under [bold]{escape(str(out))}[/bold]:", highlight=False)
    console.print(f"  {escape(', '.join([*document.files, FILE_NAME]))}", highlight=False, soft_wrap=True)
