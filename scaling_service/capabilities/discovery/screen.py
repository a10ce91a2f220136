"""What people see of a search: effects with their sizes, the gap, the verdict, what is left open."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from rich.markup import escape
from rich.table import Table

from scaling_service.capabilities.discovery.report.page import headline
from scaling_service.capabilities.discovery.report.style import digits, placed
from scaling_service.capabilities.discovery.saving import FILE_NAME
from scaling_service.capabilities.discovery.words import shown
from scaling_service.capabilities.shared.screen import console_of_results, introduce, say

if TYPE_CHECKING:
    from scaling_service.capabilities.discovery.document import DiscoveryDocument, EffectDocument

_LEFT = 5  # places still above the floor; all are in discovery.json (chosen: as many as fit a screen)
_TWINS = 3  # members of a class beside the effect (chosen); all are in discovery.json
_SIZES = 4  # numbers of an effect in the table (chosen); all are in discovery.json


def show(document: DiscoveryDocument, out: Path) -> None:
    """The table of effects, the verdict in a sentence, and what it leaves open."""
    console = console_of_results()
    how = "as given" if document.start == "none" else f"scaled by {document.start}"
    introduce(console, document, f"model {how}")
    if document.effects:
        console.print(_effects(document))
    console.print(_gap(document))
    say(console, "Verdict", "bold", [f"{headline(document)}."])
    say(console, "Class", "cyan", list(_classes(document.effects)))
    say(console, "Left", "yellow", _left(document))
    say(console, "Note", "yellow", document.notes)
    console.print(f"Written under [bold]{escape(str(out))}[/bold]:", highlight=False)
    console.print(f"  {escape(', '.join([*document.files, FILE_NAME]))}", highlight=False, soft_wrap=True)
    if document.hidden is not None:
        hidden = [f"{placed(h)}: {_listed(h.parameters)}" for h in document.hidden]
        say(console, "Had been hidden", "bold", hidden)


def _effects(document: DiscoveryDocument) -> Table:
    """Effect, where, size, and the gap of its places on what was not fitted."""
    table = Table(box=None, pad_edge=False, header_style="bold")
    unseen = "Held-out gap" if document.held_out_trials else "Gap"
    for name in ("Effect", "Where", "Size ± sd", f"{unseen}: before → after (floor)"):
        table.add_column(name)
    for effect in document.effects:
        following = f"\nwith {', '.join(effect.driver)}" if effect.driver else ""
        only = f"\nin {', '.join(effect.trials)} only" if effect.trials else ""
        sizes = [shown(n, q, spread=True) for n, q in effect.parameters.items()]
        more = [f"and {len(sizes) - _SIZES} more"] if len(sizes) > _SIZES else []
        table.add_row(
            effect.kind.replace("_", " "),
            escape(", ".join(effect.where) + following + only),
            escape("\n".join([*sizes[:_SIZES], *more])),
            "\n".join(_at_places(document, effect)),
        )
    return table


def _at_places(document: DiscoveryDocument, effect: EffectDocument) -> Iterator[str]:
    places = document.gap.held_out.places
    for name in effect.where:
        if name in places:
            level = places[name]
            yield (
                f"{escape(name)} {digits(level.before)} → {digits(level.after)} "
                f"({digits(level.floor)}) {level.unit}"
            )


def _gap(document: DiscoveryDocument) -> Table:
    """All of one kind together."""
    table = Table(box=None, pad_edge=False, header_style="bold")
    table.add_column("Gap, RMS")
    for title in ("before", "after", "floor", "ceiling"):
        table.add_column(title, justify="right")
    held_out = [("held out", document.gap.held_out)] if document.held_out_trials else []
    for role, gap in (("used to fit", document.gap.fit), *held_out):
        for name, level in (
            ("times the floor", gap.whitened),
            ("markers, mm", gap.markers_mm),
            ("force, N", gap.force_N),
            ("moment, N m", gap.moment_Nm),
        ):
            if level is not None:
                values = (level.before, level.after, level.floor, level.ceiling)
                table.add_row(f"{role}: {name}", *(digits(v) for v in values))
    return table


def _classes(effects: Sequence[EffectDocument]) -> Iterator[str]:
    for effect in effects:
        if effect.confusable_with:
            others = [placed(twin) for twin in effect.confusable_with]
            more = f" and {len(others) - _TWINS} more" if len(others) > _TWINS else ""
            twins = "; ".join(others[:_TWINS]) + more
            apart = f". To separate: {effect.would_separate}" if effect.would_separate else ""
            yield f"{placed(effect)} cannot be told here from {twins}{apart}"


def _left(document: DiscoveryDocument) -> list[str]:
    found = [
        f"{', '.join(u.where)}: {digits(u.rms)} {u.unit} above a floor of {digits(u.floor)}: {u.law}"
        for u in document.unexplained
    ]
    more = [f"and {len(found) - _LEFT} more places"] if len(found) > _LEFT else []
    return [*found[:_LEFT], *more]


def _listed(parameters: dict[str, float]) -> str:
    return ", ".join(f"{name} {value:.3g}" for name, value in parameters.items())
