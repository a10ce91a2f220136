"""What the calibration could have explained, as effects of size zero for the search to move along."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from scaling_service.capabilities.discovery.effects.catalogue import candidates
from scaling_service.capabilities.discovery.laws.candidates import Candidate, Estimate
from scaling_service.capabilities.discovery.laws.scene import Scene
from scaling_service.capabilities.scaling.methods.optimised import Optimised
from scaling_service.capabilities.scaling.methods.table import METHODS
from scaling_service.capabilities.shared.settings import CalibrationSettings
from scaling_service.model.body import BodyModel, Parameter
from scaling_service.model.trial import Trial
from scaling_service.numerics.least_squares.masks import ever, seen

NOTE = "as calibrated"
"""Marks them, so that they are not taken for effects that were named."""

_SOURCES = {"length": "segment_length", "axis": "joint_axis_tilt", "marker": "marker_offset"}
"""The group of a calibration's parameter to the effect that is the same change."""


def free_of(
    method: str, model: BodyModel, trials: Sequence[Trial], settings: CalibrationSettings
) -> tuple[Estimate, ...]:
    """The numbers that a method frees, at zero.

    Parameters
    ----------
    method : str
        A key of ``METHODS``. Only optimised methods free anything.
    model : BodyModel
        As calibrated, without parameters.
    trials : sequence of Trial
        Those that calibrated it.
    settings : CalibrationSettings
    """
    row = METHODS[method]
    if not isinstance(row, Optimised):
        return ()
    shown = frozenset(
        label for t in trials for label, once in zip(t.labels, ever(seen(t.markers)), strict=True) if once
    )
    freed = row.freedom.apply(model, shown, settings)
    return tuple(_of(Scene(model, _marked(model, shown), (), ()), freed.parameters))


def _marked(model: BodyModel, shown: frozenset[str]) -> tuple[str, ...]:
    return tuple(m.name for m in model.markers if m.name in shown and m.weight > 0.0)


def _of(scene: Scene, parameters: Sequence[Parameter]) -> Iterator[Estimate]:
    """One candidate for each thing that was freed, with the columns of its free numbers."""
    free: dict[tuple[str, str], set[str]] = {}
    for parameter in parameters:
        free.setdefault((parameter.group, parameter.target), set()).add(parameter.name[-1])
    for (group, target), letters in free.items():
        for candidate in candidates(scene, [_SOURCES[group]]):
            if candidate.where == (target,):
                kept = _kept(candidate, letters, group)
                yield Estimate(kept, np.zeros(len(kept.columns)))


def _kept(candidate: Candidate, letters: set[str], group: str) -> Candidate:
    """The columns that were free; a size has one, whatever its letter."""
    columns = tuple(c for c in candidate.columns if group == "length" or c.name[0] in letters)
    return replace(candidate, columns=columns, note=NOTE)
