"""Numbers and names as people read them."""

from __future__ import annotations

import re
from collections import abc

_SHORT = {
    "calcn": "heel bone",
    "mtp_angle": "toe angle",
    "arm_flex": "arm flexion",
    "arm_add": "arm adduction",
    "arm_rot": "arm rotation",
    "elbow_flex": "elbow flexion",
    "pro_sup": "forearm rotation",
    "inter_hip": "distance between the hips",
}
"""Names of OpenSim's models and of this program that are no words."""

_OF_PARAMETERS = {"scale": "length", "axis": "axis", "centre": "centre"}
_PART = re.compile(r"(?:[a-z]+_)+[rl]|plate_\d+")  # of body or laboratory, and no marker's label


def number(value: float | None, digits: int = 1) -> str:
    """A number as shown, a dash where there is none."""
    return "–" if value is None else f"{value:.{digits}f}"


def format_signed(value: float | None, digits: int = 1) -> str:
    """A difference as shown, with its sign."""
    return "–" if value is None else f"{value:+.{digits}f}"


def describe_spans(spans: abc.Iterable[tuple[float, float]]) -> str:
    """Where along a cycle something holds.

    Examples
    --------
    >>> describe_spans([(10.0, 32.0)]), describe_spans([])
    ('10–32', 'nowhere')
    """
    return ", ".join(f"{start:.0f}–{end:.0f}" for start, end in spans) or "nowhere"


def unite_keys(mappings: abc.Iterable[abc.Mapping[str, object]]) -> list[str]:
    """All keys, in the order in which they first appear."""
    return list(dict.fromkeys(name for mapping in mappings for name in mapping))


def spell_name(name: str) -> str:
    """A coordinate's, joint's or segment's name for people.

    Examples
    --------
    >>> spell_name("hip_flexion_r"), spell_name("arm_flex_l")
    ('hip flexion, right', 'arm flexion, left')
    """
    stem, _, side = name.rpartition("_")
    if stem and side in ("r", "l"):
        return f"{spell_name(stem)}, {'right' if side == 'r' else 'left'}"
    return _SHORT.get(name, name.replace("_", " "))


def spell_place(name: str) -> str:
    """A part of body or laboratory within a sentence; labels of markers stay.

    Examples
    --------
    >>> spell_place("hip_r"), spell_place("plate_1"), spell_place("RKNE")
    ('right hip', 'plate 1', 'RKNE')
    """
    words, _, side = spell_name(name).partition(", ") if _PART.fullmatch(name) else (name, "", "")
    return f"{side} {words}".strip()


def spell_parameters(names: abc.Iterable[str]) -> list[str]:
    """Numbers of a model for people: what of which part; components of one place once.

    Examples
    --------
    >>> spell_parameters(["scale.femur_l", "centre.hip_r.x", "centre.hip_r.z"])
    ["the left femur's length", "the right hip's centre"]
    """
    found = []
    for name in names:
        group, _, place = name.partition(".")
        words, _, side = spell_name(place.split(".")[0]).partition(", ")
        known = group in _OF_PARAMETERS and place
        found.append(f"the {side + ' ' if side else ''}{words}'s {_OF_PARAMETERS[group]}" if known else name)
    return list(dict.fromkeys(found))
