"""Forces as a matrix times the inertial parameters, in blocks of frames.

The columns of link k are ``10 k … 10 k + 9``, in the order of ``Inertias.parameters``.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from scaling_service.numerics.multibody.laws import Array
from scaling_service.numerics.multibody.mechanism import N_PARAMETERS, TENSOR, Mechanism
from scaling_service.numerics.multibody.motion import LinkMotion, Motion, move_links, point_acceleration
from scaling_service.numerics.multibody.tree import cross
from scaling_service.numerics.wrench.ground_wrench import GRAVITY, blocks

REGRESSOR_BLOCK = 64
"""Frames computed together (chosen: 35 rows by 160 columns by 64 frames are 3 MB)."""


@dataclass(frozen=True, slots=True, eq=False)
class RegressorBlock:
    """The regressors of a block of frames, frames first."""

    rows: slice  # which frames
    # (n, 6, 10 n_links): force and moment about the root link's origin, ground axes: what all external loads
    # together must provide
    ground: Array


def regressor_blocks(
    mechanism: Mechanism, motion: Motion, p: Array, *, gravity: Array = GRAVITY, size: int = REGRESSOR_BLOCK
) -> Iterator[RegressorBlock]:
    """Regressors of the ground wrench.

    ``mechanism``: its inertias are not used.
    ``p``: (n_parameters,).
    ``gravity``: (3,), m/s2.
    ``size``: frames at a time: bounds the memory.
    In the order of the frames. Its product with all inertial parameters (joined) is the wrench.
    """
    for rows in blocks(motion.n, size):
        state = move_links(mechanism, motion.block(rows), p)
        links = _link_regressors(state, gravity).reshape(-1, 6, rows.stop - rows.start)
        links[:, 3:] -= cross(state.poses.origins[0], links[:, :3])
        yield RegressorBlock(rows, np.ascontiguousarray(np.moveaxis(links, -1, 0).transpose(0, 2, 1)))


def _link_regressors(state: LinkMotion, gravity: Array) -> Array:
    """Wrench of each link about the ground origin per parameter, (n_links, 10, 6, n)."""
    axes, origins = state.poses.axes, state.poses.origins
    spin, pace = state.twists[:, 3:], state.accelerations[:, 3:]
    lift = point_acceleration(state.twists, state.accelerations, origins) - gravity[:, None]
    result = np.zeros((len(axes), N_PARAMETERS, 6, axes.shape[-1]))
    result[:, 0, :3] = lift
    for j in range(3):  # a unit first moment along axis j
        arm = axes[:, j]
        result[:, 1 + j, :3] = cross(pace, arm) + cross(spin, cross(spin, arm))
        result[:, 1 + j, 3:] = cross(arm, lift)
    result[:, :4, 3:] += cross(origins[:, None], result[:, :4, :3])
    result[:, 4:, 3:] = _tensor_columns(axes, spin, pace)
    return result


def _tensor_columns(axes: Array, spin: Array, pace: Array) -> Array:
    """Moment per number of the tensor, (n_links, 6, 3, n)."""
    w = np.einsum("kjan,kan->kjn", axes, spin)
    a = np.einsum("kjan,kan->kjn", axes, pace)
    local = np.zeros((len(axes), len(TENSOR), 3, axes.shape[-1]))
    for column, (i, j) in enumerate(TENSOR):
        turned = np.zeros_like(w)
        local[:, column, i] += a[:, j]
        turned[:, i] += w[:, j]
        if i != j:
            local[:, column, j] += a[:, i]
            turned[:, j] += w[:, i]
        local[:, column] += cross(w, turned)
    moments: Array = np.einsum("kjan,kcjn->kcan", axes, local)
    return moments
