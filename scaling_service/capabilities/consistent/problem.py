"""The two objectives of dynamically consistent inverse kinematics, and their normal equations.

Joint angles are splines; what is estimated are their coefficients (Futamure et al., eq. 6), together with
numbers shared by all frames: how far markers glide with the movement, and how the inertia differs from the
table's.
"""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray

from scaling_service.capabilities.consistent.geometric import GeometryPrior
from scaling_service.core.arrays import Array
from scaling_service.numerics import wrench as numerics_wrench
from scaling_service.numerics.multibody import marker_rates
from scaling_service.numerics.multibody import motion as motions
from scaling_service.numerics.multibody.tree import Tree
from scaling_service.numerics.signals import splines
from scaling_service.recording.settings import DYNAMICS_CUTOFF_HZ

SPREAD = GeometryPrior(0.05, 0.009)
"""5 % of a length, 9 mm of a marker's coordinate: the priors of the other calibrations."""

CONSTANT = 0
"""The signal of constant shifts."""

BLOCK = 128
"""Frames at a time (chosen: 30 coordinates then take 10 MB for each matrix of a frame's unknowns)."""


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class ConsistentSettings:
    """Settings of the loop of motion, geometry and inertia (Futamure et al., fig. 2)."""

    # of the filter of the classical motion and of the forces (Muller et al. 2017, sec. 2.1; Futamure et al.
    # name none).
    cutoff_hz: float = DYNAMICS_CUTOFF_HZ
    # between knots of the joint angles. Chosen: 0.1 s lets pass up to 5 Hz, the cutoff.
    spacing_s: float = 0.1
    # expected error of a force in body weights. Chosen: 0.4 %, between the accuracy of a plate (AMTI, 0.1 %
    # of the load) and the residuals of walking (2 %; both Muller et al. 2017): a squat is slow, a body not
    # rigid.
    force_share: float = 0.004
    # expected error of a moment over that of a force. Chosen: 1 m, about the height of the centre of mass
    # over the ankles.
    arm_m: float = 1.0
    # residual_m, independent_s: what markers err beside the artefact that follows the joints: 2 to 3 mm RMS
    # below 2 Hz (as for virtual persons), so that errors are new after a quarter of a second
    residual_m: float = 0.0025
    independent_s: float = 0.25
    # standard deviation of what is wrong with a marker's place on its segment, each axis. Zero where the
    # model's markers were fitted to movements: the place is then known.
    placed_m: float = 0.0
    geometry_bound: float = 0.5  # lengths and coordinates stay within this share of their start (eq. 7)
    geometry_prior: GeometryPrior = SPREAD  # what holds them
    most_loops: int = 3  # chosen: Futamure et al. needed two
    # marker_resolution_m, force_resolution_n, moment_resolution_nm: the loop ends when RMS errors change by
    # less. Markers: Vicon's noise at rest, 0.2 mm. Forces: AMTI, 0.22 N (Muller et al. 2017). Moments: that
    # force at ``arm_m``.
    marker_resolution_m: float = 2e-4
    force_resolution_n: float = 0.22
    moment_resolution_nm: float = 0.22


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class WrenchTargets:
    """The measured ground wrench."""

    values: Array  # (n, 6): force on the body (N), moment about the point (N m); zero where not known
    weights: Array  # (n, 6): of the squares; zero where not known
    about: Array  # (n, 3), m: the point that moments are taken about


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class Objectives:
    """What a motion leaves unexplained."""

    # markers, wrench: the two objectives; see :class:`ConsistentProblem`
    markers: float
    wrench: float
    marker_gaps: Array  # (n, n_markers, 3), m: measured minus model without gliding, zero where not seen
    wrench_gaps: Array  # (n, 6), N and N m: measured minus model, also where nothing is weighed


