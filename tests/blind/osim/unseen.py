"""Disturbances that were added once the search was as it is: none of them was looked at before."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tests.blind.body import Array, Body
from tests.blind.forces import PLATE_NAMES, Plates
from tests.blind.hidden import Hidden, Scene, direction, one, sign
from tests.blind.osim.disturbances import Draw, limb_marker
from tests.blind.strangers.clock_drift import COMPONENTS

_ALL_FORCES = ("forces", *COMPONENTS)


@dataclass(frozen=True, kw_only=True)
class DriftingMarker(Hidden):
    """One marker comes later and later, by ``ms_per_s``: a tracker with a clock of its own."""

    def seen(self, scene: Scene, markers: Array) -> Array:
        then = (1.0 - 1e-3 * self.parameters["ms_per_s"]) * scene.times
        return _moved(scene, markers, self.where[0], then)


@dataclass(frozen=True, kw_only=True)
class SlippedMarker(Hidden):
    """At a ``share`` of the trial a marker slips by ``mm`` on its segment; before the next it is put back."""

    toward: tuple[float, float, float]

    def on_skin(self, scene: Scene, markers: Array) -> Array:
        segment, changed = scene.body.marker(self.where[0]).segment, markers.copy()
        after = scene.times > self.parameters["share"] * scene.times[-1]
        way = 1e-3 * self.parameters["mm"] * after[:, None] * np.array(self.toward)
        changed[:, scene.marker(self.where[0])] += scene.poses.turned(segment, way)
        return changed


@dataclass(frozen=True, kw_only=True)
class RepeatedFrames(Hidden):
    """The cameras show the last frame again, ``frames`` times out of every ``every``."""

    def seen(self, scene: Scene, markers: Array) -> Array:
        k = np.arange(len(scene.times))
        over = np.mod(k, self.parameters["every"]) - (self.parameters["every"] - self.parameters["frames"])
        return np.asarray(markers[(k - np.maximum(over, 0)).astype(int)])


@dataclass(frozen=True, kw_only=True)
class BreathingVolume(Hidden):
    """All markers are scaled by a ``share`` that comes and goes with ``hz``: a zoom that hunts."""

    def seen(self, scene: Scene, markers: Array) -> Array:
        wave = self.parameters["share"] * np.sin(2 * np.pi * self.parameters["hz"] * scene.times)
        return np.asarray(markers * (1.0 + wave[:, None, None]))


@dataclass(frozen=True, kw_only=True)
class CurvedPlate(Hidden):
    """A plate reads the more the more it bears: by a ``share`` of each kilonewton."""

    def measured(self, plates: Plates) -> Plates:
        k = PLATE_NAMES.index(self.where[0])
        gain = 1.0 + self.parameters["share"] * 1e-3 * plates.force[:, k, 1:2]
        return plates.changed(k, gain * plates.force[:, k], gain * plates.moment[:, k])


def _moved(scene: Scene, markers: Array, name: str, then: Array) -> Array:
    """Markers with the path of one as it was at other times."""
    changed, k = markers.copy(), scene.marker(name)
    changed[:, k] = np.stack([np.interp(then, scene.times, x) for x in markers[:, k].T], axis=1)
    return changed


def _drifting_marker(body: Body, rng: np.random.Generator) -> Hidden:
    parameters = {"ms_per_s": sign(rng) * rng.uniform(30.0, 60.0)}
    return DriftingMarker(kind="drifting_marker", where=limb_marker(body, rng), parameters=parameters)


def _slipped_marker(body: Body, rng: np.random.Generator) -> Hidden:
    parameters = {"mm": rng.uniform(10.0, 25.0), "share": rng.uniform(0.35, 0.65)}
    x, y, z = direction(rng).tolist()
    where = limb_marker(body, rng)
    return SlippedMarker(kind="slipped_marker", where=where, parameters=parameters, toward=(x, y, z))


def _repeated_frames(body: Body, rng: np.random.Generator) -> Hidden:
    parameters = {"every": float(rng.integers(10, 20)), "frames": float(rng.integers(3, 6))}
    also = (*body.marker_names, *_ALL_FORCES)
    return RepeatedFrames(kind="repeated_frames", where=("markers",), parameters=parameters, also_where=also)


def _breathing_volume(body: Body, rng: np.random.Generator) -> Hidden:
    parameters = {"share": rng.uniform(0.01, 0.02), "hz": rng.uniform(0.7, 2.0)}
    where, also = ("markers",), (*body.marker_names, *_ALL_FORCES)
    return BreathingVolume(kind="breathing_volume", where=where, parameters=parameters, also_where=also)


def _curved_plate(_body: Body, rng: np.random.Generator) -> Hidden:
    where, parameters = (one(rng, list(PLATE_NAMES)),), {"share": sign(rng) * rng.uniform(0.2, 0.4)}
    return CurvedPlate(kind="curved_plate", where=where, parameters=parameters, also_where=_ALL_FORCES)


UNSEEN: dict[str, Draw] = {
    "drifting_marker": _drifting_marker,
    "slipped_marker": _slipped_marker,
    "repeated_frames": _repeated_frames,
    "breathing_volume": _breathing_volume,
    "curved_plate": _curved_plate,
}
"""By kind."""
