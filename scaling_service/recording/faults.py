"""Faults of cameras and plates that show in the readings alone, whatever the person does."""

from __future__ import annotations

from typing import TypeVar

import numpy as np
import scipy

from scaling_service.core import arrays
from scaling_service.model.forces import CONTACT_N, GroundForces
from scaling_service.model.trial import Repair, Trial, is_unlabelled
from scaling_service.numerics.least_squares.problem import find_seen
from scaling_service.numerics.signals.filters import find_runs
from scaling_service.recording.plausibility import remove_strays

_AnyTrial = TypeVar("_AnyTrial", bound=Trial)

OF_CAMERAS = ("shaking", "uneven")
"""Repairs after which the cameras are not to be trusted."""

OF_PLATES = ("dead_channel", "saturated")
"""Repairs after which what a plate bears stays unknown."""

FAULTS = ("merged", "jitter", *OF_CAMERAS, "spikes", *OF_PLATES)
"""Repairs of this module."""

ONE_POINT_M = 5e-3
"""Two balls whose middles are nearer are one point with two labels (chosen: the balls of body markers measure
9 mm and more, and noise of 1 mm on each parts one point by more only once in 200 frames)."""

APART_M, _USUAL = 0.025, 0.9
"""How far apart markers usually are, lest they were meant as one, and the quantile that this is (both chosen:
a short recording may show them as one most of the time)."""

PAIR = ", "
"""Between the labels of two merged markers."""

_LOOKED_AT_S = 0.02  # chosen: two markers are taken for one for longer
_FLICKER = 5  # frames between two of one point that are of it, too (chosen)

JITTER_M = 8e-3  # chosen: skin and an impact leave 6 mm from frame to frame, over a window
_UNUSUAL, _FEW = 5.0, 0.25
"""Of the noise of the others, from which a marker's own is a fault, and the share of markers of which it may
be (both chosen: where more jump about, the cameras do)."""

_SLOWEST_HZ = 60.0  # chosen: at fewer frames a second a kick is as rough as noise
_WINDOW = 11  # frames over which noise is measured (chosen: an impact lasts five)
_FOURTH = np.array([1.0, -4.0, 6.0, -4.0, 1.0]) / np.sqrt(70.0)
"""Fourth differences, of which noise leaves its own deviation, and what moves smoothly nothing."""

UNEVEN = 1.5
"""Of the longer of the markers' steps before and after, from which a step is too long: half of the way to
two, which is what a picture leaves that is missing or shown again (133 real files: none)."""

_OF_NOISE = 5.0  # times a coordinate's noise by which such a step is too long (chosen)

SHAKEN_HZ = 6.0  # chosen: above what people do (Winter 2009, sec. 3.4.3)
SHAKEN_MS2 = 1.0  # chosen: RMS over the markers; a body that does so at such a pace jumps
_OF_PLACE, _OVER_OTHERS = 0.85, 10.0
"""Share of a line's power that depends on the place alone, and how far that stands above the lines near it
(both chosen: a runner's harmonics have 0.7 of the first; where cameras were shaken by 2 mm, walking shows 10
to 30 of the second and squats 400)."""

_NEAR, _FINER = (3.0, 15.0), 4  # widths of a line between which others are near; points of a line (chosen)
_FASTEST, _LONGEST_S, _LEAST = 0.4, 20.0, (40, 8)  # of the frame rate; at most; frames and markers (chosen)
_SEEN = 0.9  # of these frames, in which a marker must be seen (chosen)

SPIKE_N = 50.0
"""Least force of a spike (chosen: a tenth of most feet's load, above what shakes a floor)."""

_BESIDE = 2  # samples on either side of a spike, which itself lasts up to as many (chosen)
_CLEAR = 3.0
"""Of a spike, over how much the course without it bends nearby (chosen: an impact's flanks bend, too)."""

LOADED_N = 100.0  # chosen: under less load a sideways force may be lost in the noise
_FEWEST_LOADED = 50  # samples (chosen)
_DEAD, _ALIVE = 0.004, 0.01
"""Spread of a sideways force over the load it stands under: below the first no foot moves, above the second
it shows that feet push so here (chosen: 0.02 to 0.1 in squats and walking)."""

_SIDEWAYS = np.array([True, False, True])