@dataclasses.dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class ConsistentProblem:
    """Markers and ground wrench of one recording, as functions of spline coefficients and shared numbers."""

    mechanism: motions.Mechanism
    tree: Tree  # the mechanism's links, with the markers to follow
    p: Array  # (n_parameters,)
    basis: splines.SplineBasis
    free: NDArray[np.intp]  # (m,): coordinates that are estimated
    constant: Array  # (n_coordinates,): values of the others
    markers: marker_rates.MarkerTargets  # weights such that the mean of errors as large as expected is one
    wrench: WrenchTargets  # likewise
    shifts: marker_rates.MarkerShifts
    inertia: Array  # (10 n_links, k): how it may differ, by one standard deviation of the prior each
    # weight of the square of each shared number in the markers' objective: what was known before forces
    prior: float

    @property
    def n_shared(self) -> int:
        """Shifts first, then inertia."""
        return self.shifts.count + int(self.inertia.shape[1])

    def motion(self, coefficients: Array) -> motions.Motion:
        """The motion of all coordinates, of coefficients (n_coefficients, m)."""
        n = len(self.basis.times)
        parts = []
        for order, moved in enumerate(self.basis.evaluate(coefficients)):
            whole = np.tile(self.constant if order == 0 else np.zeros_like(self.constant), (n, 1))
            whole[:, self.free] = moved
            parts.append(whole)
        return motions.Motion.of_frames(*parts)

    def move_mechanism(self, shared: Array) -> motions.Mechanism:
        """The mechanism with the inertia that shared numbers say."""
        change = self.inertia @ shared[self.shifts.count :]
        parameters = self.mechanism.inertias.parameters() + change.reshape(-1, motions.N_PARAMETERS)
        return dataclasses.replace(self.mechanism, inertias=motions.Inertias.of_parameters(parameters))

    def objectives(self, state: splines.Unknowns) -> Objectives:
        """Both objectives; shared numbers are in standard deviations."""
        return self.objectives_of(self.motion(state.coefficients), state.shared)

    def objectives_of(self, motion: motions.Motion, shared: Array | None = None) -> Objectives:
        """Both objectives of any motion at the basis' times."""
        n, x = len(self.basis.times), np.zeros(self.n_shared) if shared is None else shared
        mechanism = self.move_mechanism(x)
        gaps, wrench_gaps, total = np.empty((n, self.tree.n_markers, 3)), np.empty((n, 6)), 0.0
        for rows in numerics_wrench.split_blocks(n, BLOCK):
            state = motions.move_links(mechanism, motion.block(rows), self.p)
            _, moved, _, targets = self._marker_block(state, x, rows)
            _, squares = marker_rates.compute_marker_misfit(moved, targets)
            rigid = marker_rates.compute_marker_motion(self.tree, self.p, state)
            gaps[rows] = np.where(targets.weights[0, ..., None] > 0, targets.values[0] - rigid[0], 0.0)
            total += float(squares.sum())
            wrench = numerics_wrench.link_wrenches(mechanism, state).sum(axis=0)
            about = numerics_wrench.move_moment(wrench, self.wrench.about[rows].T)
            wrench_gaps[rows] = self.wrench.values[rows] - about.T
        known = total + self.prior * float(x @ x)
        return Objectives(known, float((self.wrench.weights * wrench_gaps**2).sum()), gaps, wrench_gaps)

    def glide(self, state: splines.Unknowns) -> Array:
        """Displacement of markers that follows the joints, without constant shifts, (n, n_markers, 3), m."""
        motion, n = self.motion(state.coefficients), len(self.basis.times)
        x = np.where(self.shifts.signal == CONSTANT, 0.0, state.shared[: self.shifts.count])
        result = np.empty((n, self.tree.n_markers, 3))
        for rows in numerics_wrench.split_blocks(n, BLOCK):
            moved = motions.move_links(self.mechanism, motion.block(rows), self.p)
            shifts = self.shifts.rows(rows)
            result[rows] = shifts.move(shifts.columns(self.tree, moved), x, self.tree.n_markers)[0]
        return result

    def normal(self, at: splines.Unknowns) -> tuple[splines.Quadratic, splines.Quadratic]:
        """Gauss-Newton models of both objectives."""
        motion, m, k = self.motion(at.coefficients), len(self.free), self.n_shared
        mechanism, glide = self.move_mechanism(at.shared), slice(0, self.shifts.count)
        markers, wrenches = (splines.Quadratic.empty(self.basis.n_coefficients, m, k) for _ in range(2))
        for rows in numerics_wrench.split_blocks(len(self.basis.times), BLOCK):
            screws = motions.list_screws(mechanism, motion.block(rows), self.p, self.free)
            shifts, moved, columns, targets = self._marker_block(screws.state, at.shared, rows)
            gap, squares = marker_rates.compute_marker_misfit(moved, targets)
            by = marker_rates.list_twist_rows(moved)
            said = marker_rates.form_normal_equations(
                mechanism, self.tree, screws, by, gap, targets.weights, m
            )
            self._add(markers, rows, float(squares.sum()), *said)
            if shifts.count:
                shared = marker_rates.shift_normal(
                    shifts, mechanism, self.tree, screws, by, columns, gap, targets.weights, m
                )
                self._add_shared(markers, rows, glide, *shared)
            self._add_wrench(wrenches, mechanism, screws, motion.block(rows), rows, m)
        markers.value += self.prior * float(at.shared @ at.shared)
        markers.shared_gradient += self.prior * at.shared
        markers.corner[np.diag_indices(k)] += self.prior
        return markers, wrenches

    def _add(
        self, total: splines.Quadratic, rows: slice, value: float, gradient: Array, curvature: Array
    ) -> None:
        """Add what some frames say of the coefficients."""
        total.value += value
        splines.add_to_rows(self.basis, rows, total.gradient, gradient)
        splines.add_to_blocks(self.basis, rows, total.blocks, curvature)

    def _add_shared(
        self,
        total: splines.Quadratic,
        rows: slice,
        which: slice,
        gradient: Array,
        corner: Array,
        cross: Array,
    ) -> None:
        """Add what some frames say of some shared numbers."""
        total.shared_gradient[which] += gradient
        total.corner[which, which] += corner
        splines.add_to_rows(self.basis, rows, total.border[:, :, which], cross)

    def _marker_block(
        self, state: motions.LinkMotion, shared: Array, rows: slice
    ) -> tuple[marker_rates.MarkerShifts, Array, Array, marker_rates.MarkerTargets]:
        shifts = self.shifts.rows(rows)
        columns = shifts.columns(self.tree, state)
        rigid = marker_rates.compute_marker_motion(self.tree, self.p, state)
        moved = rigid + shifts.move(columns, shared[: shifts.count], self.tree.n_markers)
        return shifts, moved, columns, self.markers.rows(rows)

    def _add_wrench(
        self,
        total: splines.Quadratic,
        mechanism: motions.Mechanism,
        screws: motions.Screws,
        motion: motions.Motion,
        rows: slice,
        m: int,
    ) -> None:
        needed, rates = numerics_wrench.differentiate_wrench(mechanism, screws, m)
        by = self._moments_about(rates.reshape(-1, 6, 3 * m), rows, np.zeros((3, motion.n)))
        gap = self.wrench.values[rows] - numerics_wrench.move_moment(needed, self.wrench.about[rows].T).T
        heavy = self.wrench.weights[rows]
        weighed = np.swapaxes(by * heavy[..., None], 1, 2)
        curvature = (weighed @ by).reshape(-1, 3, m, 3, m).transpose(0, 1, 3, 2, 4)
        gradient = -(weighed @ gap[..., None]).reshape(-1, 3, m)
        self._add(total, rows, float((heavy * gap**2).sum()), gradient, curvature)
        if self.inertia.shape[1]:
            ((_, regressor),) = numerics_wrench.compute_regressor_blocks(
                mechanism, motion, self.p, size=BLOCK
            )
            root = screws.state.poses.origins[0]
            columns = self._moments_about(regressor @ self.inertia, rows, root)
            self._add_shared(
                total,
                rows,
                slice(self.shifts.count, self.n_shared),
                -np.einsum("nck,nc,nc->k", columns, heavy, gap),
                np.einsum("nck,nc,ncl->kl", columns, heavy, columns, optimize=True),
                (weighed @ columns).reshape(-1, 3, m, columns.shape[2]),
            )

    def _moments_about(self, columns: Array, rows: slice, point: Array) -> Array:
        """Wrenches (n, 6, k) about points (3, n), with their moments about the targets' points."""
        arm = point.T - self.wrench.about[rows]
        result = columns.copy()
        result[:, 3:] += np.cross(arm[:, None], columns[:, :3], axisa=2, axisb=1, axisc=1)
        return result
