"""Disturbances that no effect describes, one class each; to be called unexplained."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from tests.blind.body import Array, Body
from tests.blind.forces import PLATE_NAMES, Plates
from tests.blind.hidden import Hidden, Scene, direction, one, sign
from tests.blind.motions.motion import RATE_HZ, low_passed
from tests.blind.strangers.clock_drift import COMPONENTS

Draw = Callable[[Body, np.random.Generator], Hidden]


@dataclass(frozen=True, kw_only=True)
class MarkerLate(Hidden):
    """One marker is shown ``delay_s`` late: another exposure, or a filter of its own."""

    def seen(self, scene: Scene, markers: Array) -> Array:
        then = scene.times - self.parameters["delay_s"]
        return _replaced(scene, markers, self.where, lambda path: _at(then, scene.times, path))


@dataclass(frozen=True, kw_only=True)
class FrozenMarker(Hidden):
    """A marker stays where it was, for ``spell_s`` out of every ``every_s``."""

    def seen(self, scene: Scene, markers: Array) -> Array:
        every, spell = self.parameters["every_s"], self.parameters["spell_s"]
        phase = np.mod(scene.times, every)
        then = np.where(phase > every - spell, scene.times - phase + every - spell, scene.times)
        return _replaced(scene, markers, self.where, lambda path: _at(then, scene.times, path))


@dataclass(frozen=True, kw_only=True)
class SmoothedCluster(Hidden):
    """The markers of a segment were low-passed at ``cutoff_hz``, the others were not."""

    def seen(self, scene: Scene, markers: Array) -> Array:
        cutoff = self.parameters["cutoff_hz"]
        return _replaced(scene, markers, self.where, lambda path: low_passed(path, cutoff))


@dataclass(frozen=True, kw_only=True)
class SlidingMarker(Hidden):
    """A marker slides down its segment at ``mm_per_s`` and is pushed back before the next trial."""

    toward: tuple[float, float, float]

    def on_skin(self, scene: Scene, markers: Array) -> Array:
        segment = scene.body.marker(self.where[0]).segment
        way = 1e-3 * self.parameters["mm_per_s"] * scene.times[:, None] * np.array(self.toward)
        return _replaced(scene, markers, self.where, lambda path: path + scene.poses.turned(segment, way))


@dataclass(frozen=True, kw_only=True)
class GhostFlicker(Hidden):
    """In a ``share`` of the frames, in runs of three, a reflection ``mm`` away is taken for the marker."""

    toward: tuple[float, float, float]
    seed: int

    def seen(self, scene: Scene, markers: Array) -> Array:
        runs = np.random.default_rng(self.seed).random(len(scene.times) // 3 + 1)
        ghost = np.repeat(runs < self.parameters["share"], 3)[: len(scene.times), None]
        away = 1e-3 * self.parameters["mm"] * ghost * np.array(self.toward)
        return _replaced(scene, markers, self.where, lambda path: path + away)


@dataclass(frozen=True, kw_only=True)
class CameraMoved(Hidden):
    """After half of a trial the volume is sheared along X by ``mm_per_m`` times the height."""

    def seen(self, scene: Scene, markers: Array) -> Array:
        after = scene.times > scene.times[-1] / 2
        moved = markers.copy()
        moved[after, :, 0] += 1e-3 * self.parameters["mm_per_m"] * markers[after, :, 1]
        return moved


@dataclass(frozen=True, kw_only=True)
class FramesDropped(Hidden):
    """The cameras lose ``frames`` in the middle of a trial and go on as if nothing had been."""

    def measured(self, plates: Plates) -> Plates:
        late = np.where(plates.times > plates.times[-1] / 2, self.parameters["frames"] / RATE_HZ, 0.0)
        return plates.resampled(plates.times - late)


@dataclass(frozen=True, kw_only=True)
class PlateCreep(Hidden):
    """A plate's vertical force creeps up by ``share`` of the load with a time constant of a second."""

    def measured(self, plates: Plates) -> Plates:
        k = PLATE_NAMES.index(self.where[0])
        force = plates.force[:, k].copy()
        dt = plates.times[1] - plates.times[0]
        kernel = dt * np.exp(-plates.times)
        force[:, 1] += self.parameters["share"] * np.convolve(force[:, 1], kernel)[: len(force)]
        return plates.changed(k, force, plates.moment[:, k])


