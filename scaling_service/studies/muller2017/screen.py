"""Muller et al. 2017 done again, on the screen."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from scaling_service.capabilities.dynamics.residuals import COMPONENTS
from scaling_service.capabilities.dynamics.uncertainty.total import UncertaintySettings
from scaling_service.capabilities.shared.screen import console_of_results
from scaling_service.studies.muller2017.document import Muller2017Document
from scaling_service.studies.muller2017.run import reproduce_muller2017, save_muller2017
from scaling_service.studies.muller2017.study import SUBJECTS

_WORDS = {True: "[green]holds[/green]", False: "[red]not[/red]", None: "[yellow]undecided[/yellow]"}


def run_muller2017(
    out: Path,
    *,
    subjects: int | None,
    recordings: Sequence[Path],
    samples: int,
    seed: int,
    worker_count: int | None,
) -> None:
    """Do the study, write it and show it."""
    stderr = Console(stderr=True)
    count = SUBJECTS if subjects is None else subjects

    def finished(name: str, done: int) -> None:
        stderr.print(f"{done} of {count}  {name}", markup=False, highlight=False)

    settings = UncertaintySettings(samples=samples, seed=seed)
    document = reproduce_muller2017(
        settings,
        subjects=count,
        recordings=recordings,
        worker_count=worker_count,
        finished=finished,
    )
    files = save_muller2017(document, out)
    console = console_of_results()
    _show(console, document)
    console.print(f"Written under [bold]{escape(str(out))}[/bold]: {', '.join(files)}", highlight=False)


def _show(console: Console, document: Muller2017Document) -> None:
    """Means over persons, then the claims."""
    console.print(f"[bold]{escape(document.source)}[/bold]", highlight=False)
    table = Table(
        box=None,
        pad_edge=False,
        header_style="bold",
        title="Means over persons, % of weight, of weight x height",
        title_justify="left",
    )
    for heading in ("", *COMPONENTS):
        table.add_column(heading, justify="left" if not heading else "right")
    for said, name in (
        ("residual", "dr"),
        ("uncertainty", "total"),
        ("SD by the markers' errors", "markers_sd"),
        ("true error of the measurement", "true_measurement_error"),
        ("true error of the inertia", "true_inertial_error"),
    ):
        means = 100 * np.mean([getattr(person, name) for person in document.persons], axis=0)
        table.add_row(said, *(f"{mean:.2f}" for mean in means))
    for recording in document.recordings:
        table.add_row(f"{recording.name}: residual", *(f"{100 * v:.2f}" for v in recording.dr))
        table.add_row(f"{recording.name}: uncertainty", *(f"{100 * v:.2f}" for v in recording.total))
    console.print(table)
    claims = Table(
        box=None, pad_edge=False, header_style="bold", title="Does it hold here?", title_justify="left"
    )
    for heading in ("", "where", "claim"):
        claims.add_column(heading)
    for claim in document.claims:
        claims.add_row(_WORDS[claim.holds], claim.where, escape(claim.claim))
    console.print(claims)
    held = sum(claim.holds is True for claim in document.claims)
    console.print(
        f"{held} of {len(document.claims)} claims hold; {document.wall_s:.0f} s for "
        f"{len(document.persons)} persons",
        highlight=False,
    )