_TOP, _FLAT, _STANDS = 0.95, 0.005, 0.6
"""Of the highest force: from where on it may have been cut off, by how much it then differs from its median,
and in which share of these samples (all chosen: of a parabola's top 0.2 lie so near)."""

_BEYOND = 0.015  # of the limit, by which noise passes it (chosen: who comes to rest bears 3 % more before)
_SHORTEST = 4  # samples that stand still (chosen)
_STILL = 0.9  # of the limit; chosen: who stands still on a plate never loads it less (0.995 when quiet)
_BRIEF_S = 1.0  # chosen: nobody stands still for less, again and again at one load
_CORNER, _CORNER_S = 0.025, 0.1
"""Of the limit, and in how long: what a load changes there that is cut off as it rises or falls, and not one
that slowly comes to rest (chosen: a squat's load that is cut by a twentieth changes twice as fast)."""


def repair_markers(trial: _AnyTrial) -> _AnyTrial:
    """A recording as read without positions that cannot be those of its markers; bad cameras are noted."""
    return note_uneven(note_shaking(remove_jitter(separate_merged(remove_strays(trial)))))


def repair_forces(forces: GroundForces) -> GroundForces:
    """Forces as read without spikes and what stands at a limit; what cannot be repaired is noted."""
    return leave_out_saturated(note_dead_channels(remove_spikes(forces)))


def separate_merged(trial: _AnyTrial) -> _AnyTrial:
    """Mark two markers that are seen as one point as not seen while they are.

    It lies between them or on one of them: no label says which.

    ``trial``: in any axes, m. Returns one Repair, ``merged``, for each pair; the same trial if there is none.
    """
    shown = find_seen(trial.markers)
    hidden = np.zeros_like(shown)
    repairs = []
    # Columns of markers that are usually apart, and at one point at times; how far they usually are, m
    meeting = []
    step = max(1, int(_LOOKED_AT_S * trial.rate_hz))
    named = [k for k, label in enumerate(trial.labels) if not is_unlabelled(label)]
    some = trial.markers[::step, named]
    for k in range(len(named) - 1):
        square = np.square(some[:, k + 1 :] - some[:, k, None]).sum(axis=2)
        close = square < ONE_POINT_M**2  # never where one is not seen
        for after in np.flatnonzero(close.any(axis=0)).tolist():
            usual = float(np.sqrt(np.nanquantile(square[:, after], _USUAL)))
            if usual > APART_M:
                meeting.append((named[k], named[k + 1 + after], usual))
    for one, other, usual in meeting:
        distance = np.linalg.norm(trial.markers[:, one] - trial.markers[:, other], axis=1)
        near = distance < ONE_POINT_M
        merged = near | scipy.ndimage.binary_closing(near, np.ones(_FLICKER))
        merged &= shown[:, one] & shown[:, other]
        hidden[:, [one, other]] |= merged[:, None]
        where = f"{trial.labels[one]}{PAIR}{trial.labels[other]}"
        detail = "seen as one point, both taken as not seen there"
        repairs.append(Repair("merged", where, detail, frames=int(merged.sum()), off=usual / 2))
    if not repairs:
        return trial
    markers = np.where(hidden[..., None], np.nan, trial.markers)
    return trial.with_markers(markers, *repairs)


def remove_jitter(trial: _AnyTrial) -> _AnyTrial:
    """Mark a marker as not seen where it jumps about from frame to frame, as no skin does, nor the others.

    ``trial``: in any axes, m. Returns one Repair, ``jitter``, for each marker concerned; the same trial where
    there is none.
    """
    if trial.rate_hz < _SLOWEST_HZ or not trial.labels:
        return trial
    rough = np.abs(scipy.ndimage.convolve1d(np.nan_to_num(trial.markers), _FOURTH, axis=0)).max(axis=2)
    shown = find_seen(trial.markers)
    high = scipy.ndimage.binary_erosion(shown, np.ones((len(_FOURTH), 1)), border_value=1) & (
        rough > JITTER_M
    )
    often = np.flatnonzero(_find_mostly(high).any(axis=1))
    if not len(often):
        return trial
    usual = np.zeros((len(rough), 1))
    usual[often] = np.median(rough[often], axis=1, keepdims=True)
    worse = _find_mostly(high & (rough > _UNUSUAL * usual))
    poor = shown & (worse | scipy.ndimage.binary_closing(worse, np.ones((_WINDOW, 1))))
    size = {k: float(np.median(rough[poor[:, k], k])) for k in np.flatnonzero(poor.any(axis=0)).tolist()}
    size = {k: rms for k, rms in size.items() if rms > JITTER_M}
    if not 0 < len(size) < _FEW * len(trial.labels):
        return trial
    markers, repairs = trial.markers.copy(), []
    for k, rms in size.items():
        markers[poor[:, k], k] = np.nan
        detail = f"jumps about by some {1e3 * rms:.0f} mm, taken as not seen there"
        repairs.append(Repair("jitter", trial.labels[k], detail, frames=int(poor[:, k].sum()), off=rms))
    return trial.with_markers(markers, *repairs)


