"""The wrench on the ground against what is ordinary: its noise, plates, and the masses of persons.

All recordings with forces are one stack of rows, few enough for the levels of all components to be learnt
with every candidate, so that none hides in the noise that it makes.
"""

from __future__ import annotations

import copy
import math
from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from scaling_service.capabilities.discovery.evidence.fit import Fit
from scaling_service.capabilities.discovery.laws import loads
from scaling_service.capabilities.discovery.laws.candidates import Candidate
from scaling_service.capabilities.discovery.observations.wrench import Load, WrenchFit
from scaling_service.capabilities.discovery.ordinary.body import find_part
from scaling_service.capabilities.discovery.ordinary.columns import factorise
from scaling_service.capabilities.discovery.ordinary.levels import FACTORS, learn_level, weigh_level
from scaling_service.capabilities.discovery.ordinary.odds import Scored
from scaling_service.capabilities.discovery.ordinary.soles import Soles, tabulate_steps
from scaling_service.core.arrays import Array

NOISE = np.array([12.0, 12.0, 8.0, 6.0, 3.0, 9.0])
"""By what plates and motion disagree along each component, N and N m, in a person of 65 kg (Muller et al.
2017: 10 to 20 N and 10 to 25 N m RMS in squats and walks; moments: 0.6 of that, the median of four
laboratories)."""

_SPREAD, _AT_REST = 0.5, 1.5
"""Deviation of the logarithm of its level in a person who moves (measured along each force: 0.42 in three
laboratories of adults, 0.55 in one of children; Muller's range is 0.35) and in one who stands still, who may
be a thirtieth as lively (measured: 0.03 to 1)."""

_OF_KG = 65.0
OF_MOVEMENT = 0.1  # of the wrench's own deviation, that and more (low)
_LASTING_S = np.array([0.06, 0.06, 0.06, 0.2, 0.2, 0.2])
"""Time of correlation to 1/e of what ordinary recordings leave below 6 Hz (measured: forces 0.05, 0.05, 0.05
and 0.08 s in four laboratories; moments 0.07 to 0.09 in three of them and 0.4 in one)."""

_RATE = 4.0  # frames looked at per period of the filter (chosen: products of what passes it need two)
_SHIFT_M, _GAIN, _LATE_S, _TURN = 0.003, 0.004, 0.003, math.radians(0.5)
"""Plates as installed: Cappello 2011 (2 to 14 mm of the centre of pressure at most), makers' 0.5 %; a third
of a frame; chosen: laid to half a degree."""

_BIAS = np.array([1.5, 1.5, 1.5, 0.7, 0.7, 0.7])  # N, N m: drift since the last zero (low)
_VERTICAL = math.radians(0.2)  # chosen: a calibration frame's level
_MASS, _SEGMENT = 0.005, 0.1
"""Of a declared mass, as clothes and a day differ; and of a segment's, about the total (tables differ by 10
%)."""

_CENTRES_M: Mapping[str, float] = {"trunk": 0.025, "pelvis": 0.020, "legs": 0.012, "arms": 0.012}
_SIDEWAYS = 0.3
"""Of centres of mass along each axis (tables disagree about the trunk's by 50 mm: de Leva 1996, Dumas 2007);
persons are nearly symmetric."""

_STILL = 0.1
"""m/s2, RMS: a centre of mass that accelerates less is that of a person who stands still, and says nothing of
how well motion and forces agree in movement (chosen: standing sways by 0.01 to 0.05, a slow squat 0.5)."""

_PASSES = 6  # of learning levels (chosen: they settle to a per cent)
_LIVELY = 3  # the same, of frames that are livelier than others


