"""Curves of a known kind: smooth ones of unit variance, and a bump to add to them."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import gaussian_filter1d

NODES = np.arange(101)


def smooth(rng: np.random.Generator, *shape: int, fwhm: float = 20.0) -> np.ndarray:
    """Gaussian curves of unit variance on 101 nodes, smooth over ``fwhm`` nodes as joint angles are."""
    sd, margin = fwhm / 2.3548, 60
    raw = gaussian_filter1d(rng.normal(size=(*shape, 101 + 2 * margin)), sd, axis=-1)
    return raw[..., margin:-margin] * np.sqrt(2 * np.sqrt(np.pi) * sd)


def bump(centre: float, width: float = 9.0) -> np.ndarray:
    """A Gaussian of height one around a node, (101,); its standard deviation is ``width`` nodes."""
    return np.exp(-0.5 * ((NODES - centre) / width) ** 2)
