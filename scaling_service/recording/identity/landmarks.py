"""The landmarks of the whole body that laboratories mark: the model's own and more."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache

from scaling_service.model import body
from scaling_service.model.builtin import load_builtin

_MODEL = "full_body_35dof"
STATURE_M = 1.762  # of that model

MORE: Mapping[str, tuple[str, tuple[float, float, float]]] = {
    "GT": ("femur", (-0.005, -0.010, 0.085)),
    "THI": ("femur", (0.000, -0.250, 0.100)),
    "TUB": ("tibia", (0.040, -0.055, 0.000)),
    "SHK": ("tibia", (0.000, -0.200, 0.060)),
    "CREST": ("pelvis", (-0.055, 0.085, 0.145)),
    "HLAT": ("calcn", (-0.045, -0.045, 0.032)),
    "HMED": ("calcn", (-0.040, -0.040, -0.033)),
    "HTOP": ("calcn", (-0.065, -0.005, 0.000)),
    "NAV": ("calcn", (0.045, -0.025, -0.035)),
    "B1": ("calcn", (0.080, -0.010, -0.020)),
    "B5": ("calcn", (0.060, -0.050, 0.040)),
    "HLX": ("calcn", (0.165, -0.045, -0.020)),
}
"""Where laboratories put markers beside the model's own, on the right, m in the segment's frame: greater
trochanter, tuberosity and iliac crest (Rajagopal 2016's bones), a thigh's and a shank's wand, heel,
navicular, bases of the first and fifth metatarsal and big toe (outline of a foot of .152 of stature, Winter
2009; its back half-way along about 65 mm above the floor, McPoil et al. 2008).
Chosen to 10 mm: they take the labels that lie there from the landmarks beside them."""

_NOT_MARKED = ("L3",)  # of the model's markers: a sacral marker lies as near to it


def list_landmarks() -> tuple[str, ...]:
    """The landmarks of the body."""
    return read_body().marker_names


@cache
def read_body() -> body.BodyModel:
    """The whole-body model with these landmarks as its markers."""
    model = load_builtin(_MODEL)
    own = [m for m in model.markers if m.weight > 0.0 and m.name not in _NOT_MARKED]
    sacral = body.Marker.at("SACR", "pelvis", (-0.155, 0.0, 0.0))
    more = [
        body.Marker.at(
            f"{side}{name}",
            segment if segment == "pelvis" else f"{segment}_{side.lower()}",
            (x, y, z if side == "R" else -z),
        )
        for name, (segment, (x, y, z)) in MORE.items()
        for side in "RL"
    ]
    return model.with_markers((*own, sacral, *more))
