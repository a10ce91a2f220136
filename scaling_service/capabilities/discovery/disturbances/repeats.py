"""Frames that are shown again: for a moment all markers stand still, and then leap to where they should be.

The pose follows them, so nothing shows among the markers, but no plate feels the body halt. A push of any
course somewhere seems to explain it. With such frames left out the forces agree.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from scaling_service.capabilities.discovery.disturbances.disturbance import Disturbance, DisturbanceLaw
from scaling_service.capabilities.discovery.evidence.fit import Fit
from scaling_service.capabilities.discovery.evidence.statistics import assess_share
from scaling_service.capabilities.discovery.observations.oscillator import differentiate_places
from scaling_service.capabilities.discovery.observations.tracked import ROLES, TrackedTrial
from scaling_service.numerics.multibody.laws import Array

_MISSING = 0.5  # of a step, from which a frame is the one before rather than the next (chosen: half way)


@dataclass(frozen=True, slots=True, eq=False)
class _Steps:
    """What all markers do together from one frame to the next, beside their smooth course."""

    along: Array  # (n - 1,), m2: squares of what they do along their paths, by one share for all
    across: Array  # (n - 1,), m2: what a number of any other direction of the pose has of these squares
    share: Array  # (n - 1,): of a step that they do too much

    @classmethod
    def of(cls, item: TrackedTrial) -> _Steps:
        """As the model's markers show it."""
        places = item.places
        velocity = differentiate_places(places, item.step)[0].reshape(len(places), -1)
        way = 0.5 * item.step * (velocity[1:] + velocity[:-1])
        off = np.diff(places.reshape(len(places), -1), axis=0) - way
        size, common = np.square(way).sum(axis=1) + 1e-300, (off * way).sum(axis=1)
        along = common**2 / size
        across = (np.square(off).sum(axis=1) - along) / (float(item.task.free.sum()) - 1.0)
        return cls(along, across, common / size)

    @property
    def shown_again(self) -> NDArray[np.bool_]:
        """Frames that are the ones before, (n,)."""
        stands = (self.share < -_MISSING) & (self.along > self.across.mean())
        return np.concatenate([[False], stands])

    def leave_out(self, item: TrackedTrial) -> TrackedTrial:
        """The motion as the other frames have it."""
        frames = np.arange(len(item.q))
        new = ~self.shown_again
        return replace(item, q=np.stack([np.interp(frames, frames[new], q[new]) for q in item.q.T], axis=1))


def find_repeated_frames(fit: Fit) -> Iterator[Disturbance]:
    """What forces agree better by without frames that are shown again."""
    steps = {item.name: _Steps.of(item) for item in fit.tracked}
    fitting = [item for item in fit.wrenches if item.role == "fit"]
    again = np.concatenate([steps[item.name].shown_again for item in fitting] or [np.zeros(0, bool)])
    if not again.any():
        return
    of_role = [[item for item in fit.tracked if item.role == role] for role in ROLES]
    p, held_out = (_test_direction(items or of_role[0], steps, fit.settings.block_s) for items in of_role)
    without = [
        replace(item, tracked=steps[item.name].leave_out(item.tracked), known_covariance=item.covariance)
        for item in fitting
    ]
    gain = sum(item.square - other.square for item, other in zip(fitting, without, strict=True))
    law = f"frames are shown again, {100.0 * again.mean():.2g} % of them: all markers stand still together"
    yield Disturbance(where=("markers",), law=law, expected=gain, p=p, held_out=held_out, seen_in="wrench")


def _test_direction(items: Sequence[TrackedTrial], steps: dict[str, _Steps], block_s: float) -> float:
    """How likely any other direction has as much, each block being as good as one frame."""
    blocks = float(sum(len(list(item.blocks(block_s))) for item in items))
    along, across = (sum(float(getattr(steps[i.name], k).sum()) for i in items) for k in ("along", "across"))
    return assess_share(along, across, blocks)


LAWS = (DisturbanceLaw(search=find_repeated_frames),)
