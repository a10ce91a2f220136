"""Futamure et al. done again, on the screen."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from scaling_service.capabilities.shared.screen import console_of_results
from scaling_service.studies.futamure.document import FutamureDocument, RecordingEntry
from scaling_service.studies.futamure.run import reproduce_futamure, save_futamure
from scaling_service.studies.futamure.squatters import SUBJECTS

_WORDS = {True: "[green]holds[/green]", False: "[red]not[/red]", None: "[yellow]undecided[/yellow]"}


def run_futamure(
    out: Path, *, subjects: int | None, recordings: Sequence[Path], seed: int, worker_count: int | None
) -> None:
    """Do the study, write it and show it."""
    stderr = Console(stderr=True)
    count = SUBJECTS if subjects is None else subjects

    def finished(name: str, done: int) -> None:
        stderr.print(f"{done} of {count}  {name}", markup=False, highlight=False)

    document = reproduce_futamure(
        seed=seed, subjects=count, recordings=recordings, worker_count=worker_count, finished=finished
    )
    files = save_futamure(document, out)
    console = console_of_results()
    _show(console, document)
    console.print(f"Written under [bold]{escape(str(out))}[/bold]: {', '.join(files)}", highlight=False)


def _show(console: Console, document: FutamureDocument) -> None:
    """Means over persons, real recordings, then the claims."""
    console.print(f"[bold]{escape(document.source)}[/bold]", highlight=False)
    table = Table(box=None, pad_edge=False, header_style="bold", title="RMS errors", title_justify="left")
    for heading in ("", "fx, N", "fy, N", "mz, N m", "markers, mm", "angles, deg"):
        table.add_column(heading, justify="left" if not heading else "right")
    for part in ("fitted", "held_out"):
        _rows(table, part.replace("_", " "), [getattr(p, part) for p in document.persons])
    for real in document.recordings:
        for part in ("fitted", "held_out"):
            _rows(table, f"{real.name}, {real.model}, {part.replace('_', ' ')}", [getattr(real, part)])
    console.print(table)
    claims = Table(
        box=None, pad_edge=False, header_style="bold", title="Does it hold here?", title_justify="left"
    )
    for heading in ("", "where", "claim", "here"):
        claims.add_column(heading)
    for claim in document.claims:
        claims.add_row(_WORDS[claim.holds], claim.where, escape(claim.claim), escape(claim.ours))
    console.print(claims)
    held = sum(claim.holds is True for claim in document.claims)
    console.print(
        f"{held} of {len(document.claims)} claims hold; {document.wall_s:.0f} s for "
        f"{len(document.persons)} persons",
        highlight=False,
    )


def _rows(table: Table, label: str, found: Sequence[RecordingEntry]) -> None:
    for way in ("classical", "consistent", "predicted"):
        entries = [getattr(recording, way) for recording in found]
        wrench = np.mean([entry.wrench_rmse for entry in entries], axis=0)
        markers = np.mean([entry.marker_rms_mm for entry in entries])
        angles = [np.mean(entry.angle_rmse_deg) for entry in entries if entry.angle_rmse_deg]
        last = f"{np.mean(angles):.2f}" if angles else "–"
        table.add_row(f"{label}, {way}", *(f"{v:.1f}" for v in wrench), f"{markers:.1f}", last)
