"""Every segment's size as one weighted estimate: measured distances, and anthropometry as prior.

In logarithms the person's size over the model's is Gaussian beforehand (what persons of this sex, stature and
mass are like, ``anthropometry``), and every measured distance is that size with an
error. The posterior weighs both, and what one segment says of another: a leg that was not marked follows the
marked one as far as legs resemble each other.
"""

from __future__ import annotations

import re
from collections import abc
from dataclasses import dataclass
from itertools import combinations
from types import MappingProxyType

import numpy as np

from scaling_service.capabilities.scaling.methods.functional import FunctionalJoints
from scaling_service.capabilities.scaling.sizes import points
from scaling_service.capabilities.scaling.sizes import ratios as sizes_ratios
from scaling_service.capabilities.scaling.sizes.measurements import open_axes
from scaling_service.capabilities.shared.settings import CalibrationSettings
from scaling_service.core.arrays import Array
from scaling_service.core.errors import TrialUnusable
from scaling_service.core.names import say_name, say_names
from scaling_service.core.text import list_few
from scaling_service.model import body, results
from scaling_service.model import subject as subjects
from scaling_service.model.anatomy import anthropometry
from scaling_service.model.anatomy import centres as anatomy_centres
from scaling_service.model.anatomy.lengths import measure_segment_lengths
from scaling_service.model.anatomy.markers import find_canonical
from scaling_service.model.places import find_landmarks_by_place

_WORDS: abc.Mapping[str, str] = MappingProxyType(
    {
        "inter_hip": "pelvis sacrum",
        "femur": "femur thigh patella",
        "shank": "tibia shank fibula",
        "foot": "talus calcn calcaneus foot midfoot toes",
        "trunk": "torso trunk thorax abdomen lumbar spine rib ribs",
        "head_length": "head skull neck cervical",
        "upper_arm": "humerus upperarm arm scapula clavicle clavicula",
        "forearm": "ulna radius forearm lunate",
        "hand": "hand fingers",
    }
)
"""Dimension, and the words in a segment's name that say that its size follows it."""

_DIMENSION_OF: abc.Mapping[str, str] = MappingProxyType(
    {word: dimension for dimension, words in _WORDS.items() for word in words.split()}
)
DECLARED_SD: abc.Mapping[str, float] = MappingProxyType({"stature": 0.02, "mass": 0.05})
"""Relative standard deviation of what files declare. Mass is often 2 to 5 % off (shoes, clothes, an older
value); stature, chosen: shoes, and a child grows by 4 % in a year."""

_PRIOR_NAMES: abc.Mapping[str, str] = MappingProxyType({"asis_width": "pelvis_width"})
"""Sizes measured by hand that anthropometry has under another name."""

BONE_SD_M = 0.002
"""Standard deviation of a length between centres on a bone's surface. Chosen: a voxel or two of MRI, from
many of which a centre is fitted."""

PALPATION_M = 0.010
"""Standard deviation of a marker's place on a segment: Della Croce 2005, within examiners 6 to 21 mm."""

_SHORTEST_M = 0.03  # chosen: nearer markers measure their own placing


_SMALLEST = 0.2  # chosen: a newborn is 0.29 of an adult's stature; beyond this a unit or a label is wrong

NO_BONES: abc.Mapping[str, float] = MappingProxyType({})

_MIDLINE = frozenset({"inter_hip", "trunk", "head_length"})
_NO_PERSONS = 0.5
"""Chosen: logarithm of a model's length over an adult's beyond which it is defined otherwise."""

_EXACT = 1e-4
"""Chosen: relative standard deviation of a model's own length, which is known but must not be zero."""


def find_dimension(segment: str) -> str | None:
    """The person's dimension that a segment's size follows, None where its name says nothing.

    Examples
    --------
    >>> [find_dimension(name) for name in ("tibia_r", "l_humerus", "lumbar3", "crate")]
    ['shank_r', 'upper_arm_l', 'trunk', None]
    """
    words = re.findall(r"[a-z]+", re.sub(r"(?<=[a-z])(?=[A-Z])", "_", segment).lower())
    dimension = next(
        (_DIMENSION_OF[w] for word in words for w in (word, word.removesuffix("s")) if w in _DIMENSION_OF),
        None,
    )
    if "trunk" in words:
        dimension = "trunk"
    if dimension is None or dimension in _MIDLINE:
        return dimension
    left = any(word in ("l", "left") for word in words)
    return f"{dimension}_{'l' if left else 'r'}"