@dataclass(frozen=True, kw_only=True)
class PlateCrosstalk(Hidden):
    """A ``share`` of the other plate's vertical force is read as this plate's sideways force."""

    def measured(self, plates: Plates) -> Plates:
        k = PLATE_NAMES.index(self.where[0])
        force = plates.force[:, k].copy()
        force[:, 2] += self.parameters["share"] * plates.force[:, 1 - k, 1]
        return plates.changed(k, force, plates.moment[:, k])


@dataclass(frozen=True, kw_only=True)
class MainsHum(Hidden):
    """A hum of ``N`` on all forces of a plate, folded down to ``hz`` by the sampling."""

    def measured(self, plates: Plates) -> Plates:
        k = PLATE_NAMES.index(self.where[0])
        hum = self.parameters["N"] * np.sin(2 * np.pi * self.parameters["hz"] * plates.times)
        return plates.changed(k, plates.force[:, k] + hum[:, None], plates.moment[:, k])


@dataclass(frozen=True, kw_only=True)
class SoftFloor(Hidden):
    """A mat between foot and plate: the plate feels the force through a low-pass of ``cutoff_hz``."""

    def measured(self, plates: Plates) -> Plates:
        rate, cutoff = 1.0 / (plates.times[1] - plates.times[0]), self.parameters["cutoff_hz"]
        for k in range(len(PLATE_NAMES)):
            both = (low_passed(x[:, k], cutoff, rate) for x in (plates.force, plates.moment))
            plates = plates.changed(k, *both)
        return plates


@dataclass(frozen=True, kw_only=True)
class CoarseGrid(Hidden):
    """All markers are rounded to a grid of ``mm``: a file with too few digits."""

    def seen(self, scene: Scene, markers: Array) -> Array:
        step = 1e-3 * self.parameters["mm"]
        return np.asarray(step * np.round(markers / step))


@dataclass(frozen=True, kw_only=True)
class MergedMarkers(Hidden):
    """Two neighbours are seen as one, half way between them, for ``spell_s`` out of every ``every_s``."""

    def seen(self, scene: Scene, markers: Array) -> Array:
        merged = np.mod(scene.times, self.parameters["every_s"]) < self.parameters["spell_s"]
        middle = np.mean([markers[:, scene.marker(name)] for name in self.where], axis=0)
        return _replaced(scene, markers, self.where, lambda path: np.where(merged[:, None], middle, path))


@dataclass(frozen=True, kw_only=True)
class RollingShutter(Hidden):
    """Markers are the later the higher they are, by ``ms_per_m``."""

    def seen(self, scene: Scene, markers: Array) -> Array:
        late = 1e-3 * self.parameters["ms_per_m"] * markers[..., 1]
        moved = [
            np.stack([np.interp(scene.times - late[:, k], scene.times, x) for x in markers[:, k].T], axis=1)
            for k in range(markers.shape[1])
        ]
        return np.stack(moved, axis=1)


@dataclass(frozen=True, kw_only=True)
class DeadChannel(Hidden):
    """A plate's sideways force is read as zero."""

    def measured(self, plates: Plates) -> Plates:
        k = PLATE_NAMES.index(self.where[0])
        force = plates.force[:, k] * np.array([1.0, 1.0, 0.0])
        return plates.changed(k, force, plates.moment[:, k])


