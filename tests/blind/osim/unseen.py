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


@dataclass(frozen=True, kw_only=True)
class FlippedChannel(Hidden):
    """A plate's sideways force is read with the opposite sign."""

    def measured(self, plates: Plates) -> Plates:
        k = PLATE_NAMES.index(self.where[0])
        return plates.changed(k, plates.force[:, k] * np.array([1.0, 1.0, -1.0]), plates.moment[:, k])


@dataclass(frozen=True, kw_only=True)
class OnePlateLate(Hidden):
    """One plate's readings come ``delay_s`` later than the other's."""

    def measured(self, plates: Plates) -> Plates:
        k = PLATE_NAMES.index(self.where[0])
        late = plates.resampled(plates.times - self.parameters["delay_s"])
        return plates.changed(k, late.force[:, k], late.moment[:, k])


@dataclass(frozen=True, kw_only=True)
class StretchedAxis(Hidden):
    """All heights are off by a ``share``: the wand was held askew when the volume was calibrated."""

    def seen(self, scene: Scene, markers: Array) -> Array:
        return np.asarray(markers * np.array([1.0, 1.0 + self.parameters["share"], 1.0]))


@dataclass(frozen=True, kw_only=True)
class BridgedGaps(Hidden):
    """A marker that is lost for ``spell_s`` out of every ``every_s`` was filled by straight lines."""

    def seen(self, scene: Scene, markers: Array) -> Array:
        every, spell = self.parameters["every_s"], self.parameters["spell_s"]
        seen = np.mod(scene.times, every) >= spell
        changed, k = markers.copy(), scene.marker(self.where[0])
        for axis in range(3):
            changed[:, k, axis] = np.interp(scene.times, scene.times[seen], markers[seen, k, axis])
        return changed


