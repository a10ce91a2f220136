"""Skin as an oscillator that the segment drives: ``u'' + 2 z w u' + w^2 u = -a``."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from scaling_service.capabilities.discovery.evidence.standing import since_down
from scaling_service.capabilities.discovery.evidence.watched import Watched
from scaling_service.capabilities.discovery.laws.oscillator import oscillate, pulled
from scaling_service.capabilities.discovery.laws.profiles import Constant, Following, Profile, Standing, Swing
from scaling_service.numerics.multibody.laws import Array
from scaling_service.numerics.multibody.tree import forward, positions

TRIED = tuple((f, z) for f in (3.0, 4.5, 6.5, 9.0, 13.0, 18.0) for z in (0.1, 0.3))
"""Frequencies (Hz) and damping ratios tried first; the best is tuned (chosen: from the slow sway of heavy
tissue to the quick one of a marker on thin skin, lightly and well damped)."""


@dataclass(frozen=True, eq=False)
class Skin:
    """What drives the skin of one recording.

    Parameters
    ----------
    item : Watched
    """

    item: Watched

    @property
    def step(self) -> float:
        """Time from frame to frame, s."""
        return float(np.median(np.diff(self.item.trial.times)))

    @cached_property
    def _placed(self) -> tuple[Array, Array]:
        tree = self.item.task.tree
        poses = forward(tree, np.ascontiguousarray(self.item.q.T), self.item.task.p)
        return np.moveaxis(positions(tree, poses), -1, 0), poses.axes[tree.marker_link]

    @property
    def places(self) -> Array:
        """Of the bone under every marker, (n, n_markers, 3), m, ground."""
        return self._placed[0]

    @cached_property
    def _pull(self) -> Array:
        """Minus the acceleration under every marker, (n, n_markers, 3), m/s2, ground."""
        return pulled(self.places, self.step)

    def local_swing(self, frequency_hz: float, damping: float) -> Array:
        """How far every marker moves, steady at first, (n, n_markers, 3), m, in the axes of its segment."""
        swing = oscillate(self._pull, self.step, frequency_hz, damping)[0]
        return np.asarray(np.einsum("majn,nmj->nma", self._placed[1], swing))


def shapes(profiles: Sequence[Profile], item: Watched) -> Array:
    """Profiles in every frame of a recording, (n_profiles, n_frames)."""
    names, n = item.task.model.coordinate_names, len(item.q)
    skin = Skin(item)
    tried = {(p.frequency_hz, p.damping) for p in profiles if isinstance(p, Swing)}
    swings = {pair: skin.local_swing(*pair) for pair in sorted(tried)}
    found = np.ones((len(profiles), n))
    for k, profile in enumerate(profiles):
        if isinstance(profile, Following):
            found[k] = item.q[:, names.index(profile.coordinate)]
        elif isinstance(profile, Swing):
            found[k] = _swung(swings[profile.frequency_hz, profile.damping], item, profile)
        elif isinstance(profile, Standing):
            found[k] = since_down(item, profile.markers)
        else:
            assert isinstance(profile, Constant)
    return found


def _swung(swing: Array, item: Watched, profile: Swing) -> Array:
    if profile.marker not in item.markers:
        return np.zeros(len(swing))
    return np.asarray(swing[:, item.markers.index(profile.marker), profile.axis])
