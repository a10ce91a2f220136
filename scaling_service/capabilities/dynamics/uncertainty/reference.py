"""A recording as perturbed motions need it: Muller's reference data (2017, sec. 2.1), set up once."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from scaling_service.capabilities.kinetics import inverse_dynamics
from scaling_service.core.arrays import Array
from scaling_service.model import body, inertia
from scaling_service.model import compile as compiling
from scaling_service.model.forces import SegmentLoads
from scaling_service.model.results import Motion
from scaling_service.numerics import wrench as wrenches
from scaling_service.numerics.multibody import tree as trees
from scaling_service.numerics.multibody.motion import Mechanism
from scaling_service.numerics.multibody.motion import Motion as Rates
from scaling_service.numerics.signals import filters
from scaling_service.recording.settings import DYNAMICS_CUTOFF_HZ

STENCIL = (1.6, -0.2, 8.0 / 315.0, -1.0 / 560.0)
"""Weights of the central second difference of order 8 at lags 1 to 4, times the squared step (Fornberg 1988,
Math Comput 51:699-706, table 1). At 5 Hz and 100 frames per second it errs by 3e-8, at 20 Hz by 8e-4."""

SLOPES = (0.8, -0.2, 4.0 / 105.0, -1.0 / 280.0)
"""The same of the first difference, times the step."""

HALO = len(STENCIL)
"""Frames on each side that the difference needs."""

_PERIODS = 20  # of the cutoff; chosen: the impulse response has long died away


def make_trees(
    model: body.BodyModel, markers: tuple[str, ...], segments: Sequence[body.Segment]
) -> tuple[trees.Tree, trees.Tree]:
    """A tree with these markers and then the segments' centres of mass, and the same without the latter."""
    centres = tuple(body.Marker.at(f"centre of mass of {s.name}", s.name, s.com) for s in segments)
    whole = compiling.compile_model(model.with_markers((*(model.marker(name) for name in markers), *centres)))
    count = len(markers)
    alone = dataclasses.replace(
        whole,
        marker_link=whole.marker_link[:count],
        marker_local=whole.marker_local[:count],
        marker_terms=tuple(t for t in whole.marker_terms if t.marker < count),
    )
    return whole, alone


def difference_twice(x: Array, step_s: float) -> Array:
    """Second derivative along the last axis without the halo, shape (..., n - 2 HALO)."""
    n = x.shape[-1] - 2 * HALO
    result: Array = -2.0 * sum(STENCIL) * x[..., HALO : HALO + n]
    for lag, weight in enumerate(STENCIL, start=1):
        result += weight * (x[..., HALO + lag : HALO + lag + n] + x[..., HALO - lag : HALO - lag + n])
    return result / step_s**2


def difference_once(x: Array, step_s: float) -> Array:
    """First derivative along the last axis without the halo, shape (..., n - 2 HALO)."""
    n = x.shape[-1] - 2 * HALO
    result: Array = np.zeros((*x.shape[:-1], n))
    for lag, weight in enumerate(SLOPES, start=1):
        result += weight * (x[..., HALO + lag : HALO + lag + n] - x[..., HALO - lag : HALO - lag + n])
    return result / step_s


NoiseOn = Literal["rotations", "all"]
"""Which coordinates are perturbed. One size cannot serve radians and metres: as much noise on the root's
position as on every angle moves the whole body and is nearly all of the forces' uncertainty, the vertical
one's as well; the paper's vertical one is about half of the horizontal ones (fig. 8), as noise on rotations
makes it here."""


@dataclasses.dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class LoadedMotion:
    """One recording with its external loads."""

    model: body.BodyModel  # with mass, as inverse kinematics used it
    motion: Motion  # from inverse kinematics, not filtered, of a constant rate
    loads: SegmentLoads  # on the motion's clock, filtered as the motion will be
    height_m: float  # the person's stature
    # (n,): those to judge, such as with no foot beside the plates. All known ones by default.
    frames: NDArray[np.bool_] | None = None
    # cutoff_hz, order: of the filter of inverse dynamics
    cutoff_hz: float = DYNAMICS_CUTOFF_HZ
    order: int = inverse_dynamics.ORDER


