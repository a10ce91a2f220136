"""What the noise of force plates does to a residual (Muller et al. 2017, sec. 2.2)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from scaling_service.capabilities.dynamics.uncertainty.reference import Reference
from scaling_service.core.arrays import Array
from scaling_service.model.forces import CONTACT_N
from scaling_service.numerics.multibody import tree

SIGMAS = 3.0
"""A data sheet's figure of a plate stands for three standard deviations, and so does the dispersion that is
reported (Muller et al. 2017, sec. 2.2)."""


@dataclass(frozen=True, slots=True)
class PlateNoise:
    """What the data sheet of a force plate promises (AMTI, as Muller et al. 2017 quote it)."""

    share: float = 0.001  # of the load
    least_n: float = 0.22  # not less than this
    centre_m: float = 0.0002  # of the centre of pressure, in each direction
    surface_m: float = 0.0  # height of the plates' surface


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class PressedPlates:
    """Residual (6, n), and each load's force and lever from the root (k, 3, n), over the frames used.

    ``sigma`` and ``centre`` (k, 1, n) are standard deviations of the components of each force and of its
    centre of pressure, zero without contact.
    """

    residual: Array
    force: Array
    lever: Array
    sigma: Array
    centre: Array
    scale: Array


def list_pressed(reference: Reference, noise: PlateNoise) -> PressedPlates:
    """What each load's noise acts on, over the frames used."""
    used = reference.used
    _, residual = reference.residual(reference.q)
    poses = tree.pose_links(reference.tree, reference.q[:, used], reference.p)
    root = poses.frames[poses.plan.link_node[0], 3]
    force, moment = (np.moveaxis(x[used], 0, -1) for x in (reference.loads.force, reference.loads.moment))
    pressing = force[:, 1]
    loaded = pressing > CONTACT_N
    ground = np.array([0.0, noise.surface_m, 0.0])[:, None]
    about = moment - tree.cross(np.broadcast_to(ground, force.shape), force)
    # n x M / (n . F) with the normal n up
    flat = np.stack([about[:, 2], np.zeros_like(pressing), -about[:, 0]], axis=1)
    centre = np.divide(flat, pressing[:, None], out=np.zeros_like(flat), where=loaded[:, None]) + ground
    load = np.linalg.norm(force, axis=1)
    sigma = np.where(loaded, np.maximum(noise.share * load, noise.least_n) / SIGMAS, 0.0)[:, None]
    spread = np.where(loaded, noise.centre_m / SIGMAS, 0.0)[:, None]
    return PressedPlates(
        residual=residual[:, used],
        force=force,
        lever=centre - root,
        sigma=sigma,
        centre=spread,
        scale=reference.scale,
    )


def propagate_plate_noise(reference: Reference, noise: PlateNoise) -> Array:
    """Three standard deviations of the indicator under noise of forces and centres of pressure, (6,).

    With r the residual and v the variance of its noise, by frame, the mean square has the mean ``<r^2 + v>``
    and the variance ``sum(4 r^2 v + 2 v^2) / n^2`` (Gaussian noise, frames independent); its root is
    linearised about the mean.
    """
    plates = list_pressed(reference, noise)
    pushed, shifted = plates.sigma**2, plates.centre**2
    own = np.broadcast_to(pushed, plates.force.shape).sum(axis=0)
    lever, force = (
        (part**2).sum(axis=1, keepdims=True) - part**2 for part in (plates.lever, plates.force)
    )  # squared distance from each axis
    turned = (pushed * lever + shifted * force + 2.0 * pushed * shifted).sum(axis=0)
    square, variance = plates.residual**2, np.concatenate([own, turned])
    n = square.shape[1]
    spread = np.sqrt((4.0 * square * variance + 2.0 * variance**2).sum(axis=1)) / n
    return np.asarray(SIGMAS * spread / (2.0 * np.sqrt((square + variance).mean(axis=1))) / plates.scale)
