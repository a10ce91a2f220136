"""Which marker set the labels of recordings belong to, and what that says of each label."""

from __future__ import annotations

from collections import abc
from dataclasses import dataclass
from typing import Literal

from scaling_service.model import marker_sets
from scaling_service.model.anatomy import markers as anatomy_markers
from scaling_service.model.anatomy.lengths import find_segment
from scaling_service.model.body import BodyModel

MOSTLY = 0.6
"""Chosen: a set of which a smaller share of the labels is there is not named."""


@dataclass(frozen=True, slots=True, kw_only=True)
class MarkerSetMatch:
    """The marker set that recordings were made with."""

    name: str
    title: str
    share: float  # of the labels that the set asks for on the sides that were recorded
    lacks: tuple[str, ...] = ()  # labels that it asks for and that no recording has
    additions: tuple[str, ...] = ()
    """Titles of sets that come with others, such as the Oxford foot model, and are there, too."""
    key_points: bool = False  # whether the labels are joint centres guessed from video rather than markers


def recognise(labels: abc.Iterable[str]) -> MarkerSetMatch | None:
    """The marker set that fits the labels of all recordings best; None where none is mostly there.

    Of two sets that fit, the one counts that explains more of the labels and asks for fewer others
    (Dice coefficient). Labels that only the static trial needs count where they are, and are not missed.

    ``labels``: of all recordings together.

    Examples
    --------
    >>> found = recognise("RASI LASI SACR RTHI LTHI RKNE LKNE RTIB LTIB RANK LANK RTOE LTOE RHEE".split())
    >>> found.name, found.lacks
    ('plug_in_gait_lower', ('LHEE',))
    """
    present = {
        anatomy_markers.make_plain_key(label) for label in labels if not anatomy_markers.is_computed(label)
    }
    every = marker_sets.list_marker_sets().values()
    additions = [s for s in every if s.adds_to_others and _share(s, present) >= MOSTLY]
    explained = present - {
        anatomy_markers.make_plain_key(n) for s in additions for label in s.labels for n in label.names
    }
    whole = [s for s in every if not s.adds_to_others and _share(s, present) >= MOSTLY]
    if not whole:
        return None
    best = max(whole, key=lambda s: _rate_likeness(s, present, explained))
    asked, lacks = _list_asked(best, present)
    return MarkerSetMatch(
        name=best.name,
        title=best.title,
        share=1.0 - len(lacks) / len(asked),
        lacks=lacks,
        additions=tuple(s.title for s in additions),
        key_points=best.key_points,
    )


def _is_present(label: marker_sets.SetLabel, present: set[str]) -> bool:
    return any(anatomy_markers.make_plain_key(name) in present for name in label.names)


def _list_asked(
    marker_set: marker_sets.MarkerSet, present: set[str]
) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Labels that a set asks for on the sides that are there, and those of them that are missing."""
    sides = {label.side for label in marker_set.labels if _is_present(label, present)} | {""}
    of_sides = [label for label in marker_set.labels if label.side in sides]
    found = {label.label for label in of_sides if _is_present(label, present)}
    free = {name for choice in marker_set.one_of for group in choice for name in group}
    asked = [n.label for n in of_sides if not n.optional and not n.static_only and n.label not in free]
    for choice in marker_set.one_of:
        here = [[name for name in group if any(n.label == name for n in of_sides)] for group in choice]
        asked += min((group for group in here if group), key=lambda g: len(set(g) - found), default=[])
    return tuple(asked), tuple(name for name in asked if name not in found)


def _share(marker_set: marker_sets.MarkerSet, present: set[str]) -> float:
    if not marker_set.adds_to_others:
        asked, lacks = _list_asked(marker_set, present)
        return 1.0 - len(lacks) / len(asked) if len(asked) > len(lacks) else 0.0
    found = [_is_present(label, present) for label in marker_set.labels if not label.optional]
    return sum(found) / len(found)


def _rate_likeness(marker_set: marker_sets.MarkerSet, present: set[str], explained: set[str]) -> float:
    asked, _ = _list_asked(marker_set, present)
    found = [label for label in marker_set.labels if _is_present(label, present)]
    size = len({*asked, *(label.label for label in found)})
    return 2.0 * len(found) / (size + max(len(explained), len(found)))


def assign_tracking_segments(labels: abc.Iterable[str], model: BodyModel) -> dict[str, str]:
    """Segment of each label that is known and that no marker of the model takes, where the model has it.

    Examples
    --------
    >>> from scaling_service.model.builtin import load_builtin
    >>> assign_tracking_segments(["RASI", "SACR", "RTHI", "LHEE", "odd"], load_builtin("lower_limb_14dof"))
    {'SACR': 'pelvis', 'RTHI': 'femur_r'}
    """
    markers = [marker.name for marker in model.markers if marker.weight > 0.0]
    found = {}
    for label in labels:
        meant = anatomy_markers.look_up_meaning(label)
        if (
            meant is None
            or anatomy_markers.is_computed(label)
            or any(anatomy_markers.describe_likeness(label, name) is not None for name in markers)
        ):
            continue
        midline = meant.segment in ("pelvis", "torso", "head")
        segment = find_segment(model, meant.segment, "" if midline else meant.side)
        if segment is not None:
            found[label] = segment
    return found


def find_plane_marker(
    labels: abc.Sequence[str], joint: Literal["knee", "ankle"], side: Literal["r", "l"]
) -> str | None:
    """The label of the marker that tells the plane of a joint's axis: the conventional gait model's wands.

    With the joint centre above and the joint's lateral marker it spans the plane in which the joint's centre
    is looked for (Davis 1991).

    ``labels``: of one recording. ``joint``: the thigh's marker tells the knee's, the shank's the ankle's.

    Examples
    --------
    >>> find_plane_marker(["S01:RASI", "S01:RTHI"], "knee", "r")
    'S01:RTHI'
    """
    keys = {
        anatomy_markers.make_plain_key(name)
        for marker_set in marker_sets.list_marker_sets().values()
        for entry in marker_set.labels
        if entry.plane_of == joint and entry.side == side
        for name in entry.names
    }
    return next((label for label in labels if anatomy_markers.make_plain_key(label) in keys), None)
