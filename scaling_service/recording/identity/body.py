"""A body of the person's stature, posed as the person stands, and the labels that lie at its landmarks.

The whole-body model with more landmarks than it follows is placed over the standing markers, whatever way
these face; labels and landmarks are assigned to each other, limbs bent and sized to suit, and so on in turn.
Several headings and statures are tried.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from scaling_service.core.arrays import Array
from scaling_service.model import compile as compiling
from scaling_service.model.body import BodyModel, Marker
from scaling_service.model.scaling import scale_model
from scaling_service.numerics.multibody import tree as trees
from scaling_service.numerics.multibody.rigid import rotate_about
from scaling_service.numerics.multibody.sweep import solve_motion
from scaling_service.recording.identity import starts
from scaling_service.recording.identity.landmarks import MORE, STATURE_M, read_body

_FINE_M = (starts.FIRST_M, 0.06, 0.05, 0.04, 0.04, 0.04)
_TRIED = 9  # of headings and statures, bent and sized
_BENT = np.radians(20.0)  # SD of joint angles in standing, beside a marker's 30 mm (chosen)
_PLACED_M = 0.03
_PALPATED_M = 0.010  # SD of a marker about its landmark, by hand (della Croce 2005: 6 to 21 mm)
_MEDIAN_OF_CHI = 1.538  # with three degrees of freedom
_SIZES = (0.9, 1.1)  # chosen: a segment's size may change by so much a round
_ADAPTED = 0.5  # chosen: share of what both sides show of a landmark's place that the body takes over
_ELSEWHERE_M = 0.020  # chosen: a label much farther from its landmark is another one (Welsch's weights)
_ALIKE = 1e-6  # m and shares; chosen: far above what solutions leave open, far below what matters
_UNLIKE_M = 0.030  # chosen: markers of both sides are placed by hand, each to 10 or 15 mm
_HANGING = (0.0, 0.0, 0.0)
_ARMS = (
    _HANGING,
    *(
        (float(flexed), float(abducted), float(elbow))
        for flexed, abducted, elbow in np.radians(
            [(0, 40, 0), (0, 85, 0), (45, 20, 45), (85, 0, 0), (0, 15, 90), (60, 0, 90), (-20, 40, 60)]
        )
    ),
)
"""How people hold their arms in standing trials: hanging, held off, spread, forward, elbows bent, hands on
hips or before the chest. Chosen; each start finds what lies within 30 deg of it."""

_ARM = ("humerus", "ulna", "hand")
_ENDS = (("LFE", "MFE"), ("LM", "MM"))
_WANDS = ("THI", "SHK")  # put anywhere along the segment, on each side at another height
_MIRROR = np.array([1.0, 1.0, -1.0])

_LEVELS = (
    ("femur", ("ASIS",), ("LFE", "MFE")),
    ("tibia", ("LFE", "MFE"), ("LM", "MM")),
    ("humerus", ("SHO",), ("ELB", "MEL")),
    ("ulna", ("ELB", "MEL"), ("WRA", "WRB")),
)
"""Segment, and the landmarks above and below that tell its length."""

_BONES = {
    "torso": ("torso", "head"),
    "femur": ("femur", "tibia"),
    "tibia": ("tibia", "calcn"),
    "humerus": ("humerus", "ulna"),
    "ulna": ("ulna", "hand"),
}
"""Segment, and those whose origins are its bone's ends."""


Met = dict[tuple[int, tuple[tuple[int, int], ...]], Array]
"""Round and pairs to where the landmarks of the pairs, moves on segments and sizes were, where nobody marked
the trunk: arms, which hang on it, then are none of the labels', however they are held."""


@dataclasses.dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class StandingBody:
    """A body over the labels of a standing trial.

    ``taken``: label (its number) to landmark. ``places``: landmark to where the body has it, (3,) m, and
    ``segments`` the segment of each. ``ends``: segment to the ends of its bone, (2, 3) m. ``heading``: where
    it faces, rad about Y from X. ``misfit`` m2: squared distances of all labels, those at no landmark as far.
    """

    start: starts.Start
    stature: float
    taken: Mapping[int, str]
    places: Mapping[str, Array]
    segments: Mapping[str, str]
    ends: Mapping[str, Array]
    heading: float
    misfit: float