@dataclasses.dataclass(frozen=True, eq=False, kw_only=True)
class Reference:
    """The reference data as arrays, frames last."""

    trial: str
    mechanism: Mechanism
    tree: trees.Tree  # with the markers that are compared with the measured ones
    p: Array  # (n_parameters,)
    low_pass: LowPass
    step_s: float
    q: Array  # (n_coordinates, n), rad or m: filtered
    varied: NDArray[np.intp]  # coordinates that are perturbed
    # runs of frames in which all coordinates are known, long enough to differentiate
    spans: tuple[tuple[int, int], ...]
    measured: Array  # (n_markers, 3, n), m: zero where not seen
    seen: Array  # (n_markers, n): 1 where a marker was seen, else 0
    loads: SegmentLoads
    external: Array  # (6, n), N and N m: all loads together about the ground origin
    used: NDArray[np.bool_]  # (n,): frames whose residual is judged
    scale: Array  # (6,), N and N m: body weight, and body weight times stature

    @classmethod
    def of(cls, recording: LoadedMotion, noise_on: NoiseOn = "rotations") -> Reference:
        """Filter and arrange a recording; noise goes on those coordinates that the markers determine.

        Refuses a cutoff or stature that does not suit, loads on another clock, and a recording without a
        frame that has a motion and all its forces.
        """
        model, motion = recording.model, recording.motion
        inverse_dynamics.check_clock(recording.loads, motion.times, motion.trial)
        scale = inverse_dynamics.scale_indicator(inertia.sum_mass(model), recording.height_m)
        raw = inverse_dynamics.in_model_order(model, motion)
        rated = inverse_dynamics.differentiate_motion(
            model, motion.times, raw, cutoff_hz=recording.cutoff_hz, order=recording.order
        )
        known = np.asarray(np.isfinite(rated.q).all(axis=1))
        spans = tuple((a, b) for a, b in filters.find_runs(known).tolist() if b - a > 2 * HALO)
        inner = np.zeros(len(known), dtype=bool)
        for start, stop in spans:
            inner[start + HALO : stop - HALO] = True
        external = recording.loads.total.T
        used = inner & np.asarray(np.isfinite(external).all(axis=0))
        if recording.frames is not None:
            used &= recording.frames
        if not used.any():
            raise inverse_dynamics.report_no_frame(motion.trial)
        # Markers first, frames last; zero where not seen.
        tree = compiling.compile_model(model, motion.markers)
        placed = trees.pose_markers(tree, np.nan_to_num(raw), compiling.list_parameter_values(model))
        measured = np.moveaxis(placed + motion.residuals, 0, -1)
        shown = np.asarray(np.isfinite(measured).all(axis=1) & np.isfinite(motion.q).all(axis=1))
        measured = np.where(shown[:, None], measured, 0.0)
        step = float(np.median(np.diff(motion.times)))
        names = set(motion.estimated)
        chosen = [
            k
            for k, coordinate in enumerate(model.coordinates)
            if coordinate.name in names and (noise_on == "all" or coordinate.kind == "rotation")
        ]
        return cls(
            trial=motion.trial,
            mechanism=inertia.compile_mechanism(model),
            tree=tree,
            p=compiling.list_parameter_values(model),
            low_pass=LowPass(1.0 / step, recording.cutoff_hz, recording.order),
            step_s=step,
            q=np.ascontiguousarray(rated.q.T),
            varied=np.array(chosen, dtype=np.intp),
            spans=spans,
            measured=measured,
            seen=np.ascontiguousarray(shown.astype(float)),
            loads=recording.loads,
            external=np.where(np.isfinite(external), external, 0.0),
            used=used,
            scale=scale,
        )

    @property
    def n_frames(self) -> int:
        """How many frames there are."""
        return int(self.q.shape[1])

    def perturb(self, noise: Array, size: float) -> Array:
        """The reference motion with filtered noise added, white (len(varied), n) times its size, rad and m.

        The filter is linear, so noise is filtered alone.
        """
        q = self.q.copy()
        for start, stop in self.spans:
            q[self.varied, start:stop] += size * self.low_pass.apply(noise[:, start:stop])
        return q

    def residual(self, q: Array) -> tuple[float, Array]:
        """What a filtered motion (n_coordinates, n) leaves unexplained.

        The mean distance between measured and model markers, m (Muller et al. 2017, eq. 3), and the residual
        (6, n), N and N m, about the root segment's origin, meaningless where not ``used``.
        """
        residual = np.zeros((6, self.n_frames))
        far = np.zeros(self.seen.shape)
        for start, stop in self.spans:
            inner = slice(start + HALO, stop - HALO)
            known = q[:, start:stop]
            rates = difference_once(known, self.step_s), difference_twice(known, self.step_s)
            wrench, root = wrenches.compute_root_wrench(self.mechanism, Rates(q[:, inner], *rates), self.p)
            residual[:, inner] = wrenches.move_moment(wrench - self.external[:, inner], root)
            poses = trees.pose_links(self.tree, np.ascontiguousarray(q[:, inner]), self.p)
            away = trees.place_tree_markers(self.tree, poses) - self.measured[:, :, inner]
            far[:, inner] = self.seen[:, inner] * np.linalg.norm(away, axis=1)
        count = sum(self.seen[:, start + HALO : stop - HALO].sum() for start, stop in self.spans)
        return float(far.sum() / count), residual

    def indicator(self, residual: Array) -> Array:
        """Muller's dr (eq. 7) over the frames used, shape (6,)."""
        used = residual[:, self.used]
        return np.asarray(np.sqrt(np.einsum("cn,cn->c", used, used) / used.shape[1]) / self.scale)


@dataclasses.dataclass(frozen=True, slots=True)
class LowPass:
    """The zero-phase Butterworth filter of inverse dynamics."""

    rate_hz: float
    cutoff_hz: float
    order: int  # see ``butterworth``

    def apply(self, noise: Array) -> Array:
        """Filter finite noise (m, n) along the last axis; what is too short for it stays as it is."""
        found = filters.filter_run(noise, rate_hz=self.rate_hz, cutoff_hz=self.cutoff_hz, order=self.order)
        return noise if found is None else found

    def autocovariance(self, lags: int) -> Array:
        """Of filtered white noise of unit variance, at lags 0 to ``lags``."""
        reach = int(np.ceil(_PERIODS * self.rate_hz / self.cutoff_hz))
        impulse = np.zeros((1, 2 * reach + 1))
        impulse[0, reach] = 1.0
        response = np.pad(self.apply(impulse)[0], (0, lags))
        return np.array([response @ np.roll(response, -lag) for lag in range(lags + 1)])
