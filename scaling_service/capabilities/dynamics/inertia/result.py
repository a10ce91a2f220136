"""What inertial identification gives: a model, every parameter, and what held-out recordings say of it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

import numpy as np

from scaling_service.model.body import BodyModel
from scaling_service.numerics.multibody.laws import Array

QUANTITIES = ("mass", "com_x", "com_y", "com_z", "Ixx", "Iyy", "Izz", "Ixy", "Ixz", "Iyz")
"""kg, m in the segment's frame, kg m2 about the centre of mass in the segment's axes."""

_NOTHING: Mapping[str, float] = MappingProxyType({})


@dataclass(frozen=True, slots=True)
class InertialParameter:
    """One number of one segment, in SI units.

    Parameters
    ----------
    segment : str
    quantity : str
        One of ``QUANTITIES``.
    before, after : float
    prior_sd, sd : float
        Before and after; the second leaves out that limits of possible bodies narrow it.
    identifiable : bool
        Whether the recordings say more about it than the prior does.
    """

    segment: str
    quantity: str
    before: float
    after: float
    prior_sd: float
    sd: float
    identifiable: bool

    @property
    def moved(self) -> float:
        """The change in units of the prior's standard deviation."""
        return (self.after - self.before) / self.prior_sd


@dataclass(frozen=True, slots=True)
class Combination:
    """A combination of parameters that the recordings determine.

    Parameters
    ----------
    shares : tuple of (segment, quantity, weight)
        Its largest parts; the weights are a unit vector in units of the prior's standard deviations.
    gain : float
        How many times more the recordings say about it than the prior, as variances.
    moved, sd : float
        Change and standard deviation, in units of the prior's.
    """

    shares: tuple[tuple[str, str, float], ...]
    gain: float
    moved: float
    sd: float


@dataclass(frozen=True, slots=True, eq=False)
class WrenchFit:
    """How well the ground wrench of one recording is explained.

    Parameters
    ----------
    trial : str
    held_out : bool
        Whether it was not used to fit.
    frames : int
    before, after : ndarray, shape (6,), N and N m
        RMS error with the prior's and the identified inertia; moments about the root segment's origin,
        ground axes, in the order of ``COMPONENTS``.
    """

    trial: str
    held_out: bool
    frames: int
    before: Array
    after: Array


@dataclass(frozen=True, slots=True, eq=False)
class InertialIdentification:
    """The inertia that recordings and tables give together.

    Parameters
    ----------
    model : BodyModel
        With the identified inertia.
    parameters : tuple of InertialParameter
        Ten for each segment with mass.
    combinations : tuple of Combination
        Those that were free to move, best determined first.
    fits : tuple of WrenchFit
        Fitted and held-out recordings.
    components : tuple of bool
        Which components of the wrench were used.
    noise : ndarray, shape (6,), N and N m
        Standard deviation of the wrench's error that was assumed or found; NaN for components not used.
    warnings : tuple of str
    settings : mapping
        What was decided, for documents.
    """

    model: BodyModel
    parameters: tuple[InertialParameter, ...]
    combinations: tuple[Combination, ...]
    fits: tuple[WrenchFit, ...]
    components: tuple[bool, ...]
    noise: Array
    warnings: tuple[str, ...] = ()
    settings: Mapping[str, object] = field(default_factory=lambda: _NOTHING)

    def relative_error(self, *, held_out: bool) -> float:
        """Error after over error before, of the used components, each counted in units of the noise.

        NaN where there is no such recording.
        """
        fits = [fit for fit in self.fits if fit.held_out == held_out]
        used = np.array(self.components)
        if not fits:
            return float("nan")
        before, after = (
            sum(f.frames * float(((value / self.noise)[used] ** 2).sum()) for f, value in pairs)
            for pairs in ([(f, f.before) for f in fits], [(f, f.after) for f in fits])
        )
        return float(np.sqrt(after / before))