def expect_dimensions(subject: subjects.Subject) -> anthropometry.DimensionPrior:
    """What is known of a person's dimensions before markers are looked at: declared and measured by hand."""
    blank = anthropometry.predict_dimensions(sex=None, height_m=None, mass_kg=None).names
    sizes = {
        _PRIOR_NAMES.get(name, name): (value, anatomy_centres.size_sd(name, value))
        for name, value in subject.sizes_m.items()
    }
    return anthropometry.predict_dimensions(
        sex=subject.sex,
        height_m=subject.height_m,
        mass_kg=subject.mass_kg,
        sizes={name: size for name, size in sizes.items() if name in blank},
        stated_sd=DECLARED_SD,
    )


def estimate_sizes(
    model: body.BodyModel,
    ratios: sizes_ratios.Ratios,
    prior: anthropometry.DimensionPrior,
    *,
    weighted: bool = True,
) -> dict[str, results.SegmentSize]:
    """The size of every segment over the model's, with its standard deviation and what it rests on.

    ``model``: the generic model.
    ``ratios``: what was measured.
    ``prior``: of the person.
    ``weighted``: whether prior and distances are weighed; else a measured segment takes the mean of its
        distances as it is, and the prior serves the others.
    Returns segment to its size. Segments whose names say nothing take their parent's.
    """
    stands_for = {name: find_dimension(model.bone_of(name)) for name in model.segment_names}
    dimensions = {name: dimension for name, dimension in stands_for.items() if dimension is not None}
    names = tuple(dict.fromkeys(dimensions.values()))
    if not names:
        return {}
    expected = prior.select(names)
    ratios = ratios if weighted else ratios.average()
    # Logarithms of the model's own dimensions: its lengths, the rest as of a person with these lengths.
    blank = anthropometry.predict_dimensions(sex=None, height_m=None, mass_kg=None, age_years=30.0)
    lengths = {}
    for name, length in measure_segment_lengths(model).items():
        sided = name if name in blank.names else f"{name}_r"
        if sided in blank.names and abs(np.log(length / blank.value(sided))) < _NO_PERSONS:
            lengths[sided] = (length, _EXACT * length)
    alike = blank.condition(lengths)
    mean = expected.mean - np.array([np.log(alike.value(name)) for name in names])
    measured = {model.bone_of(name): dimension for name, dimension in dimensions.items()}
    rows = [next(measured[s] for s in m.segments if s in measured) for m in ratios.measurements]
    pick = np.eye(len(names))[[names.index(row) for row in rows]].reshape(len(rows), len(names))
    before = expected.covariance
    noise = ratios.covariance if weighted else np.zeros_like(ratios.covariance)
    gain = np.linalg.solve(pick @ before @ pick.T + noise, pick @ before).T
    logs = mean + gain @ (ratios.logs - pick @ mean)
    kept = np.eye(len(names)) - gain @ pick
    covariance = kept @ before @ kept.T + gain @ ratios.covariance @ gain.T
    sizes = {}
    for segment, dimension in dimensions.items():
        k = names.index(dimension)
        mine = [j for j, row in enumerate(rows) if row == dimension]
        share = float(gain[k, mine].sum())
        sizes[segment] = results.SegmentSize(
            dimension=dimension,
            factor=float(np.exp(logs[k])),
            sd=float(np.sqrt(covariance[k, k])),
            measured=share,
            others=float(gain[k].sum()) - share,
            own=bool(mine),
        )
    return _with_followers(model, sizes)


def _with_followers(
    model: body.BodyModel, sizes: abc.Mapping[str, results.SegmentSize]
) -> dict[str, results.SegmentSize]:
    """Segments whose names say nothing take the size of the nearest one above, else of the first."""
    found = dict(sizes)
    parents = {segment.name: segment.parent for segment in model.segments}
    for segment in model.segments:
        above = segment.name
        while above not in found and above != body.GROUND:
            above = parents[above]
        found.setdefault(segment.name, found.get(above) or next(iter(sizes.values())))
    return {name: found[name] for name in model.segment_names}


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Sizing:
    """Factors of all segments, and how they came about.

    ``factors``: segment to its x, y, z factors.
    ``sizes``: segment to its estimate.
    ``centres``: ``hip_r`` … to how the first recording that shows it gave the person's joint centre.
    ``people``: the recordings' points, the best first.
    """

    factors: abc.Mapping[str, body.Vector]
    sizes: abc.Mapping[str, results.SegmentSize]
    centres: abc.Mapping[str, results.EstimatedCentre]
    people: tuple[points.PersonPoints, ...]
    notes: tuple[str, ...]