def propose_standing_bodies(
    points: Array, *, stature: float | None = None, known: Mapping[int, str] | None = None
) -> list[StandingBody]:
    """Place bodies over the points of a standing person: several headings and statures, the best first.

    ``points`` (n, 3), m: Y up, any heading; NaN where a label was not seen. ``stature`` m: where it is known.
    ``known``: labels whose landmarks are certain. Empty where there are too few points.
    """
    seen = np.flatnonzero(np.isfinite(points).all(axis=1))
    if len(seen) < starts.FEWEST:
        return []
    at, fixed = points[seen], _renumber(seen, known)
    tried: list[starts.Start] = []
    for start in sorted(starts.place_rigidly(at, stature, fixed), key=lambda start: start.cost):
        if len(tried) < _TRIED and not any(start.resembles(other) for other in tried):
            tried.append(start)
    bodies = sorted(filter(None, (_bend(at, start, fixed) for start in tried)), key=lambda body: body.misfit)
    return [_with_numbers_of(seen, body) for body in bodies]


def refine_standing_body(
    points: Array, body: StandingBody, known: Mapping[int, str] | None = None
) -> StandingBody:
    """A proposed body with its arms held as the person's, its landmarks where both sides show them."""
    seen = np.flatnonzero(np.isfinite(points).all(axis=1))
    at, fixed = points[seen], _renumber(seen, known)
    free = len(body.taken) < len(seen) or any(body.segments[n].startswith(_ARM) for n in body.taken.values())
    arms = _ARMS if free else (_HANGING,)  # where no label is or may be an arm's, nothing tells of them
    met: Met = {}
    held = [_bend(at, body.start, fixed, adapt=True, arms=how, met=met) for how in arms]
    return _with_numbers_of(seen, min(filter(None, held), key=lambda other: other.misfit))


def _renumber(seen: NDArray[np.intp], known: Mapping[int, str] | None) -> dict[int, str]:
    return {int(np.flatnonzero(seen == k)[0]): name for k, name in (known or {}).items() if k in seen}


def _with_numbers_of(seen: NDArray[np.intp], body: StandingBody) -> StandingBody:
    return dataclasses.replace(body, taken={int(seen[k]): name for k, name in body.taken.items()})


