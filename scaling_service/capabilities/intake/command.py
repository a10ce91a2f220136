"""The command that looks at a folder's files before anything is computed."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from scaling_service.capabilities.shared import flags
from scaling_service.capabilities.shared.screen import running
from scaling_service.capabilities.shared.settings import Settings
from scaling_service.core.names import say_name, say_sizes
from scaling_service.core.text import list_few

COMMANDS = ("proof",)

if TYPE_CHECKING:
    from scaling_service.capabilities.intake.result import ProofDocument

_COLOURS = {"error": "red", "warning": "yellow", "note": "dim"}


@flags.with_flags
def proof(
    folder: Annotated[Path, typer.Argument(metavar="FOLDER", help="With recordings.", show_default=False)],
    out: flags.Out,
    settings: Annotated[Settings, flags.Only("up", "forward")],
) -> None:
    """Look at the files of a folder: what they are for, axes, labels, gaps, and what scaling would refuse.

    Nothing is scaled. Writes proof.json, its tables, and subject.yaml, a proposal to correct and to scale by.

    [bold]Example[/bold]: scaling-service proof recordings --out looked
    """
    with running(out) as progress:
        from scaling_service.capabilities.intake.run import SUBJECT, prove_folder

        found = prove_folder(folder, out, settings, progress=progress)
    _show(found)
    if found.proposal is not None:
        Console().print(f"Proposed: {escape(str(out / SUBJECT))}", soft_wrap=True)


def _show(found: ProofDocument) -> None:
    """Files, person, marker set, markers and plates, then axes and problems."""
    console = Console()
    files = Table("file", "is", "used as", "why", title="Files")
    for file in found.files:
        why = file.problem.problem if file.problem is not None else file.why
        files.add_row(*(escape(text) for text in (file.name, file.kind, file.role or "–", why)))
    console.print(files)
    # Model and sizes
    person = [f"Model: {found.model}{'' if found.model_why is None else f' ({found.model_why})'}"]
    if found.sizes is not None:
        sizes = {"height_m": found.sizes.height_m, "mass_kg": found.sizes.mass_kg}
        sizes |= {f"{name}_mm": value for name, value in found.sizes.sizes_mm.items()}
        if said := say_sizes({name: value for name, value in sizes.items() if value is not None}):
            person.append(f"Sizes: {said} (from {list_few(found.sizes.source)})")
    for line in (*person, *_describe_marker_set(found)):
        console.print(escape(line))
    renamed = [m for m in found.markers if m.label not in (None, m.marker)]
    if renamed:
        markers = Table("marker", "label", "confidence", "why", title=f"Markers of {escape(found.model)}")
        for marker in renamed:
            shown = (marker.marker, marker.label or "", f"{marker.confidence:.2f}", marker.why)
            markers.add_row(*(escape(text) for text in shown))
        console.print(markers)
    for line in _describe_labels(found):
        console.print(escape(line))
    if any(recording.plates for recording in found.recordings):
        table = Table(
            "recording",
            "plate",
            "type",
            "centre x, z (m)",
            "peak (N)",
            "loaded by",
            "at rest (N)",
            title="Plates",
        )
        for recording in found.recordings:
            for plate in recording.plates:
                row = (
                    recording.file,
                    say_name(plate.name),
                    "–" if plate.kind is None else str(plate.kind),
                    "–" if plate.centre_m is None else f"{plate.centre_m[0]:.2f}, {plate.centre_m[2]:.2f}",
                    "–" if plate.peak_N is None else f"{plate.peak_N:.0f}",
                    list_few(plate.loaded_by) or "nobody",
                    "–" if plate.offset_N is None else f"{plate.offset_N:.1f}",
                )
                table.add_row(*map(escape, row))
        console.print(table)
    for text in () if found.axes is None else found.axes.why:
        console.print(escape(text))
    of_files = [file.problem for file in found.files if file.problem is not None]
    of_recordings = [p for recording in found.recordings for p in recording.problems]
    for problem in (*of_files, *of_recordings, *found.problems):
        where = ", ".join(part for part in (problem.file, problem.field) if part)
        said = f"{where}: {problem.problem}" if where else problem.problem
        colour = _COLOURS[problem.severity]
        console.print(
            f"[{colour}]{problem.severity}[/{colour}] {escape(said)}. {escape(problem.remedy or '')}"
        )
    for entry in found.readiness:
        lacks = [f"{need.name}: {need.text}" for need in entry.needs if need.required and not need.there]
        apart = [n.text for n in entry.needs if n.name == "segments" and not n.there]
        state = f"ready{''.join(f'; {text}' for text in apart)}" if entry.ready else "; ".join(lacks)
        console.print(escape(f"{entry.title}: {state}"))
    console.print(f"{escape(found.headline)}.")


def _describe_marker_set(found: ProofDocument) -> Iterator[str]:
    """The marker set, what it lacks, and what that means."""
    known = found.marker_set
    if known is None:
        yield "Marker set: none that is known; labels count by their names alone"
    else:
        yield (
            f"Marker set: {' with '.join([known.title, *known.additions])}; "
            f"{known.share:.0%} of its labels are there"
            f"{f', not {list_few(known.lacks)}' if known.lacks else ''}"
        )
    yield from (f"  {text}" for text in found.consequences)


def _describe_labels(found: ProofDocument) -> Iterator[str]:
    """How many markers are called as in the model, which have no label, tracking markers, labels not used."""
    from scaling_service.model.anatomy.markers import strip_prefix

    computed = {entry.label for r in found.recordings for entry in r.labels if entry.computed}
    same = sum(m.label == m.marker and m.label not in computed for m in found.markers)
    if same:
        yield f"Markers whose labels are the model's own names: {same}"
    missing = [m.marker for m in found.markers if m.label is None]
    if missing and found.proposal is None:  # else scaling's own warning names them
        yield f"Markers of the model without a label: {', '.join(missing)}"
    proposed = (found.proposal or {}).get("extra_markers", {})
    on: dict[str, list[str]] = {}
    for label, segment in proposed.items():
        on.setdefault(str(segment), []).append(label)
    if proposed:
        yield "Tracking markers: " + "; ".join(
            f"{say_name(segment)}: {', '.join(on[segment])}" for segment in on
        )
    unused = [n for n in found.unused_labels if n not in computed and strip_prefix(n) not in proposed]
    if unused:
        yield f"Labels that are not used: {', '.join(unused)}"
    if computed:
        yield f"Points that software computed, not used: {list_few(sorted(computed))}"
