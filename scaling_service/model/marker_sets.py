"""Marker sets as data: what each label of a laboratory's set stands for.

The sets, each with its source, are in ``reference_models/marker_sets``, the landmarks in
``reference_models/landmarks.yaml``. Sides are written once, for the right.
"""

from __future__ import annotations

import dataclasses
from collections import abc
from functools import cache
from types import MappingProxyType
from typing import Any, Literal

from scaling_service.model import reference

Side = Literal["r", "l", ""]


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class Landmark:
    """A place that can be felt through the skin."""

    name: str  # as the built-in models call its marker
    segment: str  # what carries it, without side: pelvis, femur, tibia, calcn …
    side: Side
    at: str  # in words
    aliases: tuple[str, ...] = ()  # names that belong to no marker set


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class SetLabel:
    """One label of a marker set, and what it stands for."""

    label: str
    aliases: tuple[str, ...]
    landmark: str | None
    """The landmark; None of tracking markers, whose place is each laboratory's own choice."""
    segment: str  # what carries it, without side
    side: Side
    wand: bool = False  # whether it stands off the skin on a stick
    plane_of: str | None = None
    """``knee`` or ``ankle`` where it is put into the plane of the joint's axis and the segment's length."""
    static_only: bool = False  # whether the set asks for it in the static trial only
    optional: bool = False  # whether the set is whole without it

    @property
    def names(self) -> tuple[str, ...]:
        """The label and its aliases."""
        return (self.label, *self.aliases)


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class MarkerSet:
    """A marker set."""

    name: str
    title: str
    source: str
    labels: tuple[SetLabel, ...]  # both sides
    one_of: tuple[tuple[tuple[str, ...], ...], ...] = ()
    """Choices: of each, all labels of one of its groups are asked for."""
    adds_to_others: bool = False  # whether it comes with another set, never by itself
    key_points: bool = False  # whether its labels are guesses of joint centres rather than markers


@cache
def list_landmarks() -> abc.Mapping[str, Landmark]:
    """All landmarks that are known, both sides, by name."""
    content = reference.read_reference(reference.find_reference_folder() / "landmarks.yaml")
    found: dict[str, Landmark] = {}
    for name, side, entry in _list_entries(content):
        aliases = tuple(_name_on_side(side, alias) for alias in entry.get("aliases", ()))
        found[name] = Landmark(
            name=name, segment=entry["segment"], side=side, at=entry["at"], aliases=aliases
        )
    return MappingProxyType(found)


@cache
def list_marker_sets() -> abc.Mapping[str, MarkerSet]:
    """All marker sets that come with the product, by name."""
    contents = {name: reference.read_reference(file) for name, file in reference.list_marker_set_files()}
    return MappingProxyType({name: _set(name, contents) for name in contents})


def _set(name: str, contents: abc.Mapping[str, Any]) -> MarkerSet:
    content = contents[name]
    own = MarkerSet(
        name=name,
        title=content["title"],
        source=content["source"],
        labels=tuple(_label(*entry) for entry in _list_entries(content)),
        one_of=tuple(tuple(map(tuple, choice)) for choice in content.get("one_of", ())),
        adds_to_others=content.get("adds_to_others", False),
        key_points=content.get("key_points", False),
    )
    if "extends" not in content:
        return own
    base = _set(content["extends"], contents)
    return dataclasses.replace(own, labels=(*base.labels, *own.labels), one_of=(*base.one_of, *own.one_of))


def _label(name: str, side: Side, entry: abc.Mapping[str, Any]) -> SetLabel:
    landmark = entry.get("landmark")
    known = None if landmark is None else list_landmarks()[_name_on_side(side, landmark)]
    return SetLabel(
        label=name,
        aliases=tuple(_name_on_side(side, alias) for alias in entry.get("aliases", ())),
        landmark=None if known is None else known.name,
        segment=entry["segment"] if known is None else known.segment,
        side=side,
        **{key: said for key, said in entry.items() if key not in ("aliases", "landmark", "segment")},
    )


def _list_entries(content: abc.Mapping[str, Any]) -> abc.Iterator[tuple[str, Side, abc.Mapping[str, Any]]]:
    """Names of both sides and of the midline, with what is written of each."""
    for name, entry in content.get("sided", {}).items():
        yield name, "r", entry
        yield _name_on_side("l", name), "l", entry
    for name, entry in content.get("midline", {}).items():
        yield name, "", entry


def _name_on_side(side: Side, name: str) -> str:
    """A name of the right on a side."""
    return f"L{name[1:]}" if side == "l" else name
