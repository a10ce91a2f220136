"""From recordings to the factor of every segment: points, distances, estimate, and what to tell of them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from scaling_service.capabilities.scaling.methods.functional import FunctionalJoints
from scaling_service.capabilities.scaling.methods.per_axis import per_axis
from scaling_service.capabilities.scaling.sizes.measured import Ratios, centre_sds, measure_ratios
from scaling_service.capabilities.scaling.sizes.points import (
    PersonPoints,
    model_points,
    person_points,
    read_landmarks,
    standing_leg_lengths,
)
from scaling_service.capabilities.scaling.sizes.segment_sizes import (
    dimension_of,
    estimate_sizes,
    expect_dimensions,
)
from scaling_service.capabilities.subject.settings import CalibrationSettings
from scaling_service.core.errors import TrialUnusable
from scaling_service.core.text import few
from scaling_service.model.anatomy.anthropometry import DimensionPrior
from scaling_service.model.anatomy.centres import ADULT_STATURE_M, MARKER_RADIUS_M, BodySizes, Size, size_sd
from scaling_service.model.body import BodyModel, Vector
from scaling_service.model.results import EstimatedCentre, SegmentSize
from scaling_service.model.subject import Session, Subject

_SMALLEST = 0.2  # chosen: a newborn is 0.29 of an adult's stature; beyond this a unit or a label is wrong


@dataclass(frozen=True, slots=True, eq=False)
class Sizing:
    """Factors of all segments, and how they came about.

    Parameters
    ----------
    factors : mapping
        Segment to its x, y, z factors.
    sizes : mapping
        Segment to its estimate.
    centres : mapping
        ``hip_r`` … to how the first recording that shows it gave the person's joint centre.
    people : tuple of PersonPoints
        The recordings' points, the best first.
    notes : tuple of str
    """

    factors: Mapping[str, Vector]
    sizes: Mapping[str, SegmentSize]
    centres: Mapping[str, EstimatedCentre]
    people: tuple[PersonPoints, ...]
    notes: tuple[str, ...]


def size_segments(
    session: Session, settings: CalibrationSettings, joints: FunctionalJoints | None = None
) -> Sizing:
    """Factors of each segment from landmarks and anthropometry: one, or one along each axis.

    Each distance is taken on the first trial that shows both of its ends, the static trial before movements.

    Parameters
    ----------
    joints : FunctionalJoints, optional
        Hip centres that take the regression's place.

    Raises
    ------
    TrialUnusable
        Nothing could be measured, or a size is no person's.
    """
    subject, model = session.subject, session.model
    prior = expect_dimensions(subject)
    scale = prior.value("stature") / ADULT_STATURE_M
    people = _people(session, settings, body_sizes(session, prior), joints, scale)
    ours = model_points(model)
    weighted = settings.sizes == "weighted"
    ratios = measure_ratios(people, ours, model.segment_names, besides=weighted)
    if not len(ratios.logs):
        raise TrialUnusable(
            "no segment could be measured: the landmarks of the pelvis, knees and ankles are not all there",
            field="markers",
            remedy="Map the labels of ASIS, PSIS, epicondyles and malleoli under `markers:`",
        )
    for measurement, log in zip(ratios.measurements, ratios.logs, strict=True):
        _check(float(np.exp(log)), next(s for s in measurement.segments if s in model.segment_names))
    sizes = estimate_sizes(model, ratios, prior, weighted=weighted)
    factors: dict[str, Vector] = {name: (size.factor,) * 3 for name, size in sizes.items()}
    notes = [*_notes(model, ratios, sizes, subject)]
    if settings.scaling == "per-axis":
        factors, more = per_axis(factors, [person.points for person in people], ours)
        notes.extend(more)
    for segment, along in factors.items():
        for factor in along:
            _check(factor, segment)
    return Sizing(factors, sizes, _centres(people), people, tuple(notes))


def body_sizes(session: Session, prior: DimensionPrior) -> BodySizes:
    """Sizes as measured, else as the other side's, else as of persons like this one."""
    measured = session.subject.sizes_m
    widths: dict[str, tuple[Size, float]] = {}
    for joint in ("knee", "ankle"):
        for side, other in ("rl", "lr"):
            name = f"{joint}_width"
            own = measured.get(f"{name}_{side}", measured.get(f"{name}_{other}"))
            expected = f"{name}_{side}"
            widths[f"{joint}_{side}"] = (
                (prior.value(expected), prior.sd(expected)) if own is None else (own, size_sd(name, own))
            )
    legs = {side: measured[f"leg_length_{side}"] for side in "rl" if f"leg_length_{side}" in measured}
    diameter = measured.get("marker_diameter", 2.0 * MARKER_RADIUS_M)
    sizes = BodySizes(widths, legs, diameter / 2.0)
    if session.static is None:
        return sizes
    return sizes.with_leg_lengths(standing_leg_lengths(read_landmarks(session.static)))


def _people(
    session: Session,
    settings: CalibrationSettings,
    sizes: BodySizes,
    joints: FunctionalJoints | None,
    scale: float,
) -> tuple[PersonPoints, ...]:
    static = () if session.static is None else (session.static,)
    return tuple(
        person_points(
            trial,
            standing=trial is session.static,
            regression=settings.hip_regression,
            sizes=sizes,
            joints=joints,
            scale=scale,
        )
        for trial in (*static, *session.calibration)
    )


def _centres(people: Sequence[PersonPoints]) -> dict[str, EstimatedCentre]:
    found: dict[str, EstimatedCentre] = {}
    for person in people:
        missing = [name for name in person.centres if name not in found]
        sds = centre_sds(person) if missing else {}
        for name in missing:
            if name in sds:
                x, y, z = (float(v) for v in sds[name])
                found[name] = EstimatedCentre(person.centres[name].source, (x, y, z))
    return found


def _notes(
    model: BodyModel, ratios: Ratios, sizes: Mapping[str, SegmentSize], subject: Subject
) -> Sequence[str]:
    notes = []
    for measurement in dict.fromkeys(ratios.measurements):
        taken, all_pairs = ratios.measurements.count(measurement), len(measurement.pairs)
        if taken < all_pairs:
            own = [s for s in measurement.segments if s in model.segment_names]
            notes.append(f"MB: {', '.join(own)} measured on {taken} of {all_pairs} distances")
    known = [
        name
        for name, value in (("stature", subject.height_m), ("mass", subject.mass_kg), ("sex", subject.sex))
        if value is not None
    ]
    like = f"persons of this {', '.join(known)}" if known else "adults and children of any size"
    unmeasured = [name for name, size in sizes.items() if not size.own and dimension_of(name)]
    if unmeasured:
        notes.append(
            f"MB: {few(unmeasured)}: not measured; the size is that of {like}, as far as the other segments "
            f"allow (standard deviation {_percent([sizes[n].sd for n in unmeasured])})"
        )
    following = [name for name in sizes if dimension_of(name) is None]
    if following:
        notes.append(
            f"MB: {few(following)}: scaled as the segment that carries it, for nothing else is known"
        )
    return notes


def _percent(sds: Sequence[float]) -> str:
    low, high = (f"{100.0 * sd:.0f}" for sd in (min(sds), max(sds)))
    return f"{low} %" if low == high else f"{low} to {high} %"


def _check(factor: float, segment: str) -> None:
    if not _SMALLEST < factor < 1.0 / _SMALLEST:
        raise TrialUnusable(
            f"segment '{segment}' would be scaled by {factor:.3g}",
            field="markers",
            remedy="Check the unit of the recording and that the labels mean the right landmarks",
        )
