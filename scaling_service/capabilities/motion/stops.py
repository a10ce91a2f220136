"""Joints that stand at the end of their range: the model decides there, and not the markers."""

from __future__ import annotations

from collections import abc

import numpy as np

from scaling_service.core.names import spell_name
from scaling_service.model import body
from scaling_service.model import compile as compiling
from scaling_service.model.results import Motion

_LONG = 0.1
"""Share of a recording from which on a stop is told. Chosen: a tenth shows in means and ranges."""


def describe_stops(model: body.BodyModel, motions: abc.Mapping[str, Motion]) -> list[str]:
    """A sentence for each joint that stands at one end of its range for long, in the recording where longest.

    Examples
    --------
    >>> from scaling_service.model.builtin import load_builtin
    >>> describe_stops(load_builtin("lower_limb_14dof"), {})
    []
    """
    bounds = compiling.list_coordinate_bounds(model)
    ranges, said = compiling.list_kept_ranges(model), list[str]()
    for k, coordinate in enumerate(model.coordinates):
        for side, sign in ((0, -1.0), (1, 1.0)) if coordinate.name in ranges else ():
            shares = {
                trial: float(np.mean(sign * motion.column(coordinate.name) >= sign * bounds[side][k]))
                for trial, motion in motions.items()
                if coordinate.name in motion.estimated
            }
            longest = max(shares, key=lambda trial: shares[trial], default="")
            if shares.get(longest, 0.0) < _LONG:
                continue
            unit, digits = ("deg", 0) if coordinate.kind == "rotation" else ("m", 3)
            joint, _, where = spell_name(coordinate.name).partition(", ")
            more = sum(share >= _LONG for share in shares.values()) - 1
            stop = f"{ranges[coordinate.name][side]:.{digits}f} {unit}"
            also = f", and in {more} more" if more else ""
            said.append(
                f"{longest}: {where}{' ' * bool(where)}{joint} stands at its stop, {stop}, for "
                f"{shares[longest]:.0%} of the recording{also}: there the model's range "
                "decides, not the markers"
            )
    return said
