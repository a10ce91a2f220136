"""A recording with forces as the search sees it: what the plates measured minus what the motion needs."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np
import scipy
from numpy.typing import NDArray

from scaling_service.capabilities.discovery.observations.oscillator import compute_pull
from scaling_service.capabilities.discovery.observations.tracked import InertialLoads, MotionFit
from scaling_service.capabilities.kinetics.inverse_dynamics import RatedMotion
from scaling_service.core.arrays import Array
from scaling_service.model.body import BodyModel
from scaling_service.model.compile import list_parameter_values
from scaling_service.model.forces import GroundForces
from scaling_service.model.inertia import compile_mechanism, gather_inertias
from scaling_service.numerics.multibody.motion import N_PARAMETERS
from scaling_service.numerics.multibody.tree import place_tree_markers, pose_links
from scaling_service.numerics.signals.filters import filter_butterworth
from scaling_service.recording.settings import DYNAMICS_CUTOFF_HZ

COMPONENTS = ("fx", "fy", "fz", "mx", "my", "mz")
FEET = ("calcn", "toes", "foot", "talus")
"""What names of segments of a foot begin with."""

BAND_HZ = 15.0
"""Of the light filter of coordinates and forces (chosen: holds gait to its 15th harmonic; above it double
differentiation makes more noise than the comparison's filter takes off)."""


class Load(Protocol):
    """What changes the ground wrench in proportion to a number."""

    def column(self, fit: WrenchFit) -> Array:
        """Its derivative, (n, 6), moment about the ground origin."""


def choose_band_hz(rate_hz: float) -> float:
    """The light filter's half-power frequency at a frame rate."""
    return min(BAND_HZ, 0.4 * rate_hz)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Step:
    """A foot alone on one plate."""

    plate: str
    segments: tuple[str, ...]  # of the foot
    outward: float  # 1 where the foot's outer side is to its right, else -1
    frames: slice
    whole: bool  # from its coming down to its going: else pressure may lie anywhere along it


@dataclass(frozen=True, slots=True, eq=False)
class ContactAssignment:
    """The ground's forces in one trial, and in which frames they are all that touches the body."""

    ground: GroundForces  # at the trial's times, in its axes, filtered by :func:`choose_band_hz`
    usable: NDArray[np.bool_]  # (n,): frames in which nothing but the plates is known to touch the body
    cutoff_hz: float = DYNAMICS_CUTOFF_HZ  # below which wrenches are compared
    steps: tuple[Step, ...] = ()


@dataclass(frozen=True, eq=False, kw_only=True)
class WrenchFit:
    """One trial with forces, its motion and what is left between the two."""

    tracked: MotionFit
    model: BodyModel  # with mass, as it is in this trial
    contacts: ContactAssignment
    gravity: Array  # (3,), m/s2
    oscillating: tuple[tuple[Load, float], ...] = ()  # masses (kg) on springs
    # (n, 6): what touches the body beside the plates, moment about the ground origin
    touched: Array | None = None

    @property
    def name(self) -> str:
        """The trial's."""
        return self.tracked.name

    @property
    def cutoff_hz(self) -> float:
        """Below which wrenches are compared."""
        return self.contacts.cutoff_hz

    @property
    def times(self) -> Array:
        """Of the frames, s."""
        return self.tracked.times

    def blocks(self, length_s: float) -> Iterator[slice]:
        """Blocks of time of about this length."""
        return self.tracked.blocks(length_s)

    @property
    def inertial_loads(self) -> InertialLoads:
        """What the motion needs, filtered as lightly as the forces."""
        return self.tracked.inertial_loads(self.gravity, choose_band_hz(self.tracked.trial.rate_hz))

    @property
    def rated(self) -> RatedMotion:
        """The motion with its rates, filtered as lightly as the forces."""
        return self.inertial_loads.rated

    def filter(self, ground_wrench: Array) -> Array:
        """A wrench (n, 6) about the ground origin below the frequency of comparison.

        Motion and forces pass the filter as wrenches: filtered coordinates need another wrench than the
        filtered one, by some 10 N in brisk walking at 5 Hz.
        """
        rate = self.tracked.trial.rate_hz
        cutoff = min(self.cutoff_hz, 0.4 * rate)
        return filter_butterworth(ground_wrench, rate_hz=rate, cutoff_hz=cutoff, order=4).values

    @cached_property
    def measured(self) -> Array:
        """All plates together, (n, 6), moment about the ground origin; zero where not known."""
        ground = self.contacts.ground
        both = np.concatenate([ground.force, ground.moment], axis=2)
        return np.asarray(np.nan_to_num(both).sum(axis=1))

    @cached_property
    def usable(self) -> NDArray[np.bool_]:
        """Frames that count: usable, known, away from the ends where filters lean on nothing."""
        known = self.contacts.usable & np.isfinite(self.rated.qddot).all(axis=1)
        known &= self.contacts.ground.known.all(axis=1)
        edge = 0.5 / self.cutoff_hz
        inside = (self.times >= self.times[0] + edge) & (self.times <= self.times[-1] - edge)
        reach = int(np.ceil(edge * self.tracked.trial.rate_hz))
        spoilt = (
            scipy.ndimage.binary_dilation(~known, iterations=reach) if reach and not known.all() else ~known
        )
        return np.asarray(inside & ~spoilt)

    @property
    def about(self) -> Array:
        """The point that moments are taken about: the trunk's origin, (n, 3), m."""
        return self.inertial_loads.root

    @cached_property
    def needed(self) -> Array:
        """What the motion needs with the model's masses, (n, 6), moment about the ground origin."""
        return np.asarray(self.inertial_loads.per_number @ gather_inertias(self.model).parameters().ravel())

    @cached_property
    def residuals(self) -> Array:
        """Measured minus needed, smoothed, (n, 6), moment about :attr:`about`."""
        left = self.measured - self.needed
        for load, size in self.oscillating:
            left = left - size * load.column(self)
        smooth = self.filter(np.nan_to_num(left))
        return self.move_moment(smooth if self.touched is None else smooth + self.touched)

    def move_moment(self, ground_wrench: Array) -> Array:
        """A wrench (n, 6) with its moment about :attr:`about` instead of the ground origin."""
        moment = ground_wrench[:, 3:] - np.cross(self.about, ground_wrench[:, :3])
        return np.concatenate([ground_wrench[:, :3], moment], axis=1)

    def compute_needed_more(self, segment: str, change: Sequence[float]) -> Array:
        """Wrench about the ground origin that a change (10,) of a segment's numbers needs, (n, 6)."""
        at = N_PARAMETERS * self.model.segment_names.index(segment)
        return np.asarray(self.inertial_loads.per_number[:, :, at : at + N_PARAMETERS] @ change)

    def _numbers(self, segments: Sequence[str]) -> list[int]:
        return [self.model.segment_names.index(segment) for segment in segments]

    @cached_property
    def step(self) -> float:
        """Time from frame to frame, s."""
        return self.tracked.step

    @cached_property
    def _places(self) -> tuple[Array, Array, Array]:
        """Centres of mass (n, s, 3), origins (n, s, 3) and axes (n, s, 3, 3) of all segments."""
        mechanism, p = compile_mechanism(self.model), list_parameter_values(self.model)
        poses = pose_links(mechanism.tree, self.rated.rates.q, p)
        centres = np.moveaxis(place_tree_markers(mechanism.tree, poses), -1, 0)
        return centres, np.moveaxis(poses.origins, -1, 0), np.moveaxis(poses.axes, -1, 0)

    def centres(self, segments: Sequence[str], along: float = 1.0) -> Array:
        """Points ``along`` of the way from origins to centres of mass of segments, (n, n_segments, 3), m."""
        return _interpolate_places(self._places[:2], along, self._numbers(segments))

    def pulls(self, segments: Sequence[str], along: float = 1.0) -> Array:
        """Minus the acceleration of these points, (n, n_segments, 3), m/s2."""
        return _interpolate_places(self._pulls, along, self._numbers(segments))

    @cached_property
    def _pulls(self) -> tuple[Array, Array]:
        centres, origins = (compute_pull(places, self.step) for places in self._places[:2])
        return centres, origins

    def segment_frame(self, segment: str) -> tuple[Array, Array]:
        """A segment's origin (n, 3) and axes (n, 3, 3), the axes as rows."""
        k = self.model.segment_names.index(segment)
        return self._places[1][:, k], self._places[2][:, k]

    @property
    def mass(self) -> float:
        """Of the whole body, kg."""
        return float(sum(s.mass for s in self.model.segments))

    @cached_property
    def centre_of_mass(self) -> Array:
        """Of the whole body, (n, 3), m."""
        masses = np.array([s.mass for s in self.model.segments])
        return np.asarray(np.einsum("s,nsa->na", masses / masses.sum(), self._places[0]))

    def plate(self, name: str) -> Array:
        """One plate's wrench, (n, 6), moment about the ground origin; zero for a plate that there is not."""
        return self._of_plate(name, lambda g, k: np.concatenate([g.force[:, k], g.moment[:, k]], axis=1), 6)

    def readings(self, name: str) -> Array:
        """How much of each frame a plate's readings make, (n,), 0 to 1."""
        return self._of_plate(name, lambda g, k: g.readings[:, k])

    def _of_plate(self, name: str, what: Callable[[GroundForces, int], Array], *width: int) -> Array:
        ground = self.contacts.ground
        if name not in ground.plates:
            return np.zeros((len(self.times), *width))
        return np.asarray(np.nan_to_num(what(ground, ground.plates.index(name))))

    def tells_of(self, name: str) -> bool:
        """Whether a plate bears something in frames that count, or a step."""
        ground = self.contacts.ground
        if name not in ground.plates:
            return False
        bears = ground.in_contact()[:, ground.plates.index(name)] & self.usable
        return bool(bears.any()) or any(step.plate == name for step in self.contacts.steps)

    def centre(self, name: str) -> Array:
        """The middle of a plate, (3,), m; zero for a plate that there is not."""
        ground = self.contacts.ground
        return (
            find_middle_of_pressure(ground, ground.plates.index(name))
            if name in ground.plates
            else np.zeros(3)
        )


def _interpolate_places(ends: tuple[Array, Array], along: float, numbers: Sequence[int]) -> Array:
    """Between values of some segments' centres (along = 1) and origins (0)."""
    centres, origins = (values[:, numbers] for values in ends)
    return np.asarray(along * centres + (1.0 - along) * origins)


def find_middle_of_pressure(ground: GroundForces, k: int) -> Array:
    """The mean centre of pressure of a plate, else the point of its surface that is known, (3,), m."""
    centres = ground.centre_of_pressure()[:, k]
    known = np.isfinite(centres).all(axis=1)
    return np.asarray(centres[known].mean(axis=0) if known.any() else ground.surfaces[k])