def _bend(
    at: Array,
    start: starts.Start,
    fixed: Mapping[int, str],
    *,
    adapt: bool = False,
    arms: tuple[float, float, float] = _HANGING,
    met: Met | None = None,
) -> StandingBody | None:
    """The body with its joints bent and its segments sized as the labels at its landmarks ask for.

    ``adapt``: whether its landmarks move on their segments, too; rivals are compared without. ``arms``: how
    they start, flexion, abduction and the elbow's flexion, rad. ``met``: how others stood, to which this one
    is added; None where it comes to stand as one of them did: from there on, both are the same.
    """
    body = read_body()
    names = list(body.marker_names)
    factors = {name: np.full(3, start.stature / STATURE_M) for name in body.segment_names}
    shifts = np.zeros((len(names), 3))
    q = compiling.repeat_default_pose(body, 1)
    index = {name: k for k, name in enumerate(body.coordinate_names)}
    q[0, [index[f"pelvis_t{letter}"] for letter in "xyz"]] = start.origin + rotate_about(
        (0.0, 1.0, 0.0), start.heading
    ) @ (start.stature / STATURE_M * q[0, [index[f"pelvis_t{letter}"] for letter in "xyz"]])
    q[0, index["pelvis_rotation"]] += start.heading
    for side in "rl":
        flexed, abducted, elbow = arms
        q[0, [index[f"{name}_{side}"] for name in ("arm_flex", "arm_add", "elbow_flex")]] = (
            flexed,
            -abducted,
            elbow,
        )
    rotations = np.array([c.kind == "rotation" and not c.name.startswith("pelvis") for c in body.coordinates])
    pull = np.where(rotations, (_PLACED_M / _BENT) ** 2, 0.0)
    wanted = q.copy()
    model = scale_model(body, {n: tuple(f) for n, f in factors.items()})
    upright = trees.pose_markers(
        compiling.compile_model(model, names), q, compiling.list_parameter_values(body)
    )[0]
    pairs = starts.assign(at, upright, names, 2.0 * _FINE_M[0], fixed)
    for k, reach in enumerate(_FINE_M):
        model = scale_model(body, {n: tuple(f) for n, f in factors.items()}) if k else model
        if shifts.any():
            moved = (
                Marker.at(m.name, m.segment, tuple(np.array(m.nominal) + shift))
                for m, shift in zip(model.markers, shifts, strict=True)
            )
            model = model.with_markers(tuple(moved))
        tree = compiling.compile_model(model, names)
        measured = np.full((1, len(names), 3), np.nan)
        for row, column in pairs:
            measured[0, column] = at[row]
        q = solve_motion(
            tree,
            measured,
            np.ones(len(names)),
            q,
            compiling.list_parameter_values(model),
            free=_list_carrying(model, {model.markers[column].segment for _, column in pairs}),
            bounds=compiling.list_coordinate_ranges(model),
            prior=(wanted, pull),
        ).q
        places = trees.pose_markers(tree, q, compiling.list_parameter_values(model))[0]
        rare = _scale_rarity(at, places, pairs) if adapt else starts.RARE_M
        pairs = starts.assign(at, places, names, 2.0 * reach, fixed, rare)
        adrift = _list_adrift(model, {names[column] for _, column in pairs})
        if adrift:
            far = np.where([[name in adrift] for name in names], np.inf, places)
            pairs = starts.assign(at, far, names, 2.0 * reach, fixed, rare)
        pairs = _pair_the_back(at, _reconcile(model, q, at, pairs, names, fixed), names, places)
        _resize(factors, at, places, names, pairs)
        if adapt:
            shifts = _adapt(model, q, at, pairs, names, shifts)
        columns = [column for _, column in pairs]
        if met is not None and not any(model.markers[column].segment == "torso" for column in columns):
            stands = np.concatenate([places[columns], shifts, list(factors.values())])
            before = met.setdefault((k, tuple(pairs)), stands)
            if before is not stands and np.abs(stands - before).max() < _ALIKE:
                return None
    segments = {m.name: m.segment for m in model.markers}
    return StandingBody(
        start=start,
        stature=start.stature,
        taken={row: names[column] for row, column in pairs},
        places=dict(zip(names, places, strict=True)),
        segments=segments,
        ends=_list_ends(model, q),
        heading=start.heading + float(q[0, index["pelvis_rotation"]] - wanted[0, index["pelvis_rotation"]]),
        misfit=starts.measure_misfit(at, places, pairs),
    )


def _scale_rarity(at: Array, places: Array, pairs: list[tuple[int, int]]) -> float:
    """How much farther a rarely marked landmark counts, m: its odds are the same, distances tell more.

    They tell as much as the labels lie near their landmarks; half of them within 1.54 SD (chi, 3 degrees).
    """
    gaps = [float(np.linalg.norm(at[row] - places[column])) for row, column in pairs]
    spread = max(_PALPATED_M, float(np.median(gaps)) / _MEDIAN_OF_CHI) if gaps else _PLACED_M
    return starts.RARE_M * min(1.0, spread / _PLACED_M)


def _list_carrying(model: BodyModel, marked: set[str]) -> NDArray[np.bool_]:
    """Which coordinates are free and move segments that bear markers, (n_coordinates,)."""
    carrying, moving = set(marked), set[str]()
    for segment in reversed(model.segments):
        if segment.name in carrying:
            carrying.add(segment.parent)
            moving |= {name for joint in segment.joints for name in joint.law.coordinates}
    return np.array([not c.locked and c.name in moving for c in model.coordinates])


