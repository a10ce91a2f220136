"""The force plates' part of a residual's uncertainty, by the data sheet (Muller et al. 2017, eq. 11)."""

from __future__ import annotations

from concurrent.futures import Executor
from dataclasses import dataclass
from functools import partial

import numpy as np

from scaling_service.capabilities.dynamics.uncertainty.reference import Reference
from scaling_service.capabilities.dynamics.uncertainty.tasks import in_chunks
from scaling_service.core.streams import stream
from scaling_service.model.forces import CONTACT_N
from scaling_service.numerics.multibody.laws import Array
from scaling_service.numerics.multibody.tree import cross, forward

SIGMAS = 3.0
"""A data sheet's figure stands for three standard deviations, and so does the dispersion that is reported
(Muller et al. 2017, sec. 2.2)."""


@dataclass(frozen=True, slots=True)
class PlateNoise:
    """What the data sheet of a force plate promises (AMTI, as Muller et al. 2017 quote it).

    Parameters
    ----------
    share : float
        Of the load.
    least_n : float
        Not less than this.
    centre_m : float
        Of the centre of pressure, in each direction.
    surface_m : float
        Height of the plates' surface.
    """

    share: float = 0.001
    least_n: float = 0.22
    centre_m: float = 0.0002
    surface_m: float = 0.0


@dataclass(frozen=True, slots=True, eq=False)
class _Plates:
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


def plate_dispersion(
    reference: Reference, noise: PlateNoise, samples: int, seed: int, executor: Executor
) -> Array:
    """Three standard deviations of the residual indicator under noise of forces and centres of pressure.

    Parameters
    ----------
    reference : Reference
    noise : PlateNoise
    samples, seed : int
    executor : Executor

    Returns
    -------
    ndarray, shape (6,)
    """
    plates = _plates(reference, noise)
    rows = in_chunks(executor, partial(_samples, plates, seed, reference.trial), samples)
    return np.asarray(SIGMAS * rows.std(axis=0, ddof=1))


def _plates(reference: Reference, noise: PlateNoise) -> _Plates:
    used = reference.used
    _, residual = reference.residual(reference.q)
    poses = forward(reference.body.tree, reference.q[:, used], reference.body.p)
    root = poses.frames[poses.plan.link_node[0], 3]
    force, moment = (np.moveaxis(x[used], 0, -1) for x in (reference.loads.force, reference.loads.moment))
    pressing = force[:, 1]
    loaded = pressing > CONTACT_N
    ground = np.array([0.0, noise.surface_m, 0.0])[:, None]
    about = moment - cross(np.broadcast_to(ground, force.shape), force)
    # n x M / (n . F) with the normal n up
    flat = np.stack([about[:, 2], np.zeros_like(pressing), -about[:, 0]], axis=1)
    centre = np.divide(flat, pressing[:, None], out=np.zeros_like(flat), where=loaded[:, None]) + ground
    load = np.linalg.norm(force, axis=1)
    sigma = np.where(loaded, np.maximum(noise.share * load, noise.least_n) / SIGMAS, 0.0)[:, None]
    spread = np.where(loaded, noise.centre_m / SIGMAS, 0.0)[:, None]
    return _Plates(residual[:, used], force, centre - root, sigma, spread, reference.scale)


def _samples(plates: _Plates, seed: int, trial: str, numbers: range) -> Array:
    return np.array([_sample(plates, stream(seed, "uncertainty", trial, "plates", k)) for k in numbers])


def _sample(plates: _Plates, rng: np.random.Generator) -> Array:
    """The residual indicator under one draw of noise; what the plates measure too much is missing then."""
    pushed = plates.sigma * rng.standard_normal(plates.force.shape)
    shifted = plates.centre * rng.standard_normal(plates.force.shape)
    moment = cross(plates.lever + shifted, pushed) + cross(shifted, plates.force)
    residual = plates.residual - np.concatenate([pushed.sum(axis=0), moment.sum(axis=0)])
    rms: Array = np.sqrt(np.einsum("cn,cn->c", residual, residual) / residual.shape[1]) / plates.scale
    return rms
