"""Whether right is right: the handedness of a person, from all landmarks at once.

A person is not congruent to their mirror image once it is known which way they face and which labels are
right ones: the pelvis' front, the feet, bent knees, the chest, the face and the way they walk tell the first,
the labels the second. A recording with one axis negated and one whose labels of both sides were exchanged are
the same up to a turn, so that positions alone never tell which of the two it is.

Every pair of a right and a left label is a line that points to the right or, exchanged, to the left. Its
cosine with the body's right (front x up) and with the lines beside it are the evidence; which pairs are
exchanged is one posterior over the whole body, in which each witness of the front may be wrong.
"""

from __future__ import annotations

from collections import abc
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from scaling_service.core.arrays import Array
from scaling_service.model.trial import Trial
from scaling_service.recording.witnesses import WRONG, Body, SidePair, Witness, normalise, take_median

MIRRORED, BLOCK, PAIR = 1e-3, 1e-3, 1e-3
"""Prior probability that a whole recording is mirrored, that all labels of a part of the body stand for the
other side's, and that those of one pair do (chosen: one export or labelling in a thousand)."""

_FRONT, _BESIDE = (0.8, 0.3), (0.85, 0.35)
"""Mean and SD over people and postures of the median cosine between the body's right and a line to the right,
and between two lines beside each other (chosen: feet turn out by 30 deg, trunks turn by 40, legs swing
apart)."""

_OUT = (0.6, 0.3)
"""The same of lines from the inner to the outer side of a joint (chosen: a limb turns by up to 60 deg)."""

CROSSED, STEPPING_CROSSED = 1e-3, 1e-6
"""Prior probability that somebody keeps the legs crossed throughout a recording, and steps so (chosen)."""

_STEP_M = 0.1  # chosen: SD of one foot's place against the other's from which on somebody steps

_ODD = 1e-6  # chosen: lines that a trusted witness says nothing of; its own error is counted once

_BACK = -0.3  # chosen: median cosine below which a front looks like a back, 107 deg off

_NEIGHBOURS = {
    frozenset(pair)
    for pair in (
        ("head", "trunk"), ("trunk", "arm"), ("trunk", "pelvis"), ("pelvis", "thigh"), ("thigh", "shank"),
        ("shank", "foot"),
    )
}  # fmt: skip
_BLOCKS: abc.Mapping[str, frozenset[str]] = {
    "the upper body": frozenset({"head", "trunk", "arm"}),
    "the head": frozenset({"head"}),
    "the arms": frozenset({"arm"}),
    "the legs": frozenset({"thigh", "shank", "foot"}),
    "the shanks and feet": frozenset({"shank", "foot"}),
    "the feet": frozenset({"foot"}),
    "the shanks": frozenset({"shank"}),
    "the thighs": frozenset({"thigh"}),
    "the pelvis": frozenset({"pelvis"}),
}
"""Parts whose labels may all be exchanged, as when somebody corrected only the others."""


_MOST_PAIRS = 60  # that are weighed against each other (chosen: both hands' fingers have as many)


@dataclass(frozen=True, slots=True, kw_only=True)
class Handedness:
    """What the posterior says of one recording.

    ``log_odds``: natural logarithm of the odds that some sides are exchanged, all is mirrored, or some front
    is a back, against none of these. ``whole``: whether all sides are. ``part``: the part of the body whose
    are, in words. ``pairs``: those exchanged. ``witnesses``: what the front was known from. ``turned``: those
    of them that contradict the others.
    """

    log_odds: float
    whole: bool
    part: str
    pairs: tuple[tuple[str, str], ...]
    witnesses: tuple[str, ...]
    turned: tuple[Witness, ...] = ()


