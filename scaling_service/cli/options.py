"""Options that several commands share."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from scaling_service.calibration.settings import CalibrationSettings
from scaling_service.core.errors import InputError
from scaling_service.jobs.settings import Settings
from scaling_service.processing.pipeline import ProcessingSettings


class Strategy(StrEnum):
    """How motion and parameters are fitted."""

    JOINT = "joint"
    ALTERNATING = "alternating"


# Whether a path can be read is asked where it is read, with file and remedy in the answer.
SubjectFile = Annotated[
    Path,
    typer.Argument(metavar="SUBJECT", help="Subject file, YAML or JSON.", show_default=False, readable=False),
]


def _folder(text: str) -> Path:
    """A folder as typed; an empty text, as of an unset shell variable, is none."""
    if not text.strip():
        raise InputError("no folder is given", field="--out", remedy="Name a folder")
    return Path(text)


Out = Annotated[
    Path,
    typer.Option(
        "--out",
        "-o",
        metavar="DIR",
        help="Folder for the results.",
        show_default=False,
        parser=_folder,
    ),
]
StrategyOption = Annotated[
    Strategy,
    typer.Option(help="Motion and parameters together (joint), or in turn as in Puchaud 2019 (alternating)."),
]
Frames = Annotated[
    int,
    typer.Option(min=1, metavar="N", help="Frames used to fit, equally spaced over the calibration trials."),
]
Seed = Annotated[int, typer.Option(min=0, metavar="N", help="Seed of everything random.")]
Up = Annotated[
    str | None,
    typer.Option(
        metavar="AXIS",
        help="Laboratory axis that points up, such as +z; unless given, found from markers.",
    ),
]
Forward = Annotated[
    str | None,
    typer.Option(metavar="AXIS", help="Laboratory axis that the person faces, such as -x."),
]
SmoothHz = Annotated[
    float | None,
    typer.Option(
        min=0.0,
        metavar="HZ",
        help="Smooth by a Butterworth filter with this cutoff, not by a moving average; 0: not at all.",
    ),
]

DEFAULT_FRAMES = CalibrationSettings().n_frames


def resolve(
    strategy: Strategy, frames: int, seed: int, up: str | None, forward: str | None, smooth_hz: float | None
) -> Settings:
    """Settings from options."""
    return Settings(
        calibration=CalibrationSettings(strategy=strategy.value, n_frames=frames),
        processing=_processing(smooth_hz),
        up=up,
        forward=forward,
        seed=seed,
    )


def _processing(smooth_hz: float | None) -> ProcessingSettings:
    if smooth_hz is None:
        return ProcessingSettings()
    if smooth_hz == 0.0:
        return ProcessingSettings(smoothing="none")
    return ProcessingSettings(smoothing="butterworth", cutoff_hz=smooth_hz)