def _list_adrift(model: BodyModel, taken: set[str]) -> set[str]:
    """Landmarks of forearms without an upper arm, of arms without a trunk, of feet without an ankle.

    Nobody marks those, nor a foot by nothing but what few laboratories mark.
    """
    owner = {m.name: m.segment for m in model.markers}
    marked = {owner[name] for name in taken}
    alone = {f"{part}_{s}" for part in ("hand", "ulna") for s in "rl" if f"humerus_{s}" not in marked}
    if "torso" not in marked:
        alone |= {f"{part}_{s}" for part in ("hand", "ulna", "humerus") for s in "rl"}
    alone |= {f"calcn_{s.lower()}" for s in "RL" if not {f"{s}LM", f"{s}MM"} & taken}
    common = {owner[name] for name in taken if name[1:] not in MORE}
    return {
        name
        for name, segment in owner.items()
        if segment in alone or (name[1:] in MORE and segment.startswith("calcn") and segment not in common)
    }


def _adapt(
    model: BodyModel, q: Array, at: Array, pairs: list[tuple[int, int]], names: list[str], shifts: Array
) -> Array:
    """Landmarks moved on their segments to where both sides show them: people are nearly symmetric.

    A landmark that one side shows elsewhere than the other counts on both as half of it.
    """
    inside = _turn_into_segments(model, q, at)
    local = {
        column: inside[model.markers[column].segment][row] - model.markers[column].nominal + shifts[column]
        for row, column in pairs
    }
    result = np.zeros_like(shifts)
    for column, gap in local.items():
        name = names[column]
        other = names.index({"R": "L", "L": "R"}[name[0]] + name[1:]) if name[0] in "RL" else column
        twin = _MIRROR * local.get(other, _MIRROR * gap)
        both = (gap + twin) / 2.0
        result[column] = _ADAPTED * float(np.exp(-0.5 * (both @ both) / _ELSEWHERE_M**2)) * both
    return result


def _turn_into_segments(model: BodyModel, q: Array, at: Array) -> dict[str, Array]:
    """Segment to the points (n, 3) in its frame."""
    tree = compiling.compile_model(model)
    poses = trees.pose_links(tree, np.ascontiguousarray(q.T), compiling.list_parameter_values(model))
    link = {m.segment: int(k) for m, k in zip(model.markers, tree.marker_link, strict=True)}
    return {s: (at - poses.origins[k][:, 0]) @ poses.axes[k][:, :, 0].T for s, k in link.items()}


def _reconcile(
    model: BodyModel,
    q: Array,
    at: Array,
    pairs: list[tuple[int, int]],
    names: list[str],
    fixed: Mapping[int, str],
) -> list[tuple[int, int]]:
    """Pairs that agree with each other: both sides are mirror images, both ends of a joint are level.

    Of two that do not, the one nearer to its place on the body counts, and the other takes the label nearest
    to where the first wants it.
    """
    inside = _turn_into_segments(model, q, at)
    nominal = {m.name: np.array(m.nominal) for m in model.markers}
    owner = {m.name: m.segment for m in model.markers}
    row_of = {names[column]: row for row, column in pairs}
    told = {name: row for row, name in fixed.items()}
    ends = [(side + outer, side + inner) for side in "RL" for outer, inner in _ENDS]
    twins = [("R" + n[1:], "L" + n[1:]) for n in names if n[0] == "R" and n[1:] not in _WANDS]
    for first, second in (*ends, *twins):
        if not {first, second} <= row_of.keys() or {first, second} <= told.keys():
            continue
        mirror = _MIRROR if owner[first] != owner[second] or first[0] != second[0] else np.ones(3)
        own = {name: inside[owner[name]][row_of[name]] - nominal[name] for name in (first, second)}
        if np.linalg.norm(own[first] - mirror * own[second]) < _UNLIKE_M:
            continue
        sure, other = sorted((first, second), key=lambda n: (n not in told, float(np.linalg.norm(own[n]))))
        gaps = np.linalg.norm(inside[owner[other]] - nominal[other] - mirror * own[sure], axis=1)
        gaps[[row for name, row in told.items() if name != other]] = np.inf
        nearest = int(np.argmin(gaps))
        if gaps[nearest] < _UNLIKE_M and nearest not in (row_of[other], row_of[sure]):
            row_of = {name: row for name, row in row_of.items() if row != nearest} | {other: nearest}
    return [(row, names.index(name)) for name, row in row_of.items()]


