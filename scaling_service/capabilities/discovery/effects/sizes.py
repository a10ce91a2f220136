"""Sizes of effects that laboratories meet, each with its source: ``reference_models/effect_sizes.yaml``."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
import scipy

from scaling_service.capabilities.discovery.laws.candidates import SHAPES, Candidate
from scaling_service.capabilities.discovery.ordinary.body import find_part
from scaling_service.core.arrays import Array
from scaling_service.model.body import BodyModel
from scaling_service.model.inertia import sum_mass
from scaling_service.model.reference import find_reference_folder, read_reference

_LIMBS = ("legs", "arms")
_HARDLY = 0.025  # probability of a size that is met, below which it is not (one tail of 95 %)


@dataclass(frozen=True, slots=True)
class Range:
    """Of a number as the results call it."""

    low: float
    high: float

    def chance(self, value: float, sd: float) -> float:
        """Probability that a normal number lies in it."""
        if sd <= 0.0:
            return float(self.low <= value <= self.high)
        return float(
            scipy.special.ndtr((self.high - value) / sd) - scipy.special.ndtr((self.low - value) / sd)
        )


def look_up_usual_sizes(candidate: Candidate, model: BodyModel) -> Callable[[str], Range | None]:
    """By its name in the results, the range of a number that laboratories meet; None where none is known."""
    of_kind, where = _read_sizes().get(candidate.kind, {}), candidate.where
    own = next((s for s in model.segments if s.name == where[0]), None)
    units = {"of_body": sum_mass(model), "of_segment": own.mass if own else 0.0, "sizes": 1.0}
    if own is not None and find_part(model.bone_of(own.name)) in _LIMBS:
        units = {"of_limb": 1.0, **units}

    def look_up(name: str) -> Range | None:
        for table, unit in units.items():
            ranges = of_kind.get(table, {})
            found = ranges.get(name) or next((r for k, r in ranges.items() if name.endswith(f"_{k}")), None)
            if found is not None:
                return Range(unit * found[0], unit * found[1])
        return None

    return look_up


def cite_source_of_sizes(kind: str) -> str:
    """Where the sizes of a kind come from."""
    return str(_read_sizes()[kind]["source"])


@cache
def _read_sizes() -> Mapping[str, Any]:
    found: Mapping[str, Any] = read_reference(find_reference_folder() / "effect_sizes.yaml")
    return found


def list_usual_deviations(candidate: Candidate, model: BodyModel) -> Array | None:
    """Prior standard deviations of a candidate's numbers about nothing, SI: half of how far 95 of 100 go.

    Where that is not known, half of what the search allows; None of what has neither.
    """
    usual, found = look_up_usual_sizes(candidate, model), []
    for column in candidate.columns:
        known = usual(column.name) or Range(column.low, column.high)
        far = max(abs(known.low - column.neutral), abs(known.high - column.neutral))
        found.append(0.5 * far / column.unit)
    sds = np.array(found)
    return sds if len(sds) and np.isfinite(sds).all() and (sds > 0.0).all() else None


def settle_size(candidate: Candidate, size: Array, covariance: Array, model: BodyModel) -> Array | None:
    """A size (SI) with deviations, given that laboratories meet it: the mean within the ranges.

    None where it lies beyond a range by more than it is uncertain: then it is something else.
    """
    usual, found = look_up_usual_sizes(candidate, model), size.copy()
    for k, (column, sd) in enumerate(zip(candidate.columns, np.sqrt(np.diag(covariance)), strict=True)):
        known, shown = usual(column.name), column.neutral + column.unit * size[k]
        if known is None or known.low <= shown <= known.high:
            continue
        spread = abs(column.unit) * float(sd)
        chance = known.chance(shown, spread)
        if chance < _HARDLY:
            return None
        ends = scipy.stats.norm.pdf([(known.low - shown) / spread, (known.high - shown) / spread])
        found[k] += (ends[0] - ends[1]) * spread / (chance * column.unit)
    return found


def is_met(candidate: Candidate, size: Array, model: BodyModel) -> bool:
    """Whether laboratories meet every number of an effect (SI)."""
    usual = look_up_usual_sizes(candidate, model)
    for name, shape in zip(SHAPES, candidate.oscillation or (), strict=False):
        of_shape = usual(name)
        if of_shape is not None and not of_shape.low <= shape <= of_shape.high:
            return False
    for column, value in zip(candidate.columns, size.tolist(), strict=True):
        known, shown = usual(column.name), column.neutral + column.unit * value
        if known is not None and not known.low <= shown <= known.high:
            return False
    return True