def judge_handedness(trial: Trial, roles: abc.Mapping[str, str]) -> Handedness | None:
    """The posterior over which sides of a recording are exchanged; None where nothing tells.

    ``trial``: in any axes and unit. ``roles``: label to landmark (``RASIS``, ``RLFE`` …), others by words.
    """
    body = Body(trial, roles)
    pairs = list(body.find_pairs())[:_MOST_PAIRS]
    witnesses = [w for w in body.find_witnesses() if np.isfinite(w.right).all(axis=1).any()]
    if not pairs or not witnesses:
        return None
    lines = [normalise(pair.line, softened=True) for pair in pairs]
    states, priors = _list_states(pairs)
    total = np.log(priors)
    for a, b in combinations(range(len(pairs)), 2):
        one, other = pairs[a].region, pairs[b].region
        if one == other or frozenset((one, other)) in _NEIGHBOURS:
            cosine = take_median(np.einsum("fi,fi->f", lines[a], lines[b]))
            if np.isfinite(cosine):
                alike, unlike = np.log(_weigh(np.array([cosine, -cosine]), _BESIDE, WRONG))
                total += np.where(states[:, a] == states[:, b], alike, unlike)
    votes = np.full((len(witnesses), len(pairs)), np.nan)
    for row, witness in zip(votes, witnesses, strict=True):
        right = normalise(witness.right)
        for k, (pair, line) in enumerate(zip(pairs, lines, strict=True)):
            if pair.region in witness.regions:
                row[k] = take_median(np.einsum("fi,fi->f", right, line))
    # Log density of what a witness says if it can be trusted.
    likely = np.zeros((len(witnesses), len(states)))
    for k, row in enumerate(votes):
        known = np.flatnonzero(np.isfinite(row))
        terms = [_weigh(states[:, i] * row[i], _FRONT, _ODD) for i in known]
        # Lines of one region are one line seen several times: their evidence is averaged.
        likely[k] = np.mean(np.log(terms), axis=0) if terms else 0.0
    rates = np.array([w.wrong for w in witnesses])[:, None]
    heard = np.isfinite(votes).any(axis=1)
    misled = np.where(heard[:, None], np.log(rates * 0.5), 0.0)
    trusted = np.where(heard[:, None], np.log1p(-rates) + likely, 0.0)
    total += np.logaddexp(misled, trusted).sum(axis=0)
    outward = np.zeros(len(states))
    for k, cosine in body.find_outward_lines(pairs, witnesses):
        outward += np.log(_weigh(states[:, k] * cosine, _OUT, WRONG))
    # A sound person has no side exchanged and no front that is a back; legs may be crossed, with their outer
    # sides outside; who walks backwards is sound.
    against = np.array(
        [
            w.wrong == WRONG and h and np.nanmean(row) < _BACK
            for w, h, row in zip(witnesses, heard, votes, strict=True)
        ]
    )
    strict = total - ((np.logaddexp(misled, trusted) - trusted) * against[:, None]).sum(axis=0)
    crossed = _find_crossed(states, pairs)
    legs = (
        np.logaddexp.reduce(strict[crossed] - np.log(priors[crossed]))
        + np.log(STEPPING_CROSSED if _steps(pairs) else CROSSED)
        if len(crossed)
        else -np.inf
    )
    sound = float(np.logaddexp(strict[0], legs) + outward[0])
    total += outward
    every = float(np.logaddexp.reduce(total))
    others = every + float(np.log(max(-np.expm1(strict[0] + outward[0] - every), 1e-15)))
    best = int(np.argmax(total))
    exchanged = [pair for pair, sign in zip(pairs, states[best], strict=True) if sign < 0.0]
    whole = len(exchanged) > len(pairs) / 2 and any(p.region in ("pelvis", "trunk") for p in exchanged)
    part = _name_part(pairs, exchanged)
    return Handedness(
        log_odds=others - sound,
        whole=whole,
        part=part,
        pairs=body.complete(exchanged, whole=whole, part=bool(part)),
        witnesses=tuple(w.name for w, h in zip(witnesses, heard, strict=True) if h),
        turned=tuple(
            w
            for w, h, row in zip(witnesses, heard, votes, strict=True)
            if w.wrong == WRONG and h and np.nanmean(states[best] * row) < _BACK
        ),
    )


def _find_crossed(states: Array, pairs: abc.Sequence[SidePair]) -> NDArray[np.intp]:
    """Which states turn round what crossed legs do: all lines below some height, and no others."""
    regions = np.array([pair.region for pair in pairs])
    legs = [states[:, regions == name] < 0.0 for name in ("thigh", "shank", "foot") if name in regions]
    sound = ~(states[:, ~np.isin(regions, ("thigh", "shank", "foot"))] < 0.0).any(axis=1)
    # From the hips down: none, then one region at whose height the legs cross, then all.
    found = np.zeros(len(states), dtype=bool)
    for k, crossing in enumerate(legs[:2] if len(legs) == 3 else legs):
        here = crossing.any(axis=1) if k + 1 < len(legs) else crossing.all(axis=1)
        found |= sound & here & np.all([part.all(axis=1) for part in legs[k + 1 :]], axis=0)
        sound &= ~crossing.any(axis=1)
    return np.flatnonzero(found)


def _steps(pairs: abc.Sequence[SidePair]) -> bool:
    """Whether the feet move past each other."""
    lines = [pair.line for pair in pairs if pair.region == "foot"] or [
        p.line for p in pairs if p.region == "shank"
    ]
    return any(
        float(np.nanstd(line, axis=0).max(initial=0.0)) > _STEP_M for line in lines if np.isfinite(line).any()
    )


def _name_part(pairs: abc.Sequence[SidePair], exchanged: abc.Sequence[SidePair]) -> str:
    """The part of the body of which all pairs are exchanged and no others, in words; empty if none is."""
    present = {pair.region for pair in pairs}
    wrong = {pair.region for pair in exchanged}
    whole = len(exchanged) == sum(pair.region in wrong for pair in pairs)
    return next(
        (name for name, regions in _BLOCKS.items() if whole and wrong and wrong == regions & present), ""
    )


def _weigh(cosine: Array, usual: tuple[float, float], tail: float) -> Array:
    """Density of a cosine for people; ``tail``: share of those of whom nothing is known."""
    mean, sd = usual
    normal = np.exp(-0.5 * ((cosine - mean) / sd) ** 2) / (sd * np.sqrt(2.0 * np.pi))
    density: Array = (1.0 - tail) * normal + tail * 0.5
    return density


def _list_states(pairs: abc.Sequence[SidePair]) -> tuple[Array, Array]:
    """Signs of the lines by hypothesis, (n_states, n_pairs), and prior probabilities; none flipped first."""
    regions = [pair.region for pair in pairs]
    bases = {np.ones(len(pairs)).tobytes(): 1.0, (-np.ones(len(pairs))).tobytes(): MIRRORED}
    for block in _BLOCKS.values():
        signs = np.where([r in block for r in regions], -1.0, 1.0)
        bases.setdefault(signs.tobytes(), BLOCK)
    found: dict[bytes, float] = {}
    for key, prior in bases.items():
        base = np.frombuffer(key)
        for count in range(3):
            for chosen in combinations(range(len(pairs)), count):
                signs = base.copy()
                signs[list(chosen)] *= -1.0
                found[signs.tobytes()] = max(found.get(signs.tobytes(), 0.0), prior * PAIR**count)
    return np.array([np.frombuffer(key) for key in found]), np.array(list(found.values()))
