"""Whether all recordings show one person with one placement of the markers, at one scale."""

from __future__ import annotations

from collections import abc
from itertools import combinations

import numpy as np

from scaling_service.core.arrays import Array
from scaling_service.model.trial import Trial
from scaling_service.recording import findings, witnesses

_BONY = (
    ("RLFE", "RLM"), ("LLFE", "LLM"), ("RASIS", "LASIS"), ("RPSIS", "LPSIS"), ("RASIS", "RPSIS"),
    ("LASIS", "LPSIS"), ("RASIS", "SACR"), ("LASIS", "SACR"), ("RHEE", "RMT5"), ("LHEE", "LMT5"),
    ("RHEE", "RMT1"), ("LHEE", "LMT1"), ("RELB", "RWRA"), ("LELB", "LWRA"), ("RLM", "RMM"), ("LLM", "LMM"),
    ("C7", "CLAV"), ("RFHD", "LFHD"), ("RTUB", "RLM"), ("LTUB", "LLM"), ("RFH", "RLM"), ("LFH", "LLM"),
)  # fmt: skip
"""Distances within one bone, or between ends that slide little."""

_SLIDES = (0.008, 0.03, 0.1)
"""SD of such a distance's change between recordings of one placement, m; of a marker that was put on anew,
and its share (chosen: 3 to 13 mm in recordings of twelve persons; skin on bones, ``people.yaml``)."""

_OTHERS = (0.07, 0.05)
"""SD of the logarithm of another person's size and of each of its lengths (ANSUR II: stature 4 %, both sexes
and children 7; proportions 3 to 5)."""

_OTHER_PERSON = 0.01  # prior probability that a recording is of another person or scale (chosen)

_CHANGES: abc.Mapping[str, float] = {"trunk": 0.005, "arm": 0.004, "thigh": 0.004}
_CHANGE, _CHANGE_ANEW, _CHANGE_SD = 0.002, 0.012, 0.8
"""Median over persons of by how much the distances within a segment change between recordings of one
placement (their median over the pairs of its markers, m; larger of trunk and arms), and of another person or
placement; SD of the logarithm of both (chosen: 0 to 10 mm and 3 to 50 mm in recordings of twelve persons)."""

_ODD_SEGMENT = 0.01  # share of segments with a fault of their own (chosen: 2 of 300)

_PLATE_M = 0.001  # chosen: markers that keep their distances so well sit on a plate, which fits everybody

_FEWEST_BONES = 3  # distances that tell a person's size (chosen)


def ask_same_person(trials: abc.Sequence[Trial]) -> abc.Iterator[findings.Finding]:
    """Whether all recordings show one person with one placement of the markers, at one scale.

    Bones that differ in size are another person's or another scale's. Markers that all sit elsewhere may have
    been put on anew, which a recording of another day is told of and not refused.
    """
    bones = []
    for trial in trials:
        inverse = {role: label for label, role in findings.list_roles(trial).items()}
        step = max(1, trial.n_frames // witnesses.FRAMES)
        found = {}
        for a, b in _BONY:
            if a in inverse and b in inverse:
                distance = np.linalg.norm(
                    (trial.position(inverse[a]) - trial.position(inverse[b]))[::step], axis=1
                )
                known = distance[np.isfinite(distance)]
                if len(known):
                    found[a, b] = float(np.median(known))
        bones.append(found)
    segments = [witnesses.measure_within_segments(trial, findings.list_roles(trial)) for trial in trials]
    odds: dict[tuple[int, int], tuple[float, float, float]] = {}
    for i, j in combinations(range(len(trials)), 2):
        anew = _weigh_anew(segments[i], segments[j])
        common = sorted({*bones[i]} & {*bones[j]})
        here, there = (np.array([bones[k][pair] for pair in common]) for k in (i, j))
        other, scale = _weigh_another(here, there) if len(common) >= _FEWEST_BONES else (-np.inf, 0.0)
        odds[i, j] = (max(other, anew), other, scale)
    # What contradicts most of the others is told; of two that contradict each other, the first.
    against = {
        i: [pair for pair, found in odds.items() if i in pair and found[0] > 0.0] for i in range(len(trials))
    }
    told: set[int] = set()
    for i in sorted(against, key=lambda i: -len(against[i])):
        left = [pair for pair in against[i] if not told & {*pair}]
        if not left or 2 * len(against[i]) <= len(trials) - 1:
            continue
        told.add(i)
        worst = max(left, key=lambda pair: odds[pair])
        _, other, scale = odds[worst]
        rival = trials[worst[0] if worst[1] == i else worst[1]]
        sure = other > np.log(findings.BEYOND_DOUBT)
        scale = scale if worst[0] == i else -scale
        size = f"{abs(np.expm1(scale)):.0%} {'larger' if scale > 0 else 'smaller'}"
        yield findings.Finding(
            code="another_person",
            place=trials[i].name,
            severity="refusal" if sure else "warning",
            problem=f"its bones are not those of {rival.name}, on the whole {size}: it is another person or "
            "another scale"
            if sure
            else f"markers lie elsewhere on their segments than in {rival.name}: they were put on anew, or "
            "it is another person or another scale",
            remedy="Use recordings of one person with one calibration of the volume, and of one placement of "
            "the markers where they are fitted together",
        )


def _weigh_anew(
    here: abc.Mapping[tuple[str, str, str], float], there: abc.Mapping[tuple[str, str, str], float]
) -> float:
    """Logarithm of the odds that markers sit on other places of their segments."""
    changes: dict[str, list[float]] = {}
    for pair in {*here} & {*there}:
        changes.setdefault(pair[0], []).append(abs(here[pair] - there[pair]))
    total = float(np.log(_OTHER_PERSON / (1.0 - _OTHER_PERSON)))
    told = {
        segment: found
        for segment, found in changes.items()
        if len(found) >= 3 and np.median(found) >= _PLATE_M
    }
    if len(told) < 2:  # of one segment, single markers tell
        return -np.inf
    for segment, found in told.items():
        change = np.log(float(np.median(found)))
        usual = np.log(_CHANGES.get(segment.split()[0], _CHANGE))
        same, anew = (
            np.exp(-0.5 * ((change - middle) / _CHANGE_SD) ** 2) for middle in (usual, np.log(_CHANGE_ANEW))
        )
        total += float(np.log(anew) - np.log((1.0 - _ODD_SEGMENT) * same + _ODD_SEGMENT * anew))
    return total


def _weigh_another(here: Array, there: Array) -> tuple[float, float]:
    """Logarithm of the odds that two sets of lengths (n,), m, are of two persons, and of their ratio."""
    slide, anew, share = _SLIDES

    def density(off: Array, sd: Array | float) -> Array:
        values: Array = np.exp(-0.5 * (off / sd) ** 2) / (sd * np.sqrt(2.0 * np.pi))
        return values

    off = here - there
    least = 1e-300  # of a density, whose logarithm is taken
    same = np.log((1.0 - share) * density(off, slide) + share * density(off, anew) + least).sum()
    scales = np.linspace(-3.0, 3.0, 121) * _OTHERS[0]
    spread = np.sqrt(slide**2 + (_OTHERS[1] * there) ** 2)
    likely = np.log(density(here - np.exp(scales)[:, None] * there, spread) + least).sum(axis=1)
    prior = -0.5 * (scales / _OTHERS[0]) ** 2
    prior -= np.logaddexp.reduce(prior)
    other = np.logaddexp.reduce(likely + prior)
    ratio = float(np.average(np.log(here / there), weights=there**2))
    return float(other - same + np.log(_OTHER_PERSON / (1.0 - _OTHER_PERSON))), ratio
