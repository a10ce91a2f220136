"""Before anything is computed: whether recordings show one person, whose markers are what their labels say.

Each question takes recordings and gives what it found as values. Those that contradict a sound person beyond
doubt are refused by whoever computes; the others are told.
"""

from __future__ import annotations

import re
from collections import abc
from itertools import combinations
from typing import TypeVar

import numpy as np

from scaling_service.core.arrays import Array
from scaling_service.core.text import list_few
from scaling_service.model.anatomy import markers as anatomy_markers
from scaling_service.model.body import BodyModel
from scaling_service.model.trial import Relabelling, Repair, Trial, is_unlabelled
from scaling_service.numerics.least_squares.problem import find_shown
from scaling_service.recording import exchanged, findings, sides, witnesses
from scaling_service.recording.plausibility import find_moved_markers
from scaling_service.recording.root import ask_root
from scaling_service.recording.same_person import ask_same_person
from scaling_service.recording.sizes import ask_sizes

ANOTHER_M = 0.3  # chosen: two labels of one landmark of one person are nearer, whoever palpated
_FEWEST_TWICE = 4  # labels that stand twice, far apart, before they make another person (chosen)
_MOST_ALIKE = 20  # labels of one name or landmark that are compared (chosen: so many persons in one volume)
_AFFIX = 8  # letters that a system or a person adds to tell two subjects apart (chosen)

_NOISE_FLOOR_M = 0.003  # chosen: no marker keeps its place on a segment better, over skin
_SAFE, _ODD = (
    np.log1p(-witnesses.WRONG),
    np.log(witnesses.WRONG),
)  # that a model's segment is as it says, and that it is not
_FEWEST_SOLID = 4  # markers of a segment that tell it from its mirror image

_STRAIGHT = 0.9  # chosen: hip to ankle over thigh and shank; 0.7 of somebody who sits
_LEANS_DEG = 12.5
"""From the vertical, of the line from the ankles to the shoulders (else the neck, the pelvis) of somebody who
stands: the whole range, forward and backward together, over which people sway without a step (12.5 deg in the
equilibrium score of computerised posturography, after Nashner). Of 9 persons who stand the largest is 4 deg,
of 13 by the pelvis 8 deg."""

_HANGS = np.cos(np.radians(135.0))  # chosen: beyond it a body hangs head down


def ask(given: findings.Recordings) -> tuple[findings.Finding, ...]:
    """All questions, those that refuse first."""
    of_sides = [one for trial in given.trials for one in ask_sides(trial, given.model)]
    # Which way is up follows from right and front, where these are sound.
    mirrored = {one.place for one in of_sides if one.severity == "refusal"}
    found = [
        *(one for trial in given.trials for one in ask_one_person(trial)),
        *of_sides,
        *(one for trial in given.trials for one in ask_root(trial, given.model, given.clusters)),
        *ask_sizes(given.trials, given.static, given.stated),
        *ask_same_person(given.trials),
        *ask_posture([trial for trial in given.trials if trial.name not in mirrored], given.static),
        *(one for trial in given.trials for one in ask_exchanged(trial)),
        *ask_segments(given.trials, given.clusters),
        *ask_moved(given.trials, given.clusters),
    ]
    return findings.sort_findings(found)


_Kind = TypeVar("_Kind", bound=Trial)


def mend(trial: _Kind, corrections: abc.Iterable[Relabelling], mirrored: str | None) -> _Kind:
    """The recording as its person says that it should be, each change among its repairs.

    ``trial``: in the laboratory's axes. ``mirrored``: ``x``, ``y`` or ``z``: the axis along which the
    positions of all markers are mirrored; force plates keep their places. Raises MarkerMissing: see
    :func:`relabel`.
    """
    if mirrored is not None:
        markers = trial.markers.copy()
        markers[..., "xyz".index(mirrored)] *= -1.0
        detail = f"positions mirrored along {mirrored}, as the subject file says"
        made = Repair("mirrored", trial.name, detail, frames=trial.n_frames)
        trial = trial.with_markers(markers, made)
    return exchanged.relabel(trial, corrections)


