"""A recording as perturbed motions need it: Muller's reference data (2017, sec. 2.1), set up once."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from scaling_service.capabilities.dynamics.inverse_dynamics import ORDER, rated_motion
from scaling_service.capabilities.dynamics.settings import CUTOFF_HZ
from scaling_service.capabilities.dynamics.uncertainty.noise import LowPass
from scaling_service.capabilities.dynamics.uncertainty.points import HALO, PointBody
from scaling_service.core.errors import InputError, TrialUnusable
from scaling_service.model.body import BodyModel
from scaling_service.model.compile import compile_model, parameter_values
from scaling_service.model.forces import SegmentLoads
from scaling_service.model.inertia import total_mass
from scaling_service.model.results import Motion
from scaling_service.numerics.multibody.laws import Array
from scaling_service.numerics.multibody.tree import marker_positions, positions
from scaling_service.numerics.signals.filters import runs
from scaling_service.numerics.wrench.ground_wrench import GRAVITY, moment_about

NoiseOn = Literal["rotations", "all"]
"""Which coordinates are perturbed. One size cannot serve radians and metres: as much noise on the root's
position as on every angle moves the whole body and is nearly all of the forces' uncertainty, the vertical
one's as well; the paper's vertical one is about half of the horizontal ones (fig. 8), as noise on rotations
makes it here."""

BLOCK = 1016
"""Frames computed together; with the halo 1024 (chosen: the fastest measured, 3.2 µs a frame against 3.9
at 256; a block takes 15 MB)."""


@dataclass(frozen=True, slots=True, eq=False)
class Recording:
    """One recording with its external loads.

    Parameters
    ----------
    model : BodyModel
        With mass, as inverse kinematics used it.
    motion : Motion
        From inverse kinematics, not filtered, of a constant rate.
    loads : SegmentLoads
        On the motion's clock, filtered as the motion will be.
    height_m : float
        The person's stature.
    frames : ndarray of bool, shape (n,), optional
        Those to judge, such as with no foot beside the plates. All known ones by default.
    cutoff_hz, order : optional
        Of the filter of inverse dynamics.
    """

    model: BodyModel
    motion: Motion
    loads: SegmentLoads
    height_m: float
    frames: NDArray[np.bool_] | None = None
    cutoff_hz: float = CUTOFF_HZ
    order: int = ORDER


@dataclass(frozen=True, eq=False)
class Reference:
    """The reference data as arrays, frames last.

    Parameters
    ----------
    trial : str
    body : PointBody
    low_pass : LowPass
    step_s : float
    q : ndarray, shape (n_coordinates, n), rad or m
        Filtered.
    varied : ndarray of int
        Coordinates that are perturbed.
    spans : tuple of (int, int)
        Runs of frames in which all coordinates are known, long enough to differentiate.
    measured : ndarray, shape (n_markers, 3, n), m
        Zero where not seen.
    seen : ndarray, shape (n_markers, n)
        1 where a marker was seen, else 0.
    loads : SegmentLoads
    external : ndarray, shape (6, n), N and N m
        All loads together about the ground origin.
    used : ndarray of bool, shape (n,)
        Frames whose residual is judged.
    scale : ndarray, shape (6,), N and N m
        Body weight, and body weight times stature.
    """

    trial: str
    body: PointBody
    low_pass: LowPass
    step_s: float
    q: Array
    varied: NDArray[np.intp]
    spans: tuple[tuple[int, int], ...]
    measured: Array
    seen: Array
    loads: SegmentLoads
    external: Array
    used: NDArray[np.bool_]
    scale: Array

    @classmethod
    def of(cls, recording: Recording, noise_on: NoiseOn = "rotations") -> Reference:
        """Filter and arrange a recording.

        Parameters
        ----------
        recording : Recording
        noise_on : 'rotations' or 'all'
            Of the coordinates that the markers determine.

        Raises
        ------
        TrialUnusable
            Loads are on another clock, or no frame has a motion and all its forces.
        InputError
            The cutoff does not suit.
        """
        model, motion = recording.model, recording.motion
        _check_clocks(recording)
        order = [motion.coordinates.index(name) for name in model.coordinate_names]
        rated = rated_motion(
            model, motion.times, motion.q[:, order], cutoff_hz=recording.cutoff_hz, order=recording.order
        )
        known = np.asarray(np.isfinite(rated.q).all(axis=1))
        spans = tuple((a, b) for a, b in runs(known).tolist() if b - a > 2 * HALO)
        inner = np.zeros(len(known), dtype=bool)
        for start, stop in spans:
            inner[start + HALO : stop - HALO] = True
        external = recording.loads.total.T
        used = inner & np.asarray(np.isfinite(external).all(axis=0))
        if recording.frames is not None:
            used &= recording.frames
        if not used.any():
            raise TrialUnusable(
                "no frame has both a motion and all its forces",
                file=motion.trial,
                field="forces",
                remedy="Check that every foot on the floor stands on a plate",
            )
        measured, seen = _measured(model, motion)
        step = float(np.median(np.diff(motion.times)))
        weight = total_mass(model) * -GRAVITY[1]
        return cls(
            motion.trial,
            PointBody.of(model, motion.markers),
            LowPass(1.0 / step, recording.cutoff_hz, recording.order),
            step,
            np.ascontiguousarray(rated.q.T),
            _varied(model, motion, noise_on),
            spans,
            measured,
            seen,
            recording.loads,
            np.where(np.isfinite(external), external, 0.0),
            used,
            np.array([weight] * 3 + [weight * recording.height_m] * 3),
        )

    @property
    def n_frames(self) -> int:
        """How many frames there are."""
        return int(self.q.shape[1])

    def perturbed(self, noise: Array, size: float) -> Array:
        """The reference motion with filtered noise added.

        Parameters
        ----------
        noise : ndarray, shape (len(varied), n)
            White, of unit variance; the filter is linear, so it is filtered alone.
        size : float, rad and m
        """
        q = self.q.copy()
        for start, stop in self.spans:
            q[self.varied, start:stop] += size * self.low_pass.apply(noise[:, start:stop])
        return q

    def residual(self, q: Array) -> tuple[float, Array]:
        """What a motion leaves unexplained.

        Parameters
        ----------
        q : ndarray, shape (n_coordinates, n)
            Filtered.

        Returns
        -------
        error_m : float
            The mean distance between measured and model markers (Muller et al. 2017, eq. 3).
        residual : ndarray, shape (6, n), N and N m
            About the root segment's origin; meaningless where not ``used``.
        """
        far, total = 0.0, 0.0
        residual = np.zeros((6, self.n_frames))
        for rows in self._blocks():
            inner = slice(rows.start + HALO, rows.stop - HALO)
            poses = self.body.poses(np.ascontiguousarray(q[:, rows]))
            root = poses.frames[poses.plan.link_node[0], 3]
            needed = self.body.wrench(self.body.moved(poses), root, self.step_s)
            residual[:, inner] = needed - moment_about(self.external[:, inner], root[:, HALO:-HALO])
            away = positions(self.body.tree, poses)[:, :, HALO:-HALO] - self.measured[:, :, inner]
            seen = self.seen[:, inner]
            far += float(np.vdot(np.sqrt(np.einsum("man,man->mn", away, away)), seen))
            total += float(seen.sum())
        return far / total, residual

    def indicator(self, residual: Array) -> Array:
        """Muller's dr (eq. 7) over the frames used, shape (6,)."""
        used = residual[:, self.used]
        rms: Array = np.sqrt(np.einsum("cn,cn->c", used, used) / used.shape[1]) / self.scale
        return rms

    def _blocks(self) -> list[slice]:
        """Frames to compute together, each block with its halo."""
        return [
            slice(at, min(at + BLOCK + 2 * HALO, stop))
            for start, stop in self.spans
            for at in range(start, stop - 2 * HALO, BLOCK)
        ]