def _find_mostly(flags: arrays.Mask) -> arrays.Mask:
    """Where most frames of the window around a frame (n, any) have a flag."""
    return np.asarray(
        scipy.ndimage.uniform_filter1d(flags.astype(np.float32), _WINDOW, axis=0, mode="nearest") > 0.5
    )


def note_shaking(trial: _AnyTrial) -> _AnyTrial:
    """Note that all markers oscillate together at one frequency, each by where it is, the standing feet, too.

    Cameras or the floor shake then: the field of displacements is a linear function of place. Nothing is
    corrected. ``trial``: in any axes, m. Returns one Repair, ``shaking``; the same trial if nothing shakes.
    """
    frames = min(trial.n_frames, int(_LONGEST_S * trial.rate_hz))
    first = (trial.n_frames - frames) // 2
    paths = trial.markers[first : first + frames]
    paths = paths[:, np.isfinite(paths).all(axis=2).mean(axis=0) > _SEEN]
    if frames < _LEAST[0] or paths.shape[1] < _LEAST[1]:
        return trial
    # Gaps of paths (n, m, 3) bridged by straight lines
    at, filled = np.arange(len(paths)), paths.copy()
    for k in np.flatnonzero(~np.isfinite(paths).all(axis=(0, 2))).tolist():
        known = np.isfinite(paths[:, k]).all(axis=1)
        for axis in range(3):
            filled[:, k, axis] = np.interp(at, at[known], paths[known, k, axis])
    # Frequencies (Hz), squares of all accelerations there (m2/s4), and of what depends on place alone
    acceleration = np.diff(filled, 2, axis=0) * trial.rate_hz**2
    window = np.hanning(len(acceleration) + 2)[1:-1]
    points = _FINER * len(acceleration)
    hertz = np.fft.rfftfreq(points, 1.0 / trial.rate_hz)
    some = (hertz >= SHAKEN_HZ / 2.0) & (
        hertz <= _FASTEST * trial.rate_hz
    )  # and what a line must stand above
    lines = np.fft.rfft(acceleration * window[:, None, None], points, axis=0)[some] * 2.0 / window.sum()
    place = filled.mean(axis=0)
    functions = np.linalg.qr(np.column_stack([np.ones(len(place)), place - place.mean(axis=0)]))[0]
    shared = np.einsum("mk,fma->fka", functions, lines)
    hertz, power, of_place = hertz[some], *(np.square(np.abs(x)).sum(axis=(1, 2)) for x in (lines, shared))
    if not len(hertz):  # too few frames a second to show any shaking
        return trial
    near = _average_beside(of_place)
    acceleration = np.sqrt(of_place / paths.shape[1])
    possible = (hertz >= SHAKEN_HZ) & (acceleration > SHAKEN_MS2)
    k = int(np.argmax(np.where(possible, of_place / near, 0.0)))
    if not possible[k] or of_place[k] <= max(_OVER_OTHERS * near[k], _OF_PLACE * power[k]):
        return trial
    size = float(acceleration[k]) / (2.0 * np.pi * hertz[k]) ** 2
    detail = f"tremble together at {hertz[k]:.1f} Hz by {1e3 * size:.2g} mm: the cameras or the floor shake"
    note = Repair("shaking", "all markers", detail, frames=trial.n_frames, off=float(size / np.sqrt(2.0)))
    return trial.with_markers(trial.markers, note)


