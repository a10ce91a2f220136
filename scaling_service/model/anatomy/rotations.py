"""Whose rotation a measured one is, by its label, and how far such rotations are off in people."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np

from scaling_service.core.arrays import Array
from scaling_service.model import reference
from scaling_service.model.anatomy.lengths import find_segment
from scaling_service.model.body import BodyModel

_ENDINGS = re.compile(r"(_4x4|[_ ]?imu|_sensor)$", re.IGNORECASE)
_RADIUS = "radius"
_SIDES = (
    re.compile(r"(?P<side>left|right|l|r)[_ ]?(?P<part>.+)"),
    re.compile(r"(?P<part>.+?)[_ ]?(?P<side>left|right|l|r)"),
)
"""A side before or behind the name of a part."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class RotationTable:
    """``reference_models/rotations.yaml``: labels, axes, and deviations in rad and m."""

    parts: Mapping[str, str]
    ignored: Sequence[str]
    axes: Array  # (3, 3): maps a vector in a markerless system's segment to one in ours
    total: float
    lasting: float
    passing: float
    centre: float


@cache
def read_rotation_table() -> RotationTable:
    """The table of ``reference_models/rotations.yaml``.

    Examples
    --------
    >>> read_rotation_table().parts["shank"]
    'tibia'
    """
    table: Mapping[str, Any] = reference.read_reference(reference.find_reference_folder() / "rotations.yaml")
    off = table["deviations"]
    return RotationTable(
        parts=table["segments"],
        ignored=table["ignored"],
        axes=np.array(table["axes"]["segments"], dtype=float),
        total=float(np.radians(off["total_deg"])),
        lasting=float(np.radians(off["lasting_deg"])),
        passing=float(np.radians(off["passing_deg"])),
        centre=1e-3 * float(off["centre_mm"]),
    )


def match_rotation(label: str, model: BodyModel) -> str | None:
    """The segment of a model that a label names; None where it names none.

    The model's own names come first, with or without ``_imu`` behind, as OpenSense has them.

    Examples
    --------
    >>> from scaling_service.model.builtin import load_builtin
    >>> body = load_builtin("lower_limb_14dof")
    >>> [match_rotation(label, body) for label in ("r_thigh_4X4", "tibia_l_imu", "S1:pelvis", "r_hand_4X4")]
    ['femur_r', 'tibia_l', 'pelvis', None]
    >>> [match_rotation(label, body) for label in ("RightUpperLeg", "shank_left", "lowerleg_r_imu", "IMU03")]
    ['femur_r', 'tibia_l', 'tibia_r', None]
    """
    plain = _make_plain(label)
    own = {name.lower(): name for name in model.segment_names}
    if plain in own:
        return own[plain]
    table = read_rotation_table()
    if plain in table.ignored:
        return None
    read = [("", plain), *((m["side"][0], m["part"]) for one in _SIDES if (m := one.fullmatch(plain)))]
    known = ((side, table.parts.get(re.sub("[_ ]", "", name))) for side, name in read)
    side, part = next(((side, part) for side, part in known if part is not None), ("", None))
    if part == _RADIUS:  # a model without one has the whole forearm as the ulna
        return own.get(f"{_RADIUS}_{side}") or find_segment(model, "ulna", side)
    return None if part is None else find_segment(model, part, side)


def is_ignored(label: str) -> bool:
    """Whether a label is of a frame that is no segment's: the laboratory's, or another program's."""
    return _make_plain(label) in read_rotation_table().ignored


def _make_plain(label: str) -> str:
    """A label without its subject, path and ending, in lower case."""
    return _ENDINGS.sub("", label.rpartition(":")[2].strip().rpartition("/")[2]).lower()
