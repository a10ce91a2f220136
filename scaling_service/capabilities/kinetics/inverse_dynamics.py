"""Joint forces and the residual wrench of a recorded motion, and how large the residual is.

The motion is filtered once; velocities and accelerations are exact derivatives of one quintic spline per
coordinate. External loads must have been filtered by the same filter
(``synchronise``).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from scaling_service.core import errors
from scaling_service.core.arrays import Array
from scaling_service.model import inertia
from scaling_service.model.body import BodyModel
from scaling_service.model.compile import list_parameter_values
from scaling_service.model.forces import SegmentLoads
from scaling_service.model.results import Motion
from scaling_service.numerics import wrench
from scaling_service.numerics.multibody import tree
from scaling_service.numerics.multibody.motion import Motion as Rates
from scaling_service.numerics.signals import filters
from scaling_service.numerics.signals.splines import differentiate_spline
from scaling_service.numerics.wrench import GRAVITY
from scaling_service.recording.plates_feet import FootContacts
from scaling_service.recording.settings import DYNAMICS_CUTOFF_HZ

ORDER = 4
"""Effective order, zero phase; Muller et al. 2017, sec. 2.1."""

EDGE_PERIODS = 0.5
"""Periods of the cutoff left out at both ends of what is known (chosen). There the filter leans on
mirrored data: in public walking trials the residual peaks at 90 to 240 N there, at 30 to 120 N elsewhere."""

FASTEST = 200.0
"""Angular acceleration of a filtered joint worth a note, rad/s2 (chosen: 0.2 rad to and fro at 5 Hz; knees in
walking reach about 100). Markers that hardly determine a joint make it tremble so."""

COMPONENTS = ("fx", "fy", "fz", "mx", "my", "mz")
"""Ground axes X forward, Y up, Z right. Muller et al. 2017 have Z up: their Fz, Mz are our fy, my."""

HICKS = "Hicks 2015"
"""Name of the limits of Hicks et al. 2015, J Biomech Eng 137:020905, table 2."""

FORCE_SHARE = 0.05
"""Residual force over net external force (Hicks et al. 2015)."""

MOMENT_SHARE = 0.01
"""Residual moment over net external force times height of the centre of mass (Hicks et al. 2015)."""

OPENSIM_LIMITS = (("peak force", 25.0), ("RMS force", 15.0), ("peak moment", 75.0), ("RMS moment", 50.0))
"""N and N m: upper ends of what OpenSim's "Simulation checklist" accepts for residuals of walking."""

PLAUSIBLE_M = (0.5, 2.5)
"""Statures outside are not statures (chosen)."""


@dataclass(frozen=True, slots=True, eq=False)
class RatedMotion:
    """A filtered motion with its exact rates."""

    times: Array  # (n,), s
    # q, qdot, qddot (n, n_coordinates), rad or m, per s, per s2: in the model's order. NaN where not known,
    # or known too briefly to differentiate.
    q: Array
    qdot: Array
    qddot: Array

    @property
    def rates(self) -> Rates:
        """For the kernels: frames last."""
        return Rates.of_frames(self.q, self.qdot, self.qddot)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class InverseDynamics:
    """What a motion needs beside the external loads."""

    trial: str
    coordinates: tuple[str, ...]
    motion: RatedMotion
    # (n, n_coordinates), N m or N: generalised force of every coordinate; those of the root's are the
    # residual in its own axes
    forces: Array
    # (n, 6): force (N) and moment about the root segment's origin (N m), ground axes: what the motion needs
    # and nothing provides (lambda_1 of Muller et al. 2017, eq. 6).
    residual: Array
    root: Array  # (n, 3), m: the root segment's origin
    centre_of_mass: Array  # (n, 3), m
    external: Array  # (n, 6): all external loads together: force (N), moment about the ground origin (N m)
    mass: float  # kg: the model's

    @property
    def known(self) -> NDArray[np.bool_]:
        """Frames whose residual is known, shape (n,)."""
        return np.asarray(np.isfinite(self.residual).all(axis=1))

    def find_used(self, frames: NDArray[np.bool_] | None = None) -> NDArray[np.bool_]:
        """Frames whose residual is known, of those given, (n,); TrialUnusable where there is none."""
        used = self.known if frames is None else self.known & frames
        if not used.any():
            raise report_no_frame(self.trial)
        return used


def report_no_frame(trial: str) -> errors.TrialUnusable:
    """Tells that nothing of a recording can be judged."""
    return errors.TrialUnusable(
        "no frame has both a motion and all its forces",
        file=trial,
        field="forces",
        remedy="Check that every foot on the floor stands on a plate",
    )


def check_clock(loads: SegmentLoads, times: Array, trial: str) -> None:
    """Refuse loads that are not at the times of the motion."""
    if len(loads.times) != len(times) or np.abs(loads.times - times).max() > 1e-6:
        raise errors.TrialUnusable(
            "loads and motion are not on one clock",
            file=trial,
            field="time",
            remedy="Bring the forces to the times of the markers first",
        )


