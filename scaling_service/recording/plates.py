"""Ground forces: from what the sensors of a plate show to wrenches in our axes, on the markers' clock.

The C3D user guide ("Force plate types") is followed: the numbers are the *reaction* on the body, in the
plate's axes with z into the floor. Some files hold the action on the plate instead: it pulls the body down,
which shows once the axes are known (:func:`orient_forces`).
"""

from __future__ import annotations

from copy import copy

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from scaling_service.core import errors
from scaling_service.core.arrays import Array
from scaling_service.core.names import say_name
from scaling_service.model import trial
from scaling_service.model.forces import CONTACT_N, GroundForces, PlateRecording, RawPlate, list_plate_names
from scaling_service.numerics.signals import filters
from scaling_service.recording.orientation import Orientation

BEYOND_M = 0.1  # chosen: a centre of pressure may lie this far off the plate by errors of corners and offsets
MOSTLY = 0.5  # chosen: share of the loaded samples that decides

ORDER = 4
"""Effective order, zero phase: Muller et al. 2017, sec. 2.1, for the motion; the same must hold for forces,
or impacts appear on one side of the equation only (van den Bogert & de Koning 1996)."""

ROUNDED = 0.25  # share of a step by which a time may be rounded and still stand on a regular clock (chosen)


def compute_ground_forces(recording: PlateRecording | errors.TrialUnusable) -> GroundForces:
    """Wrenches of all plates in the laboratory's axes, about the laboratory's origin.

    Raises TrialUnusable if that is what reading the plates gave, or a loaded plate's centre of pressure lies
    mostly off the plate: units or corners are wrong.
    """
    if isinstance(recording, errors.TrialUnusable):
        raise copy(recording)  # whoever catches it adds the file's path
    repairs = list(recording.repairs)
    parts = []
    for plate, name in zip(recording.plates, list_plate_names(len(recording.plates)), strict=True):
        # Force, moment about the laboratory's origin, middle and upward normal of one plate
        force, moment = _read_wrench(plate, turned=False)
        size = np.array([np.linalg.norm(plate.corners[0] - plate.corners[k]) for k in (1, 3)])
        inside = _share_inside(force, moment, size)
        if inside < MOSTLY:
            turned = _read_wrench(plate, turned=True)
            if _share_inside(*turned, size) > inside:
                force, moment = turned
                inside = _share_inside(force, moment, size)
                repairs.append(
                    trial.Repair(
                        "plate_origin",
                        name,
                        "ORIGIN was taken with the opposite sign: else pressure is off the plate",
                    )
                )
        if inside < MOSTLY:
            raise errors.TrialUnusable(
                f"the centre of pressure lies off {say_name(name)} in {1 - inside:.0%} of its loaded samples",
                file=recording.name,
                field="FORCE_PLATFORM",
                remedy="Check the units of moments (N mm or N m), the plate's corners and its origin",
            )
        R_lab_plate = find_plate_axes(plate.corners)
        middle = plate.corners.mean(axis=0)
        force, moment = force @ R_lab_plate.T, moment @ R_lab_plate.T
        parts.append((force, moment + np.cross(middle, force), middle, -R_lab_plate[:, 2]))
    force, moment, middles, normals = (np.stack(list(x)) for x in zip(*parts, strict=True))
    return GroundForces(
        name=recording.name,
        times=recording.times,
        plates=list_plate_names(len(recording.plates)),
        force=np.ascontiguousarray(force.swapaxes(0, 1)),
        moment=np.ascontiguousarray(moment.swapaxes(0, 1)),
        surfaces=middles,
        normals=normals,
        repairs=tuple(repairs),
        corners=np.stack([plate.corners for plate in recording.plates]),
    )


def find_plate_axes(corners: Array) -> Array:
    """Axes of a plate in the laboratory from its corners (4, 3), as columns, (3, 3); z into the floor."""
    x = corners[0] - corners[1]
    z = np.cross(x, corners[0] - corners[3])
    x, z = x / np.linalg.norm(x), z / np.linalg.norm(z)
    return np.stack([x, np.cross(z, x), z], axis=1)


