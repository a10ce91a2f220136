"""What an optimisation-based method frees: lengths, knee axes, marker coordinates (Puchaud 2019, table 1)."""

from __future__ import annotations

import math
from dataclasses import dataclass

from scaling_service.anatomy.markers import canonical
from scaling_service.calibration.settings import CalibrationSettings
from scaling_service.models.body import BodyModel
from scaling_service.models.parameters import free_axis, free_marker, free_scale

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


@dataclass(frozen=True, slots=True)
class Freedom:
    """Whether segment lengths are free, and whether all marker coordinates are or only table 1's."""

    lengths: bool
    all_markers: bool

    def apply(self, model: BodyModel, seen: frozenset[str], settings: CalibrationSettings) -> BodyModel:
        """The model with its parameters freed.

        Only what the recordings can speak of is freed: markers that were seen, and sizes of
        segments that carry such markers.

        Parameters
        ----------
        seen : frozenset of str
            Markers seen in the calibration frames.
        """
        carrying = {m.segment for m in model.markers if m.name in seen and m.weight > 0.0}
        if self.lengths:
            for segment in model.segments:
                if segment.name in carrying:
                    model = free_scale(model, segment.name, settings.length_bound, settings.length_sd)
        bounds = (math.radians(settings.axis_bound_x_deg), math.radians(settings.axis_bound_y_deg))
        for joint in knee_joints(model):
            model = free_axis(model, joint, *bounds, math.radians(settings.axis_sd_deg))
        for marker in model.markers:
            if marker.name in seen and marker.weight > 0.0:
                axes = "xyz" if self.all_markers else selected_coordinates(marker.name)
                if axes:
                    model = free_marker(
                        model, marker.name, axes, settings.marker_bound_m, settings.marker_sd_m
                    )
        return model


def selected_coordinates(marker: str) -> str:
    """The local coordinates that MB_lam frees for a marker, whatever its alias."""
    landmark = canonical(marker)
    if landmark is None:
        return OTHER_COORDINATES
    return SELECTED_COORDINATES.get(landmark[1:], OTHER_COORDINATES)


def knee_joints(model: BodyModel) -> tuple[str, ...]:
    """The joints between thigh and shank: those that lead to a segment called ``tibia…``."""
    return tuple(
        s.joint_name
        for s in model.segments
        if s.name.startswith("tibia")
        and any(j.kind == "rotation" and not j.law.is_constant for j in s.joints)
    )