def differentiate_motion(
    model: BodyModel,
    times: ArrayLike,
    q: ArrayLike,
    *,
    cutoff_hz: float | None = DYNAMICS_CUTOFF_HZ,
    order: int = ORDER,
) -> RatedMotion:
    """Filter coordinates and differentiate them.

    ``times`` (n,), s, strictly increasing, of constant rate where a cutoff is given. ``q`` (n,
    n_coordinates), rad or m, in the model's order; NaN where not known. ``order`` is that of both passes
    together. Refuses a cutoff that is not below half the frame rate.
    """
    # Rotations without jumps of whole turns, which a filter would smear; each run by itself.
    smooth = np.array(q, dtype=float)
    for column, coordinate in enumerate(model.coordinates):
        if coordinate.kind == "rotation":
            for start, stop in filters.find_runs(np.isfinite(smooth[:, column])).tolist():
                smooth[start:stop, column] = np.unwrap(smooth[start:stop, column])
    clock, values = np.asarray(times, dtype=float), smooth
    if cutoff_hz is not None:
        rate = 1.0 / float(np.median(np.diff(clock)))
        if not 0 < cutoff_hz < 0.5 * rate:
            raise errors.InputError(
                f"a cutoff of {cutoff_hz:g} Hz does not suit {rate:g} frames per second",
                field="cutoff_hz",
                remedy=f"Choose one between 0 and {0.5 * rate:g} Hz",
            )
        values = filters.filter_butterworth(values, rate_hz=rate, cutoff_hz=cutoff_hz, order=order).values
    qdot, qddot = differentiate_spline(clock, values)
    return RatedMotion(clock, values, qdot, qddot)


def solve_inverse_dynamics(
    model: BodyModel,
    motion: Motion,
    loads: SegmentLoads | None = None,
    *,
    cutoff_hz: float | None = DYNAMICS_CUTOFF_HZ,
) -> InverseDynamics:
    """Joint forces and residual wrench of a motion that inverse kinematics found.

    The model has mass and its parameters are at their values. Loads are at the motion's times; without any,
    nothing touches the body. Refuses loads on another clock or on a segment that the model does not have.
    """
    rated = differentiate_motion(model, motion.times, in_model_order(model, motion), cutoff_hz=cutoff_hz)
    return compute_dynamics(model, rated, loads, trial=motion.trial)


def compute_dynamics(
    model: BodyModel, rated: RatedMotion, loads: SegmentLoads | None = None, *, trial: str = ""
) -> InverseDynamics:
    """Joint forces and residual wrench of a motion whose rates are known; errors as above."""
    mechanism, p = inertia.compile_mechanism(model), list_parameter_values(model)
    rates = rated.rates
    if loads is None:
        acting = None
    else:
        check_clock(loads, rated.times, trial)
        unknown = [name for name in loads.segments if name not in model.segment_names]
        if unknown:
            raise errors.InputError(
                f"a load acts on '{unknown[0]}', which is no segment of the model",
                file=trial,
                field=unknown[0],
                remedy=f"Segments are {', '.join(model.segment_names)}",
            )
        rows = np.array([model.segment_names.index(name) for name in loads.segments], dtype=np.intp)
        both = np.concatenate([loads.force, loads.moment], axis=2)
        acting = wrench.Loads(rows, np.ascontiguousarray(np.moveaxis(both, 0, -1)))
    found = wrench.compute_inverse_dynamics(mechanism, rates, p, acting)
    centres = tree.place_tree_markers(mechanism.tree, tree.pose_links(mechanism.tree, rates.q, p))
    masses = mechanism.inertias.mass
    centre = np.einsum("k,kan->na", masses / masses.sum(), centres)
    external = loads.total if loads is not None else np.zeros((len(rated.times), 6))
    return InverseDynamics(
        trial=trial,
        coordinates=model.coordinate_names,
        motion=rated,
        forces=np.ascontiguousarray(found.forces.T),
        residual=np.ascontiguousarray(found.residual.T),
        root=np.ascontiguousarray(found.root.T),
        centre_of_mass=centre,
        external=external,
        mass=inertia.sum_mass(model),
    )


def in_model_order(model: BodyModel, motion: Motion) -> Array:
    """The motion's coordinates as the model orders them, (n, n_coordinates)."""
    missing = [name for name in model.coordinate_names if name not in motion.coordinates]
    if missing:
        raise errors.TrialUnusable(
            f"the motion has no coordinate '{missing[0]}'",
            file=motion.trial,
            field=missing[0],
            remedy=f"Give a motion of the model '{model.name}'",
        )
    return motion.q[:, [motion.coordinates.index(name) for name in model.coordinate_names]]


def find_judged_frames(
    dynamics: InverseDynamics, contacts: FootContacts, cutoff_hz: float
) -> NDArray[np.bool_]:
    """Frames with motion and all forces, away from the ends of what is known, shape (n,)."""
    known = dynamics.known
    edge = EDGE_PERIODS / cutoff_hz - 1e-9
    times = dynamics.motion.times
    inner = np.zeros_like(known)
    for start, stop in filters.find_runs(known).tolist():
        span = times[start:stop]
        inner[start:stop] = (span - span[0] >= edge) & (span[-1] - span >= edge)
    return inner & contacts.supported


