"""When a segment stands on the floor, told by its own markers."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from scaling_service.capabilities.discovery.evidence.watched import Watched
from scaling_service.numerics.multibody.laws import Array
from scaling_service.numerics.multibody.tree import forward, positions

_LOW = 0.05  # quantile of heights at which a segment stands
_NEAR_M = 0.015  # m; chosen: a foot that rolls over the floor keeps its middle so near its lowest
_RISES_M = 0.05  # m; chosen: a foot that steps rises more
_FLOOR_M = 0.2  # m; chosen: the middle of a standing foot's markers is lower


def stands(item: Watched, markers: Sequence[str]) -> bool:
    """Whether a segment with these markers comes down to the floor and leaves it again."""
    height = _height(item, markers)
    low = float(np.quantile(height, _LOW))
    return low < _FLOOR_M and float(height.max()) - low > _RISES_M


def since_down(item: Watched, markers: Sequence[str]) -> Array:
    """Time since the segment came down, (n,), s; zero while it is off the floor."""
    height = _height(item, markers)
    down = height < np.quantile(height, _LOW) + _NEAR_M
    frames = np.arange(len(down))
    last_up = np.maximum.accumulate(np.where(down, -1, frames))
    step = float(np.median(np.diff(item.trial.times)))
    return np.where(down, (frames - last_up) * step, 0.0)


def _height(item: Watched, markers: Sequence[str]) -> Array:
    """Of the middle of the markers, (n,), m."""
    tree = item.task.tree
    placed = positions(tree, forward(tree, np.ascontiguousarray(item.q.T), item.task.p))
    at = [item.markers.index(m) for m in markers if m in item.markers]
    return np.asarray(placed[at, 1].mean(axis=0)) if at else np.zeros(len(item.q))
