"""The segment of every label, by where it stands and what it moves with, and the landmark that it lies at.

A label's segment is the one that explains both best: its distance to the segment's bone while standing, and
how far its distances to the segment's other labels change over the movements. Labels and segments are settled
in turn, as in a mixture (expectation and maximisation; Dempster, Laird and Rubin 1977).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from scaling_service.core.arrays import Array
from scaling_service.model import trial as trials
from scaling_service.model.anatomy import markers
from scaling_service.numerics.multibody.rigid import fit_rigid
from scaling_service.recording.identity.body import (
    StandingBody,
    propose_standing_bodies,
    refine_standing_body,
)
from scaling_service.recording.identity.landmarks import list_landmarks

_THICK_M: Mapping[str, float] = {
    "pelvis": 0.12,
    "abdomen": 0.12,
    "torso": 0.12,
    "head": 0.09,
    "femur": 0.075,
    "tibia": 0.05,
    "calcn": 0.03,
    "humerus": 0.045,
    "ulna": 0.035,
    "hand": 0.03,
}
"""From a bone's line to the skin over it (chosen, from girths of ANSUR II over two pi)."""

_STANDS_M = 0.03  # SD of that, with what is not known of the pose (chosen)
_MOVES_M = 0.010  # SD of a distance within a segment: skin in ordinary movements (D'Isidoro 2020: 4 to 16 mm)
_TAIL = 2.0  # of Student's distribution (three degrees of freedom): arms are held anyhow, feet are not rigid
_ROUNDS = 8
_FRAMES = 300  # looked at, equally spaced
_SPREAD = (10.0, 90.0)  # percentiles: a few bad frames change nothing
_BENDS = np.radians(25.0)  # chosen: no knee bends forward so far
_UPRIGHT = ("pelvis", "abdomen", "torso")
_KNEES = 20.0  # chosen: nats for a body whose knees bend backward, against one whose knees bend forward
_FEW = 10  # frames in which two labels must be seen together
MOST_LABELS = 400
"""Chosen: nobody carries more; among more, places say nothing of whose they are."""

_SMALLEST = 1e-12  # of a probability, before its logarithm is taken
_LANDMARK_M = 0.03  # SD of a label about its landmark on the fitted body (chosen: as the body is fitted)