def find_trembling(dynamics: InverseDynamics, model: BodyModel, frames: NDArray[np.bool_]) -> list[str]:
    """Coordinates that turn faster than joints do, largest first."""
    fastest = {
        coordinate.name: float(np.abs(dynamics.motion.qddot[frames, k]).max())
        for k, coordinate in enumerate(model.coordinates)
        if coordinate.kind == "rotation"
    }
    return sorted((n for n, value in fastest.items() if value > FASTEST), key=lambda n: -fastest[n])


@dataclass(frozen=True, slots=True, kw_only=True)
class Gate:
    """One limit on the residual.

    ``value`` and ``limit`` in ``unit``; it is passed where the value is not above the limit.
    """

    name: str
    source: str
    value: float
    limit: float
    unit: str

    @property
    def passed(self) -> bool:
        """Whether the residual is small enough."""
        return self.value <= self.limit


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Residuals:
    """The residual of one recording."""

    trial: str
    frames: int  # over how many it is computed
    left_out: int  # frames whose motion or forces are not known
    rms: Array  # (6,), N and N m: in the order of ``COMPONENTS``
    # (6,): ``rms`` over body weight, and over body weight times stature (Muller et al. 2017, eq. 7).
    dr: Array
    gates: tuple[Gate, ...]


def compute_residual_indicator(residual: Array, mass_kg: float, height_m: float) -> Array:
    """Muller's indicator dr of residual wrenches.

    ``residual`` (..., n, 6), N and N m: several samples may lead, frames with a NaN are left out. Returns
    (..., 6), NaN where no frame is known. Refuses a mass or height that cannot be a person's.

    Examples
    --------
    >>> import numpy as np
    >>> compute_residual_indicator(np.full((3, 6), 9.80665), 50.0, 2.0).round(12).tolist()
    [0.02, 0.02, 0.02, 0.01, 0.01, 0.01]
    """
    return np.asarray(_compute_rms(residual) / scale_indicator(mass_kg, height_m))


def scale_indicator(mass_kg: float, height_m: float) -> Array:
    """Body weight, and body weight times stature, (6,), N and N m; refuses what cannot be a person's."""
    if not mass_kg > 0:
        raise errors.InputError(
            f"a mass of {mass_kg:g} kg is none", field="subject.mass_kg", remedy="Give it in kg"
        )
    if not PLAUSIBLE_M[0] <= height_m <= PLAUSIBLE_M[1]:
        raise errors.InputError(
            f"a height of {height_m:g} m is none", field="subject.height_m", remedy="Give the stature in m"
        )
    weight = mass_kg * -GRAVITY[1]
    return np.array([weight] * 3 + [weight * height_m] * 3)


def evaluate_residuals(
    dynamics: InverseDynamics, height_m: float, *, frames: NDArray[np.bool_] | None = None
) -> Residuals:
    """The indicator and the gates of one recording, over those of the frames whose residual is known.

    Body weight is the model's.
    """
    used = dynamics.find_used(frames)
    residual = dynamics.residual[used]
    # Hicks's gates, peak against peak and RMS against RMS (our reading), and OpenSim's plain limits
    force, moment, external = (
        np.linalg.norm(x[used], axis=1)
        for x in (dynamics.residual[:, :3], dynamics.residual[:, 3:], dynamics.external[:, :3])
    )
    height = float(dynamics.centre_of_mass[used, 1].mean())
    gates = []
    for name, of in (("peak", np.max), ("RMS", lambda x: np.sqrt(np.mean(x**2)))):
        net = float(of(external))
        gates += [
            Gate(
                name=f"{name} force", source=HICKS, value=float(of(force)), limit=FORCE_SHARE * net, unit="N"
            ),
            Gate(
                name=f"{name} moment",
                source=HICKS,
                value=float(of(moment)),
                limit=MOMENT_SHARE * net * height,
                unit="N m",
            ),
        ]
    values = {g.name: g for g in gates}
    plain = [
        Gate(name=n, source="OpenSim checklist", value=values[n].value, limit=limit, unit=values[n].unit)
        for n, limit in OPENSIM_LIMITS
    ]
    return Residuals(
        trial=dynamics.trial,
        frames=int(used.sum()),
        left_out=int(len(used) - used.sum()),
        rms=_compute_rms(residual),
        dr=compute_residual_indicator(residual, dynamics.mass, height_m),
        gates=(*gates, *plain),
    )


def _compute_rms(residual: Array) -> Array:
    known = np.asarray(np.all(np.isfinite(residual), axis=-1))
    squares = np.where(known[..., None], residual, 0.0) ** 2
    count = known.sum(axis=-1)[..., None]
    with np.errstate(invalid="ignore"):  # 0/0 is NaN: no frame known
        rms: Array = np.sqrt(squares.sum(axis=-2) / count)
    return rms