def _pair_the_back(
    at: Array, pairs: list[tuple[int, int]], names: list[str], places: Array
) -> list[tuple[int, int]]:
    """One label behind the pelvis is sacral, two are the spines, three are both: the pelvis is symmetric."""
    behind = [(row, names[column]) for row, column in pairs if names[column] in ("RPSIS", "LPSIS", "SACR")]
    across = places[names.index("RASIS")] - places[names.index("LASIS")]
    rows = sorted((row for row, _ in behind), key=lambda row: -float(at[row] @ across))
    order = {1: ("SACR",), 2: ("RPSIS", "LPSIS"), 3: ("RPSIS", "SACR", "LPSIS")}.get(len(rows), ())
    kept = [(row, column) for row, column in pairs if (row, names[column]) not in behind]
    return [*kept, *((row, names.index(name)) for row, name in zip(rows, order, strict=True))]


def _resize(
    factors: dict[str, Array], at: Array, places: Array, names: list[str], pairs: list[tuple[int, int]]
) -> None:
    """Segments as long as the labels at both ends are apart, both sides alike; the pelvis as wide."""
    seen = {names[column]: at[row] for row, column in pairs}
    model = {names[column]: places[column] for _, column in pairs}

    def middle(points: Mapping[str, Array], side: str, ends: tuple[str, ...]) -> Array | None:
        own = [points[side + end] for end in ends if side + end in points]
        return np.mean(own, axis=0) if own else None

    for segment, upper, lower in _LEVELS:
        ratios = []
        for side in "RL":
            ends = [middle(points, side, level) for points in (seen, model) for level in (upper, lower)]
            if all(end is not None for end in ends):
                a, b, c, d = (np.asarray(end) for end in ends)
                ratios.append(float(np.linalg.norm(a - b) / np.linalg.norm(c - d)))
        for side in "rl" if ratios else "":
            factors[f"{segment}_{side}"] = factors[f"{segment}_{side}"] * np.clip(np.mean(ratios), *_SIZES)
    if {"RASIS", "LASIS"} <= seen.keys():
        wide = np.linalg.norm(seen["RASIS"] - seen["LASIS"]) / np.linalg.norm(model["RASIS"] - model["LASIS"])
        factors["pelvis"] = factors["pelvis"] * [1.0, 1.0, float(np.clip(wide, *_SIZES))]


def _list_ends(model: BodyModel, q: Array) -> dict[str, Array]:
    """The ends of every segment's bone; of head, hands and feet those of its landmarks' middle line."""
    carriers = [Marker.at(s, s, (0.0, 0.0, 0.0)) for s in model.segment_names]
    origins = dict(
        zip(
            model.segment_names,
            trees.pose_markers(
                compiling.compile_model(model.with_markers(tuple(carriers))),
                q,
                compiling.list_parameter_values(model),
            )[0],
            strict=True,
        )
    )
    landmarks = trees.pose_markers(compiling.compile_model(model), q, compiling.list_parameter_values(model))[
        0
    ]
    found = {}
    for segment in model.segment_names:
        kind, _, side = segment.partition("_")
        if kind in _BONES:
            first, last = (f"{name}_{side}" if side else name for name in _BONES[kind])
            found[segment] = np.stack([origins[first], origins[last]])
            continue
        own = landmarks[[m.segment == segment for m in model.markers]]
        if kind == "pelvis":
            found[segment] = np.stack([own.mean(axis=0)] * 2)
        elif len(own):
            middle = own.mean(axis=0)
            along = np.linalg.svd(own - middle)[2][0]
            reach = np.abs((own - middle) @ along).max()
            found[segment] = np.stack([middle - reach * along, middle + reach * along])
    return found
