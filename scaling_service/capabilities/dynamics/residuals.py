"""How large the dynamic residual is: Muller's indicator, and the gates that OpenSim's users are told."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from scaling_service.capabilities.dynamics.inverse_dynamics import InverseDynamics
from scaling_service.core.errors import InputError
from scaling_service.numerics.multibody.laws import Array
from scaling_service.numerics.wrench.ground_wrench import GRAVITY

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


@dataclass(frozen=True, slots=True)
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


@dataclass(frozen=True, slots=True, eq=False)
class Residuals:
    """The residual of one recording."""

    trial: str
    frames: int  # over how many it is computed
    left_out: int  # frames whose motion or forces are not known
    rms: Array  # (6,), N and N m: in the order of ``COMPONENTS``
    # (6,): ``rms`` over body weight, and over body weight times stature (Muller et al. 2017, eq. 7).
    dr: Array
    gates: tuple[Gate, ...]


def residual_indicator(residual: Array, mass_kg: float, height_m: float) -> Array:
    """Muller's indicator dr of residual wrenches.

    ``residual`` (..., n, 6), N and N m: several samples may lead, frames with a NaN are left out. Returns
    (..., 6), NaN where no frame is known. Refuses a mass or height that cannot be a person's.

    Examples
    --------
    >>> import numpy as np
    >>> residual_indicator(np.full((3, 6), 9.80665), 50.0, 2.0).round(12).tolist()
    [0.02, 0.02, 0.02, 0.01, 0.01, 0.01]
    """
    indicator: Array = _rms(residual) / indicator_scale(mass_kg, height_m)
    return indicator


def indicator_scale(mass_kg: float, height_m: float) -> Array:
    """Body weight, and body weight times stature, (6,), N and N m; refuses what cannot be a person's."""
    if not mass_kg > 0:
        raise InputError(f"a mass of {mass_kg:g} kg is none", field="subject.mass_kg", remedy="Give it in kg")
    if not PLAUSIBLE_M[0] <= height_m <= PLAUSIBLE_M[1]:
        raise InputError(
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
    used = dynamics.used(frames)
    residual = dynamics.residual[used]
    return Residuals(
        dynamics.trial,
        int(used.sum()),
        int(len(used) - used.sum()),
        _rms(residual),
        residual_indicator(residual, dynamics.mass, height_m),
        _gates(dynamics, used),
    )


def _rms(residual: Array) -> Array:
    known = np.asarray(np.all(np.isfinite(residual), axis=-1))
    squares = np.where(known[..., None], residual, 0.0) ** 2
    count = known.sum(axis=-1)[..., None]
    with np.errstate(invalid="ignore"):  # 0/0 is NaN: no frame known
        rms: Array = np.sqrt(squares.sum(axis=-2) / count)
    return rms


def _gates(dynamics: InverseDynamics, used: NDArray[np.bool_]) -> tuple[Gate, ...]:
    """Hicks's gates, peak against peak and RMS against RMS (our reading), and OpenSim's plain limits."""
    force, moment, external = (
        np.linalg.norm(x[used], axis=1)
        for x in (dynamics.residual[:, :3], dynamics.residual[:, 3:], dynamics.external[:, :3])
    )
    height = float(dynamics.centre_of_mass[used, 1].mean())
    gates = []
    for name, of in (("peak", np.max), ("RMS", lambda x: np.sqrt(np.mean(x**2)))):
        net = float(of(external))
        gates += [
            Gate(f"{name} force", HICKS, float(of(force)), FORCE_SHARE * net, "N"),
            Gate(f"{name} moment", HICKS, float(of(moment)), MOMENT_SHARE * net * height, "N m"),
        ]
    values = {g.name: g for g in gates}
    plain = [
        Gate(n, "OpenSim checklist", values[n].value, limit, values[n].unit) for n, limit in OPENSIM_LIMITS
    ]
    return (*gates, *plain)