@dataclass(frozen=True, kw_only=True)
class AmplifierSpikes(Hidden):
    """In a ``share`` of the samples a plate reads ``N`` more of vertical force."""

    seed: int

    def measured(self, plates: Plates) -> Plates:
        k = PLATE_NAMES.index(self.where[0])
        force = plates.force[:, k].copy()
        hit = np.random.default_rng(self.seed).random(len(force)) < self.parameters["share"]
        force[:, 1] += self.parameters["N"] * hit
        return plates.changed(k, force, plates.moment[:, k])


def _replaced(
    scene: Scene, markers: Array, names: tuple[str, ...], change: Callable[[Array], Array]
) -> Array:
    """Markers with the paths (n, 3) of some of them changed."""
    changed = markers.copy()
    for name in names:
        changed[:, scene.marker(name)] = change(markers[:, scene.marker(name)])
    return changed


def _at(then: Array, times: Array, path: Array) -> Array:
    return np.stack([np.interp(then, times, column) for column in path.T], axis=1)


def _toward(rng: np.random.Generator) -> tuple[float, float, float]:
    x, y, z = direction(rng)
    return (float(x), float(y), float(z))


def limb_marker(body: Body, rng: np.random.Generator) -> tuple[str]:
    """A marker of a thigh or shank, which move in squats, too."""
    segments = [f"{s}_{side}" for s in ("femur", "tibia") for side in "rl"]
    return (one(rng, [m for s in segments for m in body.on(s)]),)


def _plate(rng: np.random.Generator) -> tuple[str]:
    return (one(rng, list(PLATE_NAMES)),)


_ALL_FORCES = ("forces", *COMPONENTS)


def _marker_late(body: Body, rng: np.random.Generator) -> Hidden:
    delay = sign(rng) * rng.uniform(0.04, 0.07)
    return MarkerLate(kind="marker_late", where=limb_marker(body, rng), parameters={"delay_s": delay})


def _frozen_marker(body: Body, rng: np.random.Generator) -> Hidden:
    parameters = {"every_s": 0.6, "spell_s": rng.uniform(0.2, 0.3)}
    return FrozenMarker(kind="frozen_marker", where=limb_marker(body, rng), parameters=parameters)


def _smoothed_cluster(body: Body, rng: np.random.Generator) -> Hidden:
    segment = one(rng, ["tibia_r", "tibia_l", "femur_r", "femur_l"])
    parameters = {"cutoff_hz": rng.uniform(1.0, 1.5)}
    return SmoothedCluster(
        kind="smoothed_cluster", where=body.on(segment), parameters=parameters, also_where=(segment,)
    )


def _sliding_marker(body: Body, rng: np.random.Generator) -> Hidden:
    parameters = {"mm_per_s": rng.uniform(10.0, 20.0)}
    return SlidingMarker(
        kind="sliding_marker", where=limb_marker(body, rng), parameters=parameters, toward=_toward(rng)
    )


def _ghost_flicker(body: Body, rng: np.random.Generator) -> Hidden:
    parameters = {"share": rng.uniform(0.1, 0.25), "mm": rng.uniform(20.0, 40.0)}
    return GhostFlicker(
        kind="ghost_flicker", where=limb_marker(body, rng), parameters=parameters,
        toward=_toward(rng), seed=int(rng.integers(2**31)),
    )  # fmt: skip


def _camera_moved(body: Body, rng: np.random.Generator) -> Hidden:
    parameters = {"mm_per_m": sign(rng) * rng.uniform(20.0, 40.0)}
    also = (*body.marker_names, *_ALL_FORCES)
    return CameraMoved(kind="camera_moved", where=("markers",), parameters=parameters, also_where=also)


def _frames_dropped(_body: Body, rng: np.random.Generator) -> Hidden:
    parameters = {"frames": float(rng.integers(4, 9))}
    also = ("markers", *PLATE_NAMES, *COMPONENTS)
    return FramesDropped(kind="frames_dropped", where=("forces",), parameters=parameters, also_where=also)


