"""The body and its markers against what is ordinary: levels learnt, candidates in the order of their odds."""

from __future__ import annotations

import math
from collections import Counter, defaultdict
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import scipy

from scaling_service.capabilities.discovery.effects.catalogue import propose_candidates
from scaling_service.capabilities.discovery.effects.missing_dof import find_free_motions
from scaling_service.capabilities.discovery.effects.sizes import list_usual_deviations
from scaling_service.capabilities.discovery.effects.skin_wobble import find_swinging_skin, tune_swing
from scaling_service.capabilities.discovery.evidence.fit import Fit
from scaling_service.capabilities.discovery.laws.candidates import Candidate, Estimate, Swinging
from scaling_service.capabilities.discovery.laws.spots import Generators, MarkerSpot
from scaling_service.capabilities.discovery.observations.tracked import MotionFit
from scaling_service.capabilities.discovery.ordinary.body import (
    Ordinary,
    expect_body,
    find_part,
    make_clusters,
)
from scaling_service.capabilities.discovery.ordinary.columns import Base
from scaling_service.capabilities.discovery.ordinary.forces import OF_MOVEMENT, bend_course
from scaling_service.capabilities.discovery.ordinary.levels import MARKER, STILLEST, find_most, learn_level
from scaling_service.capabilities.discovery.ordinary.odds import Scored, Table
from scaling_service.capabilities.discovery.ordinary.sums import Look, Sums, White, score_course
from scaling_service.capabilities.discovery.search.cameras import EVERYDAY, OFF_M, propose_cameras
from scaling_service.capabilities.discovery.search.leanings import Leanings
from scaling_service.core.arrays import Array

_WANDERING, _LASTING = 4, 4
"""Passes of learning levels: of what wanders, and of what lasts (chosen: they settle to some per cent)."""

_AGAIN = 12
"""Of the likeliest that are looked at once more, levels learnt beside them (chosen: the lead is there)."""

_WORTH = -2.0  # log odds from which that is done
_TINY = 1e-9  # m or rad: a size of nothing


@dataclass(frozen=True, slots=True, eq=False)
class Ranked:
    """A candidate, its log odds and what is told of it; nothing of one without columns."""

    odds: float
    candidate: Candidate
    scored: Scored | None = None


