"""A second effect turned so that it works against the first, at the same place."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from tests.blind.body import Body
from tests.blind.hidden import Hidden

TYPICAL_DEG = 20.0
"""Of a driving joint angle (chosen: half the range of hip flexion in gait)."""


def against(first: Hidden, second: Hidden, body: Body) -> Hidden:
    """The second effect at the place of the first, of opposite sign, and as large as it was drawn."""
    return _TURNED[first.kind, second.kind](first, second, body)


def _artefact(first: Hidden, second: Hidden, body: Body) -> Hidden:
    """The skin takes the marker back where it should be as the joint bends."""
    size = np.linalg.norm(list(second.parameters.values()))
    offset = np.array([first.parameters[f"{a}_mm"] for a in "xyz"])
    gain = -size * offset / np.linalg.norm(offset)
    name = first.where[0]
    segment = body.marker(name).segment
    side = name[0].lower()
    driver = f"{'knee_angle' if segment.startswith('tibia') else 'hip_flexion'}_{side}"
    parameters = {f"{a}_mm_per_deg": float(v) for a, v in zip("xyz", gain, strict=True)}
    return replace(second, where=(name,), driver=(driver,), parameters=parameters)


def _bias(first: Hidden, second: Hidden, body: Body) -> Hidden:
    """The constant pulls down what the gain pushes up."""
    size = np.linalg.norm(list(second.parameters.values()))
    fy = -float(np.sign(first.parameters["factor"] - 1) * size)
    return replace(second, where=first.where, parameters={"fx_N": 0.0, "fy_N": fy, "fz_N": 0.0})


def _rotation(first: Hidden, second: Hidden, body: Body) -> Hidden:
    """The same plate, turned against the sign of its sideways shift."""
    angle = abs(second.parameters["about_vertical_deg"])
    turned = -float(np.sign(first.parameters["z_mm"]) * angle)
    return replace(second, where=first.where, parameters={"about_vertical_deg": turned})


_TURNED = {
    ("marker_offset", "soft_tissue_artefact"): _artefact,
    ("plate_gain", "plate_bias"): _bias,
    ("plate_position", "plate_rotation"): _rotation,
}
