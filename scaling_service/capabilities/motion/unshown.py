"""Coordinates that no marker shows, told as such: a model holds them at a value that is nobody's angle."""

from __future__ import annotations

import numpy as np

from scaling_service.core.arrays import Array
from scaling_service.model.body import BodyModel
from scaling_service.model.builtin import list_unmarked
from scaling_service.model.results import Motion


def list_unshown_names(motion: Motion, model: BodyModel) -> frozenset[str]:
    """The coordinates that a motion shows in no frame; those that the model itself locks are known."""
    locked = {c.name for c in model.coordinates if c.locked} - list_unmarked(model)
    return frozenset(motion.coordinates) - locked - set(motion.estimated)


def hide_unshown(motion: Motion, model: BodyModel, values: Array, by: float = np.nan) -> Array:
    """Values of coordinates (n_frames, n_coordinates), another in place of those that are never shown."""
    hidden = list_unshown_names(motion, model)
    return np.where([name in hidden for name in motion.coordinates], by, values)