@dataclass(frozen=True, eq=False, kw_only=True)
class BodyTable:
    """Recordings as they are tracked, against what is ordinary of the body."""

    fit: Fit
    base: Base
    ordinary: Ordinary
    candidates: Sequence[tuple[Candidate, Array]]  # with prior deviations
    cameras: Sequence[tuple[Candidate, Array]]  # that misread, with the same
    whites: Sequence[White]
    table: Table
    loose: dict[str, float]  # part of the body to the level at which its skin wanders
    strays: dict[str, float]  # marker to the factor by which it wanders more than its part
    levels: dict[str, float]  # of everything else
    moved: Sequence[Array]  # of every recording, coefficients that its effects stand for

    @classmethod
    def of(cls, fit: Fit, *, given: bool, placed: bool, like: BodyTable | None = None) -> BodyTable:
        """Built anew for a fit, levels learnt, or as in another table."""
        base, scene, found = Base(), fit.scene, []
        names = scene.model.coordinate_names
        every = np.concatenate([item.q[:, : len(names)] for item in fit.tracked])
        means = dict(zip(names, every.mean(axis=0).tolist(), strict=True))
        ordinary = expect_body(base, scene, means, given=given, placed=placed)
        for candidate in propose_candidates(scene):
            shown = is_of_body(candidate) and _is_compared(candidate, fit)
            sd = list_usual_deviations(candidate, scene.model) if shown else None
            if sd is not None:
                found.append((candidate, sd))
        own = [
            (e, list_usual_deviations(e.candidate, scene.model))
            for e in fit.effects
            if is_of_body(e.candidate)
        ]
        cameras = list(propose_cameras(fit.tracked))
        for candidate in (
            *(c for c, _ in found),
            *(e.candidate for e, _ in own),
            *(c for c, _ in cameras),
        ):
            base.include(candidate)
        looks = _look(fit, base)
        loose = {c.part: 1.0 for look in looks for c in look.clusters}
        levels = {d.level: 1.0 for s in (ordinary.common, ordinary.own) for d in s.directions if d.level}
        strays = dict.fromkeys((m for look in looks for m in look.item.markers), 1.0)
        if like is not None:
            loose, strays, levels = like.loose, like.strays, like.levels
            looks = [replace(a, weight=b.look.weight) for a, b in zip(looks, like.whites, strict=True)]
        for turn in range(1 if like is not None else _WANDERING + 1):
            whites = [look.whiten(loose, strays) for look in looks]
            sums = [white.add_up(base) for white in whites]
            last = turn == _WANDERING
            for _ in range(0 if like is not None else _LASTING if last else 1):
                table, moved = _tabulate(base, sums, ordinary, levels, own)
                wandering, astray, levels = _learn(
                    base, table, whites, moved, ordinary, loose, strays, levels
                )
            if not last and like is None:
                loose, strays = wandering, astray
        table, moved = _tabulate(base, sums, ordinary, levels, own)
        return cls(
            fit=fit,
            base=base,
            ordinary=ordinary,
            candidates=found,
            cameras=cameras,
            whites=whites,
            table=table,
            loose=loose,
            strays=strays,
            levels=levels,
            moved=moved,
        )

    def reestimate(self) -> list[tuple[Estimate, Array]]:
        """Effects that are sums of columns, estimated together, and covariances of their sizes."""
        at, found = len(self.ordinary.common.expand(len(self.base), self.levels)[1]), []
        beyond = [len(self.ordinary.own.expand(len(self.base), self.levels)[1])] * len(self.table.sums)
        inner = self.table.inner
        for effect in filter(lambda e: is_of_body(e.candidate), self.fit.effects):
            count, sd = len(effect.size), list_usual_deviations(effect.candidate, self.fit.model)
            scale = np.abs(effect.size) if sd is None else sd
            if not effect.candidate.trials:
                rows = slice(at, at + count)
                at += count
                size, covariance = scale * self.table.strengths[rows], inner[rows, rows]
            else:
                sizes, covariances = [], []
                for k, s in enumerate(self.table.sums):
                    if effect.candidate.holds_in(s.trial):
                        rows = slice(beyond[k], beyond[k] + count)
                        beyond[k] += count
                        sizes.append(scale * self.table.estimate_own(k)[0][rows])
                        covariances.append(self.table.spread_own(k)[rows, rows])
                size = np.mean(sizes, axis=0)
                covariance = np.mean(covariances, axis=0) / len(covariances)
            found.append((Estimate(effect.candidate, size), covariance * np.outer(scale, scale)))
        return found

    def rank(self) -> list[Ranked]:
        """All candidates, the likeliest first."""
        places = Counter(c.kind for c, _ in self.candidates)
        found: list[Ranked] = []
        for trials in sorted({c.trials for c, _ in self.candidates}):
            chosen = [one for one in self.candidates if one[0].trials == trials]
            scored = self.table.score_each(
                [self.base.expand(c) for c, _ in chosen], [sd for _, sd in chosen], trials
            )
            for (candidate, _), s in zip(chosen, scored, strict=True):
                found.append(Ranked(s.bayes - math.log(places[candidate.kind]), candidate, s))
        found.sort(key=lambda one: -one.odds)
        again = [one for one in found[:_AGAIN] if one.odds > _WORTH]
        ranked = [self.weigh(one.candidate, places[one.candidate.kind]) for one in again]
        ranked += found[len(again) :]
        scene = self.fit.scene
        of_course = (
            *find_free_motions(scene, self.base, self.left, self.levels),
            *find_swinging_skin(scene, self.base, self.left),
        )
        ranked += [Ranked(odds, candidate) for odds, candidate in of_course]
        return sorted(ranked, key=lambda one: -one.odds)

    def lean(self, keys: Collection[str]) -> Leanings:
        """What all recordings say of some candidates together."""
        chosen = [one for one in self.candidates if one[0].key in keys]
        if not chosen:
            return Leanings()
        L = np.concatenate([self.base.expand(c) for c, _ in chosen], axis=1)
        sds = np.concatenate([sd for _, sd in chosen])
        return Leanings(tuple(c for c, _ in chosen), *self.table.project(L), sds)

    def weigh(self, candidate: Candidate, places: int) -> Ranked:
        """One candidate at one of so many places, levels learnt beside it, against a livelier place there."""
        sd = next(sd for one, sd in self.candidates if one is candidate)
        anew = self.table.score_learning(self.base.expand(candidate), sd, candidate.trials)
        odds = anew.bayes - math.log(places)
        at = self._list_places(candidate) if odds > self.fit.settings.odds else []
        return Ranked(odds - max(map(self._score_livelier, at), default=0.0), candidate, anew)

    def find_misreading(self) -> tuple[float, Candidate, Array]:
        """The likeliest way in which cameras misread: log odds, and its numbers.

        Against what every volume is off by, and livelier skin at all segments.
        """
        wanders = Candidate("camera_readings", ("markers",), (), note="wandering")
        found = [(self._score_wandering(), wanders, np.zeros(0))]
        for candidate, sd in self.cameras:
            L = self.base.expand(candidate)
            large, everyday = (self.table.score_learning(L, share * sd) for share in (1.0, EVERYDAY))
            found.append((large.bayes - max(everyday.bayes, 0.0), candidate, large.size))
        bayes, candidate, size = max(found, key=lambda one: one[0])
        odds = bayes - math.log(len(found))
        if odds > self.fit.settings.odds:
            odds -= sum(self._score_livelier(s.name) for s in self.fit.scene.bearing)
        return odds, candidate, size

    def _score_wandering(self) -> float:
        """Log Bayes factor of a volume that is stretched anew in every frame, against one that all are."""
        spots, value = {spot: k for k, spot in enumerate(self.base.spots)}, 0.0
        at = [spots[part.spot] for part in self.cameras[0][0].parts]
        for k, white in enumerate(self.whites):
            columns, left = white.columns[:, at], white.subtract(self.base, self.estimate(k))
            shown = columns @ columns.transpose(0, 2, 1)
            scores = np.matmul(columns, left[:, :, None])
            for sign, sd in ((0.5, OFF_M), (-0.5, EVERYDAY * OFF_M)):
                inverse = np.linalg.inv(np.eye(len(at)) / sd**2 + shown)
                gains = (scores * (inverse @ scores)).sum(axis=(1, 2)) + np.linalg.slogdet(inverse / sd**2)[1]
                value += sign * white.look.weight * float(gains.sum())
        return value

    @cached_property
    def left(self) -> list[tuple[White, Array]]:
        """Residuals of every recording less everything that lasts, (n, 3 m), as if none went astray."""
        plain = [white.look.whiten(self.loose) for white in self.whites]
        return [(w, w.subtract(self.base, self.estimate(k))) for k, w in enumerate(plain)]

    def score_drift(self, effect: Estimate, sd: Array) -> float:
        """Log Bayes factor of a named effect's changing in the course of recordings, beside itself.

        ``sd``: of what it changes by. Against a change by a share of itself, by which persons and models
        disagree with any size.
        """
        L, found = self.base.expand(effect.candidate), []
        here = [both for both in self.left if effect.candidate.holds_in(both[0].look.item.name)]
        shown = [
            np.matmul(white.spread_over_spots(self.base, L).transpose(0, 2, 1), white.columns)
            for white, _ in here
        ]
        for by in (sd, OF_MOVEMENT * np.maximum(np.abs(effect.size), _TINY)):
            every = [
                [
                    score_course(white, left, c, way[None], by)[0]
                    for way in bend_course(np.linspace(-1.0, 1.0, len(left)))
                ]
                for (white, left), c in zip(here, shown, strict=True)
            ]
            found.append(float(scipy.special.logsumexp(np.sum(every, axis=0))))
        return found[0] - found[1]

    def tune_swings(self) -> list[Estimate]:
        """Effects, with what swings at its likeliest frequency and damping."""
        return [
            replace(e, candidate=tune_swing(self.base, self.left, e.candidate))
            if isinstance(e.candidate.change, Swinging)
            else e
            for e in self.fit.effects
        ]

    def list_astray(self, limit: float) -> set[str]:
        """Markers that wander more than others of their part do, by so many deviations."""
        return {marker for marker, factor in self.strays.items() if math.log(factor) > limit * MARKER}

    def estimate(self, k: int) -> Array:
        """What recording k tells of all columns beside its effects."""
        return self.table.coefficients + self.table.own[k] @ self.table.estimate_own(k)[0] - self.moved[k]

    def _list_places(self, candidate: Candidate) -> list[str]:
        """Where something ordinary may be livelier instead of a candidate: skin, glide, a marker's place."""
        model = self.fit.model
        follows = candidate.follows
        first = candidate.where[0]
        if first not in model.marker_names:
            return [first] if follows else []
        segment = model.marker(first).segment
        if not follows:
            return [] if candidate.trials else [f"place of {first}"]
        return [segment, *([f"skin of {first}"] if len(candidate.where) == 1 else [])]

    def _score_livelier(self, place: str) -> float:
        """See :meth:`Table.score_livelier`."""
        if place not in self._livelier:
            L, level = self._expand_place(place)
            self._livelier[place] = self.table.score_livelier(L, level) if L.shape[1] else 0.0
        return self._livelier[place]

    @cached_property
    def _livelier(self) -> dict[str, float]:
        return {}

    def _expand_place(self, place: str) -> tuple[Array, str]:
        """What lasts at a place or of one of its markers, (n_columns, any), at level one, and whose it is."""
        model, size = self.fit.model, len(self.base)
        marker = place.rpartition(" of ")[2]
        if marker == place:
            found, owners = self.ordinary.common.expand(size, {}, place)
            return found, owners[0] if owners else ""
        segment = model.marker(marker).segment
        whole = segment if place.startswith("skin") else f"place {find_part(model.bone_of(segment))}"
        found, owners = self.ordinary.common.expand(size, {}, whole)
        spots = ((spot, n) for (spot, _), n in self.base.columns.items())
        own = [n for spot, n in spots if isinstance(spot, MarkerSpot) and spot.marker == marker]
        mask = np.zeros((size, 1))
        mask[own] = 1.0
        found = found * mask
        return found[:, np.abs(found).max(axis=0) > 0.0], owners[0] if owners else ""

    def compare(self, one: Ranked, other: Ranked) -> float:
        """Cosine between what two candidates explain, as they were found; 0 of what has no columns."""
        if one.scored is None or other.scored is None:
            return 0.0
        moved = [
            self.base.expand(r.candidate) @ s.size for r, s in ((one, one.scored), (other, other.scored))
        ]
        first, second = (set(r.candidate.trials or [s.trial for s in self.table.sums]) for r in (one, other))
        if not first & second:
            return 0.0
        both = self.table.project(np.stack(moved, axis=1), sorted(first & second))[1][0, 1]
        lengths = [
            self.table.project(m[:, None], sorted(t))[1][0, 0]
            for m, t in zip(moved, (first, second), strict=True)
        ]
        return float(both / math.sqrt(max(lengths[0] * lengths[1], 1e-300)))


