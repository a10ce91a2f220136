"""Names of body, model and laboratory as people say them.

Whoever writes a sentence says its names by these, so that terminal, page and files tell the same. Fields of
documents keep the model's own names, by which programs find them; so does what is to be written into a
file, which stands in quotes.
"""

from __future__ import annotations

import re
from collections import abc

from scaling_service.core.text import list_few

_SHORT = {
    "calcn": "heel bone",
    "mtp_angle": "toe angle",
    "arm_flex": "arm flexion",
    "arm_add": "arm adduction",
    "arm_rot": "arm rotation",
    "elbow_flex": "elbow flexion",
    "pro_sup": "forearm rotation",
    "wrist_flex": "wrist flexion",
    "wrist_dev": "wrist deviation",
    "inter_hip": "distance between the hips",
    "asis_width": "distance between the front iliac spines",
}
"""Names of OpenSim's models and of this program that are no words."""

_OF_PARAMETERS = {"scale": "length", "axis": "axis", "centre": "centre"}
_PART = re.compile(r"(?:[a-z]+_)+[rl]|plate_\d+")  # of body or laboratory, and no marker's label
_PLATE = re.compile(r"\bplate_(?=\d)")
_PLACE = re.compile(r"(.+)_t([xyz])")  # a coordinate of OpenSim that moves a segment


def spell_name(name: str) -> str:
    """A coordinate's, joint's or segment's name for people, as tables have it.

    Examples
    --------
    >>> spell_name("hip_flexion_r"), spell_name("arm_flex_l")
    ('hip flexion, right', 'arm flexion, left')
    >>> spell_name("pelvis_tx")
    'pelvis moving along x'
    """
    if moved := _PLACE.fullmatch(name):
        return f"{spell_name(moved[1])} moving along {moved[2]}"
    stem, _, side = name.rpartition("_")
    if stem and side in ("r", "l"):
        return f"{spell_name(stem)}, {'right' if side == 'r' else 'left'}"
    return _SHORT.get(name, name.replace("_", " "))


def say_name(name: str) -> str:
    """A coordinate's, joint's or segment's name within a sentence.

    Examples
    --------
    >>> say_name("hip_flexion_r"), say_name("torso")
    ('right hip flexion', 'torso')
    """
    words, _, side = spell_name(name).partition(", ")
    return f"{side} {words}".strip()


def say_names(names: abc.Iterable[str]) -> str:
    """Some of these names within a sentence, and how many more there are.

    Examples
    --------
    >>> say_names(["femur_r", "calcn_l"])
    'right femur, left heel bone'
    """
    return list_few([say_name(name) for name in names])


def say_foot(name: str) -> str:
    """A foot within a sentence, by the segment that stands for it.

    Examples
    --------
    >>> say_foot("calcn_r"), say_foot("foot")
    ('right foot', 'foot')
    """
    side = {"r": "right", "l": "left"}.get(name.rpartition("_")[2])
    return f"{side} foot" if side else say_name(name)


def say_place(name: str) -> str:
    """A part of body or laboratory within a sentence; labels of markers stay.

    Examples
    --------
    >>> say_place("hip_r"), say_place("plate_1"), say_place("RKNE")
    ('right hip', 'plate 1', 'RKNE')
    """
    return say_name(name) if _PART.fullmatch(name) else name


def say_plates(text: str) -> str:
    """Plates within what else is said of a place; labels of markers stay.

    Examples
    --------
    >>> say_plates("plate_2 fy"), say_plates("RKNE")
    ('plate 2 fy', 'RKNE')
    """
    return _PLATE.sub("plate ", text)


def say_sizes(sizes: abc.Mapping[str, float]) -> str:
    """Sizes of a person, each with its unit at the end of its name, within a sentence.

    Examples
    --------
    >>> say_sizes({"height_m": 1.732, "knee_width_r_mm": 104.0})
    'height 1.732 m, right knee width 104 mm'
    """
    named = ((*name.rpartition("_")[::2], value) for name, value in sizes.items())
    return ", ".join(f"{say_name(of)} {value:.4g} {unit}" for of, unit, value in named)


def say_parameters(names: abc.Iterable[str], *, components: bool = False) -> list[str]:
    """Numbers of a model for people: what of which part; each once.

    ``components``: whether to say which components of a place are meant.

    Examples
    --------
    >>> say_parameters(["scale.femur_l", "centre.hip_r.x", "centre.hip_r.z"])
    ["the left femur's length", "the right hip's centre"]
    >>> say_parameters(["centre.hip_r.x", "marker.r.ASIS.x", "centre.hip_r.z"], components=True)
    ["the right hip's centre (x, z)", 'marker r.ASIS (x)']
    """
    found: dict[str, list[str]] = {}
    for name in names:
        group, _, place = name.partition(".")
        stem, _, letter = place.rpartition(".")
        of, along = (stem, [letter]) if stem and letter in ("x", "y", "z") else (place, [])
        if group in _OF_PARAMETERS and of:
            said = f"the {say_name(of)}'s {_OF_PARAMETERS[group]}"
        else:
            said = f"marker {of}" if group == "marker" and of else name
        found.setdefault(said, []).extend(along)
    return [f"{said} ({', '.join(along)})" if components and along else said for said, along in found.items()]
