"""The commands that scale: demo, scale, compare."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from scaling_service.capabilities.discovery.command import find_hidden
from scaling_service.capabilities.scaling import run as tasks
from scaling_service.capabilities.scaling.demo import run_demo
from scaling_service.capabilities.scaling.methods.table import METHODS
from scaling_service.capabilities.scaling.saving import save
from scaling_service.capabilities.shared import options
from scaling_service.capabilities.shared.screen import progress_bar, show
from scaling_service.capabilities.subject.settings import Settings
from scaling_service.documents.results import ComparisonDocument
from scaling_service.documents.writing import check_folder


def demo(
    out: options.Out,
    strategy: options.StrategyOption = options.Strategy.JOINT,
    frames: options.Frames = options.DEFAULT_FRAMES,
    seed: options.Seed = 0,
    report: options.Report = True,
    discover: Annotated[
        bool,
        typer.Option(
            "--discover",
            help="Instead, hide something in the person's recordings, and search for it as `discover` does.",
        ),
    ] = False,
) -> None:
    """Compare all methods on a built-in virtual person, whose true body is known.

    [bold]Examples[/bold]: scaling-service demo --out demo

    scaling-service demo --discover --out hidden
    """
    check_folder(out)
    if discover:
        find_hidden(out, seed, report=report)
        return
    settings = options.resolve(strategy, frames, seed, None, None, None)
    with progress_bar() as progress:
        results, truth = run_demo(settings, progress=progress)
        document = save(results, out, truth=truth, report=report, progress=progress)
    show(document, out)


def scale(
    subject: options.SubjectFile,
    out: options.Out,
    method: Annotated[str, typer.Option(metavar="|".join(METHODS), help="How to scale.")] = "MB_am",
    strategy: options.StrategyOption = options.Strategy.JOINT,
    frames: options.Frames = options.DEFAULT_FRAMES,
    seed: options.Seed = 0,
    up: options.Up = None,
    forward: options.Forward = None,
    smooth_hz: options.SmoothHz = None,
    sizes: options.SizesOption = options.Sizes.WEIGHTED,
    hip_centre: options.HipCentreOption = options.HipCentre.REGRESSION,
    hip_regression: options.HipRegression = options.DEFAULT_REGRESSION,
    knee_axis: options.KneeAxisOption = options.KneeAxis.EPICONDYLES,
    scaling: options.FactorsOption = options.Factors.UNIFORM,
    knee: options.KneeOption = options.Knee.HINGE,
) -> None:
    """Scale a subject's model by one method.

    Writes under --out: METHOD/model.osim (for OpenSim), model.json, TRIAL_ik.mot for every movement, and
    scaling.json with errors, lengths, axes and the uncertainty of every fitted number.

    [bold]Example[/bold]: scaling-service scale S01.yaml --method MB_am --out results
    """
    settings = options.resolve(strategy, frames, seed, up, forward, smooth_hz)
    settings = options.beyond(settings, sizes, hip_centre, hip_regression, knee_axis, scaling, knee)
    _scale(subject, out, (method,), settings, comparison=False)


def compare(
    subject: options.SubjectFile,
    out: options.Out,
    methods: Annotated[
        str | None,
        typer.Option(metavar="M,M,…", help=f"Of {', '.join(METHODS)}; all that can be done unless given."),
    ] = None,
    strategy: options.StrategyOption = options.Strategy.JOINT,
    frames: options.Frames = options.DEFAULT_FRAMES,
    seed: options.Seed = 0,
    up: options.Up = None,
    forward: options.Forward = None,
    smooth_hz: options.SmoothHz = None,
    sizes: options.SizesOption = options.Sizes.WEIGHTED,
    hip_centre: options.HipCentreOption = options.HipCentre.REGRESSION,
    hip_regression: options.HipRegression = options.DEFAULT_REGRESSION,
    knee_axis: options.KneeAxisOption = options.KneeAxis.EPICONDYLES,
    scaling: options.FactorsOption = options.Factors.UNIFORM,
    knee: options.KneeOption = options.Knee.HINGE,
    report: options.Report = True,
) -> None:
    """Scale a subject's model by several methods and compare them.

    Writes under --out what `scale` writes for each method, comparison.json, and report.html: which method to
    use for this person, why, and how far to trust it.

    [bold]Examples[/bold]: scaling-service compare S01.yaml --out results

    scaling-service compare S01.yaml --methods MB,MB_am --up +z --out results
    """
    chosen = None if methods is None else tuple(name.strip() for name in methods.split(","))
    settings = options.resolve(strategy, frames, seed, up, forward, smooth_hz)
    settings = options.beyond(settings, sizes, hip_centre, hip_regression, knee_axis, scaling, knee)
    _scale(subject, out, chosen, settings, comparison=True, report=report)


def _scale(
    subject: Path,
    out: Path,
    methods: tuple[str, ...] | None,
    settings: Settings,
    *,
    comparison: bool,
    report: bool = False,
) -> ComparisonDocument:
    check_folder(out)
    with progress_bar() as progress:
        results = tasks.compare(subject, methods, settings, progress=progress)
        document = save(results, out, comparison=comparison, report=report, progress=progress)
    show(document, out)
    return document
