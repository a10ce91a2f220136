"""What an optimisation-based method frees: lengths, knee axes, marker coordinates (Puchaud 2019, table 1)."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

from scaling_service.capabilities.scaling.methods.per_axis import AXES
from scaling_service.capabilities.subject.settings import CalibrationSettings
from scaling_service.model.anatomy.markers import canonical
from scaling_service.model.body import BodyModel, Joint
from scaling_service.model.parameters import free_axis, free_marker, free_scale, free_scale_axes

SELECTED_COORDINATES = {
    "PSIS": "xz",
    "ASIS": "xz",
    "LFE": "",
    "MFE": "xz",
    "FH": "xz",
    "LM": "",
    "MM": "x",
}
"""Local coordinates that MB_lam frees, by landmark without its side (Puchaud 2019, table 1)."""

OTHER_COORDINATES = "xz"
"""For markers outside table 1. Chosen: as for most of its rows, never along the segment, where a shift
could not be told from a length."""

LEVEL_FOOT = {"all": "xz", "selected": "z"}
"""Of a foot that turns in two ways at the ankle: all but the heights in MB_am and EB_am, the breadth in
MB_lam, whose scale factor stands for x. Chosen: markers that may all turn about the ankle leave its angles
without a zero. On a recorded squat they drifted by 20 deg of dorsiflexion and inversion; with the heights
kept they did not, for 0.1 mm more of kinematic error (0.8 mm on the trial held out)."""

_FEET = ("calcn", "foot")

NO_SDS: Mapping[str, float] = MappingProxyType({})
"""No size is known."""


@dataclass(frozen=True, slots=True)
class Freedom:
    """Whether segment lengths are free, and whether all marker coordinates are or only table 1's."""

    lengths: bool
    all_markers: bool

    def apply(
        self,
        model: BodyModel,
        seen: frozenset[str],
        settings: CalibrationSettings,
        length_sds: Mapping[str, float] = NO_SDS,
    ) -> BodyModel:
        """The model with its parameters freed.

        Only what the recordings can speak of is freed: markers that were seen, and sizes of
        segments that carry such markers.

        Parameters
        ----------
        seen : frozenset of str
            Markers seen in the calibration frames.
        length_sds : mapping
            Segment to the relative standard deviation of its size so far; else the settings decide.
        """
        carrying = {m.segment for m in model.markers if m.name in seen and m.weight > 0.0}
        if self.lengths:
            for segment in model.segments:
                if segment.name in carrying:
                    known = length_sds.get(segment.name, settings.length_sd)
                    model = _freed_size(model, segment.name, settings, known)
        bounds = (math.radians(settings.axis_bound_x_deg), math.radians(settings.axis_bound_y_deg))
        for joint in tiltable_knees(model):
            model = free_axis(model, joint, *bounds, math.radians(settings.axis_sd_deg))
        level = level_feet(model)
        for marker in model.markers:
            if marker.name in seen and marker.weight > 0.0:
                axes = "xyz" if self.all_markers else selected_coordinates(marker.name)
                if marker.segment in level:
                    axes = LEVEL_FOOT["all" if self.all_markers else "selected"]
                if axes:
                    model = free_marker(
                        model, marker.name, axes, settings.marker_bound_m, settings.marker_sd_m
                    )
        return model


def _freed_size(model: BodyModel, segment: str, settings: CalibrationSettings, sd: float) -> BodyModel:
    spread = (settings.length_bound, sd)
    if settings.scaling == "per-axis" and segment in AXES:
        return free_scale_axes(model, segment, AXES[segment], *spread)
    return free_scale(model, segment, *spread)


def selected_coordinates(marker: str) -> str:
    """The local coordinates that MB_lam frees for a marker, whatever its alias."""
    landmark = canonical(marker)
    if landmark is None:
        return OTHER_COORDINATES
    return SELECTED_COORDINATES.get(landmark[1:], OTHER_COORDINATES)


def level_feet(model: BodyModel) -> frozenset[str]:
    """The feet that turn in two ways or more against their shank, in one joint."""
    return frozenset(
        s.name for s in model.segments if s.name.startswith(_FEET) and sum(map(_is_turning, s.joints)) > 1
    )


def tiltable_knees(model: BodyModel) -> tuple[str, ...]:
    """The knees whose axis says something: all orientations are open to three turns, however tilted."""
    turns = {s.joint_name: sum(map(_is_turning, s.joints)) for s in model.segments}
    return tuple(joint for joint in knee_joints(model) if turns[joint] < 3)


def _is_turning(joint: Joint) -> bool:
    return joint.kind == "rotation" and not joint.law.is_constant


def knee_joints(model: BodyModel) -> tuple[str, ...]:
    """The joints between thigh and shank: those that lead to a segment called ``tibia…``."""
    return tuple(
        s.joint_name for s in model.segments if s.name.startswith("tibia") and any(map(_is_turning, s.joints))
    )
