"""What two force plates under the feet say, and what is done to it on the way into a file."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from tests.blind.body import Array

RATE_HZ = 500.0
"""Chosen: five samples per frame; laboratories use 1000 Hz, which would only make the files larger."""

CONTACT_N = 20.0
"""Below this laboratories' exports hold zeros: the centre of pressure means nothing there."""

PLATE_NAMES = ("plate_1", "plate_2")
"""Under the right and the left foot."""


@dataclass(frozen=True)
class Plates:
    """Both plates; the floor is y = 0.

    Parameters
    ----------
    times : ndarray, shape (n,), s
    force : ndarray, shape (n, 2, 3), N
        On the person.
    moment : ndarray, shape (n, 2, 3), N m
        About the ground origin.
    """

    times: Array
    force: Array
    moment: Array

    @classmethod
    def from_wrenches(cls, times: Array, wrenches: Array) -> Plates:
        """From (n, 2, 6)."""
        return cls(times, wrenches[..., :3], wrenches[..., 3:])

    @property
    def loaded(self) -> Array:
        """Where a plate bears a foot, (n, 2)."""
        return np.asarray(self.force[..., 1] > CONTACT_N)

    def pressed(self) -> Array:
        """Centres of pressure, (n, 2, 3), m; NaN where not loaded."""
        fy = np.where(self.loaded, self.force[..., 1], np.nan)
        return np.stack([self.moment[..., 2] / fy, 0 * fy, -self.moment[..., 0] / fy], axis=-1)

    def free_moment(self) -> Array:
        """About the vertical through the centre of pressure, (n, 2), N m."""
        about = self.moment - np.cross(np.nan_to_num(self.pressed()), self.force)
        moment: Array = about[..., 1]
        return moment

    def centre(self, plate: int) -> Array:
        """Mean centre of pressure of a plate over its loaded samples, (3,), m."""
        centre: Array = np.nanmean(self.pressed()[:, plate], axis=0)
        return centre

    def changed(self, plate: int, force: Array, moment: Array) -> Plates:
        """The same with one plate's readings, (n, 3) each, replaced."""
        forces, moments = self.force.copy(), self.moment.copy()
        forces[:, plate], moments[:, plate] = force, moment
        return replace(self, force=forces, moment=moments)

    def moved(self, plate: int, by: Array) -> Plates:
        """The same wrench acting somewhere else, m."""
        force = self.force[:, plate]
        return self.changed(plate, force, self.moment[:, plate] + np.cross(by, force))

    def turned(self, plate: int, turn: Rotation, centre: Array) -> Plates:
        """The same readings of a plate that is turned about a point."""
        force = turn.apply(self.force[:, plate])
        local = self.moment[:, plate] - np.cross(centre, self.force[:, plate])
        return self.changed(plate, force, turn.apply(local) + np.cross(centre, force))

    def resampled(self, at: Array) -> Plates:
        """The same clock, but what was true at other times (ends held)."""
        at = np.clip(at, self.times[0], self.times[-1])
        flat = np.concatenate([self.force, self.moment], axis=-1).reshape(len(self.times), -1)
        values = np.stack([np.interp(at, self.times, column) for column in flat.T], axis=1)
        wrenches = values.reshape(len(self.times), 2, 6)
        return replace(self, force=wrenches[..., :3], moment=wrenches[..., 3:])