def _is_compared(candidate: Candidate, fit: Fit) -> bool:
    """Whether what holds in some recordings only is shown in others, too: else it holds in all."""
    of_markers = [m for m in candidate.where if m in fit.model.marker_names]
    if not candidate.trials or not of_markers:
        return True
    shown = [item.name for item in fit.tracked if set(of_markers) <= set(item.markers)]
    return bool(set(shown) & set(candidate.trials)) and bool(set(shown) - set(candidate.trials))


def is_of_body(candidate: Candidate) -> bool:
    """Whether a candidate is a sum of columns of the body and its markers."""
    return bool(candidate.columns) and all(column.parts for column in candidate.columns)


def _look(fit: Fit, base: Base) -> list[Look]:
    """At all recordings; what the same body needs is made once."""
    known: list[tuple[MotionFit, Generators]] = []
    looks = []
    for item in fit.tracked:
        alike = (g for other, g in known if _are_of_same_body(item, other))
        generators = next(alike, None)
        if generators is None:
            generators = Generators.of(item, base.spots)
            known.append((item, generators))
        looks.append(Look.of(item, base, generators, make_clusters(item)))
    return looks


def _are_of_same_body(one: MotionFit, other: MotionFit) -> bool:
    """Whether two recordings are tracked by the same body with the same markers and coordinates."""
    alike = one.markers == other.markers and np.array_equal(one.task.free, other.task.free)
    return alike and one.task.model == other.task.model


