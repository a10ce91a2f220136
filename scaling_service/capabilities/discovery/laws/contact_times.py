"""When a contact begins and ends."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from scaling_service.capabilities.discovery.evidence.weighed import Weighed
from scaling_service.capabilities.discovery.laws.onsets import onset
from scaling_service.capabilities.discovery.search.candidates import Contact
from scaling_service.numerics.multibody.laws import Array

_THROUGHOUT = 0.8  # of a trial's frames, from which a contact counts as lasting all of it (chosen)
_FEWEST = 5  # frames from which something is told

Edges = tuple[tuple[float, float], tuple[float, float]]
"""When a contact begins and when it ends, s, each with its standard deviation."""


def lasts_throughout(item: Weighed, rows: NDArray[np.intp]) -> bool:
    """Whether frames are most of a trial."""
    return bool(len(rows) > _THROUGHOUT * item.usable.sum())


def edges_of(weighed: Sequence[Weighed], contact: Contact) -> Edges | None:
    """The edges of a contact that was taken out of recordings; None where it lasts throughout one."""
    found = []
    for item in weighed:
        inside = (item.times >= contact.start_s) & (item.times <= contact.end_s)
        rows = np.flatnonzero(inside & item.usable)
        if item.touched is None or len(rows) < _FEWEST or lasts_throughout(item, rows):
            return None
        found.append(edges(item, rows, item.gap[:, :3] - np.where(inside[:, None], item.touched[:, :3], 0.0)))
    return together(found) if found else None


def edges(item: Weighed, rows: NDArray[np.intp], gap: Array) -> Edges:
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
    memory = item.item.trial.rate_hz / (2.0 * item.cutoff_hz)
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
