"""What is ordinary for people, place by place: what the gap is measured beside."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from scaling_service.capabilities.discovery.evidence.fit import Fit
from scaling_service.capabilities.discovery.observations import tracked, wrench
from scaling_service.capabilities.discovery.ordinary import forces as evidence
from scaling_service.capabilities.discovery.ordinary.sums import Look
from scaling_service.capabilities.discovery.search.markers import BodyTable
from scaling_service.core.arrays import Array

_TOGETHER = 256  # directions that are followed at once (chosen: what a cache holds of a frame)
_TINY = 1e-300
_LOOKED_AT = 15  # frames of a recording that tell how much of what lasts is the same (chosen: it is smooth)


@dataclass(frozen=True, slots=True, eq=False)
class Yardstick:
    """What people are ordinarily like, seen in these recordings."""

    levels: Mapping[str, Mapping[str, tuple[float, float]]]
    """By recording and place, what is ordinary, and what that leaves where it takes what it can; RMS, SI."""
    freedom: Mapping[str, float]
    """By place, how many independent numbers the mean square over all recordings is of: skin that lasts is
    one, however long it is looked at."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Spread:
    """How a place strays in a recording: squares of all rows together are its mean square there."""

    lasting: Array  # (n, k): in some frames, along directions that all recordings share
    own: Array  # (n, l): along this recording's
    loose: float  # mean square of what lasts no longer than a block of time
    looks: float  # numbers of that: blocks times axes
    frames: float


def make_yardstick(
    body: BodyTable, fit: Fit, forces: tuple[evidence.WrenchTable, evidence.ForceEvidence] | None
) -> Yardstick:
    """Of markers the mean over ordinary people at the levels learnt, whose poses follow; of forces these."""
    levels: dict[str, dict[str, tuple[float, float]]] = {}
    spreads: defaultdict[str, list[Spread]] = defaultdict(list)
    expanded = [s.expand(len(body.base), body.levels)[0] for s in (body.ordinary.common, body.ordinary.own)]
    directions, shared = np.concatenate(expanded, axis=1), expanded[0].shape[1]
    for k, white in enumerate(body.whites):
        look = white.look
        columns = look.columns.transpose(0, 2, 1)
        strays = [
            np.matmul(columns, white.spread_over_spots(body.base, some))
            for some in np.array_split(directions, 1 + directions.shape[1] // _TOGETHER, axis=1)
        ]
        wander = np.linalg.cholesky(look.make_covariance(body.loose))
        explained = white.spread_over_spots(body.base, body.estimate(k))
        rest = look.gap - np.matmul(explained[:, None], look.columns)[:, 0]
        lasting, loose, left = (
            _follow(look, x)
            for x in (
                np.concatenate(strays, axis=2),
                np.broadcast_to(wander, (len(look.gap), *wander.shape)),
                rest[:, :, None],
            )
        )
        lasts, wanders, remains = (_measure_squares(look, x) for x in (lasting, loose, left))
        item, some = look.item, np.linspace(0, len(look.gap) - 1, _LOOKED_AT).round().astype(int)
        blocks = 3.0 * len(list(item.blocks(fit.settings.block_s)))
        for m, marker in enumerate(item.markers):
            levels.setdefault(item.name, {})[marker] = (
                float(np.sqrt(lasts[m] + wanders[m])),
                float(np.sqrt(remains[m])),
            )
            rows = lasting[some, 3 * m : 3 * m + 3].reshape(3 * len(some), -1)
            rows *= np.sqrt(lasts[m] / max(float(np.square(rows).sum()), _TINY))  # seen in some frames only
            spreads[marker].append(
                Spread(
                    lasting=rows[:, :shared],
                    own=rows[:, shared:],
                    loose=float(wanders[m]),
                    looks=blocks,
                    frames=float(item.seen[:, m].sum()),
                )
            )
    if forces is not None:
        _add_forces(levels, spreads, fit.wrenches, fit.settings.block_s, forces)
    return Yardstick(levels, {place: count_freedom(parts) for place, parts in spreads.items()})


def _follow(look: Look, strays: Array) -> Array:
    """What strays (n, 3 m, k) leave of themselves where the pose follows them."""
    shown = np.repeat(look.seen, 3, axis=1)
    basis, strays = tracked.span(look.pose * shown[:, None]), np.where(shown[:, :, None], strays, 0.0)
    return np.asarray(strays - basis.transpose(0, 2, 1) @ (basis @ strays))


def _measure_squares(look: Look, strays: Array) -> Array:
    """Mean squared distance of every marker, (m,), m2, by strays (n, 3 m, k)."""
    square = np.square(strays).sum(axis=(0, 2)).reshape(-1, 3).sum(axis=1)
    return np.asarray(square / np.maximum(look.seen.sum(axis=0), 1))


def _add_forces(
    levels: dict[str, dict[str, tuple[float, float]]],
    spreads: Mapping[str, list[Spread]],
    fits: Sequence[wrench.WrenchFit],
    block_s: float,
    forces: tuple[evidence.WrenchTable, evidence.ForceEvidence],
) -> None:
    """The same of the components of the wrench."""
    table, none = forces
    ordinary = evidence.measure_noise(table, none.levels)
    for k, fit in enumerate(fits):
        pairs = zip(ordinary[k].tolist(), none.left[k].tolist(), strict=True)
        levels.setdefault(fit.name, {}).update(zip(wrench.COMPONENTS, pairs, strict=True))
        rows = np.flatnonzero(table.of[:, k])
        if not len(rows):
            continue
        some = rows[np.linspace(0, len(rows) - 1, _LOOKED_AT).round().astype(int)]
        lasting = table.columns[some] @ table.ordinary / np.sqrt(len(some))
        for c, component in enumerate(wrench.COMPONENTS):
            lasts = float(np.square(lasting[:, c]).sum())
            spreads[component].append(
                Spread(
                    lasting=lasting[:, c],
                    own=lasting[:, c, :0],
                    loose=max(float(ordinary[k, c] ** 2) - lasts, 0.0),
                    looks=float(len(list(fit.blocks(block_s)))),
                    frames=float(len(rows)),
                )
            )


def count_freedom(parts: Sequence[Spread]) -> float:
    """Of the chi-square whose mean and variance a place's mean square has (Satterthwaite 1946)."""
    share = np.array([part.frames for part in parts])
    share = share / max(float(share.sum()), 1.0)
    rows = np.concatenate([np.sqrt(s) * part.lasting for s, part in zip(share, parts, strict=True)])
    gram, at = rows @ rows.T, 0
    for s, part in zip(share, parts, strict=True):
        here = slice(at, at := at + len(part.own))
        gram[here, here] += s * part.own @ part.own.T
    loose = share * np.array([part.loose for part in parts])
    looks = np.array([part.looks for part in parts])
    mean = float(np.trace(gram) + loose.sum())
    half_variance = float(np.square(gram).sum() + (loose**2 / looks).sum())
    return mean**2 / half_variance if half_variance > 0.0 else 0.0