def size_segments(
    session: subjects.Session,
    settings: CalibrationSettings,
    joints: FunctionalJoints | None = None,
    lengths: abc.Mapping[str, float] = NO_BONES,
) -> Sizing:
    """Factors of each segment from landmarks and anthropometry: one, or one along each axis.

    Each distance is taken on the first trial that shows both of its ends, the static trial before movements.

    ``joints``: hip centres that take the regression's place.
    ``lengths``: dimension to its length as an image shows it, m; with them all is weighed.
    Raises TrialUnusable: nothing could be measured, or a size is no person's.
    """
    subject, model = session.subject, session.model
    places = find_landmarks_by_place(model)
    prior = expect_dimensions(subject).condition({name: (at, BONE_SD_M) for name, at in lengths.items()})
    scale = prior.value("stature") / anatomy_centres.ADULT_STATURE_M
    known = estimate_body_sizes(session, prior, places)
    people = tuple(
        points.find_person_points(
            trial,
            standing=trial is session.static,
            regression=settings.hip_regression,
            sizes=known,
            joints=joints,
            scale=scale,
            places=places,
        )
        for trial in (session.static, *session.calibration)
        if trial is not None
    )
    ours = points.find_model_points(model, places)
    weighted = settings.sizes == "weighted" or bool(lengths)
    bones = {model.bone_of(name): name for name in model.segment_names}
    doubtful = points.find_doubtful_joints(model, ours)
    ratios = sizes_ratios.measure_ratios(people, ours, tuple(bones), besides=weighted, doubtful=doubtful)
    if not len(ratios.logs):
        return _size_by_own_markers(session, people)
    for measurement, log in zip(ratios.measurements, ratios.logs, strict=True):
        check_factor(float(np.exp(log)), next(bones[s] for s in measurement.segments if s in bones))
    sizes = estimate_sizes(model, ratios, prior, weighted=weighted)
    factors: dict[str, body.Vector] = {name: (size.factor,) * 3 for name, size in sizes.items()}
    notes = [*_write_notes(model, ratios, sizes, subject)]
    if placed := [f"{name} = {landmark}" for name, landmark in places.items() if landmark is not None]:
        notes.append(f"MB: landmarks by where the model has its markers: {list_few(placed)}")
    if misnamed := [name for name in places if find_canonical(name) not in (None, places[name])]:
        elsewhere = "MB: named like landmarks that lie elsewhere on the model, not taken for them"
        notes.append(f"{elsewhere}: {list_few(misnamed)}")
    if settings.scaling == "per-axis":
        factors, more = open_axes(factors, [person.points for person in people], ours)
        notes.extend(more)
    for segment, along in factors.items():
        for factor in along:
            check_factor(factor, segment)
    return Sizing(
        factors=factors, sizes=sizes, centres=_list_centres(people), people=people, notes=tuple(notes)
    )


def _size_by_own_markers(session: subjects.Session, people: tuple[points.PersonPoints, ...]) -> Sizing:
    """Each segment by the distances between the model's own markers on it, none of which is a landmark.

    The factor is that of least squares; its deviation that of two hand-placed markers, over their distance.
    """
    model = session.model
    standing = next(trial for trial in (session.static, *session.calibration) if trial is not None)
    shown = [m for m in model.markers if m.weight > 0.0 and m.name in standing.shown_labels]
    sizes = {}
    for segment in dict.fromkeys(m.segment for m in shown):
        pairs = list(combinations([m for m in shown if m.segment == segment], 2))
        ours = np.array([np.linalg.norm(np.subtract(a.nominal, b.nominal)) for a, b in pairs])
        theirs = np.array(
            [measure_distance(standing.position(a.name), standing.position(b.name)) for a, b in pairs]
        )
        known = np.isfinite(theirs) & (ours > _SHORTEST_M)
        if known.any():
            factor = float(ours[known] @ theirs[known] / np.square(ours[known]).sum())
            sizes[segment] = results.SegmentSize(
                dimension=find_dimension(model.bone_of(segment)) or segment,
                factor=factor,
                sd=float(np.sqrt(2.0) * PALPATION_M / ours[known].max()),
                measured=1.0,
                others=0.0,
            )
    if not sizes:
        raise TrialUnusable(
            "no segment could be measured: the landmarks of the pelvis, knees and ankles are not all there, "
            "and no segment of the model carries two markers that are seen",
            field="markers",
            remedy="Map the labels of ASIS, PSIS, epicondyles and malleoli under `markers:`",
        )
    note = (
        f"MB: {say_names(sizes)}: sized by the distances between the model's markers on them, none of "
        "which is a landmark that is known here"
    )
    found = _with_followers(model, sizes)
    factors: dict[str, body.Vector] = {name: (size.factor,) * 3 for name, size in found.items()}
    for segment, (factor, *_) in factors.items():
        check_factor(factor, segment)
    return Sizing(factors=factors, sizes=found, centres=_list_centres(people), people=people, notes=(note,))


