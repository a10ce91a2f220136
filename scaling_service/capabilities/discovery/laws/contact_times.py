"""When a contact begins and ends, from the course of its force.

A force that rises smoothly stands above the noise only some time after it began. So ramps of several shapes
are laid through the course, of every beginning and length, each with the height that suits it best; what
they say is weighed by their likelihood.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from scaling_service.capabilities.discovery.laws.candidates import Contact
from scaling_service.capabilities.discovery.observations.wrench import WrenchFit
from scaling_service.numerics.multibody.laws import Array

_THROUGHOUT = 0.8  # of a trial's frames, from which a contact counts as lasting all of it (chosen)

_FEWEST = 5  # frames from which something is told

Edges = tuple[tuple[float, float], tuple[float, float]]
"""When a contact begins and when it ends, s, each with its standard deviation."""


def lasts_throughout(item: WrenchFit, rows: NDArray[np.intp]) -> bool:
    """Whether frames are most of a trial."""
    return bool(len(rows) > _THROUGHOUT * item.usable.sum())


def edges_of(wrenches: Sequence[WrenchFit], contact: Contact) -> Edges | None:
    """The edges of a contact that was taken out of recordings; None where it lasts throughout one."""
    found = []
    for item in wrenches:
        inside = (item.times >= contact.start_s) & (item.times <= contact.end_s)
        rows = np.flatnonzero(inside & item.usable)
        if item.touched is None or len(rows) < _FEWEST or lasts_throughout(item, rows):
            return None
        found.append(
            edges(item, rows, item.residuals[:, :3] - np.where(inside[:, None], item.touched[:, :3], 0.0))
        )
    return together(found) if found else None


def edges(item: WrenchFit, rows: NDArray[np.intp], gap: Array) -> Edges:
    """From the force along its main direction, as far before and after the frames as they last.

    Parameters
    ----------
    rows : ndarray of int
        Frames in which the force stands out.
    gap : ndarray, shape (n, 3), N
        What the plates do not measure of the force, negative.
    """
    _, vectors = np.linalg.eigh(gap[rows].T @ gap[rows])
    along = vectors[:, -1]
    course, noise = gap @ along, float(np.sqrt(np.square(along * item.floor[:3]).sum()))
    course *= np.sign(course[rows].mean())
    first, last = item.times[rows[[0, -1]]].tolist()
    middle, lasting = 0.5 * (first + last), last - first
    memory = item.tracked.trial.rate_hz / (2.0 * item.cutoff_hz)
    before = item.usable & (item.times >= first - lasting) & (item.times <= middle)
    after = item.usable & (item.times <= last + lasting) & (item.times >= middle)
    start, of_start = onset(item.times[before], course[before], noise, memory)
    end, of_end = onset(-item.times[after][::-1], course[after][::-1], noise, memory)
    return (start, of_start), (-end, of_end)


def together(found: Sequence[Edges]) -> Edges:
    """One beginning and end for several trials."""
    values, spreads = np.array(found).transpose(2, 0, 1)
    apart = values.var(axis=0, ddof=1) / len(values) if len(values) > 1 else np.zeros(2)
    start, end = values.mean(axis=0).tolist()
    of_start, of_end = np.sqrt(np.square(spreads).mean(axis=0) / len(values) + apart).tolist()
    return (start, of_start), (end, of_end)


_BEGINNINGS, _LENGTHS = 80, 24  # chosen: to a hundredth of what is looked through

_CHUNK = 8  # lengths at once: 80 by 8 ramps of 4 shapes and 500 frames are 10 MB


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
        [_left(times, course, beginnings, some) for some in np.array_split(lengths, _LENGTHS // _CHUNK)],
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