def _plate_creep(_body: Body, rng: np.random.Generator) -> Hidden:
    parameters = {"share": rng.uniform(0.08, 0.15)}
    return PlateCreep(kind="plate_creep", where=_plate(rng), parameters=parameters, also_where=_ALL_FORCES)


def _plate_crosstalk(_body: Body, rng: np.random.Generator) -> Hidden:
    parameters = {"share": sign(rng) * rng.uniform(0.06, 0.12)}
    return PlateCrosstalk(
        kind="plate_crosstalk", where=_plate(rng), parameters=parameters, also_where=_ALL_FORCES
    )


def _mains_hum(_body: Body, rng: np.random.Generator) -> Hidden:
    parameters = {"N": rng.uniform(10.0, 20.0), "hz": rng.uniform(3.0, 12.0)}
    return MainsHum(kind="mains_hum", where=_plate(rng), parameters=parameters, also_where=_ALL_FORCES)


def _soft_floor(_body: Body, rng: np.random.Generator) -> Hidden:
    parameters = {"cutoff_hz": rng.uniform(1.5, 2.5)}
    also = (*PLATE_NAMES, *COMPONENTS)
    return SoftFloor(kind="soft_floor", where=("forces",), parameters=parameters, also_where=also)


def _coarse_grid(body: Body, rng: np.random.Generator) -> Hidden:
    parameters = {"mm": rng.uniform(10.0, 20.0)}
    return CoarseGrid(
        kind="coarse_grid", where=("markers",), parameters=parameters, also_where=body.marker_names
    )


def _merged_markers(body: Body, rng: np.random.Generator) -> Hidden:
    parameters = {"every_s": 0.7, "spell_s": rng.uniform(0.15, 0.3)}
    pair = tuple(
        rng.permutation(body.on(one(rng, ["femur_r", "femur_l", "tibia_r", "tibia_l"])))[:2].tolist()
    )
    return MergedMarkers(kind="merged_markers", where=pair, parameters=parameters)


def _rolling_shutter(body: Body, rng: np.random.Generator) -> Hidden:
    parameters = {"ms_per_m": sign(rng) * rng.uniform(30.0, 60.0)}
    also = (*body.marker_names, *_ALL_FORCES)
    return RollingShutter(kind="rolling_shutter", where=("markers",), parameters=parameters, also_where=also)


def _dead_channel(_body: Body, rng: np.random.Generator) -> Hidden:
    return DeadChannel(
        kind="dead_channel", where=_plate(rng), parameters={"factor": 0.0}, also_where=_ALL_FORCES
    )


def _amplifier_spikes(_body: Body, rng: np.random.Generator) -> Hidden:
    parameters = {"share": rng.uniform(0.01, 0.03), "N": sign(rng) * rng.uniform(150.0, 300.0)}
    return AmplifierSpikes(
        kind="amplifier_spikes", where=_plate(rng), parameters=parameters, also_where=_ALL_FORCES,
        seed=int(rng.integers(2**31)),
    )  # fmt: skip


DISTURBANCES: dict[str, Draw] = {
    "marker_late": _marker_late,
    "frozen_marker": _frozen_marker,
    "smoothed_cluster": _smoothed_cluster,
    "sliding_marker": _sliding_marker,
    "ghost_flicker": _ghost_flicker,
    "camera_moved": _camera_moved,
    "frames_dropped": _frames_dropped,
    "plate_creep": _plate_creep,
    "plate_crosstalk": _plate_crosstalk,
    "mains_hum": _mains_hum,
    "soft_floor": _soft_floor,
    # Added once the search was as it is; none of them was looked at before.
    "coarse_grid": _coarse_grid,
    "merged_markers": _merged_markers,
    "rolling_shutter": _rolling_shutter,
    "dead_channel": _dead_channel,
    "amplifier_spikes": _amplifier_spikes,
}
"""By kind; besides those of ``tests.blind.strangers`` that need no treadmill."""