def _tabulate(
    base: Base,
    sums: Sequence[Sums],
    ordinary: Ordinary,
    levels: dict[str, float],
    named: Sequence[tuple[Estimate, Array | None]],
) -> tuple[Table, list[Array]]:
    """Sums, with effects that are named as free as candidates are about zero, not about their estimate."""
    size = len(base)
    common, owners = ordinary.common.expand(size, levels)
    own = ordinary.own.expand(size, levels)[0]
    mine, moved = [[own] for _ in sums], [np.zeros(size) for _ in sums]
    for effect, sd in named:
        L = base.expand(effect.candidate)
        block = L * (np.abs(effect.size) if sd is None else sd)
        if not effect.candidate.trials:
            common, owners = np.concatenate([common, block], axis=1), [*owners, *[""] * block.shape[1]]
        for k, s in enumerate(sums):
            if effect.candidate.holds_in(s.trial):
                moved[k] += L @ effect.size
                if effect.candidate.trials:
                    mine[k].append(block)
    shifted = [
        replace(
            s,
            scores=s.scores + s.products @ b,
            square=s.square + float(b @ (2.0 * s.scores + s.products @ b)),
        )
        for s, b in zip(sums, moved, strict=True)
    ]
    stacked = [np.concatenate(blocks, axis=1) for blocks in mine]
    return Table(sums=shifted, common=common, owners=owners, own=stacked, levels=levels), moved