_Key = tuple[Load, tuple[str, ...]]
"""A load in some trials, in all of them where none is named."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Touch:
    """A force of any course about a constant one at a point of a segment, in some frames of a recording."""

    segment: str
    trial: str
    frames: NDArray[np.bool_]  # (n,): of the recording
    columns: Array  # (n, 6, 3): of a force along each axis, moment about the trunk
    sd: float  # of the constant force along each, N
    wandering: Array  # (3,): of its course about that, as it is seen, N
    spans: float  # logarithm of the number of spans of time from which its own was chosen


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class ForceEvidence:
    """Of some recordings: logarithm of how likely they are, and what is told of further numbers."""

    value: float
    size: Array
    covariance: Array
    levels: Array  # (n_recordings, 6): of the components' noise
    left: Array  # the same: RMS of what is left where everything takes what it can, N and N m
    directions: (
        Array  # (n_columns, m): of unit variance at the likeliest levels, of what is ordinary and named
    )
    masses: float  # level of what masses differ by


class WrenchTable:
    """All recordings with forces, and the columns of everything ordinary and of candidates."""

    def __init__(self, fit: Fit, candidates: Sequence[Candidate]) -> None:
        self.fit = fit
        self._keys: dict[_Key, int] = {}
        spreads = [("plates", *s) for s in self._expect_plates()] + [
            ("masses", *s) for s in self._expect_masses()
        ]
        self.numbers: list[list[int]] = [
            [self._number(column.load, c.trials) for column in c.columns if column.load] for c in candidates
        ]
        blocks, owners = [], []
        for owner, rows, covariance in spreads:
            factor = factorise(covariance)
            block = np.zeros((len(self._keys), factor.shape[1]))
            block[rows] = factor
            blocks.append(block)
            owners += [owner] * factor.shape[1]
        self.ordinary = np.concatenate(blocks, axis=1)
        self.owners = {o: np.flatnonzero(np.array(owners) == o) for o in dict.fromkeys(owners)}
        masses = self._add_masses()
        made = [self._tabulate(item) for item in fit.wrenches]
        self.gap, self.columns, self.sd, self.weight = (
            np.concatenate([item[k] for item in made]) for k in range(4)
        )
        frames = [item[4] for item in made]
        ends = np.cumsum([0, *map(len, frames)]).tolist()
        self._frames = {
            item.name: (start, used)
            for item, start, used in zip(fit.wrenches, ends[:-1], frames, strict=True)
        }
        counts = [len(used) for _, used in self._frames.values()]
        self.of = np.repeat(np.eye(len(counts)), counts, axis=0)  # (n, n_recordings): whose row it is
        still = [_stands_still(item) for item in fit.wrenches]
        kinds = sorted(set(still))
        self.shared = np.array([[kind == k for k in kinds] for kind in still], dtype=float)
        """(n_recordings, n_kinds): those that share a level, at rest and in movement."""
        self.spread = np.where(kinds, _AT_REST, _SPREAD)[:, None]
        """(n_kinds, 1): of these levels."""
        self.soles = tabulate_steps(fit.wrenches, list(self._keys))
        self._append_weights(masses)

    def _number(self, load: Load, trials: tuple[str, ...] = ()) -> int:
        return self._keys.setdefault((load, trials), len(self._keys))

    def _expect_plates(self) -> list[tuple[list[int], Array]]:
        found: list[tuple[list[int], Array]] = []
        trials = [item.name for item in self.fit.wrenches]
        for plate in self.fit.scene.plates:
            shifts = [self._number(loads.PlateShift(plate, k)) for k in range(3)]
            found.append((shifts, _SHIFT_M**2 * np.eye(3)))
            found.append(([self._number(loads.PlateGain(plate))], np.array([[_GAIN**2]])))
            found.append(([self._number(loads.PlateTurn(plate, k)) for k in range(3)], _TURN**2 * np.eye(3)))
            for trial in trials:
                rows = [self._number(loads.PlateBias(plate, k), (trial,)) for k in range(6)]
                found.append((rows, np.diag(np.square(_BIAS))))
        found += [([self._number(loads.Late(), (trial,))], np.array([[_LATE_S**2]])) for trial in trials]
        found.append(([self._number(loads.Tilt(k)) for k in (0, 2)], _VERTICAL**2 * np.eye(2)))
        return found

    def _expect_masses(self) -> list[tuple[list[int], Array]]:
        heavy = self.fit.scene.heavy
        masses = np.array([s.mass for s in heavy])
        share = masses / masses.sum()
        about_total = np.eye(len(masses)) - np.outer(share, np.ones(len(masses)))
        apart = about_total @ np.diag(np.square(_SEGMENT * masses)) @ about_total.T
        together = (_MASS * masses.sum()) ** 2 * np.outer(share, share)
        found = [([self._number(loads.scale_segment(s)) for s in heavy], apart + together)]
        for s in heavy:
            size = _CENTRES_M[find_part(self.fit.model.bone_of(s.name))] * np.array([1.0, 1.0, _SIDEWAYS])
            rows = [self._number(loads.Inertial(s.name, loads.differentiate_centre(s, k))) for k in range(3)]
            found.append((rows, np.diag(np.square(size))))
        return found

    def _add_masses(self) -> Array:
        """All segments in proportion, (n_columns,), per share of the body's mass."""
        found = defaultdict[int, float](float)
        for s in self.fit.scene.heavy:
            found[self._number(loads.scale_segment(s))] += s.mass
        return np.array([found[k] for k in range(len(self._keys))])

    def _append_weights(self, masses: Array) -> None:
        """A column for each recording: all segments in proportion there."""
        whole = self.columns @ masses
        each = np.zeros((*whole.shape, len(self._frames)))
        for k, (start, used) in enumerate(self._frames.values()):
            rows = slice(start, start + len(used))
            each[rows, :, k] = whole[rows]
        self.columns = np.concatenate([self.columns, each], axis=2)
        self.ordinary = np.pad(self.ordinary, ((0, each.shape[2]), (0, 0)))
        told = np.pad(self.soles.columns, ((0, 0), (0, each.shape[2])))
        self.soles = Soles(self.soles.gap, told)

    def _tabulate(self, item: WrenchFit) -> tuple[Array, Array, Array, Array, NDArray[np.intp]]:
        """Residuals (n, 6), columns (n, 6, n_columns), deviations, weights (n, 6), frames (n,) of one."""
        thin = max(1, int(item.tracked.trial.rate_hz / (_RATE * item.cutoff_hz)))
        used = np.flatnonzero(item.usable)[::thin]
        here = {key: k for k, key in enumerate(self._keys) if not key[1] or item.name in key[1]}
        every = list(dict.fromkeys(load for load, _ in here))
        made = item.filter(loads.compute_columns(every, item))[used]
        about = item.about[used, None]
        made[:, 3:] -= np.cross(about, made[:, :3].transpose(0, 2, 1)).transpose(0, 2, 1)
        columns = np.zeros((len(used), 6, len(self._keys)))
        columns[:, :, list(here.values())] = made[:, :, [every.index(load) for load, _ in here]]
        measured = item.move_moment(item.filter(item.measured))[used]
        moved = measured.std(axis=0) if len(used) else np.zeros(6)
        sd = np.hypot(NOISE * item.mass / _OF_KG, OF_MOVEMENT * moved)
        weight = np.minimum(1.0, item.step * thin / (2.0 * _LASTING_S))
        shape = (len(used), 6)
        wide = np.broadcast_to(sd, shape), np.broadcast_to(weight, shape)
        return item.residuals[used], columns, *wide, used

    def expand(self, numbers: Sequence[int]) -> Array:
        """Some columns, (n_columns, k)."""
        found = np.zeros((self.columns.shape[2], len(numbers)))
        found[list(numbers), range(len(numbers))] = 1.0
        return found

    def weigh_body(self, *, each: bool) -> Array:
        """The body's mass, (n_columns, k), in shares of it: in each recording another, or the same in all."""
        count = len(self._frames)
        found = np.zeros((self.columns.shape[2], count))
        found[-count:] = np.eye(count)
        return found if each else found.sum(axis=1, keepdims=True)

    def weigh(self, named: Array, extra: Array, sd: Array, touches: Sequence[Touch] = ()) -> ForceEvidence:
        """Evidence at the likeliest levels.

        ``named`` (n_columns, j): of unit variance; ``extra`` (n_columns, k): of independent deviations
        ``sd``; ``touches``: beside what plates measure.
        """
        touched = [(*self._find_rows(touch), touch) for touch in touches]
        steady = np.zeros((len(self.gap), 6, 3 * len(touched)))
        for j, (rows, found, touch) in enumerate(touched):
            steady[rows, :, 3 * j : 3 * j + 3] = touch.sd * found
        directions = np.concatenate([self.ordinary, named, extra * sd], axis=1)
        columns = np.concatenate([steady, self.columns @ directions], axis=2)
        under = np.pad(self.soles.columns @ directions, ((0, 0), (steady.shape[2], 0)))
        noise = np.ones((self.shared.shape[1], 6))
        whose = self.of @ self.shared
        levels = dict.fromkeys(self.owners, 1.0)
        scale = np.ones(columns.shape[2])
        owned = {owner: at + steady.shape[2] for owner, at in self.owners.items()}
        best: ForceEvidence | None = None
        for _ in range(_PASSES):
            for owner, at in owned.items():
                scale[at] = levels[owner]
            by_noise = 1.0 / (self.sd * (whose @ noise))
            white, gap = columns * by_noise[:, :, None] * scale, self.gap * by_noise
            freed, cost = self._free_touched([(r, t.wandering * f) for r, f, t in touched], by_noise)
            white, gap = freed @ white, np.matmul(freed, gap[:, :, None])[:, :, 0]
            white, gap = white * np.sqrt(self.weight)[:, :, None], gap * np.sqrt(self.weight)
            count = whose.T @ (self.weight * np.square(freed).sum(axis=2))
            flat = np.concatenate([white.reshape(-1, white.shape[2]), under * scale])
            target = np.concatenate([gap.ravel(), self.soles.gap])
            factor = np.linalg.cholesky(np.eye(flat.shape[1]) + flat.T @ flat)
            inverse = np.linalg.inv(factor)
            inverse = inverse.T @ inverse
            strength = inverse @ (flat.T @ target)
            left = gap - white @ strength
            value = -0.5 * float(target @ (target - flat @ strength))
            value -= (
                float(np.log(np.diag(factor)).sum() + (whose.T @ self.weight * np.log(noise)).sum()) + cost
            )
            value -= 0.5 * float(np.square(np.log(noise) / self.spread).sum())
            value += sum(map(weigh_level, levels.values()))
            if best is None or value > best.value:
                last = slice(flat.shape[1] - len(sd), None)
                rms = np.sqrt(self.average(np.square(left / (by_noise * np.sqrt(self.weight)))))
                size, covariance = sd * strength[last], np.outer(sd, sd) * inverse[last, last]
                best = ForceEvidence(
                    value=value,
                    size=size,
                    covariance=covariance,
                    levels=self.shared @ noise,
                    left=rms,
                    directions=directions * scale[steady.shape[2] :],
                    masses=levels["masses"],
                )
            unsure = np.einsum("nak,kl,nal->na", white, inverse, white, optimize=True)
            energy = whose.T @ (np.square(left) + unsure)
            noise = learn_level(noise, energy, count, spread=self.spread)
            for owner, at in owned.items():
                known = float((1.0 - np.diag(inverse)[at]).sum())
                square = float(np.square(strength[at]).sum())
                anew = float(learn_level(levels[owner], square, known, 1.0))
                levels[owner] = math.sqrt(levels[owner] * anew)
        assert best is not None
        return best

    def weigh_livelier(
        self, none: ForceEvidence, named: Array, touches: Sequence[Touch], touching: Sequence[Touch]
    ) -> float:
        """Evidence where all components are as lively as they are seen in the frames of ``touches``.

        That many frames were chosen is taken off. ``touching``: touches that are there.
        """
        lively, levels, nothing = copy.copy(self), none.levels, np.zeros((len(named), 0))
        for _ in range(_LIVELY):  # it lowers the level of all other frames
            scale, cost = self.sd * (self.of @ levels), 0.0
            lively.sd = self.sd.copy()
            for touch in touches:
                rows, _ = self._find_rows(touch)
                factor = np.maximum(np.sqrt(np.square(self.gap[rows] / scale[rows]).mean(axis=0)), 1.0)
                lively.sd[rows] *= factor
                cost += float((self.weight[rows] * np.log(factor)).sum()) + touch.spans
            found = lively.weigh(named, nothing, np.zeros(0), touching)
            levels = found.levels
        return found.value - cost

    def _find_rows(self, touch: Touch) -> tuple[NDArray[np.intp], Array]:
        """The rows of the table that it touches, and what a force of 1 N does there, (n, 6, 3)."""
        start, used = self._frames[touch.trial]
        inside = np.flatnonzero(touch.frames[used])
        return start + inside, touch.columns[used[inside]]

    def _free_touched(
        self, touched: Sequence[tuple[NDArray[np.intp], Array]], by_noise: Array
    ) -> tuple[Array, float]:
        """What frees every row of what touches may take, (n, 6, 6), and half the log determinant of that."""
        spread = np.broadcast_to(np.eye(6), (len(self.gap), 6, 6)).copy()
        for rows, columns in touched:
            white = columns * by_noise[rows][:, :, None]
            spread[rows] += white @ white.transpose(0, 2, 1)
        any_here = np.flatnonzero(np.isin(np.arange(len(self.gap)), [r for rows, _ in touched for r in rows]))
        values, vectors = np.linalg.eigh(spread[any_here])
        freed = np.broadcast_to(np.eye(6), spread.shape).copy()
        freed[any_here] = (vectors / np.sqrt(values)[:, None]) @ vectors.transpose(0, 2, 1)
        independent = self.weight[any_here].mean(axis=1)
        return freed, 0.5 * float((independent[:, None] * np.log(values)).sum())

    @staticmethod
    def _stack(white: Array, under: Array) -> Array:
        """Rows (n, 6, k) and those of the soles (m, k), one below the other."""
        return np.concatenate([white.reshape(-1, white.shape[2]), under])

    def list_courses(self, explained: Array) -> list[Array]:
        """How the size of a load might change, (n,) each, between -1 and 1 in every recording.

        In the course of time, or with how much of it shows (rows (n, 6) that it explains): steadily, out and
        back, and there and back again.
        """
        shown = np.linalg.norm(explained, axis=1)
        spans = [slice(start, start + len(used)) for start, used in self._frames.values()]
        ways = [
            np.concatenate([np.linspace(-1.0, 1.0, s.stop - s.start) for s in spans]),
            np.concatenate(
                [2.0 * scipy.stats.rankdata(shown[s]) / max(s.stop - s.start, 1) - 1.0 for s in spans]
            ),
        ]
        return [course for way in ways for course in bend_course(way)]

    def score_roughly(
        self,
        none: ForceEvidence,
        choice: Sequence[Sequence[int]],
        sds: Sequence[Array],
        course: Array | None = None,
    ) -> list[Scored]:
        """Candidates (the numbers of their columns), each by itself, at the levels that hold without any.

        ``course`` (n,): that they take over the rows, if they are not constant.
        """
        by_noise, under = self.scale(none.levels), self.soles.columns
        known = self._stack(self.columns @ none.directions * by_noise[:, :, None], under @ none.directions)
        gap, found = np.concatenate([(self.gap * by_noise).ravel(), self.soles.gap]), []
        inner = np.linalg.inv(np.eye(known.shape[1]) + known.T @ known)
        left = gap - known @ (inner @ (known.T @ gap))
        if course is not None:
            by_noise, under = by_noise * course[:, None], np.zeros_like(under)
        for numbers, sd in zip(choice, sds, strict=True):
            own = self._stack(
                self.columns[:, :, list(numbers)] * by_noise[:, :, None], under[:, list(numbers)]
            )
            along = known.T @ own
            found.append(Scored.of(own.T @ left, own.T @ own - along.T @ inner @ along, sd))
        return found

    def score_livelier(self, none: ForceEvidence, numbers: Sequence[int], sd: Array) -> float:
        """How much likelier recordings are if everybody's share of a candidate is livelier here.

        What that costs is taken off. ``sd``: everybody's share where masses differ as between people.
        """
        best = 0.0
        for factor in FACTORS:
            (found,) = self.score_roughly(none, [numbers], [factor * none.masses * sd])
            best = max(best, found.bayes + weigh_level(factor))
        return best

    def add_back(self, numbers: Sequence[int], size: Array) -> None:
        """What some columns of a size explain, which was taken off all that is measured."""
        self.gap = self.gap + self.explain(numbers, size)
        self.soles = Soles(self.soles.gap + self.soles.columns[:, list(numbers)] @ size, self.soles.columns)

    def scale(self, levels: Array) -> Array:
        """What whitens the rows at some levels (n_recordings, 6), (n, 6)."""
        return np.asarray(np.sqrt(self.weight) / (self.sd * (self.of @ levels)))

    def rate_levels(self, evidence: ForceEvidence) -> Array:
        """By how many of their deviations components are livelier than usual, (n_recordings, 6)."""
        return np.asarray(np.log(evidence.levels) / (self.shared @ self.spread))

    def average(self, values: Array) -> Array:
        """Means over the rows of each recording, (n_recordings, 6)."""
        return np.asarray(self.of.T @ values / np.maximum(self.of.sum(axis=0), 1.0)[:, None])

    def explain(self, numbers: Sequence[int], size: Array) -> Array:
        """What some columns of a size make of the wrench, (n, 6)."""
        return np.asarray(self.columns[:, :, list(numbers)] @ size)


def bend_course(way: Array) -> list[Array]:
    """Of a course (n,) from -1 to 1: that, out and back, and there and back again."""
    return [way, 1.5 * way**2 - 0.5, np.cos(2.0 * np.pi * way)]


def measure_noise(table: WrenchTable, levels: Array) -> Array:
    """What is ordinary of each component, (n_recordings, 6): noise, plates and masses together, N and N m."""
    spread = np.square(table.columns @ table.ordinary).sum(axis=2)
    return np.asarray(np.sqrt(table.average(np.square(table.sd * (table.of @ levels)) + spread)))


def _stands_still(item: WrenchFit) -> bool:
    """Whether the body as a whole hardly accelerates in the frames that count."""
    force = item.filter(item.needed)[item.usable, :3] + item.mass * item.gravity
    return bool(np.square(force).sum() < (_STILL * item.mass) ** 2 * len(force))