_WORDS = {
    "femur": "thigh",
    "tibia": "shank",
    "calcn": "foot",
    "humerus": "upper arm",
    "ulna": "forearm",
    "torso": "trunk",
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Identity:
    """What a label is.

    ``segment`` as ``full_body_35dof`` calls it, None where nothing tells. ``landmark``: a built-in model's
    marker, None of a tracking marker. ``confidence``: probability of the segment, ``at_landmark`` of the
    landmark.
    """

    label: str
    segment: str | None
    landmark: str | None
    confidence: float
    at_landmark: float
    why: str


@dataclass(frozen=True, slots=True, eq=False)
class Identification:
    """The labels of a session, and the body that was placed over the standing ones."""

    labels: Mapping[str, Identity]
    body: StandingBody | None


def identify(
    standing: trials.Trial | None,
    movements: Sequence[trials.Trial],
    *,
    stature: float | None = None,
    landmarks: Mapping[str, str] | None = None,
) -> Identification:
    """Tell what every label is.

    ``standing``: m, Y up. ``movements``: recordings of the same labels, in the same axes. ``stature``: m.
    ``landmarks``: label to landmark, of those whose names or the user tell. Points that software computed and
    trajectories without a label are left out. Without a standing trial, or of more labels than a person
    carries, nothing is told.
    """
    if standing is None:
        return Identification({}, None)
    names = [
        label
        for label in dict.fromkeys(standing.labels)
        if not markers.is_computed(markers.strip_prefix(label)) and not trials.is_unlabelled(label)
    ]
    if len(names) > MOST_LABELS:
        return Identification({}, None)
    at = np.full((len(names), 3), np.nan)
    for place, label in zip(at, names, strict=True):
        path = standing.position(label)
        known = path[np.isfinite(path).all(axis=1)]
        if len(known):
            place[:] = np.median(known, axis=0)
    placed = list_landmarks()
    told = {
        names.index(label): landmark
        for label, landmark in (landmarks or {}).items()
        if label in names and landmark in placed
    }
    spreads = _measure_spreads(names, movements)
    bodies = propose_standing_bodies(at, stature=stature, known=told)
    if not bodies:
        return Identification({}, None)
    looks = [_look(at, body, spreads, told) for body in bodies]
    scores = [look.score + _KNEES * _tell_by_knees(names, at, look, movements) for look in looks]
    likeliest = refine_standing_body(at, looks[int(np.argmax(scores))].body, told)
    look = _look(at, likeliest, spreads, told, chosen=True)
    body, segments, share = look.body, look.segments, look.share
    found = {}
    for k, label in enumerate(names):
        if not np.isfinite(at[k]).all():
            continue
        best = int(share[k].argmax())
        landmark = told.get(k) or body.taken.get(k)
        sits = landmark is not None and body.segments[landmark] == segments[best]
        near = float(np.linalg.norm(at[k] - body.places[landmark])) if landmark is not None else np.inf
        found[label] = Identity(
            label=label,
            segment=segments[best],
            landmark=landmark if sits else None,
            confidence=float(share[k, best]),
            at_landmark=1.0 if k in told else _weigh_landmark(at, k, landmark, body) if sits else 0.0,
            why=_explain(label, k, segments[best], share, spreads, near, landmark if sits else None),
        )
    return Identification(found, body)


@dataclass(frozen=True, slots=True, eq=False)
class _Look:
    """A body, its segments with labels, each label's probability of them, and how likely it all is (log)."""

    body: StandingBody
    segments: list[str]
    share: Array
    score: float


def _look(
    at: Array, body: StandingBody, spreads: Array, told: Mapping[int, str], *, chosen: bool = False
) -> _Look:
    """Who the labels are if this is the body; once it is ``chosen``, lying at its landmarks counts, too."""
    marked = {body.segments[name] for name in (*body.taken.values(), *told.values())}
    segments = [s for s in body.ends if s in marked]
    stands = np.column_stack([_measure_apart(at, s, body) for s in segments])
    for row, name in body.taken.items():
        apart = float(np.linalg.norm(at[row] - body.places[name]))
        own = segments.index(body.segments[name])
        stands[row, own] = min(stands[row, own], apart)
    owners = [segments.index(body.segments[told[k]]) if k in told else None for k in range(len(at))]
    # Probability of each label's segment, (n, n_segments), and how likely all labels are (logarithm)
    place = -_TAIL * np.log1p(stands**2 / (2.0 * _TAIL * _STANDS_M**2))
    place[~np.isfinite(stands).all(axis=1)] = 0.0
    if chosen:
        place = _tell_by_landmarks(place, at, body, segments, told)
    share = _normalise(place, owners)
    square = np.where(np.isfinite(spreads), spreads, 0.0) ** 2
    seen = np.isfinite(spreads).astype(float)
    for _ in range(_ROUNDS):
        weight = seen @ share
        moved = (square @ share) / np.maximum(weight, 1e-12)
        # A segment of which a label sees less than one whole other label says nothing of it either way.
        loose = np.where(weight > 0.5, moved, np.nan)
        worst = np.nanmin(np.where(np.isfinite(loose), loose, np.inf), axis=1, keepdims=True)
        loose = np.where(np.isfinite(loose), loose, np.where(np.isfinite(worst), worst, 0.0))
        log = place - _TAIL * np.log1p(loose / (2.0 * _TAIL * _MOVES_M**2))
        share = _normalise(log, owners)
    return _Look(body, segments, share, float((share * log).sum()))


def _tell_by_landmarks(
    place: Array, at: Array, body: StandingBody, segments: list[str], told: Mapping[int, str]
) -> Array:
    """``place`` (n, n_segments), log, with what lying at a landmark tells.

    It is of the landmark's segment then: malleoli and epicondyles are as near to one segment of their joint
    as to the other, and move with both.
    """
    share = _normalise(place, [None] * len(place))
    for row, name in body.taken.items():
        if row not in told:
            there = _weigh_landmark(at, row, name, body)
            share[row] *= 1.0 - there
            share[row, segments.index(body.segments[name])] += there
    return np.asarray(np.log(np.maximum(share, _SMALLEST)))


def _tell_by_knees(names: Sequence[str], at: Array, look: _Look, movements: Sequence[trials.Trial]) -> int:
    """Whether the knees bend backward over the movements (1), forward (-1), or neither is seen (0).

    The lowest labels of thigh and shank stand for knee and ankle, the pelvis's labels for the hips; the
    body's right is the trunk's.
    """
    owner = np.array(look.segments)[look.share.argmax(axis=1)]
    heading = look.body.heading
    right = np.array([np.sin(heading), 0.0, np.cos(heading)])  # the body's Z in the room
    forward, backward = 0.0, 0.0
    for trial in movements:
        shown = np.array([name in trial.labels for name in names])
        placed = shown & np.isfinite(at[:, 1])
        pelvis = np.flatnonzero((owner == "pelvis") & placed).tolist()
        trunk = np.flatnonzero(np.isin(owner, _UPRIGHT) & placed).tolist()
        if not pelvis or len(trunk) < 3:
            continue
        rows = np.unique(np.linspace(0, trial.n_frames - 1, min(trial.n_frames, _FRAMES)).astype(int))
        paths = {k: trial.position(names[k])[rows] for k in np.flatnonzero(shown).tolist()}
        moving = np.stack([paths[k] for k in pelvis], axis=1)
        across = fit_rigid(at[trunk], np.stack([paths[k] for k in trunk], axis=1))[0] @ right
        for side in "rl":
            lowest = [
                min(on, key=lambda k: at[k, 1])
                for part in ("femur", "tibia")
                if (on := np.flatnonzero((owner == f"{part}_{side}") & placed).tolist())
            ]
            if len(lowest) == 2:
                standing = _flex(at[pelvis].mean(axis=0), at[lowest[0]], at[lowest[1]], right)
                bent = _flex(moving.mean(axis=1), paths[lowest[0]], paths[lowest[1]], across) - standing
                known = bent[np.isfinite(bent)]
                if len(known):
                    backward = max(backward, float(np.percentile(known, 95.0)))
                    forward = max(forward, float(-np.percentile(known, 5.0)))
    if max(forward, backward) < _BENDS:
        return 0
    return 1 if backward > 2.0 * forward else -1 if forward > 2.0 * backward else 0


def _flex(hip: Array, knee: Array, ankle: Array, right: Array) -> Array:
    """How far the shank turns backward against the thigh, rad: points and the body's right, each (..., 3)."""
    thigh, shank = knee - hip, ankle - knee
    turned: Array = -(np.cross(thigh, shank) * right).sum(axis=-1)
    return np.asarray(np.arctan2(turned, (thigh * shank).sum(axis=-1)))


def _measure_apart(at: Array, segment: str, body: StandingBody) -> Array:
    """Distances (n,) of points (n, 3) from a segment's skin, m; its landmarks are on the skin."""
    first, last = body.ends[segment]
    along = last - first
    length = float(along @ along)
    share = np.clip((at - first) @ along / length, 0.0, 1.0) if length > 0.0 else np.zeros(len(at))
    bone = np.linalg.norm(at - first - share[:, None] * along, axis=1)
    scale = body.stature / 1.762
    depth = np.abs(bone - scale * _THICK_M[segment.partition("_")[0]])
    own = [place for name, place in body.places.items() if body.segments[name] == segment]
    nearest = np.full(len(at), np.inf)
    for place in own:
        nearest = np.minimum(nearest, np.linalg.norm(at - place, axis=1))
    beside = (share > 0.0) & (share < 1.0)
    return np.asarray(np.minimum(np.where(beside, depth, np.maximum(depth, nearest / 2.0)), nearest))


def _measure_spreads(names: Sequence[str], movements: Sequence[trials.Trial]) -> Array:
    """Half the range of the distance of every two labels over the movements, (n, n), m; NaN if unknown."""
    count = len(names)
    spread = np.full((count, count), np.nan)
    for trial in movements:
        own = [k for k, name in enumerate(names) if name in trial.labels]
        if len(own) < 2:
            continue
        rows = np.unique(np.linspace(0, trial.n_frames - 1, min(trial.n_frames, _FRAMES)).astype(int))
        at = trial.select([names[k] for k in own]).markers[rows]
        for i, k in enumerate(own):
            distance = np.linalg.norm(at[:, i, None] - at[:, i + 1 :], axis=2)
            seen = np.isfinite(distance).sum(axis=0)
            wide = np.full(distance.shape[1], np.nan)
            whole = (seen == len(distance)) & (seen >= _FEW)
            low, high = np.percentile(distance[:, whole], _SPREAD, axis=0)
            wide[whole] = 0.5 * (high - low)
            for j in np.flatnonzero(~whole & (seen >= _FEW)):
                low, high = np.percentile(distance[np.isfinite(distance[:, j]), j], _SPREAD)
                wide[j] = 0.5 * (high - low)
            others = own[i + 1 :]
            spread[k, others] = spread[others, k] = np.fmax(spread[k, others], wide)
    return spread


def _normalise(log: Array, told: Sequence[int | None]) -> Array:
    share = np.exp(log - log.max(axis=1, keepdims=True))
    share /= share.sum(axis=1, keepdims=True)
    for row, segment in enumerate(told):
        if segment is not None:
            share[row] = 0.0
            share[row, segment] = 1.0
    return np.asarray(share)


def _weigh_landmark(at: Array, row: int, landmark: str | None, body: StandingBody) -> float:
    """Probability that a label is the one at a landmark, and not another one nearby or none."""
    if landmark is None:
        return 0.0
    place = body.places[landmark]
    gaps = np.linalg.norm(at - place, axis=1)
    density = np.exp(-0.5 * (gaps / _LANDMARK_M) ** 2)
    rivals = np.isfinite(gaps) & ~np.isin(np.arange(len(at)), list(body.taken))
    none = np.exp(-0.5 * 4.0)  # two deviations: as likely to be another marker
    return float(density[row] / (density[row] + density[rivals].sum() + none))


def _explain(
    label: str, row: int, segment: str, share: Array, spreads: Array, near: float, landmark: str | None
) -> str:
    meaning = markers.look_up_meaning(label)
    parts = []
    mates = share.argmax(axis=1) == share[row].argmax()
    known = spreads[row, mates & np.isfinite(spreads[row]) & (np.arange(len(share)) != row)]
    if len(known):
        parts.append(
            f"moves with the {_word(segment)}: {1e3 * float(np.median(known)):.0f} mm over the movements"
        )
    else:
        parts.append(f"stands at the {_word(segment)}")
    if landmark is not None and np.isfinite(near):
        parts.append(f"{1e3 * near:.0f} mm from where the body has {landmark}")
    if meaning is not None and meaning.segment not in segment:
        parts.append(f"its name says {meaning.segment}")
    return "; ".join(parts)


def _word(segment: str) -> str:
    """A segment in plain words, such as ``right thigh``."""
    kind, _, side = segment.partition("_")
    word = _WORDS.get(kind, kind)
    return f"{ {'r': 'right', 'l': 'left'}[side] } {word}" if side else word