def ask_one_person(trial: Trial) -> abc.Iterator[findings.Finding]:
    """Whether two sets of the same labels stand in one recording, far apart."""
    step = max(1, trial.n_frames // witnesses.FRAMES)
    shown = find_shown(trial.markers[::step])
    keys = {
        label: anatomy_markers.make_plain_key(label)
        for label, seen in zip(trial.labels, shown, strict=True)
        if seen and not anatomy_markers.is_computed(label) and not is_unlabelled(label)
    }
    twice: dict[str, list[tuple[str, str]]] = {}
    for (one, other), alike in _find_alike(keys).items():
        distance = np.linalg.norm((trial.position(one) - trial.position(other))[::step], axis=1)
        known = distance[np.isfinite(distance)]
        if len(known) and np.median(known) > ANOTHER_M:
            twice.setdefault(alike, []).append((one, other))
    found = max(twice.values(), key=len, default=[])
    if len(found) >= _FEWEST_TWICE:
        names = list_few([f"{one} and {other}" for one, other in found])
        yield findings.Finding(
            code="two_persons",
            place=trial.name,
            severity="refusal",
            labels=tuple(label for pair in found for label in pair),
            problem=f"two persons stand in it: {len(found)} landmarks are labelled twice, more than "
            f"{ANOTHER_M:g} m apart ({names})",
            remedy="Export one person alone, or remove the other's labels",
        )


def _find_alike(keys: abc.Mapping[str, str]) -> dict[tuple[str, str], str]:
    """Pairs of labels that stand for one place, in the order of the recording, and what tells them apart.

    ``keys``: label to its plain name. Each name is looked up among those that are some letters shorter.
    """
    order = {label: k for k, label in enumerate(keys)}
    named: dict[str, list[str]] = {}
    placed: dict[str, list[str]] = {}
    for label, key in keys.items():
        named.setdefault(key, []).append(label)
        role = anatomy_markers.find_canonical(label)
        if role is not None:
            placed.setdefault(role, []).append(label)
    found: dict[tuple[str, str], str] = {}

    def keep(one: str, other: str, alike: str) -> None:
        found.setdefault((one, other) if order[one] < order[other] else (other, one), alike)

    for label, key in keys.items():
        shorter = {part for n in range(1, _AFFIX + 1) for part in (key[:-n], key[n:]) if len(part) > 1}
        for short in shorter & named.keys():
            affix = _find_affix(short, key)
            for other in named[short][:_MOST_ALIKE] if affix is not None else ():
                keep(label, other, affix or "")
    for labels in placed.values():
        for one, other in combinations(labels[:_MOST_ALIKE], 2):
            keep(one, other, "")
    return dict(sorted(found.items(), key=lambda pair: (order[pair[0][0]], order[pair[0][1]])))


def _find_affix(one: str, other: str) -> str | None:
    """What one name has more than the other, before or after it; None where the rest is not the same."""
    short, long = sorted((one, other), key=len)
    more = len(long) - len(short)
    if not 0 < more <= _AFFIX or len(short) < 2:
        return None
    if long.startswith(short) and re.search(r"\d$|^[A-Z]+$", long[-more:]):
        return f"{long[-more:]}>"
    return f"<{long[:more]}" if long.endswith(short) else None


def ask_sides(trial: Trial, model: BodyModel | None = None) -> abc.Iterator[findings.Finding]:
    """Whether right is right: mirrored recordings, exchanged sides, fronts that are backs."""
    roles = findings.list_roles(trial)
    found = sides.judge_handedness(trial, roles)
    if found is None:
        yield from ask_shapes(trial, model) if model is not None else ()
        return
    sure = found.log_odds > np.log(findings.BEYOND_DOUBT)
    if found.log_odds <= np.log(findings.TOLD):
        return
    if found.pairs:
        labels = tuple(label for pair in found.pairs for label in pair)
        exchange = exchanged.Exchange(
            labels=labels,
            true=tuple(label for pair in found.pairs for label in reversed(pair)),
            start_s=float(trial.times[0]),
            end_s=float(trial.times[-1]),
        )
        names = list_few([right for right, _ in found.pairs])
        seen = list_few(list(found.witnesses))
        if found.whole:
            problem = (
                f"it shows the mirror image of a person: {names} lie on the left of where {seen} face. "
                "Either an axis was mirrored, or the labels of both sides are exchanged; positions do not "
                "tell which"
            )
            remedy = (
                "Mend the export; or say in the subject file which it is: the axis under `mirrored:`, or the "
                "labels under `corrections:`"
            )
        else:
            of = f" of {found.part}" if found.part else ""
            pairs = list_few([f"{right} and {left}" for right, left in found.pairs])
            problem = f"the labels{of} {pairs} look exchanged between right and left"
            remedy = "Correct the labels under `corrections:`, or in the recording"
        yield findings.Finding(
            code="mirrored" if found.whole else "sides_exchanged",
            place=trial.name,
            severity="refusal" if sure else "warning",
            labels=labels,
            exchanges=(exchange,),
            problem=problem,
            remedy=remedy,
        )
    alone = len(found.turned) == len([name for name in found.witnesses if name != "the walk"])
    for witness in found.turned:
        what = "bends backwards" if witness.name.endswith("knee") else "faces backwards"
        yield findings.Finding(
            code="backwards",
            place=trial.name,
            severity="refusal" if sure else "warning",
            labels=witness.labels,
            problem=f"{witness.name} {what}, as {list_few(list(witness.labels))} lie"
            + (": labels are exchanged, or the recording is mirrored" if alone else ", against all else"),
            remedy="Correct the labels in the recording"
            + ("; or name the axis along which it is mirrored under `mirrored:`" if alone else ""),
        )


def ask_shapes(trial: Trial, model: BodyModel) -> abc.Iterator[findings.Finding]:
    """Whether segments are mirror images of the model's; asked where no names tell sides and fronts."""
    turned, seen = 0.0, []
    for segment in model.segments:
        own = [
            m
            for m in model.markers
            if m.segment == segment.name and m.name in trial.labels and m.weight > 0.0
        ]
        if len(own) < _FEWEST_SOLID:
            continue
        step = max(1, trial.n_frames // witnesses.FRAMES)
        cloud = trial.select([m.name for m in own]).markers[::step]
        cloud = cloud[np.isfinite(cloud).all(axis=(1, 2))]
        if not len(cloud):
            continue
        # Logarithm of how much better a cloud (n, m, 3) fits the mirror image of places (m, 3), at any size.
        # The marginal likelihood of Gaussian noise of unknown size is a power of the squares that are left.
        places = np.array([m.nominal for m in own])
        away, local = cloud - cloud.mean(axis=1, keepdims=True), places - places.mean(axis=0)
        cross = np.einsum("nmi,mj->nij", away, local)
        singular = np.linalg.svd(cross, compute_uv=False)
        sign = np.sign(np.linalg.det(cross))
        whole, size = np.square(away).sum(axis=(1, 2)), np.square(local).sum()
        floor = len(places) * _NOISE_FLOOR_M**2
        plain, mirrored = (
            whole - np.square(singular[:, 0] + singular[:, 1] + side * sign * singular[:, 2]) / size + floor
            for side in (1.0, -1.0)
        )
        gain = float(np.median(0.5 * (3 * len(places) - 7) * np.log(plain / mirrored)))
        turned += float(np.logaddexp(gain + _SAFE, _ODD) - np.logaddexp(_SAFE, gain + _ODD))
        seen.append(segment.name)
    log_odds = turned + np.log(sides.MIRRORED)
    if log_odds > np.log(findings.TOLD):
        yield findings.Finding(
            code="mirrored",
            place=trial.name,
            severity="refusal" if log_odds > np.log(findings.BEYOND_DOUBT) else "warning",
            problem=f"the markers of {list_few(seen)} are the mirror image of the model's: an axis was "
            "mirrored, or labels are exchanged",
            remedy="Mend the export; or say in the subject file along which axis it is mirrored, under "
            "`mirrored:`",
        )


def ask_posture(trials: abc.Sequence[Trial], static: str | None) -> abc.Iterator[findings.Finding]:
    """Whether somebody hangs head down throughout, or does not stand in the static trial; Y up."""
    for trial in trials:
        places = {role: trial.position(label) for label, role in findings.list_roles(trial).items()}
        feet = [places[name] for name in ("RLM", "LLM", "RHEE", "LHEE") if name in places]
        pelvis = _find_steepness(places, feet, ("RASIS", "LASIS", "SACR", "RPSIS", "LPSIS"))
        if pelvis is not None and pelvis.max() < _HANGS:
            yield findings.Finding(
                code="upside_down",
                place=trial.name,
                severity="refusal" if trial.name == static else "warning",
                problem="the feet are above the pelvis in every frame",
                remedy="Correct which axis points up, or leave it out, so that it is found from the markers",
            )
        elif trial.name == static:
            yield from _ask_standing(trial, places)


def _ask_standing(trial: Trial, places: abc.Mapping[str, Array]) -> abc.Iterator[findings.Finding]:
    if not has_straight_legs(trial):
        yield findings.Finding(
            code="bent",
            place=trial.name,
            problem="nobody stands upright in it, for a leg is bent as in sitting",
            remedy="Name a recording of standing, or record one: sizes are taken here, and skin slides over "
            "joints that are bent",
        )
        return
    ankles = [places[name] for name in ("RLM", "LLM") if name in places]
    for upper in (("RSHO", "LSHO"), ("C7", "CLAV"), ("RASIS", "LASIS")):
        if len(ankles) == len(upper) and {*upper} <= places.keys():
            steep = _find_steepness(places, ankles, upper)
            if steep is None:
                continue
            lean = float(np.degrees(np.arccos(np.clip(np.median(steep), -1.0, 1.0))))
            if lean > _LEANS_DEG:
                yield findings.Finding(
                    code="leaning",
                    place=trial.name,
                    problem=f"who stands leans by {lean:.0f} deg against the laboratory's vertical, more "
                    "than people can without a step: the laboratory's axes are tilted, or nobody stands",
                    remedy="Calibrate the laboratory's vertical, or turn the recordings; until then tilts of "
                    "pelvis and trunk, and all that rests on gravity, are off by as much",
                )
            return


def _find_steepness(
    places: abc.Mapping[str, Array], low: abc.Sequence[Array], upper: abc.Iterable[str]
) -> Array | None:
    """Cosines to the vertical of the line from low to upper places, in frames that show it; None without."""
    high = [places[name] for name in upper if name in places]
    if not high or not low:
        return None
    up = np.mean(high, axis=0) - np.mean(low, axis=0)
    known = up[np.isfinite(up).all(axis=1)]
    return known[:, 1] / np.linalg.norm(known, axis=1) if len(known) else None


def has_straight_legs(trial: Trial) -> bool:
    """Whether no leg is bent as in sitting, from the ASIS over the outer knee to the outer ankle."""
    legs = {side: [f"{side}{name}" for name in ("ASIS", "LFE", "LM")] for side in "RL"}
    shape = exchanged.measure_shape([findings.name_landmarks(trial)], legs)
    for hip, knee, ankle in legs.values():
        leg, thigh, shank = (shape.get(pair) for pair in ((hip, ankle), (hip, knee), (knee, ankle)))
        if leg and thigh and shank and leg < _STRAIGHT * (thigh + shank):
            return False
    return True


def ask_exchanged(trial: Trial) -> abc.Iterator[findings.Finding]:
    """Labels of an outer and an inner landmark that look exchanged; throughout, nothing can be computed."""
    roles = findings.list_roles(trial)
    for exchange, throughout in exchanged.find_exchanged_labels(trial, roles):
        sure = throughout and tuple(roles[label][1:] for label in exchange.labels) in exchanged.LEG_PAIRS
        end = ", the end" if exchange.end_s == trial.times[-1] else ""
        span = "throughout" if throughout else f"from {exchange.start_s:.2f} s to {exchange.end_s:.2f} s{end}"
        yield findings.Finding(
            code="exchanged",
            place=trial.name,
            severity="refusal" if sure else "warning",
            labels=exchange.labels,
            exchanges=(exchange,),
            problem=f"the labels {' and '.join(exchange.labels)} look exchanged {span}",
            remedy="Correct the labels in the recording",
        )


def ask_segments(trials: abc.Sequence[Trial], clusters: exchanged.Clusters) -> abc.Iterator[findings.Finding]:
    """Labels of one segment that stand for each other for a while.

    Of two recordings that contradict each other all along, it is told once for both.
    """
    wrong: dict[str, list[exchanged.Exchange]] = {}
    for trial in trials:
        usual = exchanged.measure_shape((other for other in trials if other is not trial), clusters)
        wrong[trial.name] = list(
            exchanged.find_exchanges(trial, clusters, usual or exchanged.measure_shape([trial], clusters))
        )
    told: set[tuple[str, ...]] = set()
    for name, found in wrong.items():
        for item in found:
            rivals = [
                n for n, others in wrong.items() if n != name and item.labels in [o.labels for o in others]
            ]
            if rivals and item.labels in told:
                continue
            told.add(item.labels)
            where = f", or in {list_few(rivals)}" if rivals else ""
            yield findings.Finding(
                code="exchanged",
                place=name,
                labels=item.labels,
                exchanges=tuple(o for o in found if o.labels == item.labels),
                rivals={rival: tuple(o for o in wrong[rival] if o.labels == item.labels) for rival in rivals},
                problem=f"the labels {' and '.join(item.labels)} look exchanged from {item.start_s:.2f} to "
                f"{item.end_s:.2f} s{where}: distances on their segment differ by "
                f"{1e3 * item.difference_m:.0f} mm from those in the other recordings, by "
                f"{1e3 * item.left_m:.0f} mm with the labels put right",
                remedy="Correct the labels under `corrections:`, or in the recording; until then do not fit "
                "it: good markers would be blamed",
            )


def ask_moved(trials: abc.Sequence[Trial], clusters: exchanged.Clusters) -> abc.Iterator[findings.Finding]:
    """Markers that sit elsewhere than in the other recordings."""
    for one in find_moved_markers(trials, clusters):
        yield findings.Finding(
            code="moved",
            place=one.trial,
            labels=(one.label,),
            problem=str(one),
            remedy="Look at the recordings; leave the marker out, or use recordings of one placement",
        )