def _check_clocks(recording: Recording) -> None:
    times, loads = recording.motion.times, recording.loads.times
    if len(loads) != len(times) or np.abs(loads - times).max() > 1e-6:
        raise TrialUnusable(
            "loads and motion are not on one clock",
            file=recording.motion.trial,
            field="time",
            remedy="Bring the forces to the times of the markers first",
        )
    if not 0.5 <= recording.height_m <= 2.5:
        raise InputError(
            f"a height of {recording.height_m:g} m is none",
            field="subject.height_m",
            remedy="Give the stature in m",
        )


def _varied(model: BodyModel, motion: Motion, noise_on: NoiseOn) -> NDArray[np.intp]:
    names = set(motion.estimated)
    chosen = [
        k
        for k, coordinate in enumerate(model.coordinates)
        if coordinate.name in names and (noise_on == "all" or coordinate.kind == "rotation")
    ]
    return np.array(chosen, dtype=np.intp)


def _measured(model: BodyModel, motion: Motion) -> tuple[Array, Array]:
    """Measured markers, zero where not seen, and where they were seen; markers first, frames last."""
    tree = compile_model(model, motion.markers)
    order = [motion.coordinates.index(name) for name in model.coordinate_names]
    placed = marker_positions(tree, np.nan_to_num(motion.q[:, order]), parameter_values(model))
    measured = np.moveaxis(placed + motion.residuals, 0, -1)
    seen = np.asarray(np.isfinite(measured).all(axis=1)) & np.asarray(np.isfinite(motion.q).all(axis=1))
    return np.where(seen[:, None], measured, 0.0), np.ascontiguousarray(seen.astype(float))
