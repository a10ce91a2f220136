"""How much likelier recordings are with a candidate than with what is ordinary alone, in closed form.

With ``G``, ``g`` the sums of a recording and ``P = A A'`` what is ordinary, ``K = G - G A (1 + A'GA)^-1
A'G``. A candidate ``L b`` with ``b ~ N(0, S)`` has ``X = L'KL``, ``x = L'k`` and the log Bayes factor
``x'(S^-1 + X)^-1 x / 2 - log det(1 + S X) / 2``.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy

from scaling_service.capabilities.discovery.ordinary.levels import find_most, learn_level, weigh_level
from scaling_service.capabilities.discovery.ordinary.sums import Sums
from scaling_service.core.arrays import Array

_LIVELIER = 3.0  # times, from where the level of one place is learnt
_PASSES = 6  # of learning levels (chosen: they settle to a per cent)


def invert_root(products: Array) -> Array:
    """Lower triangular R with ``R'R = (1 + products)^-1``: solves, its diagonal and determinant in one.

    Examples
    --------
    >>> invert_root(np.array([[3.0, 2.0], [2.0, 4.0]])).tolist()  # 1 + products = [[4, 2], [2, 5]]
    [[0.5, 0.0], [-0.25, 0.5]]
    """
    factor = np.linalg.cholesky(np.eye(len(products)) + products)
    root, _ = scipy.linalg.lapack.dtrtri(factor, lower=1)
    return np.asarray(root)


def _weigh(root: Array, pull: Array) -> float:
    """Log Bayes factor of independent numbers of unit variance, from the inverse root and their scores."""
    return 0.5 * float(np.square(root @ pull).sum()) + float(np.log(np.diag(root)).sum())


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Scored:
    """A candidate against what is ordinary."""

    bayes: float  # logarithm of the Bayes factor
    size: Array  # (k,)
    covariance: Array  # (k, k): of the size
    sd: Array  # (k,): its prior deviations
    information: Array  # (k, k): that the recordings have of it

    @classmethod
    def of(cls, x: Array, X: Array, sd: Array) -> Scored:
        """Of numbers of independent deviations about zero, from their scores and products."""
        scaled = np.eye(len(sd)) + X * np.outer(sd, sd)
        inverse = np.linalg.inv(scaled)
        size = sd * (inverse @ (sd * x))
        bayes = 0.5 * float(x @ size) - 0.5 * float(np.linalg.slogdet(scaled)[1])
        return cls(bayes=bayes, size=size, covariance=np.outer(sd, sd) * inverse, sd=sd, information=X)


@dataclass(frozen=True, eq=False, kw_only=True)
class Table:
    """Some recordings, with all that is another in each of them integrated out."""

    sums: Sequence[Sums]
    common: Array  # (n, m): directions of unit variance of what is the same in all
    owners: Sequence[str]  # whose level each has
    own: Sequence[Array]  # of each recording, (n, any): what is another in it
    levels: Mapping[str, float]

    @cached_property
    def parts(self) -> list[tuple[Array, Array]]:
        """Products and scores of each recording."""
        found = []
        for s, (shown, pull, root) in zip(self.sums, self._freed, strict=True):
            taken = root @ shown.T
            found.append((s.products - taken.T @ taken, s.scores - taken.T @ (root @ pull)))
        return found

    @cached_property
    def _freed(self) -> list[tuple[Array, Array, Array]]:
        """Of what is each recording's own: products with all columns, scores, and the inverse root."""
        found = []
        for s, mine in zip(self.sums, self.own, strict=True):
            few = scipy.sparse.csr_array(mine.T)  # every direction is of few columns
            shown = few @ s.products
            found.append((shown.T, few @ s.scores, invert_root(few @ shown.T)))
        return found

    def add_up(self, trials: Sequence[str] = ()) -> tuple[Array, Array]:
        """Products and scores over some recordings, all unless given."""
        if not trials:
            return self._total
        chosen = [p for p, s in zip(self.parts, self.sums, strict=True) if s.trial in trials]
        return np.sum([p[0] for p in chosen], axis=0), np.sum([p[1] for p in chosen], axis=0)

    @cached_property
    def _total(self) -> tuple[Array, Array]:
        return np.sum([p[0] for p in self.parts], axis=0), np.sum([p[1] for p in self.parts], axis=0)

    @cached_property
    def _root(self) -> Array:
        return invert_root(self._common_products)

    @property
    def inner(self) -> Array:
        """Covariance of the strengths, (m, m): (1 + A'GA)^-1."""
        return np.asarray(self._root.T @ self._root)

    @cached_property
    def _common_products(self) -> Array:
        few = scipy.sparse.csr_array(self.common.T)
        return np.asarray(few @ (few @ self._total[0]).T)

    @cached_property
    def strengths(self) -> Array:
        """Of the common directions, in their deviations, (m,)."""
        return np.asarray(self._root.T @ (self._root @ (self.common.T @ self._total[1])))

    @property
    def determined(self) -> Array:
        """How much of each direction the recordings tell, 0 to 1, (m,)."""
        return np.asarray(1.0 - np.square(self._root).sum(axis=0))

    @property
    def coefficients(self) -> Array:
        """Of the columns, what is the same in all recordings, (n,)."""
        return np.asarray(self.common @ self.strengths)

    @cached_property
    def evidence(self) -> float:
        """Logarithm of how likely the recordings are, but for what levels of what wanders make of it."""
        value = _weigh(self._root, self.common.T @ self._total[1])
        for s, (_, pull, root) in zip(self.sums, self._freed, strict=True):
            value += _weigh(root, pull) - 0.5 * s.square
        return value

    def estimate_own(self, k: int) -> tuple[Array, Array]:
        """Strengths of what is another in recording k, and how much of each is told, both (any,)."""
        shown, pull, root = self._freed[k]
        strengths = root.T @ (root @ (pull - shown.T @ self.coefficients))
        return strengths, 1.0 - np.square(root).sum(axis=0)

    def spread_own(self, k: int) -> Array:
        """Covariance of these strengths, (any, any)."""
        root = self._freed[k][2]
        return np.asarray(root.T @ root)

    def project(self, L: Array, trials: Sequence[str] = ()) -> tuple[Array, Array]:
        """Scores x (k,) and products X (k, k) of effects in some trials, L (n, k)."""
        G, g = self.add_up(trials)
        shown = G @ L
        along = self.common.T @ shown
        taken = self._root @ along
        return L.T @ g - along.T @ self.strengths, L.T @ shown - taken.T @ taken

    def score_each(
        self, choice: Sequence[Array], sds: Sequence[Array], trials: Sequence[str] = ()
    ) -> list[Scored]:
        """Candidates (coefficients (n, k) of each) that hold in the same trials, each by itself."""
        x, X = self.project(np.concatenate(choice, axis=1), trials)
        edges = np.cumsum([0, *map(len, sds)]).tolist()
        return [
            Scored.of(x[a:b], X[a:b, a:b], sd) for a, b, sd in zip(edges[:-1], edges[1:], sds, strict=True)
        ]

    def score_livelier(self, L: Array, level: str) -> float:
        """How much likelier recordings are where something ordinary is livelier at one place.

        All levels are learnt anew beside it, as beside a candidate; what the prior says of a place that
        differs from the others of its level is taken off. ``L`` (n, k): its directions at level one.
        """
        return max(self._learn(L, np.ones(L.shape[1]), place=level)[0] - self._learnt, 0.0)

    def score_learning(self, L: Array, sd: Array, trials: Sequence[str] = ()) -> Scored:
        """A candidate L (n, k), with levels learnt anew beside it: nothing hides in what it makes of them."""
        evidence, size, covariance = self._learn(L, sd, trials)
        X = self.project(L, trials)[1]
        bayes = evidence - self._learnt
        return Scored(bayes=bayes, size=size, covariance=covariance, sd=sd, information=X)

    @cached_property
    def _learnt(self) -> float:
        return self._learn(np.zeros((len(self.common), 0)), np.zeros(0))[0]

    def _learn(
        self, L: Array, sd: Array, trials: Sequence[str] = (), place: str = ""
    ) -> tuple[float, Array, Array]:
        """Log evidence at the likeliest levels, with further numbers; their size and covariance.

        ``place``: the level that they follow, if they do; they have one of their own then, about that.
        """
        G, g = self.add_up(trials)
        shown, n = G @ L, self.common.shape[1]
        X, C, x = L.T @ shown, self.common.T @ shown, L.T @ g
        full = np.block([[self._common_products, C * sd], [(C * sd).T, X * np.outer(sd, sd)]])
        right = np.concatenate([self.common.T @ self._total[1], sd * x])
        owners = np.array(self.owners)
        rows = {o: np.flatnonzero(owners == o) for o in dict.fromkeys(self.owners) if o in self.levels}
        levels = {o: self.levels[o] for o in rows}
        own = _LIVELIER if place else 1.0  # against the level that it follows
        best = (-math.inf, np.zeros(len(sd)), np.zeros((len(sd), len(sd))))
        for _ in range(_PASSES):
            scale = np.ones(len(right))
            for o, at in rows.items():
                scale[at] = levels[o] / self.levels[o]
            if place:
                scale[n:] = own * levels[place]
            root = invert_root(full * np.outer(scale, scale))
            z = root.T @ (root @ (scale * right))
            value = _weigh(root, scale * right) + sum(map(weigh_level, (*levels.values(), own)))
            if value > best[0]:
                best = (value, sd * z[n:], np.outer(sd, sd) * (root[:, n:].T @ root[:, n:]))
            told = 1.0 - np.square(root).sum(axis=0)
            energy = np.square(z)
            if place:
                own = float(learn_level(own, energy[n:].sum(), told[n:].sum()))
            for o, at in rows.items():
                anew = learn_level(levels[o], energy[at].sum(), told[at].sum(), find_most(o))
                levels[o] = math.sqrt(levels[o] * float(anew))
        return best