def _average_beside(power: arrays.Array) -> arrays.Array:
    """Mean power of the lines near each line (n,), on the side where it is higher: a slope is no line."""
    reach = int(_NEAR[1] * _FINER)
    away = np.arange(-reach, reach + 1) / _FINER
    sides = []
    for side in (-away, away):
        ring = ((side > _NEAR[0]) & (side < _NEAR[1])).astype(float)
        total, count = (
            scipy.ndimage.convolve1d(x, ring, mode="constant") for x in (power, np.ones(len(power)))
        )
        sides.append(total / np.maximum(count, 1.0))
    return np.asarray(np.maximum(*sides)) + 1e-300


def note_uneven(trial: _AnyTrial) -> _AnyTrial:
    """Note that markers go on by much more from one frame to the next than before and after, as no body does.

    Pictures are missing there or the last one was shown again before, or a camera moved. Nothing is
    corrected. ``trial``: in any axes, m. Returns one Repair, ``uneven``; the same trial if there is none.
    """
    slow = trial.rate_hz < _SLOWEST_HZ or trial.n_frames < len(_FOURTH)
    if slow or any(repair.what == "shaking" for repair in trial.repairs):  # which may do the same
        return trial
    steps = np.linalg.norm(np.diff(trial.markers, axis=0), axis=2)
    rough = np.abs(scipy.ndimage.convolve1d(trial.markers, _FOURTH, axis=0))
    usual = np.full(len(steps), np.nan)  # of most markers: a few may be exchanged
    many = np.isfinite(steps).sum(axis=1) >= _LEAST[1]
    if not many.any() or not np.isfinite(rough).any():
        return trial
    usual[many] = np.nanmedian(steps[many], axis=1)
    more = usual[1:-1] - np.maximum(usual[:-2], usual[2:])
    noise = 1.4826 * np.nanmedian(rough)
    at = (more > (UNEVEN - 1.0) * (usual[1:-1] - more)) & (more > _OF_NOISE * noise)
    if not at.any():
        return trial
    off = float(np.sqrt(np.square(more[at]).mean()))
    detail = f"go on by {1e3 * off:.0f} mm at once: pictures are missing or came twice, or a camera was moved"
    note = Repair("uneven", "all markers", detail, frames=int(at.sum()), off=off)
    return trial.with_markers(trial.markers, note)


def remove_spikes(forces: GroundForces) -> GroundForces:
    """Interpolate over a sample or two in which a plate jumps and comes back, as no foot does.

    ``forces``: as read, not filtered. Returns one Repair, ``spikes``, for each plate concerned (``where``
    names it and the component that jumps most: ``plate_1 fy``); the same forces where there is none.
    """
    force, moment = forces.force.copy(), forces.moment.copy()
    repairs = []
    for k, plate in enumerate(forces.plates):
        known = forces.known[:, k]
        # Samples off the course of those beside them
        seen = np.where(known[:, None], force[:, k], 0.0)
        off = np.abs(seen - scipy.ndimage.median_filter(seen, (2 * _BESIDE + 1, 1), mode="nearest"))
        bad, at = np.zeros_like(known), np.arange(len(seen))
        for path, away in zip(seen.T, off.T, strict=True):
            high = away > SPIKE_N
            if high.any():
                course = np.interp(at, at[~high], path[~high])
                bend = np.abs(np.diff(course, 2, prepend=course[0], append=course[-1]))
                bad |= high & (away > _CLEAR * scipy.ndimage.maximum_filter1d(bend, 4 * _BESIDE + 1)) & known
        good = known & ~bad
        if not bad.any() or not good.any():
            continue
        for values in (force, moment):
            for axis in range(3):
                values[bad, k, axis] = np.interp(forces.times[bad], forces.times[good], values[good, k, axis])
        off = forces.force[bad, k] - force[bad, k]
        size, rms = np.abs(off).max(axis=1), np.sqrt(np.square(off).mean(axis=0))
        detail = f"jumps by up to {size.max():.0f} N for a sample or two, interpolated"
        where = f"{plate} f{'xyz'[int(rms.argmax())]}"
        repairs.append(Repair("spikes", where, detail, frames=int(bad.sum()), off=float(rms.max())))
    return forces.change(*repairs, force=force, moment=moment) if repairs else forces