def _share_inside(force: Array, moment: Array, size: Array) -> float:
    """Share of the loaded samples whose centre of pressure is on the plate; 1 if it is never loaded."""
    loaded = np.abs(force[:, 2]) > CONTACT_N
    if not loaded.any():
        return 1.0
    centre = np.stack([-moment[loaded, 1], moment[loaded, 0]], axis=1) / force[loaded, 2:]
    return float((np.abs(centre) <= size / 2 + BEYOND_M).all(axis=1).mean())


def _read_wrench(plate: RawPlate, *, turned: bool) -> tuple[Array, Array]:
    """Force and moment about the surface's middle, in the plate's axes; ``turned``: the sign of ORIGIN."""
    force = plate.signals[:, :3]
    if plate.kind == 1:  # force, its point on the surface and the vertical moment there
        point = np.concatenate([plate.signals[:, 3:5], np.zeros((len(force), 1))], axis=1)
        unloaded = np.isfinite(force).all(axis=1) & (force == 0).all(axis=1)
        point[unloaded] = 0.0  # no force acts nowhere, whatever the file says
        free = np.concatenate([np.zeros((len(force), 2)), plate.signals[:, 5:6]], axis=1)
        return force, free + np.cross(-point if turned else point, force)
    if plate.kind == 3:  # eight piezo-electric sensors: x12, x34, y14, y23, z1, z2, z3, z4 at (±a, ±b)
        x12, x34, y14, y23, z1, z2, z3, z4 = plate.signals.T
        a, b, height = plate.origin
        force = np.stack([x12 + x34, y14 + y23, z1 + z2 + z3 + z4], axis=1)
        moment = np.stack(
            [b * (z1 + z2 - z3 - z4), a * (-z1 + z2 + z3 - z4), b * (-x12 + x34) + a * (y14 - y23)], axis=1
        )
        to_middle = np.array([0.0, 0.0, height if turned else -abs(height)])
        return force, moment - np.cross(to_middle, force)
    # Types 2 and 4 (after its calibration matrix): the moment is about the sensors' origin, which lies below;
    # z points down.
    to_middle = plate.origin if plate.origin[2] <= 0 else -plate.origin
    return force, plate.signals[:, 3:] - np.cross(-to_middle if turned else to_middle, force)


def orient_forces(axes: Orientation, forces: GroundForces) -> GroundForces:
    """Wrenches in X forward, Y up, Z right, pushing the body up.

    ``axes``: as decided for the markers of the session. ``forces``: in the laboratory's axes. Raises
    TrialUnusable: a plate's corners go round the other way, so that it pulls whoever stands on it down.
    """
    normals = axes.rotate(forces.normals)
    upward = np.where(normals[:, 1:2] < 0, -normals, normals)
    force, moment = axes.rotate(forces.force), axes.rotate(forces.moment)
    repairs = [r for r in axes.repairs if r.what in ("up_axis", "forward_axis")]
    turned = forces.change(
        *repairs,
        force=force,
        moment=moment,
        surfaces=axes.rotate(forces.surfaces),
        normals=upward,
        corners=None if forces.corners is None else axes.rotate(forces.corners),
    )
    pressing = turned.pressing
    loads = np.nansum(np.where(np.abs(pressing) > CONTACT_N, pressing, 0.0), axis=0)
    for name, load, normal in zip(forces.plates, loads, normals, strict=True):
        if load < 0.0 and normal[1] < 0.0:
            raise errors.TrialUnusable(
                f"the corners of {say_name(name)} go round the other way: mirrored, it pulls people down",
                file=forces.name,
                field="FORCE_PLATFORM.CORNERS",
                remedy="List them as C3D asks: of the plate's quadrants +x+y, -x+y, -x-y, +x-y, z downwards",
            )
    if loads.sum() < 0:
        note = trial.Repair("force_sign", forces.name, "forces pull the body down; they were turned round")
        return turned.change(note, force=-force, moment=-moment)
    return turned


