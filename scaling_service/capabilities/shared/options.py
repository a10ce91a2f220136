"""Options that several commands share."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from scaling_service.capabilities.dynamics.settings import AS_IT_IS, OWN
from scaling_service.capabilities.scaling.methods.table import METHODS
from scaling_service.capabilities.subject.calibration_settings import CalibrationSettings
from scaling_service.capabilities.subject.settings import Settings
from scaling_service.core.errors import InputError
from scaling_service.model.anatomy.hip_centre import HIP_REGRESSIONS
from scaling_service.model.inertia import TABLE_NAMES
from scaling_service.recording.pipeline import ProcessingSettings


class Strategy(StrEnum):
    """How motion and parameters are fitted."""

    JOINT = "joint"
    ALTERNATING = "alternating"


class HipCentre(StrEnum):
    """Where hip centres come from."""

    REGRESSION = "regression"
    FUNCTIONAL = "functional"


class KneeAxis(StrEnum):
    """Where knee axes start."""

    EPICONDYLES = "epicondyles"
    FUNCTIONAL = "functional"


class Factors(StrEnum):
    """How many factors a segment takes."""

    UNIFORM = "uniform"
    PER_AXIS = "per-axis"


class Sizes(StrEnum):
    """What decides the size of a segment."""

    WEIGHTED = "weighted"
    MEASURED = "measured"


class Knee(StrEnum):
    """How a knee turns."""

    HINGE = "hinge"
    UNIVERSAL = "universal"
    SPHERICAL = "spherical"


# Whether a path can be read is asked where it is read, with file and remedy in the answer.
SubjectFile = Annotated[
    Path,
    typer.Argument(metavar="SUBJECT", help="Subject file, YAML or JSON.", show_default=False, readable=False),
]


def folder(option: str) -> Callable[[str], Path]:
    """The parser of an option that names a folder; an empty text, as of an unset shell variable, is none."""

    def parse(text: str) -> Path:
        if not text.strip():
            raise InputError("no folder is given", field=option, remedy="Name a folder")
        return Path(text)

    return parse


Out = Annotated[
    Path,
    typer.Option(
        "--out",
        "-o",
        metavar="DIR",
        help="Folder for the results.",
        show_default=False,
        parser=folder("--out"),
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
Start = Annotated[
    str | None,
    typer.Option(
        metavar="|".join((*METHODS, AS_IT_IS)),
        help=f"Scaling to start from; '{AS_IT_IS}' takes the given model as it is: already scaled. "
        "EB_am where there are bones, else MB_am, unless given.",
    ),
]
Inertia = Annotated[
    str | None,
    typer.Option(
        metavar="|".join((*TABLE_NAMES, OWN)),
        help=f"Inertial table; '{OWN}' keeps the model's own. dumas2007 for built-in models that were "
        "scaled, else the model's own, unless given.",
    ),
]
CutoffHz = Annotated[
    float, typer.Option(min=0.0, metavar="HZ", help="Of the filter that motion and forces pass.")
]
Seed = Annotated[int, typer.Option(min=0, metavar="N", help="Seed of everything random.")]
Report = Annotated[bool, typer.Option("--report/--no-report", help="Whether to write report.html.")]
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
_BEYOND = "Beyond the paper"
HipCentreOption = Annotated[
    HipCentre,
    typer.Option(
        help="From the pelvis markers by regression, or where pelvis and thigh turn against each other in "
        "the calibration trials (three markers on each).",
        rich_help_panel=_BEYOND,
    ),
]
HipRegression = Annotated[
    str,
    typer.Option(
        metavar="NAME",
        help=f"Which regression: harrington2007, {', '.join(HIP_REGRESSIONS)}.",
        rich_help_panel=_BEYOND,
    ),
]
KneeAxisOption = Annotated[
    KneeAxis,
    typer.Option(
        help="Along the epicondyles, or where thigh and shank turn against each other in the calibration "
        "trials (three markers on each).",
        rich_help_panel=_BEYOND,
    ),
]
SizesOption = Annotated[
    Sizes,
    typer.Option(
        help="Weigh each segment's distances and what persons of this stature and mass are like by their "
        "errors, or take the mean of its distances alone, as the paper does.",
        rich_help_panel=_BEYOND,
    ),
]
FactorsOption = Annotated[
    Factors,
    typer.Option(
        "--scaling",
        help="One factor for each segment, or factors along its axes where markers determine them.",
        rich_help_panel=_BEYOND,
    ),
]
KneeOption = Annotated[
    Knee,
    typer.Option(
        help="Flexion alone, with inward rotation (universal), or with varus and valgus as well (spherical).",
        rich_help_panel=_BEYOND,
    ),
]

DEFAULT_FRAMES = CalibrationSettings().n_frames
DEFAULT_REGRESSION = CalibrationSettings().hip_regression


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


def beyond(
    settings: Settings,
    sizes: Sizes,
    hip_centre: HipCentre,
    hip_regression: str,
    knee_axis: KneeAxis,
    scaling: Factors,
    knee: Knee,
) -> Settings:
    """Settings with the options that go beyond Puchaud 2019."""
    calibration = replace(
        settings.calibration,
        sizes=sizes.value,
        hip_centre=hip_centre.value,
        hip_regression=hip_regression,
        knee_axis=knee_axis.value,
        scaling=scaling.value,
        knee=knee.value,
    )
    return replace(settings, calibration=calibration)


def _processing(smooth_hz: float | None) -> ProcessingSettings:
    if smooth_hz is None:
        return ProcessingSettings()
    if smooth_hz == 0.0:
        return ProcessingSettings(smoothing="none")
    return ProcessingSettings(smoothing="butterworth", cutoff_hz=smooth_hz)
