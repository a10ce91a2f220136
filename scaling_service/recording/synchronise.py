"""Forces on the markers' clock, filtered like the motion."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import CubicSpline

from scaling_service.core.errors import InputError, TrialUnusable
from scaling_service.model.forces import GroundForces
from scaling_service.model.trial import Array, Repair, repair_each
from scaling_service.numerics.signals.filters import butterworth, runs

ORDER = 4
"""Effective order, zero phase: Muller et al. 2017, sec. 2.1, for the motion; the same must hold for forces,
or impacts appear on one side of the equation only (van den Bogert & de Koning 1996)."""

ROUNDED = 0.25  # share of a step by which a time may be rounded and still stand on a regular clock (chosen)


def synchronise(
    forces: GroundForces,
    times: ArrayLike,
    *,
    cutoff_hz: float | None = None,
) -> GroundForces:
    """Forces at the times of the markers.

    ``times`` (n,), s: the markers' times, strictly increasing. ``cutoff_hz``: half-power frequency of the
    zero-phase Butterworth filter: that of the motion. None: not filtered. Returns NaN
    where the forces were not recorded or not known, in that plate and time only. Raises TrialUnusable: the
    clocks do not overlap. Raises InputError: the cutoff is not below half the rate of the forces.

    Force and moment are filtered, which add up linearly; the centre of pressure follows from them.
    """
    wanted = np.asarray(times, dtype=float)
    own = forces.times
    if own[-1] < wanted[0] or own[0] > wanted[-1]:
        raise TrialUnusable(
            f"forces from {own[0]:g} to {own[-1]:g} s and markers from {wanted[0]:g} to {wanted[-1]:g} s "
            "do not overlap",
            file=forces.name,
            field="time",
            remedy="Use forces and markers of the same recording, on one clock",
        )
    whole = np.concatenate([forces.force, forces.moment, forces.readings[..., None]], axis=2)
    own, whole, repairs = _regularise_clock(own, whole, forces.name)
    if cutoff_hz is not None:
        whole, more = _filter(whole, own, cutoff_hz, forces)
        repairs += more
    sampled = np.stack(
        [_sample(own, whole[:, k], wanted, cutoff_hz is not None) for k in range(whole.shape[1])], axis=1
    )
    outside = int(((wanted < own[0] - 1e-9) | (wanted > own[-1] + 1e-9)).sum())
    if outside:
        repairs.append(
            Repair("not_recorded", forces.name, "no forces at these frames of the markers", outside)
        )
    force, moment, read = sampled[..., :3], sampled[..., 3:6], sampled[..., 6]
    return forces.changed(*repairs, times=wanted, force=force, moment=moment, read=read)


def _regularise_clock(times: Array, values: Array, name: str) -> tuple[Array, Array, list[Repair]]:
    """The regular clock that rounded times stand for; else values interpolated onto one."""
    n = len(times)
    if n < 3:
        return times, values, []
    regular = np.linspace(times[0], times[-1], n)
    step = regular[1] - regular[0]
    if np.abs(times - regular).max() <= ROUNDED * step:
        return regular, values, []
    flat = np.stack([_interpolate(times, values[:, k], regular) for k in range(values.shape[1])], axis=1)
    return regular, flat, [Repair("clock", name, "times are irregular; interpolated onto a regular clock", n)]


def _filter(
    values: Array, times: Array, cutoff_hz: float, forces: GroundForces
) -> tuple[Array, list[Repair]]:
    rate = (len(times) - 1) / (times[-1] - times[0]) if len(times) > 1 else 0.0
    if not 0 < cutoff_hz < 0.5 * rate:
        raise InputError(
            f"a cutoff of {cutoff_hz:g} Hz does not suit forces of {rate:g} Hz",
            file=forces.name,
            field="cutoff_hz",
            remedy=f"Choose one between 0 and {0.5 * rate:g} Hz",
        )
    whole = np.where(np.isfinite(values).all(axis=2, keepdims=True), values, np.nan)
    result = butterworth(whole, rate_hz=rate, cutoff_hz=cutoff_hz, order=ORDER)
    detail = f"zero-phase Butterworth, order {ORDER}, half power at {cutoff_hz:g} Hz"
    notes = [Repair("smoothing", forces.name, detail, len(times))]
    brief = "known too briefly between gaps to be filtered"
    return result.values, notes + repair_each(
        np.any(result.unfiltered, axis=2), forces.plates, "not_smoothed", brief
    )


def _sample(times: Array, values: Array, wanted: Array, smooth: bool) -> Array:
    """Values (n, 7) at other times; smooth ones by a cubic spline in each run, others by straight lines."""
    if not smooth:
        return _interpolate(times, values, wanted)
    result = np.full((len(wanted), values.shape[1]), np.nan)
    for start, stop in runs(np.asarray(np.isfinite(values).all(axis=1))).tolist():
        inside = _within(times[start:stop], wanted)
        if stop - start > 1 and inside.any():
            result[inside] = CubicSpline(times[start:stop], values[start:stop])(wanted[inside])
    return result


def _interpolate(times: Array, values: Array, wanted: Array) -> Array:
    result = np.full((len(wanted), values.shape[1]), np.nan)
    for start, stop in runs(np.asarray(np.isfinite(values).all(axis=1))).tolist():
        inside = _within(times[start:stop], wanted)
        for column in range(values.shape[1]):
            result[inside, column] = np.interp(wanted[inside], times[start:stop], values[start:stop, column])
    return result


def _within(times: Array, wanted: Array) -> NDArray[np.bool_]:
    inside: NDArray[np.bool_] = (wanted >= times[0] - 1e-9) & (wanted <= times[-1] + 1e-9)
    return inside