def synchronise(forces: GroundForces, times: ArrayLike, *, cutoff_hz: float | None = None) -> GroundForces:
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
        raise errors.TrialUnusable(
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
    # Smooth values by a cubic spline in each run, others by straight lines
    sampled = np.full((len(wanted), *whole.shape[1:]), np.nan)
    for k in range(whole.shape[1]):
        values = whole[:, k]
        if cutoff_hz is None:
            sampled[:, k] = _interpolate(own, values, wanted)
            continue
        for start, stop in filters.find_runs(np.asarray(np.isfinite(values).all(axis=1))).tolist():
            inside = _is_within(own[start:stop], wanted)
            if stop - start > 1 and inside.any():
                sampled[inside, k] = scipy.interpolate.CubicSpline(own[start:stop], values[start:stop])(
                    wanted[inside]
                )
    outside = int(((wanted < own[0] - 1e-9) | (wanted > own[-1] + 1e-9)).sum())
    if outside:
        repairs.append(
            trial.Repair(
                "not_recorded", forces.name, "no forces at these frames of the markers", frames=outside
            )
        )
    force, moment, read = sampled[..., :3], sampled[..., 3:6], sampled[..., 6]
    return forces.change(*repairs, times=wanted, force=force, moment=moment, read=read)


def _regularise_clock(times: Array, values: Array, name: str) -> tuple[Array, Array, list[trial.Repair]]:
    """The regular clock that rounded times stand for; else values interpolated onto one."""
    n = len(times)
    if n < 3:
        return times, values, []
    regular = np.linspace(times[0], times[-1], n)
    step = regular[1] - regular[0]
    if np.abs(times - regular).max() <= ROUNDED * step:
        return regular, values, []
    flat = np.stack([_interpolate(times, values[:, k], regular) for k in range(values.shape[1])], axis=1)
    return (
        regular,
        flat,
        [trial.Repair("clock", name, "times are irregular; interpolated onto a regular clock", frames=n)],
    )


def _filter(
    values: Array, times: Array, cutoff_hz: float, forces: GroundForces
) -> tuple[Array, list[trial.Repair]]:
    rate = (len(times) - 1) / (times[-1] - times[0]) if len(times) > 1 else 0.0
    if not 0 < cutoff_hz < 0.5 * rate:
        raise errors.InputError(
            f"a cutoff of {cutoff_hz:g} Hz does not suit forces of {rate:g} Hz",
            file=forces.name,
            field="cutoff_hz",
            remedy=f"Choose one between 0 and {0.5 * rate:g} Hz",
        )
    whole = np.where(np.isfinite(values).all(axis=2, keepdims=True), values, np.nan)
    result = filters.filter_butterworth(whole, rate_hz=rate, cutoff_hz=cutoff_hz, order=ORDER)
    detail = f"zero-phase Butterworth, order {ORDER}, half power at {cutoff_hz:g} Hz"
    notes = [trial.Repair("smoothing", forces.name, detail, frames=len(times))]
    brief = "known too briefly between gaps to be filtered"
    return result.values, notes + trial.repair_each(
        np.any(result.unfiltered, axis=2), forces.plates, "not_smoothed", brief
    )


def _interpolate(times: Array, values: Array, wanted: Array) -> Array:
    result = np.full((len(wanted), values.shape[1]), np.nan)
    for start, stop in filters.find_runs(np.asarray(np.isfinite(values).all(axis=1))).tolist():
        inside = _is_within(times[start:stop], wanted)
        for column in range(values.shape[1]):
            result[inside, column] = np.interp(wanted[inside], times[start:stop], values[start:stop, column])
    return result


def _is_within(times: Array, wanted: Array) -> NDArray[np.bool_]:
    inside: NDArray[np.bool_] = (wanted >= times[0] - 1e-9) & (wanted <= times[-1] + 1e-9)
    return inside