def _learn(
    base: Base,
    table: Table,
    whites: Sequence[White],
    moved: Sequence[Array],
    ordinary: Ordinary,
    loose: dict[str, float],
    strays: dict[str, float],
    levels: dict[str, float],
) -> tuple[dict[str, float], dict[str, float], dict[str, float]]:
    """The likeliest levels: of what lasts by its strengths, of what wanders by what is left."""
    energy, count, left, freedom = (defaultdict[str, float](float) for _ in range(4))
    of: dict[str, str] = {}  # marker to its part

    def add(owners: Sequence[str], strengths: Array, told: Array) -> None:
        for owner, z, share in zip(owners, strengths.tolist(), told.tolist(), strict=False):
            energy[owner] += z * z
            count[owner] += share

    add(table.owners, table.strengths, table.determined)
    of_own = ordinary.own.expand(len(base), levels)[1]
    for k, white in enumerate(whites):
        strengths, told = table.estimate_own(k)
        add(of_own, strengths, told)
        rest = white.subtract(base, table.coefficients + table.own[k] @ strengths - moved[k])
        of |= {white.look.item.markers[row]: c.part for c in white.look.clusters for row in c.rows}
        energies, free = white.measure(rest).tolist(), white.free.tolist()
        for marker, square, number in zip(white.look.item.markers, energies, free, strict=True):
            for place in (marker, of[marker]):
                left[place] += square
                freedom[place] += number
    parts = {part: float(learn_level(old, left[part], freedom[part])) for part, old in loose.items()}
    astray = learn_level(  # about the new level of its part
        np.array(list(strays.values())),
        np.array([left[m] * (loose[of[m]] / parts[of[m]]) ** 2 for m in strays]),
        np.array([freedom[m] for m in strays]),
        spread=MARKER,
    )
    return (
        parts,
        dict(zip(strays, np.maximum(astray, STILLEST).tolist(), strict=True)),
        {
            # half of the way: how much is told of something follows its level
            level: math.sqrt(old * float(learn_level(old, energy[level], count[level], find_most(level))))
            for level, old in levels.items()
        },
    )
