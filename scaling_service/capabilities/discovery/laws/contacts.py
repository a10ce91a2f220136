"""Where on a segment something touches, and when that begins and ends.

The place follows from the moment that is left about the point. The force may take any course; where it acts
there is no moment. A foot's contact wanders over its sole, any other contact a little; so much the
moment may differ.

The time follows from the course of the force. One that rises smoothly stands above the noise some time after
it began. So ramps of several shapes are laid through it, of every beginning and length, each with the height
that suits it best; what they say is weighed by their likelihood.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from scaling_service.capabilities.discovery.laws.candidates import Contact
from scaling_service.capabilities.discovery.observations.wrench import FEET, WrenchFit
from scaling_service.core.arrays import Array
from scaling_service.numerics.least_squares.border import minimise_within
from scaling_service.numerics.multibody.rigid import build_skew

WANDER_M = {"foot": 0.06, "other": 0.02}
"""m; how far a contact wanders on its segment, one standard deviation. A sole is 0.25 m long (uniform: 0.07);
a hand's grip stays within some 2 cm (both chosen)."""

_UNIT = np.eye(3)
_ROUNDS = 3  # chosen: weights change little from one to the next
_SKIN_M = 0.08  # chosen: flesh and sole reach so far beyond markers and the centre of mass

_THROUGHOUT = 0.8  # of a trial's frames, from which a contact counts as lasting all of it (chosen)
_FEWEST = 5  # frames from which something can be said

_BEGINNINGS, _LENGTHS = 80, 24  # chosen: to a hundredth of what is looked through
_CHUNK = 8  # lengths at once: 80 by 8 ramps of 4 shapes and 500 frames are 10 MB


@dataclass(frozen=True, slots=True, eq=False)
class Spell:
    """The frames of one trial in which something may touch."""

    wrench: WrenchFit
    rows: NDArray[np.intp]
    noise: Array  # (6,): what is ordinary of each component, N and N m


def compute_wrench(item: WrenchFit, contact: Contact) -> Array:
    """What the contact must be so that nothing is left, (n, 6), moment about the ground origin."""
    inside = (item.times >= contact.start_s - 1e-9) & (item.times <= contact.end_s + 1e-9) & item.usable
    rows = np.flatnonzero(inside)
    found = np.zeros((len(item.times), 6))
    if len(rows):
        spell, point = Spell(item, rows, np.array(contact.noise)), np.array(contact.point)
        force, place = -item.residuals[rows, :3], locate(item, contact.segment, point)[rows]
        left = item.residuals[rows, 3:] + np.cross(place - item.about[rows], force)
        weight = _compute_weights(spell, contact.segment, point)
        wandering = np.einsum("nab,nbc,nc->na", _compute_wandering(force, contact.segment), weight, left)
        found[rows] = np.concatenate([force, np.cross(place, force) - wandering], axis=1)
    return found


def fit_point(spell: Spell, segment: str) -> Array:
    """The point (3,), m, within a segment's reach about which the disagreement has least moment, in its axes.

    Noise of the motion acts like forces at the centre of mass, so it would draw the point there; what its
    products come to on average is taken off (errors in variables: Nakamura 1990, Biometrika 77:127). Along a
    force that keeps its direction only noise would place the point: it stays in the middle.
    """
    # Corners of the box (in the segment's frame, m) in which something could touch it, each (3,).
    item = spell.wrench
    own = [np.array(m.nominal) for m in item.model.markers if m.segment == segment]
    places = np.array([*own, np.array(item.model.segment(segment).com)])
    low, high = places.min(axis=0) - _SKIN_M, places.max(axis=0) + _SKIN_M
    middle = point = 0.5 * (low + high)
    for _round in range(_ROUNDS):
        point = _step_point(spell, segment, point, middle, (low, high))
    return np.asarray(point)


def _step_point(
    spell: Spell, segment: str, point: Array, middle: Array, within: tuple[Array, Array]
) -> Array:
    """The best point with the weights of another one, (3,), m."""
    item, rows = spell.wrench, spell.rows
    gap, weight = item.residuals[rows], _compute_weights(spell, segment, point)
    origin, axes = (places[rows] for places in item.segment_frame(segment))
    across = _move_to_point(origin - item.about[rows])
    unit = -build_skew(_UNIT)[:, None] @ axes.transpose(0, 2, 1)  # of a force along each ground axis
    lever = np.einsum("na,anjk->njk", gap[:, :3], unit)
    weighted, heavy = weight @ lever, weight @ unit
    noise = np.diag(np.square(spell.noise))
    chance = np.einsum("ab,anjk,bnjl->kl", noise[:3, :3], unit, heavy)
    normal = np.einsum("njk,njl->kl", lever, weighted) - chance
    target = np.einsum("njk,nji,ni->k", weighted, across, gap)
    target -= np.einsum("anjk,nji,ia->k", heavy, across, noise[:, :3])
    value, vector = np.linalg.eigh(normal)
    by_chance = np.einsum("ak,ab,bk->k", vector, chance, vector)
    shown = value > by_chance
    slope = np.where(shown, vector.T @ (target - normal @ middle), 0.0)
    steep = np.maximum(np.where(shown, value, by_chance), 1e-300)
    low, high = (edge - middle for edge in within)
    return middle + minimise_within(steep, vector, slope, low, high)