@dataclass(frozen=True, kw_only=True)
class TrembledMarker(Hidden):
    """For a ``share`` of the time, in spells, a marker's position is known only to ``mm``."""

    seed: int

    def seen(self, scene: Scene, markers: Array) -> Array:
        rng = np.random.default_rng(self.seed)
        poor = np.repeat(rng.random(len(scene.times) // 20 + 1) < self.parameters["share"], 20)
        noise = 1e-3 * self.parameters["mm"] * rng.normal(size=(len(scene.times), 3))
        changed = markers.copy()
        changed[:, scene.marker(self.where[0])] += noise * poor[: len(scene.times), None]
        return changed


@dataclass(frozen=True, kw_only=True)
class CrossedChannels(Hidden):
    """A plate's forward and sideways forces are read as each other."""

    def measured(self, plates: Plates) -> Plates:
        k = PLATE_NAMES.index(self.where[0])
        return plates.changed(k, plates.force[:, k][:, [2, 1, 0]], plates.moment[:, k])


@dataclass(frozen=True, kw_only=True)
class LatePoints(Hidden):
    """A plate's centre of pressure comes ``delay_s`` later than its force: two filters in one program."""

    def measured(self, plates: Plates) -> Plates:
        k = PLATE_NAMES.index(self.where[0])
        point, free = plates.pressed()[:, k], np.zeros((len(plates.times), 3))
        known = plates.loaded[:, k]
        then = plates.times - self.parameters["delay_s"]
        for axis in range(3):
            point[:, axis] = np.interp(then, plates.times[known], point[known, axis])
        free[:, 1] = np.nan_to_num(plates.free_moment()[:, k])
        return plates.changed(k, plates.force[:, k], free + np.cross(point, plates.force[:, k]))


@dataclass(frozen=True, kw_only=True)
class RingingPlate(Hidden):
    """A loosely mounted plate rings at ``hz`` after every change of its load, by a ``share`` of it."""

    def measured(self, plates: Plates) -> Plates:
        k, dt = PLATE_NAMES.index(self.where[0]), plates.times[1] - plates.times[0]
        w, force = 2 * np.pi * self.parameters["hz"], plates.force[:, k].copy()
        kernel = np.exp(-0.1 * w * plates.times) * np.cos(w * plates.times)
        change = np.diff(force[:, 1], prepend=force[0, 1])
        force[:, 1] += self.parameters["share"] * np.convolve(change, kernel)[: len(force)]
        assert dt * self.parameters["hz"] < 0.25
        return plates.changed(k, force, plates.moment[:, k])


@dataclass(frozen=True, kw_only=True)
class DroppedReadings(Hidden):
    """A loose plug: a plate reads nothing for ``spell_s`` out of every ``every_s``."""

    def measured(self, plates: Plates) -> Plates:
        k = PLATE_NAMES.index(self.where[0])
        on = np.mod(plates.times, self.parameters["every_s"]) >= self.parameters["spell_s"]
        return plates.changed(k, plates.force[:, k] * on[:, None], plates.moment[:, k] * on[:, None])


@dataclass(frozen=True, kw_only=True)
class StickySkin(Hidden):
    """A marker lies ``mm`` to either side, after the direction in which a joint moves: skin that sticks."""

    toward: tuple[float, float, float]

    def on_skin(self, scene: Scene, markers: Array) -> Array:
        segment, changed = scene.body.marker(self.where[0]).segment, markers.copy()
        rate = np.gradient(scene.motion.column(self.driver[0]), scene.times)
        way = 1e-3 * self.parameters["mm"] * np.tanh(rate / 0.5)[:, None] * np.array(self.toward)
        changed[:, scene.marker(self.where[0])] += scene.poses.turned(segment, way)
        return changed


@dataclass(frozen=True, kw_only=True)
class SinkingFeet(Hidden):
    """The markers of a shoe sink by ``mm`` while the foot bears the body, for the sole is soft."""

    def seen(self, scene: Scene, markers: Array) -> Array:
        changed, columns = markers.copy(), [scene.marker(name) for name in self.where]
        height = markers[:, columns, 1].min(axis=1)
        bears = 1.0 / (1.0 + np.exp((height - height.min() - 0.03) / 0.005))
        changed[:, columns, 1] -= 1e-3 * self.parameters["mm"] * bears[:, None]
        return changed


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


def _flipped_channel(_body: Body, rng: np.random.Generator) -> Hidden:
    where = (one(rng, list(PLATE_NAMES)),)
    return FlippedChannel(
        kind="flipped_channel", where=where, parameters={"factor": -1.0}, also_where=_ALL_FORCES
    )


def _one_plate_late(_body: Body, rng: np.random.Generator) -> Hidden:
    where, parameters = (one(rng, list(PLATE_NAMES)),), {"delay_s": rng.uniform(0.02, 0.05)}
    return OnePlateLate(kind="one_plate_late", where=where, parameters=parameters, also_where=_ALL_FORCES)


def _stretched_axis(body: Body, rng: np.random.Generator) -> Hidden:
    parameters = {"share": sign(rng) * rng.uniform(0.02, 0.04)}
    where, also = ("markers",), (*body.marker_names, *_ALL_FORCES)
    return StretchedAxis(kind="stretched_axis", where=where, parameters=parameters, also_where=also)


def _bridged_gaps(body: Body, rng: np.random.Generator) -> Hidden:
    parameters = {"every_s": 0.8, "spell_s": rng.uniform(0.3, 0.4)}
    return BridgedGaps(kind="bridged_gaps", where=limb_marker(body, rng), parameters=parameters)


def _trembled_marker(body: Body, rng: np.random.Generator) -> Hidden:
    parameters, where = {"share": 0.4, "mm": rng.uniform(8.0, 15.0)}, limb_marker(body, rng)
    seed = int(rng.integers(2**31))
    return TrembledMarker(kind="trembled_marker", where=where, parameters=parameters, seed=seed)


def _crossed_channels(_body: Body, rng: np.random.Generator) -> Hidden:
    where = (one(rng, list(PLATE_NAMES)),)
    return CrossedChannels(
        kind="crossed_channels", where=where, parameters={"factor": 1.0}, also_where=_ALL_FORCES
    )


def _late_points(_body: Body, rng: np.random.Generator) -> Hidden:
    where, parameters = (one(rng, list(PLATE_NAMES)),), {"delay_s": rng.uniform(0.05, 0.1)}
    return LatePoints(kind="late_points", where=where, parameters=parameters, also_where=_ALL_FORCES)


def _ringing_plate(_body: Body, rng: np.random.Generator) -> Hidden:
    parameters = {"share": rng.uniform(0.3, 0.6), "hz": rng.uniform(4.0, 8.0)}
    where = (one(rng, list(PLATE_NAMES)),)
    return RingingPlate(kind="ringing_plate", where=where, parameters=parameters, also_where=_ALL_FORCES)


def _dropped_readings(_body: Body, rng: np.random.Generator) -> Hidden:
    parameters = {"every_s": 0.9, "spell_s": rng.uniform(0.05, 0.1)}
    where = (one(rng, list(PLATE_NAMES)),)
    return DroppedReadings(
        kind="dropped_readings", where=where, parameters=parameters, also_where=_ALL_FORCES
    )


def _sticky_skin(body: Body, rng: np.random.Generator) -> Hidden:
    x, y, z = direction(rng).tolist()
    where = limb_marker(body, rng)
    side = body.marker(where[0]).segment[-1]
    return StickySkin(
        kind="sticky_skin", where=where, parameters={"mm": rng.uniform(8.0, 15.0)},
        driver=(f"knee_angle_{side}",), toward=(x, y, z),
    )  # fmt: skip


def _sinking_feet(body: Body, rng: np.random.Generator) -> Hidden:
    side = one(rng, ["r", "l"])
    where = tuple(m for part in ("calcn", "toes") for m in body.on(f"{part}_{side}"))
    parameters = {"mm": rng.uniform(10.0, 20.0)}
    return SinkingFeet(kind="sinking_feet", where=where, parameters=parameters)


UNSEEN: dict[str, Draw] = {
    "drifting_marker": _drifting_marker,
    "slipped_marker": _slipped_marker,
    "repeated_frames": _repeated_frames,
    "breathing_volume": _breathing_volume,
    "curved_plate": _curved_plate,
    # Later still, once those above had been looked at.
    "flipped_channel": _flipped_channel,
    "one_plate_late": _one_plate_late,
    "stretched_axis": _stretched_axis,
    "bridged_gaps": _bridged_gaps,
    "trembled_marker": _trembled_marker,
    "crossed_channels": _crossed_channels,
    # And once those had been.
    "late_points": _late_points,
    "ringing_plate": _ringing_plate,
    "dropped_readings": _dropped_readings,
    "sticky_skin": _sticky_skin,
    "sinking_feet": _sinking_feet,
}
"""By kind."""
