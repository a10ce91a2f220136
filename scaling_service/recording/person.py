"""Before anything is computed: do these recordings show a person, the same one, with the labels that are said?

Each question takes recordings and says what it found as values. Those that contradict a sound person beyond
doubt are refused by whoever computes; the others are told.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations, pairwise
from typing import Literal, TypeVar

import numpy as np

from scaling_service.core.errors import TrialUnusable
from scaling_service.core.text import list_few
from scaling_service.model.anatomy.anthropometry import DimensionPrior, predict_dimensions
from scaling_service.model.anatomy.markers import find_canonical, is_computed, make_plain_key
from scaling_service.model.body import GROUND, BodyModel, Segment
from scaling_service.model.compile import compile_model, free_coordinates, list_parameter_values
from scaling_service.model.inertia import Sex
from scaling_service.model.trial import Array, Relabelling, Repair, Trial, is_unlabelled
from scaling_service.numerics.least_squares.problem import find_shown
from scaling_service.numerics.multibody.tree import (
    compute_jacobian,
    order_by_frame,
    place_tree_markers,
    pose_links,
)
from scaling_service.recording.exchanged import (
    Clusters,
    Exchange,
    find_exchanged_labels,
    find_exchanges,
    measure_shape,
    relabel,
)
from scaling_service.recording.plausibility import find_moved_markers
from scaling_service.recording.sides import (
    FRAMES,
    MIRRORED,
    WRONG,
    judge_handedness,
    measure_within_segments,
)

BEYOND_DOUBT = 1e3
"""Odds against a sound recording, priors included, from which on nothing is computed."""

TOLD = 0.1  # odds from which on it is told (chosen: a look at the recording costs little)

Severity = Literal["refusal", "warning"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Finding:
    """One thing about a recording that a sound one does not show."""

    code: str
    trial: str  # the recording's name
    problem: str
    remedy: str
    severity: Severity = "warning"
    labels: tuple[str, ...] = ()  # that it concerns
    exchanges: tuple[Exchange, ...] = ()  # labels that, put right, solve it
    rivals: Mapping[str, tuple[Exchange, ...]] = field(default_factory=dict)
    """Other recordings in which the same, put right instead, would solve it."""

    def __str__(self) -> str:
        return f"{self.trial}: {self.problem}: {self.remedy[0].lower()}{self.remedy[1:]}"


class NotAPerson(TrialUnusable):
    """What a recording shows cannot be a person as its labels say."""

    def __init__(self, findings: Sequence[Finding]) -> None:
        first = next(one for one in findings if one.severity == "refusal")
        super().__init__(
            first.problem, file=first.trial, field=", ".join(first.labels[:4]) or None, remedy=first.remedy
        )
        self.findings = tuple(findings)


@dataclass(frozen=True, slots=True, kw_only=True)
class Stated:
    """What is said of the person."""

    sex: Sex | None = None
    height_m: float | None = None
    mass_kg: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Recordings:
    """The recordings of one session, in m, before gaps are filled and positions smoothed.

    ``clusters``: segment to the labels on it. ``static``: the name of the one in which somebody stands.
    """

    trials: Sequence[Trial]
    clusters: Clusters = field(default_factory=dict)
    static: str | None = None
    stated: Stated = Stated()
    model: BodyModel | None = None


def ask(given: Recordings) -> tuple[Finding, ...]:
    """All questions, those that refuse first."""
    found = [
        *(one for trial in given.trials for one in ask_one_person(trial)),
        *(one for trial in given.trials for one in ask_sides(trial, given.model)),
        *(one for trial in given.trials for one in ask_root(trial, given.model, given.clusters)),
        *ask_sizes(given.trials, given.static, given.stated),
        *ask_same_person(given.trials),
        *ask_posture(given.trials, given.static),
        *(one for trial in given.trials for one in ask_exchanged(trial)),
        *ask_segments(given.trials, given.clusters),
        *ask_moved(given.trials, given.clusters),
    ]
    return sort_findings(found)


def sort_findings(found: Iterable[Finding]) -> tuple[Finding, ...]:
    """Those that refuse first, and labels once for each recording where several questions found them exchanged."""
    kept: list[Finding] = []
    for one in found:
        same = (other for other in kept if other.trial == one.trial and {*one.labels} <= {*other.labels})
        if not one.exchanges or not any(other.exchanges for other in same):
            kept.append(one)
    return tuple(sorted(kept, key=lambda one: one.severity != "refusal"))


def refuse(findings: Sequence[Finding]) -> None:
    """Raises NotAPerson if one of the findings is beyond doubt."""
    if any(one.severity == "refusal" for one in findings):
        raise NotAPerson(findings)


def list_roles(trial: Trial) -> dict[str, str]:
    """Label to landmark, of those that are known and that no other label means, too."""
    roles = {label: role for label in trial.labels if (role := find_canonical(label)) is not None}
    every = list(roles.values())
    return {label: role for label, role in roles.items() if every.count(role) == 1}


_Kind = TypeVar("_Kind", bound=Trial)


def mend(trial: _Kind, corrections: Iterable[Relabelling], mirrored: str | None) -> _Kind:
    """The recording as its person says that it should be, each change among its repairs.

    ``trial``: in the laboratory's axes. ``mirrored``: ``x``, ``y`` or ``z``: the axis along which the positions
    of all markers are mirrored; force plates keep their places. Raises MarkerMissing: see :func:`relabel`.
    """
    if mirrored is not None:
        markers = trial.markers.copy()
        markers[..., "xyz".index(mirrored)] *= -1.0
        detail = f"positions mirrored along {mirrored}, as the subject file says"
        made = Repair(what="mirrored", where=trial.name, detail=detail, frames=trial.n_frames)
        trial = replace(trial, markers=markers, repairs=(*trial.repairs, made))
    return relabel(trial, corrections)


# One person --------------------------------------------------------------------------------------------------

ANOTHER_M = 0.3  # chosen: two labels of one landmark of one person are nearer, whoever palpated
_FEWEST_TWICE = 4  # labels that stand twice, far apart, before they make another person (chosen)
_AFFIX = 8  # letters that a system or a person adds to tell two subjects apart (chosen)


def ask_one_person(trial: Trial) -> Iterator[Finding]:
    """Whether two sets of the same labels stand in one recording, far apart."""
    step = max(1, trial.n_frames // FRAMES)
    shown = find_shown(trial.markers[::step])
    keys = {
        label: make_plain_key(label)
        for label, seen in zip(trial.labels, shown, strict=True)
        if seen and not is_computed(label) and not is_unlabelled(label)
    }
    roles = {label: find_canonical(label) for label in keys}
    twice: dict[str, list[tuple[str, str]]] = {}
    for one, other in combinations(keys, 2):
        alike = _find_affix(keys[one], keys[other])
        if alike is None and roles[one] is not None and roles[other] == roles[one]:
            alike = ""
        if alike is None:
            continue
        distance = np.linalg.norm((trial.position(one) - trial.position(other))[::step], axis=1)
        known = distance[np.isfinite(distance)]
        if len(known) and np.median(known) > ANOTHER_M:
            twice.setdefault(alike, []).append((one, other))
    found = max(twice.values(), key=len, default=[])
    if len(found) >= _FEWEST_TWICE:
        names = list_few([f"{one} and {other}" for one, other in found])
        yield Finding(
            code="two_persons",
            trial=trial.name,
            severity="refusal",
            labels=tuple(label for pair in found for label in pair),
            problem=f"two persons stand in it: {len(found)} landmarks are labelled twice, more than "
            f"{ANOTHER_M:g} m apart ({names})",
            remedy="Export one person alone, or remove the other's labels",
        )


def _find_affix(one: str, other: str) -> str | None:
    """What one name has more than the other, before or after it; None where they are not the same otherwise."""
    short, long = sorted((one, other), key=len)
    more = len(long) - len(short)
    if not 0 < more <= _AFFIX or len(short) < 2:
        return None
    if long.startswith(short) and re.search(r"\d$|^[A-Z]+$", long[-more:]):
        return f"{long[-more:]}>"
    return f"<{long[:more]}" if long.endswith(short) else None


# Sides -------------------------------------------------------------------------------------------------------


def ask_sides(trial: Trial, model: BodyModel | None = None) -> Iterator[Finding]:
    """Whether right is right: mirrored recordings, exchanged sides, fronts that are backs."""
    roles = list_roles(trial)
    found = judge_handedness(trial, roles)
    if found is None:
        yield from ask_shapes(trial, model) if model is not None else ()
        return
    sure = found.log_odds > np.log(BEYOND_DOUBT)
    span = {"start_s": float(trial.times[0]), "end_s": float(trial.times[-1])}
    if found.log_odds > np.log(TOLD) and found.pairs:
        labels = tuple(label for pair in found.pairs for label in pair)
        wrong = [label for pair in found.pairs for label in pair]
        right = [label for pair in found.pairs for label in reversed(pair)]
        exchange = Exchange(labels=tuple(wrong), true=tuple(right), **span)
        names = list_few([right for right, _ in found.pairs])
        seen = list_few(list(found.witnesses))
        if found.whole:
            problem = (
                f"it shows the mirror image of a person: {names} lie on the left of where {seen} face. Either "
                "an axis was mirrored, or the labels of both sides are exchanged; positions do not tell which"
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
        yield Finding(
            code="mirrored" if found.whole else "sides_exchanged",
            trial=trial.name,
            severity="refusal" if sure else "warning",
            labels=labels,
            exchanges=(exchange,),
            problem=problem,
            remedy=remedy,
        )
    if found.log_odds <= np.log(TOLD):
        return
    alone = len(found.turned) == len([name for name in found.witnesses if name != "the walk"])
    for witness in found.turned:
        what = "bends backwards" if witness.name.endswith("knee") else "faces backwards"
        yield Finding(
            code="backwards",
            trial=trial.name,
            severity="refusal" if sure else "warning",
            labels=witness.labels,
            problem=f"{witness.name} {what}, as {list_few(list(witness.labels))} lie"
            + (": labels are exchanged, or the recording is mirrored" if alone else ", against all else"),
            remedy="Correct the labels in the recording"
            + ("; or name the axis along which it is mirrored under `mirrored:`" if alone else ""),
        )


_NOISE_FLOOR_M = 0.003  # chosen: no marker keeps its place on a segment better, over skin
_SAFE, _ODD = np.log1p(-WRONG), np.log(WRONG)  # that a model's segment is as it says, and that it is not
_FEWEST_SOLID = 4  # markers of a segment that tell it from its mirror image


def ask_shapes(trial: Trial, model: BodyModel) -> Iterator[Finding]:
    """Whether the markers of segments are mirror images of the model's, where no names tell sides and fronts."""
    turned, seen = 0.0, []
    for segment in model.segments:
        own = [
            m
            for m in model.markers
            if m.segment == segment.name and m.name in trial.labels and m.weight > 0.0
        ]
        if len(own) < _FEWEST_SOLID:
            continue
        step = max(1, trial.n_frames // FRAMES)
        cloud = trial.select([m.name for m in own]).markers[::step]
        cloud = cloud[np.isfinite(cloud).all(axis=(1, 2))]
        if not len(cloud):
            continue
        gain = _compare_with_mirror(cloud, np.array([m.nominal for m in own]))
        turned += float(np.logaddexp(gain + _SAFE, _ODD) - np.logaddexp(_SAFE, gain + _ODD))
        seen.append(segment.name)
    log_odds = turned + np.log(MIRRORED)
    if log_odds > np.log(TOLD):
        yield Finding(
            code="mirrored",
            trial=trial.name,
            severity="refusal" if log_odds > np.log(BEYOND_DOUBT) else "warning",
            problem=f"the markers of {list_few(seen)} are the mirror image of the model's: an axis was mirrored, or labels "
            "are exchanged",
            remedy="Mend the export; or say in the subject file along which axis it is mirrored, under `mirrored:`",
        )


def _compare_with_mirror(cloud: Array, places: Array) -> float:
    """Logarithm of how much better a cloud (n, m, 3) fits the mirror image of places (m, 3), at any size.

    The marginal likelihood of Gaussian noise of unknown size is a power of the squares that are left.
    """
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
    return float(np.median(0.5 * (3 * len(places) - 7) * np.log(plain / mirrored)))


# What carries the others --------------------------------------------------------------------------------------

_NOISE_M = 0.01  # chosen: skin over bone
_LARGEST_SD = np.radians(30.0)
"""Chosen: the root's turn that markers with this noise leave less certain is not shown by them."""


def ask_root(trial: Trial, model: BodyModel | None, clusters: Clusters) -> Iterator[Finding]:
    """Whether the segment that carries all others is shown, by its own markers or by what hangs on it.

    A root at the end of what is shown (an arm or a leg alone) is only not told; one between two branches would
    be invented from them.
    """
    if model is None:
        return
    shown = set(trial.shown_labels)
    carried = {m.name: m.segment for m in model.markers if m.name in shown and m.weight > 0.0}
    for root in model.children(GROUND):
        free = {t.coordinate for j in root.joints for t in j.law.terms if t.coordinate is not None}
        branches = [
            child for child in model.children(root.name) if _list_below(model, child) & {*carried.values()}
        ]
        if len(free) < 6 or len(branches) < 2 or not carried or _is_shown(trial, clusters.get(root.name, ())):
            continue
        if _measure_root_sd(model, root, tuple(carried)) > _LARGEST_SD:
            own = [
                m.name
                for m in model.markers
                if m.segment == root.name and m.name not in shown and m.weight > 0.0
            ]
            seen = [name for name, segment in carried.items() if segment == root.name]
            shows = f"only {list_few(seen)} show it" if seen else "no marker shows it"
            yield Finding(
                code="no_root",
                trial=trial.name,
                severity="refusal",
                labels=tuple(own),
                problem=f"the {root.name} is not shown, which carries {list_few([b.name for b in branches])}: {shows}",
                remedy=f"Record or label {list_few(own)}; if they have other names, map them under `markers:`; "
                "if other markers sit on it, name them under `extra_markers:`",
            )


_ACROSS_M = 0.01  # chosen: three markers that lie nearer to one line show no turn about it


def _is_shown(trial: Trial, labels: Sequence[str]) -> bool:
    """Whether some frame shows three markers of a segment off one line."""
    step = max(1, trial.n_frames // FRAMES)
    some = trial.select(list(labels)).markers[::step]
    for frame in some[np.isfinite(some).all(axis=2).sum(axis=1) >= 3][:1]:
        known = frame[np.isfinite(frame).all(axis=1)]
        return bool(np.linalg.svd(known - known.mean(axis=0), compute_uv=False)[1] > _ACROSS_M)
    return False


def _list_below(model: BodyModel, segment: Segment) -> set[str]:
    below = {segment.name}
    for child in model.children(segment.name):
        below |= _list_below(model, child)
    return below


def _measure_root_sd(model: BodyModel, root: Segment, markers: tuple[str, ...]) -> float:
    """The largest standard deviation of the root's turns, rad, near the neutral pose."""
    tree = compile_model(model, markers)
    free = free_coordinates(model)
    names = [c.name for c in model.coordinates]
    kinds = [c.kind for c in model.coordinates]
    own = {t.coordinate for j in root.joints for t in j.law.terms if t.coordinate is not None}
    turns = [k for k, name in enumerate(names) if name in own and kinds[k] == "rotation" and free[k]]
    q = np.array([c.default for c in model.coordinates])
    # A little bent: at the neutral pose axes may coincide that no person keeps aligned.
    q = q + np.where(
        free & np.array([kind == "rotation" for kind in kinds]), 0.15 + 0.01 * np.arange(len(q)) % 0.1, 0.0
    )
    poses = pose_links(tree, np.ascontiguousarray(q[:, None]), list_parameter_values(model))
    variables = np.flatnonzero(free)
    rates = order_by_frame(compute_jacobian(tree, poses, place_tree_markers(tree, poses), variables))[0]
    values, vectors = np.linalg.eigh(rates @ rates.T)
    variance = (np.square(vectors) / np.maximum(values, 1e-9)).sum(axis=1) * _NOISE_M**2
    return float(np.sqrt(max((variance[np.flatnonzero(variables == k)[0]] for k in turns), default=0.0)))


# Sizes -------------------------------------------------------------------------------------------------------

DEVIATIONS = 5.0
"""Beyond which a size is not a person's: of ANSUR II's soldiers and children by stature, see ``predict_dimensions``,
the doubt about where a marker sits included."""

DOUBTFUL = (
    2.5  # deviations of the common scale from which on it is asked (chosen: one sound session in eighty)
)


MISSTATED = 0.04
"""Relative standard deviation of a stated height that is wrong (chosen: 70 mm; last year's child, shoes, a slip of the
pen): what only contradicts the height is asked about and not refused."""


@dataclass(frozen=True, slots=True)
class _Size:
    """A distance between landmarks in terms of measures of the body, and how it differs by where markers sit."""

    ends: tuple[str, str]
    terms: Mapping[str, float]
    offset_m: float
    sd_m: float
    at_most: bool = False  # a bound that posture falls short of


_SIZES = (
    _Size(("LFE", "LM"), {"lateral_epicondyle_height": 1.0, "lateral_malleolus_height": -1.0}, 0.0, 0.02),
    _Size(("ELB", "WRA"), {"radiale_stylion": 1.0}, 0.0, 0.02),
    _Size(("ELB", "WRB"), {"radiale_stylion": 1.0}, 0.0, 0.02),
    _Size(("SHO", "ELB"), {"acromion_radiale": 1.0}, 0.0, 0.04),
    _Size(("LM", "MM"), {"bimalleolar_breadth": 1.0}, 0.016, 0.012),
    _Size(("LFE", "MFE"), {"knee_width": 1.0}, 0.016, 0.02),
    _Size(("HEE", "MT5"), {"foot_length": 0.70}, 0.0, 0.02),
    _Size(("ASIS", "PSIS"), {"stature": 0.115}, 0.0, 0.03),
    _Size(
        ("ASIS", "LFE"),
        {"trochanterion_height": 1.0, "lateral_epicondyle_height": -1.0},
        0.09,
        0.05,
        at_most=True,
    ),
    _Size(("HEE", "LM"), {"foot_length": 0.30}, 0.02, 0.02, at_most=True),
    _Size(("ASIS", "SHO"), {"acromion_height": 1.0, "iliocristale_height": -1.0}, 0.12, 0.06, at_most=True),
)
"""Offsets and deviations: chosen: balls stand 8 mm off the skin, palpation 5 to 15 mm (Della Croce 2005), skin
over moving joints up to 30 mm; the foot's markers lie over 0.66 to 0.79 of its length."""

_ACROSS = (
    _Size(("RASIS", "LASIS"), {"pelvis_width": 1.0}, 0.0, 0.025),
    _Size(("RPSIS", "LPSIS"), {"pelvis_width": 0.4}, 0.0, 0.015),
    _Size(("RSHO", "LSHO"), {"biacromial_breadth": 1.0}, 0.0, 0.05, at_most=True),
)


_STANDING = (
    _Size(("C7", "LM"), {"cervicale_height": 1.0, "lateral_malleolus_height": -1.0}, 0.0, 0.025),
    _Size(("SHO", "LM"), {"acromion_height": 1.0, "lateral_malleolus_height": -1.0}, 0.01, 0.03),
    _Size(("CLAV", "LM"), {"suprasternale_height": 1.0, "lateral_malleolus_height": -1.0}, 0.0, 0.025),
    _Size(("ASIS", "LM"), {"leg_length": 1.0}, 0.0, 0.025),
)
"""Heights over the ankles of somebody who stands upright, whose stature foretells them (deviations chosen: 15 mm of
slack in trunk and knees, and palpation)."""

_UPRIGHT = np.cos(np.radians(15.0))  # chosen: thighs, shanks and trunk of somebody who stands lean less


def ask_sizes(trials: Sequence[Trial], static: str | None, stated: Stated) -> Iterator[Finding]:
    """Whether distances between landmarks can be a person's, each and all together; trials with Y up."""
    people = predict_dimensions(sex=stated.sex, height_m=stated.height_m, mass_kg=stated.mass_kg)
    for trial in trials:
        yield from _ask_sizes_of(trial, people, stated, standing=trial.name == static)


@dataclass(frozen=True, slots=True, eq=False)
class _Measured:
    """A size of a recording beside a person's."""

    labels: tuple[str, ...]
    size_m: float
    usual_m: float
    slopes: Array  # (n_dimensions,): of its logarithm on those of the measures
    sd_m: float
    at_most: bool


def _measure_sizes(trial: Trial, people: DimensionPrior, *, standing: bool) -> Iterator[_Measured]:
    step = max(1, trial.n_frames // FRAMES)
    where = {role: (label, trial.position(label)[::step]) for label, role in list_roles(trial).items()}
    sides = [_on_side(size, side) for size in _SIZES for side in "RL"]
    for size in (*sides, *_ACROSS):
        if all(end in where for end in size.ends):
            (a, one), (b, other) = (where[end] for end in size.ends)
            found = _compare(size, (a, b), np.linalg.norm(one - other, axis=1), people)
            if found is not None:
                yield found
    if standing and _is_upright({role: at for role, (_, at) in where.items()}):
        for size in _STANDING:
            high, low = ([end] if end in where else [f"R{end}", f"L{end}"] for end in size.ends)
            if all(end in where for end in (*high, *low)):
                heights = [np.mean([where[end][1][:, 1] for end in ends], axis=0) for ends in (high, low)]
                found = _compare(size, tuple(where[end][0] for end in high), heights[0] - heights[1], people)
                if found is not None:
                    yield found


def _is_upright(where: Mapping[str, Array]) -> bool:
    """Whether legs and trunk are upright, as far as they are known; Y up."""
    middles = [
        np.mean([where[f"{side}{name}"] for side in "RL"], axis=0)
        for name in ("LM", "LFE", "ASIS", "SHO")
        if all(f"{side}{name}" in where for side in "RL")
    ]
    rises = [np.nanmean(high - low, axis=0) for low, high in pairwise(middles)]
    return len(rises) > 1 and all(rise[1] > _UPRIGHT * np.linalg.norm(rise) for rise in rises)


def _compare(size: _Size, labels: tuple[str, ...], values: Array, people: DimensionPrior) -> _Measured | None:
    known = values[np.isfinite(values)]
    if not len(known) or np.median(known) <= 0.0:
        return None
    terms = {name if name in people.names else f"{name}_r": share for name, share in size.terms.items()}
    usual = size.offset_m + sum(share * people.value(name) for name, share in terms.items())
    slopes = np.zeros(len(people.names))
    for name, share in terms.items():
        slopes[people.names.index(name)] += share * people.value(name) / usual
    return _Measured(labels, float(np.median(known)), usual, slopes, size.sd_m, size.at_most)


def _ask_sizes_of(
    trial: Trial, people: DimensionPrior, stated: Stated, *, standing: bool
) -> Iterator[Finding]:
    found = list(_measure_sizes(trial, people, standing=standing))
    exact = [k for k, one in enumerate(found) if not one.at_most]
    if not exact:
        return
    slopes = np.array([one.slopes for one in found])
    shared = slopes @ people.covariance @ slopes.T
    size, usual = np.array([(one.size_m, one.usual_m) for one in found]).T
    off = np.log(size / usual)
    own = np.array([one.sd_m for one in found]) / np.maximum(size, usual)  # where markers sit differs by mm
    misstated = 0.0 if stated.height_m is None else MISSTATED
    single = np.where(off < 0.0, size / usual - 1.0, off)  # a small one is off by mm, not by a factor
    deviations = single / np.sqrt(np.diag(shared) + own**2 + misstated**2)
    rest = np.array([one.sd_m for one in found])[exact] / usual[exact]
    weights = np.linalg.solve(shared[np.ix_(exact, exact)] + np.diag(rest**2), np.ones(len(exact)))
    scale, sd = float(weights @ off[exact] / weights.sum()), float(1.0 / np.sqrt(weights.sum()))
    prior = _describe_prior(stated)
    doubt = float(np.hypot(sd, misstated))
    wrong = [
        k for k, z in enumerate(deviations) if abs(z) > DEVIATIONS and not (found[k].at_most and z < 0.0)
    ]
    # A few that are wrong are labels; all of them are the scale.
    if wrong and 2 * len(set(wrong) & set(exact)) < len(exact):
        worst = max(wrong, key=lambda k: abs(deviations[k]))
        names = " and ".join(found[worst].labels)
        bound = "at most " if found[worst].at_most else ""
        yield Finding(
            code="length",
            trial=trial.name,
            severity="refusal",
            labels=found[worst].labels,
            problem=f"{names} are {1e3 * size[worst]:.0f} mm apart, and those of a person {prior} {bound}"
            f"{1e3 * usual[worst]:.0f} mm: {abs(deviations[worst]):.0f} standard deviations off",
            remedy="Correct the labels, one of them is of another place or person; or the person's height",
        )
    elif wrong or abs(scale) > DEVIATIONS * doubt:
        yield Finding(
            code="scale",
            trial=trial.name,
            severity="refusal",
            problem=f"on the whole its lengths are {np.exp(scale):.3g} times those of a person {prior}, "
            f"{abs(scale) / doubt:.1f} standard deviations off",
            remedy="Correct the recording's unit, the calibration of its volume, its labels or the person's "
            "height",
        )
    elif stated.height_m is not None and abs(scale) > DOUBTFUL * sd:
        change = f"{abs(np.expm1(scale)):.0%} {'larger' if scale > 0 else 'smaller'}"
        yield Finding(
            code="scale",
            trial=trial.name,
            problem=f"on the whole its lengths are {change} than those of a person {prior}, "
            f"{abs(scale) / sd:.1f} standard deviations off",
            remedy="Check the person's height and the calibration of the volume",
        )


def _on_side(size: _Size, side: str) -> _Size:
    one, other = size.ends
    return _Size((side + one, side + other), size.terms, size.offset_m, size.sd_m, size.at_most)


def _describe_prior(stated: Stated) -> str:
    if stated.height_m is None:
        return "of unknown height, child or adult"
    kind = "by a child's or an adult's proportions" if stated.height_m < 1.5 else "by ANSUR II"
    return f"of {stated.height_m:.2f} m, {kind}"


# The same person ---------------------------------------------------------------------------------------------

_BONY = (
    ("RLFE", "RLM"), ("LLFE", "LLM"), ("RASIS", "LASIS"), ("RPSIS", "LPSIS"), ("RASIS", "RPSIS"), ("LASIS", "LPSIS"),
    ("RASIS", "SACR"), ("LASIS", "SACR"), ("RHEE", "RMT5"), ("LHEE", "LMT5"), ("RHEE", "RMT1"), ("LHEE", "LMT1"),
    ("RELB", "RWRA"), ("LELB", "LWRA"), ("RLM", "RMM"), ("LLM", "LMM"), ("C7", "CLAV"), ("RFHD", "LFHD"),
    ("RTUB", "RLM"), ("LTUB", "LLM"), ("RFH", "RLM"), ("LFH", "LLM"),
)  # fmt: skip
"""Distances within one bone, or between ends that slide little."""

_SLIDES = (0.008, 0.03, 0.1)
"""SD of such a distance's change between recordings of one placement, m; of a marker that was put on anew, and
its share (chosen: 3 to 13 mm in recordings of twelve persons; skin on bones, ``skin_motion.yaml``)."""

_OTHERS = (0.07, 0.05)
"""SD of the logarithm of another person's size and of each of its lengths (ANSUR II: stature 4 %, both sexes and
children 7; proportions 3 to 5)."""

_OTHER_PERSON = 0.01  # prior probability that a recording is of another person or scale (chosen)

_CHANGES: Mapping[str, float] = {"trunk": 0.005, "arm": 0.004, "thigh": 0.004}
_CHANGE, _CHANGE_ANEW, _CHANGE_SD = 0.002, 0.012, 0.8
"""Median over persons of by how much the distances within a segment change between recordings of one placement
(their median over the pairs of its markers, m; larger of trunk and arms), and of another person or placement; SD of
the logarithm of both (chosen: 0 to 10 mm and 3 to 50 mm in recordings of twelve persons)."""

_ODD_SEGMENT = 0.01  # share of segments with a fault of their own (chosen: 2 of 300)

_PLATE_M = 0.001  # chosen: markers that keep their distances so well sit on a plate, which fits everybody


def ask_same_person(trials: Sequence[Trial]) -> Iterator[Finding]:
    """Whether all recordings show one person with one placement of the markers, at one scale.

    Bones that differ in size are another person's or another scale's. Markers that all sit elsewhere may have been
    put on anew, which a recording of another day is told of and not refused.
    """
    bones = [_measure_bony(trial) for trial in trials]
    segments = [measure_within_segments(trial, list_roles(trial)) for trial in trials]
    odds: dict[tuple[int, int], tuple[float, float, float]] = {}
    for i, j in combinations(range(len(trials)), 2):
        anew = _weigh_anew(segments[i], segments[j])
        common = sorted({*bones[i]} & {*bones[j]})
        here, there = (np.array([bones[k][pair] for pair in common]) for k in (i, j))
        other, scale = _weigh_another(here, there) if len(common) >= _FEWEST_BONES else (-np.inf, 0.0)
        odds[i, j] = (max(other, anew), other, scale)
    # A recording is told of if it contradicts most of the others; of two that contradict each other, the first.
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
        sure = other > np.log(BEYOND_DOUBT)
        scale = scale if worst[0] == i else -scale
        size = f"{abs(np.expm1(scale)):.0%} {'larger' if scale > 0 else 'smaller'}"
        yield Finding(
            code="another_person",
            trial=trials[i].name,
            severity="refusal" if sure else "warning",
            problem=f"its bones are not those of {rival.name}, on the whole {size}: it is another person or "
            "another scale"
            if sure
            else f"markers lie elsewhere on their segments than in {rival.name}: they were put on anew, or it is "
            "another person or another scale",
            remedy="Use recordings of one person with one calibration of the volume, and of one placement of "
            "the markers where they are fitted together",
        )


_FEWEST_BONES = 3  # distances that tell a person's size (chosen)


def _weigh_anew(
    here: Mapping[tuple[str, str, str], float], there: Mapping[tuple[str, str, str], float]
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


def _measure_bony(trial: Trial) -> dict[tuple[str, str], float]:
    inverse = {role: label for label, role in list_roles(trial).items()}
    step = max(1, trial.n_frames // FRAMES)
    found = {}
    for a, b in _BONY:
        if a in inverse and b in inverse:
            distance = np.linalg.norm(
                (trial.position(inverse[a]) - trial.position(inverse[b]))[::step], axis=1
            )
            known = distance[np.isfinite(distance)]
            if len(known):
                found[a, b] = float(np.median(known))
    return found


def _weigh_another(here: Array, there: Array) -> tuple[float, float]:
    """Logarithm of the odds that two sets of lengths (n,), m, are of two persons, and of their ratio."""
    slide, anew, share = _SLIDES

    def density(off: Array, sd: Array | float) -> Array:
        values: Array = np.exp(-0.5 * (off / sd) ** 2) / (sd * np.sqrt(2.0 * np.pi))
        return values

    off = here - there
    same = np.log((1.0 - share) * density(off, slide) + share * density(off, anew)).sum()
    scales = np.linspace(-3.0, 3.0, 121) * _OTHERS[0]
    spread = np.sqrt(slide**2 + (_OTHERS[1] * there) ** 2)
    likely = np.log(density(here - np.exp(scales)[:, None] * there, spread)).sum(axis=1)
    prior = -0.5 * (scales / _OTHERS[0]) ** 2
    prior -= np.logaddexp.reduce(prior)
    other = np.logaddexp.reduce(likely + prior)
    ratio = float(np.average(np.log(here / there), weights=there**2))
    return float(other - same + np.log(_OTHER_PERSON / (1.0 - _OTHER_PERSON))), ratio


# Posture -----------------------------------------------------------------------------------------------------

_HANGS = np.cos(np.radians(135.0))  # chosen: beyond it a body hangs head down


def ask_posture(trials: Sequence[Trial], static: str | None) -> Iterator[Finding]:
    """Whether somebody hangs head down throughout, which no standing trial shows; trials with Y up."""
    for trial in trials:
        places = {role: trial.position(label) for label, role in list_roles(trial).items()}
        pelvis = [places[name] for name in ("RASIS", "LASIS", "SACR", "RPSIS", "LPSIS") if name in places]
        feet = [places[name] for name in ("RLM", "LLM", "RHEE", "LHEE") if name in places]
        if not pelvis or not feet:
            continue
        up = np.mean(pelvis, axis=0) - np.mean(feet, axis=0)
        known = up[np.isfinite(up).all(axis=1)]
        if not len(known):
            continue
        cosine = known[:, 1] / np.linalg.norm(known, axis=1)
        if cosine.max() < _HANGS:
            yield Finding(
                code="upside_down",
                trial=trial.name,
                severity="refusal" if trial.name == static else "warning",
                problem="the feet are above the pelvis in every frame",
                remedy="Correct which axis points up, or leave it out, so that it is found from the markers",
            )


# Labels within a segment -------------------------------------------------------------------------------------


def ask_exchanged(trial: Trial) -> Iterator[Finding]:
    """Labels of an outer and an inner landmark that look exchanged; throughout, nothing can be computed."""
    for exchange, throughout in find_exchanged_labels(trial, list_roles(trial)):
        end = ", the end" if exchange.end_s == trial.times[-1] else ""
        span = "throughout" if throughout else f"from {exchange.start_s:.2f} s to {exchange.end_s:.2f} s{end}"
        yield Finding(
            code="exchanged",
            trial=trial.name,
            severity="refusal" if throughout else "warning",
            labels=exchange.labels,
            exchanges=(exchange,),
            problem=f"the labels {' and '.join(exchange.labels)} look exchanged {span}",
            remedy="Correct the labels in the recording",
        )


def ask_segments(trials: Sequence[Trial], clusters: Clusters) -> Iterator[Finding]:
    """Labels of one segment that stand for each other for a while.

    Of two recordings that contradict each other all along, it is told once for both.
    """
    wrong: dict[str, list[Exchange]] = {}
    for trial in trials:
        usual = measure_shape((other for other in trials if other is not trial), clusters)
        wrong[trial.name] = list(find_exchanges(trial, clusters, usual or measure_shape([trial], clusters)))
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
            yield Finding(
                code="exchanged",
                trial=name,
                labels=item.labels,
                exchanges=tuple(o for o in found if o.labels == item.labels),
                rivals={rival: tuple(o for o in wrong[rival] if o.labels == item.labels) for rival in rivals},
                problem=f"the labels {' and '.join(item.labels)} look exchanged from {item.start_s:.2f} to "
                f"{item.end_s:.2f} s{where}: distances on their segment differ by {1e3 * item.difference_m:.0f} mm "
                f"from those in the other recordings, by {1e3 * item.left_m:.0f} mm with the labels put right",
                remedy="Correct the labels under `corrections:`, or in the recording; until then do not fit it: good "
                "markers would be blamed",
            )


def ask_moved(trials: Sequence[Trial], clusters: Clusters) -> Iterator[Finding]:
    """Markers that sit elsewhere than in the other recordings."""
    for one in find_moved_markers(trials, clusters):
        yield Finding(
            code="moved",
            trial=one.trial,
            labels=(one.label,),
            problem=str(one).removeprefix(f"{one.trial}: "),
            remedy="Look at the recordings; leave the marker out, or use recordings of one placement",
        )
