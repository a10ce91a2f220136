"""The numbers of Puchaud et al. 2019, from ``reference_models``."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache

import numpy as np
import yaml

from scaling_service.model.reference import reference_folder

METHODS = ("MB", "MB_lam", "MB_am", "EB", "EB_am")
"""The five models, in the order of the paper's figures."""

LENGTHS = ("femur_r", "femur_l", "inter_hip", "shank_r", "shank_l")
"""The rows of table 2."""

AXES = ("r_x", "r_y", "l_x", "l_y")
"""Turns of the knee axes, as in table 3."""

SAME_LENGTHS: Mapping[str, str] = {"MB_am": "MB", "EB_am": "EB"}
"""Methods that keep the lengths of their first guess share its column in table 2."""

_MM = 1e-3


@dataclass(frozen=True, slots=True)
class Spread:
    """Mean and standard deviation over subjects, m or rad."""

    mean: float
    sd: float


Table = Mapping[str, Mapping[str, Spread]]
"""Method to quantity to its spread."""


@dataclass(frozen=True, slots=True)
class Paper:
    """What the paper found."""

    source: str
    lengths: Table  # table 2, m
    differs_from_EB: Mapping[str, Mapping[str, str]]  # method to length to stars, where table 2 has any
    knee_axes: Table  # table 3, rad
    errors: Mapping[str, Spread]
    shifts: Mapping[str, Spread]
    """``errors``, ``shifts``: method to kinematic error (figure 5) and marker shift (section 3.1), m."""
    length_differences: Table  # method minus EB (figure 4), m
    literature_errors: Mapping[str, float]
    table5_errors: Mapping[str, float]
    """``literature_errors``, ``table5_errors``: table 5: study to its mean kinematic error, and the
    paper's own by method, m."""


@cache
def paper() -> Paper:
    """The paper's numbers, read once."""
    content = yaml.safe_load((reference_folder() / "puchaud2019.yaml").read_text(encoding="utf-8"))
    lengths = content["segment_lengths_mm"]
    table = _table({m: lengths[SAME_LENGTHS.get(m, m)] for m in METHODS}, _MM)
    return Paper(
        source=" ".join(content["source"].split()),
        lengths=table,
        differs_from_EB=lengths["differs_from_EB"],
        knee_axes=_table(content["knee_axis_deg"], float(np.pi / 180.0)),
        errors=_spreads(content["kinematic_error_mm"], _MM),
        shifts=_spreads(content["marker_shift_mm"], _MM),
        length_differences=_table(content["length_difference_mm"], _MM),
        literature_errors={who: _MM * value for who, value in content["literature_error_mm"].items()},
        table5_errors={method: _MM * value for method, value in content["table5_error_mm"].items()},
    )


def _table(content: Mapping[str, Mapping[str, list[float]]], unit: float) -> dict[str, dict[str, Spread]]:
    return {method: _spreads(row, unit) for method, row in content.items()}


def _spreads(content: Mapping[str, list[float]], unit: float) -> dict[str, Spread]:
    return {name: Spread(unit * mean, unit * sd) for name, (mean, sd) in content.items()}