def measure_distance(one: Array, other: Array) -> float:
    """The median distance of two points over the frames (n, 3) that show both, m; NaN where none does."""
    apart = np.linalg.norm(one - other, axis=1)
    known = apart[np.isfinite(apart)]
    return float(np.median(known)) if len(known) else float("nan")


def estimate_body_sizes(
    session: subjects.Session, prior: anthropometry.DimensionPrior, places: points.Places = points.NO_PLACES
) -> anatomy_centres.BodySizes:
    """Sizes as measured, else as the other side's, else as of persons like this one."""
    measured = session.subject.sizes_m
    widths: dict[str, tuple[anatomy_centres.Size, float]] = {}
    for joint in ("knee", "ankle"):
        for side, other in ("rl", "lr"):
            name = f"{joint}_width"
            own = measured.get(f"{name}_{side}", measured.get(f"{name}_{other}"))
            expected = f"{name}_{side}"
            widths[f"{joint}_{side}"] = (
                (prior.value(expected), prior.sd(expected))
                if own is None
                else (own, anatomy_centres.size_sd(name, own))
            )
    legs = {side: measured[f"leg_length_{side}"] for side in "rl" if f"leg_length_{side}" in measured}
    diameter = measured.get("marker_diameter", 2.0 * anatomy_centres.MARKER_RADIUS_M)
    sizes = anatomy_centres.BodySizes(widths, legs, diameter / 2.0)
    if session.static is None:
        return sizes
    return sizes.with_leg_lengths(points.measure_standing_legs(points.read_landmarks(session.static, places)))


def _list_centres(people: abc.Sequence[points.PersonPoints]) -> dict[str, results.EstimatedCentre]:
    found: dict[str, results.EstimatedCentre] = {}
    for person in people:
        if not found.keys() >= person.centres.keys():
            for name, sds in sizes_ratios.estimate_centre_sds(person).items():
                centre = results.EstimatedCentre(person.centres[name].source, body.to_vector(sds))
                found.setdefault(name, centre)
    return found


def _write_notes(
    model: body.BodyModel,
    ratios: sizes_ratios.Ratios,
    sizes: abc.Mapping[str, results.SegmentSize],
    subject: subjects.Subject,
) -> abc.Sequence[str]:
    notes = []
    for measurement in dict.fromkeys(ratios.measurements):
        taken, all_pairs = ratios.measurements.count(measurement), len(measurement.pairs)
        if taken < all_pairs:
            own = [s for s in model.segment_names if model.bone_of(s) in measurement.segments]
            notes.append(f"MB: {', '.join(map(say_name, own))} measured on {taken} of {all_pairs} distances")
    known = [
        name
        for name, value in (("stature", subject.height_m), ("mass", subject.mass_kg), ("sex", subject.sex))
        if value is not None
    ]
    like = f"persons of this {', '.join(known)}" if known else "adults and children of any size"
    unmeasured = [
        name for name, size in sizes.items() if not size.own and find_dimension(model.bone_of(name))
    ]
    if unmeasured:
        notes.append(
            f"MB: {say_names(unmeasured)}: not measured; the size is that of {like}, as far as the other "
            f"segments allow (standard deviation {format_percent([sizes[n].sd for n in unmeasured])})"
        )
    following = [name for name in sizes if find_dimension(model.bone_of(name)) is None]
    if following:
        notes.append(
            f"MB: {say_names(following)}: scaled as the segment that carries it, for nothing else is known"
        )
    return notes


def format_percent(sds: abc.Sequence[float]) -> str:
    """The range of some relative deviations."""
    low, high = (f"{100.0 * sd:.0f}" for sd in (min(sds), max(sds)))
    return f"{low} %" if low == high else f"{low} to {high} %"


def check_factor(factor: float, segment: str) -> None:
    """Refuse a factor that is no person's (TrialUnusable)."""
    if not _SMALLEST < factor < 1.0 / _SMALLEST:
        raise TrialUnusable(
            f"segment '{segment}' would be scaled by {factor:.3g}",
            field="markers",
            remedy="Check the unit of the recording and that the labels mean the right landmarks",
        )
