"""The third picture: the same disagreement with what was named, and the two models in space."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from scaling_service.capabilities.discovery.document import UnexplainedDocument
from scaling_service.capabilities.discovery.report.data import DiscoveryData
from scaling_service.capabilities.discovery.report.style import digits
from scaling_service.capabilities.discovery.report.where import heat_maps
from scaling_service.report.blocks import Block, Details, Heading, Row, Table, Text
from scaling_service.report.page import Section


def after_section(data: DiscoveryData) -> Section:
    """Heat maps after, the scene, and what is left."""
    return Section("3. After: with what was named", list(_blocks(data)), new_page=True)


def _blocks(data: DiscoveryData) -> Iterator[Block]:
    if not data.document.effects:
        yield Text("Nothing was named, so nothing changed: the picture is the one before.")
    else:
        yield Text("The same places and times in the same colours as before.")
        yield from heat_maps(data.maps, "after")
    if data.scene is not None:
        yield Heading("Without and with it, in space")
        yield Text(
            "Black dots are the measured markers, labels back in place where they were exchanged. Rings are "
            "the model's markers, dots its joint centres, dashed lines its knee axes. Drag to turn."
        )
        yield data.scene
    yield Heading("What is left")
    yield from _left(data.document.unexplained)


def _left(items: Sequence[UnexplainedDocument]) -> Iterator[Block]:
    if not items:
        yield Text("Nothing that is left stands clearly above the floor.")
        return
    yield _table("Above the floor, and like no effect of the catalogue", items[:_SHOWN])
    if len(items) > _SHOWN:
        yield Details(f"{len(items) - _SHOWN} more places", [_table("Further places", items[_SHOWN:])])


_SHOWN = 10
"""Chosen: places that are seen without asking for more."""


def _table(caption: str, items: Sequence[UnexplainedDocument]) -> Table:
    rows = [
        Row(
            ", ".join(item.where),
            [f"{digits(item.rms)} {item.unit}", f"{digits(item.floor)} {item.unit}", item.law],
        )
        for item in items
    ]
    return Table(
        caption, ["place", "left over", "floor", "the simplest law that describes it"], rows, words=True
    )