def note_dead_channels(forces: GroundForces) -> GroundForces:
    """Note where a sideways force of one plate reads nothing while another plate's does.

    Nothing is corrected. Returns one Repair, ``dead_channel``, for each (``where``: ``plate_1 fz``).
    """
    loaded = (forces.pressing > LOADED_N) & forces.known
    spread = np.full((len(forces.plates), 3), np.nan)
    load = np.zeros(len(forces.plates))
    for k in np.flatnonzero(loaded.sum(axis=0) >= _FEWEST_LOADED).tolist():
        load[k] = forces.pressing[loaded[:, k], k].mean()
        spread[k] = forces.force[loaded[:, k], k].std(axis=0) / load[k]
    usual = np.nan_to_num(spread).max(axis=0)
    dead = (spread < _DEAD) & (usual > _ALIVE) & _SIDEWAYS
    detail = "reads nothing under load, where another plate does: its channel is dead"
    return forces.change(
        *(
            Repair(
                "dead_channel",
                f"{forces.plates[k]} f{'xyz'[axis]}",
                detail,
                frames=int(loaded[:, k].sum()),
                off=float(usual[axis] * load[k]),
            )
            for k, axis in np.argwhere(dead).tolist()
        )
    )


def leave_out_saturated(forces: GroundForces) -> GroundForces:
    """Mark samples as not known in which a plate's load stands at a limit, an amplifier's or a converter's.

    It does so again and again, or it stops there at once and only noise is left of it, which differs from
    sample to sample as much as over the whole time: no foot's load does either. One Repair, ``saturated``,
    for each plate concerned (``where``: ``plate_1 fy``).
    """
    pressing = np.where(forces.known, forces.pressing, 0.0)
    rate = len(forces.times) / np.ptp(forces.times) if len(forces.times) > 1 else 0.0
    force, moment, repairs = forces.force.copy(), forces.moment.copy(), []
    for k, load in enumerate(pressing.T):
        found = _find_limit(load, rate)
        if found is None:
            continue
        limit, at = found
        force[at, k], moment[at, k] = np.nan, np.nan
        detail = f"stands at {limit:.0f} N, its limit: what it bears there is not known"
        where = f"{forces.plates[k]} fy"
        repairs.append(Repair("saturated", where, detail, frames=int(at.sum())))
    return forces.change(*repairs, force=force, moment=moment) if repairs else forces


def _find_limit(load: arrays.Array, rate_hz: float) -> tuple[float, arrays.Mask] | None:
    """Where a plate's load (n,) stands when it is highest, N, and when (n,); None if it does not."""
    high = load > _TOP * load.max()
    limit = float(np.median(load[high])) if high.any() else 0.0
    if limit < LOADED_N or load.max() > (1.0 + _BEYOND) * limit:
        return None
    if np.quantile(load[load > CONTACT_N], 0.05) > _STILL * limit:
        return None
    at = high & (np.abs(load - limit) < _FLAT * limit)
    spans = [span for span in find_runs(at).tolist() if span[1] - span[0] >= _SHORTEST]
    stretches = [load[start:stop] for start, stop in spans]
    if at.sum() < _STANDS * high.sum() or not stretches:
        return None
    off = np.concatenate([part - part.mean() for part in stretches])
    steps = np.concatenate([np.diff(part) for part in stretches])
    visits = [stop - start for start, stop in find_runs(high).tolist() if at[start:stop].sum() >= _SHORTEST]
    again = len(visits) > 1 and max(visits) < int(_BRIEF_S * rate_hz)
    away = max(1, int(_CORNER_S * rate_hz))
    beside = [load[max(start - away, 0)] for start, _ in spans]
    beside += [load[min(stop - 1 + away, len(load) - 1)] for _, stop in spans]
    at_once = min(beside) < (1.0 - _CORNER) * limit
    noise = np.square(off).mean() <= np.square(steps).mean()
    if not again and not (at_once and noise):
        return None
    for start, stop in find_runs(high).tolist():  # noise parts what stands there
        there = np.flatnonzero(at[start:stop])
        if len(there) >= _SHORTEST:
            at[start + there[0] : start + there[-1] + 1] = True
    return limit, at