def locate(item: WrenchFit, segment: str, point: Array) -> Array:
    """Where a point of a segment is, (n, 3), m."""
    origin, axes = item.segment_frame(segment)
    return np.asarray(origin + np.einsum("njk,j->nk", axes, point))


def _compute_weights(spell: Spell, segment: str, point: Array) -> Array:
    """Inverse covariance of the moment about a point, (n, 3, 3): of noise, and of the point's wandering."""
    item, rows = spell.wrench, spell.rows
    across = _move_to_point((locate(item, segment, point) - item.about)[rows])
    noise = (across * np.square(spell.noise)) @ across.transpose(0, 2, 1)
    return np.asarray(np.linalg.inv(_compute_wandering(item.residuals[rows, :3], segment) + noise))


def _compute_wandering(force: Array, segment: str) -> Array:
    """Covariance of the moment of a force whose point wanders, (n, 3, 3)."""
    inside = build_skew(force) * WANDER_M["foot" if segment.startswith(FEET) else "other"]
    return np.asarray(inside @ inside.transpose(0, 2, 1))


def _move_to_point(arm: Array) -> Array:
    """What makes of a wrench its moment about a point at the end of an arm (n, 3), (n, 3, 6)."""
    return np.concatenate([-build_skew(arm), np.broadcast_to(_UNIT, (len(arm), 3, 3))], axis=2)


Edges = tuple[tuple[float, float], tuple[float, float]]
"""When a contact begins and when it ends, s, each with its standard deviation."""


def is_throughout(item: WrenchFit, rows: NDArray[np.intp]) -> bool:
    """Whether frames are most of a trial."""
    return bool(len(rows) > _THROUGHOUT * item.usable.sum())


def find_edges(item: WrenchFit, contact: Contact) -> Edges | None:
    """The edges of a contact that was taken out of a recording; None where it lasts throughout."""
    inside = (item.times >= contact.start_s) & (item.times <= contact.end_s)
    rows = np.flatnonzero(inside & item.usable)
    if item.touched is None or len(rows) < _FEWEST or is_throughout(item, rows):
        return None
    missing = item.residuals[:, :3] - np.where(inside[:, None], item.touched[:, :3], 0.0)
    return fit_edges(Spell(item, rows, np.array(contact.noise)), missing)


def fit_edges(spell: Spell, gap: Array) -> Edges:
    """From the force along its main direction, as far before and after the frames as they last.

    ``spell``: of the frames in which the force stands out; ``gap``: what the plates do not measure of it,
    negative, (n, 3), N.
    """
    item, rows = spell.wrench, spell.rows
    _, vectors = np.linalg.eigh(gap[rows].T @ gap[rows])
    along = vectors[:, -1]
    course, noise = gap @ along, float(np.linalg.norm(along * spell.noise[:3]))
    course *= np.sign(course[rows].mean())
    first, last = item.times[rows[[0, -1]]].tolist()
    middle, lasting = 0.5 * (first + last), last - first
    memory = item.tracked.trial.rate_hz / (2.0 * item.cutoff_hz)
    before = item.usable & (item.times >= first - lasting) & (item.times <= middle)
    after = item.usable & (item.times <= last + lasting) & (item.times >= middle)
    start, of_start = estimate_onset(item.times[before], course[before], noise, memory)
    end, of_end = estimate_onset(-item.times[after][::-1], course[after][::-1], noise, memory)
    return (start, of_start), (-end, of_end)


def estimate_onset(times: Array, course: Array, noise: float, memory: float) -> tuple[float, float]:
    """When a course rises from nothing, s: mean and standard deviation over all ramps.

    ``times`` (n,), s: from well before the rise to about the middle of what comes after it; ``course`` (n,):
    about zero at first, and about as high as it gets after the rise; ``noise``: its standard deviation;
    ``memory``: how many frames that remembers.
    """
    whole = times[-1] - times[0]
    beginnings = np.linspace(times[0], times[-1], _BEGINNINGS, endpoint=False)
    lengths = whole * np.linspace(0.0, 1.0, _LENGTHS + 1)[1:] ** 2  # short ones more closely
    left = np.concatenate(
        [
            _compute_left_squares(times, course, beginnings, some)
            for some in np.array_split(lengths, _LENGTHS // _CHUNK)
        ],
        axis=1,
    )
    level = max(noise**2, float(left.min()) / len(times))
    weight = np.exp(-0.5 * (left - left.min()) / (level * max(memory, 1.0)))
    share = weight.sum(axis=(1, 2)) / weight.sum()
    mean = float(share @ beginnings)
    step = float(beginnings[1] - beginnings[0])
    return mean, float(np.sqrt(share @ (beginnings - mean) ** 2 + step**2 / 12.0))


def _compute_left_squares(times: Array, course: Array, beginnings: Array, lengths: Array) -> Array:
    """Squares that ramps leave, (n_beginnings, n_lengths, n_shapes)."""
    u = np.clip((times - beginnings[:, None, None]) / lengths[:, None], 0.0, 1.0)
    ramps = [u, u * (2.0 - u), u**2 * (3.0 - 2.0 * u), u**3 * (10.0 - 15.0 * u + 6.0 * u**2)]
    shapes = np.stack(ramps, axis=2)
    square = np.square(shapes).sum(axis=3)
    height = np.maximum(shapes @ course, 0.0) / np.maximum(square, 1e-12)
    return np.asarray(course @ course - height**2 * square)
