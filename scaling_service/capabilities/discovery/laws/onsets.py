"""When a force begins and ends, from its course.

A force that rises smoothly stands above the noise only some time after it began. So ramps of several shapes
are laid through the course, of every beginning and length, each with the height that suits it best; what
they say is weighed by their likelihood.
"""

from __future__ import annotations

import numpy as np

from scaling_service.numerics.multibody.laws import Array

_BEGINNINGS, _LENGTHS = 80, 24  # chosen: to a hundredth of what is looked through
_BLOCK = 8  # lengths at once: 80 by 8 ramps of 4 shapes and 500 frames are 10 MB


def onset(times: Array, course: Array, noise: float, memory: float) -> tuple[float, float]:
    """When a course rises from nothing.

    Parameters
    ----------
    times : ndarray, shape (n,), s
        From well before the rise to about the middle of what comes after it.
    course : ndarray, shape (n,)
        About zero at first; what comes after the rise stays about as high.
    noise : float
        Its standard deviation.
    memory : float
        How many frames the noise remembers.

    Returns
    -------
    beginning, sd : float
        s; mean and standard deviation over all ramps.
    """
    whole = times[-1] - times[0]
    beginnings = np.linspace(times[0], times[-1], _BEGINNINGS, endpoint=False)
    lengths = whole * np.linspace(0.0, 1.0, _LENGTHS + 1)[1:] ** 2  # short ones more closely
    left = np.concatenate(
        [_left(times, course, beginnings, some) for some in np.array_split(lengths, _LENGTHS // _BLOCK)],
        axis=1,
    )
    level = max(noise**2, float(left.min()) / len(times))
    weight = np.exp(-0.5 * (left - left.min()) / (level * max(memory, 1.0)))
    share = weight.sum(axis=(1, 2)) / weight.sum()
    mean = float(share @ beginnings)
    step = float(beginnings[1] - beginnings[0])
    return mean, float(np.sqrt(share @ (beginnings - mean) ** 2 + step**2 / 12.0))


def _left(times: Array, course: Array, beginnings: Array, lengths: Array) -> Array:
    """Squares that ramps leave, (n_beginnings, n_lengths, n_shapes)."""
    u = np.clip((times - beginnings[:, None, None]) / lengths[:, None], 0.0, 1.0)
    ramps = [u, u * (2.0 - u), u**2 * (3.0 - 2.0 * u), u**3 * (10.0 - 15.0 * u + 6.0 * u**2)]
    shapes = np.stack(ramps, axis=2)
    square = np.square(shapes).sum(axis=3)
    height = np.maximum(shapes @ course, 0.0) / np.maximum(square, 1e-12)
    return np.asarray(course @ course - height**2 * square)
