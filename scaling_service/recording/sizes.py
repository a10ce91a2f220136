"""Whether distances between landmarks can be a person's, each and all together."""

from __future__ import annotations

from collections import abc
from dataclasses import dataclass, replace
from functools import cache
from itertools import pairwise

import numpy as np

from scaling_service.core.arrays import Array
from scaling_service.model import reference
from scaling_service.model.anatomy import anthropometry
from scaling_service.model.trial import Trial
from scaling_service.recording import findings, witnesses

DEVIATIONS = 5.0
"""Beyond which a size is not a person's: of ANSUR II's soldiers and children by stature, see
``predict_dimensions``, the doubt about where a marker sits included."""

DOUBTFUL = 2.5
"""Deviations of the common scale from which on it is asked about (chosen: one sound session in eighty)."""

MISSTATED = 0.04
"""Relative standard deviation of a stated height that is wrong (chosen: 70 mm; last year's child, shoes, a
slip of the pen): what only contradicts the height is asked about and not refused."""

_UPRIGHT = np.cos(np.radians(15.0))  # chosen: thighs, shanks and trunk of somebody who stands lean less

_REACHES: abc.Mapping[str, float] = {
    "head": 0.20, "trunk": 0.33, "arm": 0.50, "pelvis": 0.25, "thigh": 0.33, "shank": 0.28, "foot": 0.22
}  # fmt: skip
"""How far apart two markers of a part of the body may be, over stature (chosen: a quarter more than the
farthest of twelve persons, clusters and wands included)."""

_TALLEST_M = 2.1  # chosen: of a person whose height is not known


def ask_sizes(
    trials: abc.Sequence[Trial], static: str | None, stated: findings.Stated
) -> abc.Iterator[findings.Finding]:
    """Whether mass and height can be one person's, and distances between landmarks; trials with Y up."""
    people = anthropometry.predict_dimensions(
        sex=stated.sex, height_m=stated.height_m, mass_kg=stated.mass_kg
    )
    if stated.height_m is not None and stated.mass_kg is not None:
        alike = anthropometry.predict_dimensions(sex=stated.sex, height_m=stated.height_m, mass_kg=None)
        usual, spread = alike.value("mass"), alike.sd("mass") / alike.value("mass")
        off = np.log(stated.mass_kg / usual) / spread
        if abs(off) > DEVIATIONS:
            yield findings.Finding(
                code="mass",
                problem=f"{stated.mass_kg:g} kg are stated, and persons of {stated.height_m:.2f} m weigh "
                f"{usual:.0f} kg: {abs(off):.1f} standard deviations off",
                remedy="Give the mass in kg and the height in m, both of this person",
            )
    for trial in trials:
        found = list(_ask_sizes_of(trial, people, stated, standing=trial.name == static))
        yield from found or _ask_reaches(trial, stated)


def _ask_reaches(trial: Trial, stated: findings.Stated) -> abc.Iterator[findings.Finding]:
    """Whether a label is on another segment than its name says."""
    distances = witnesses.measure_within_segments(trial, findings.list_roles(trial))
    tall = (stated.height_m or _TALLEST_M) * (1.0 + MISSTATED)
    far = {ends: size for ends, size in distances.items() if size > tall * _REACHES[ends[0].split()[0]]}
    labels = [label for _, *ends in far for label in ends]
    if not labels:
        return
    worst = max(dict.fromkeys(labels), key=labels.count)
    (segment, *ends), size = max(((e, s) for e, s in far.items() if worst in e), key=lambda item: item[1])
    (other,) = {*ends} - {worst}
    part = segment.replace(" R", " on the right").replace(" L", " on the left")
    yield findings.Finding(
        code="length",
        place=trial.name,
        severity="refusal",
        labels=(worst, other),
        problem=f"{worst} and {other} are {1e3 * size:.0f} mm apart, both by their names on the {part}, "
        f"where two markers are at most {1e3 * tall * _REACHES[segment.split()[0]]:.0f} mm apart",
        remedy=f"Correct the labels: {worst} looks like another place's or another person's",
    )


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class _Measured:
    """A size of a recording beside a person's."""

    labels: tuple[str, ...]
    size_m: float
    usual_m: float
    slopes: Array  # (n_dimensions,): of its logarithm on those of the measures
    sd_m: float
    at_most: bool


@cache
def _read_sizes() -> abc.Mapping[str, abc.Sequence[anthropometry.LandmarkSize]]:
    """Sizes on either side, across the body, and of who stands upright."""
    table = reference.read_reference(reference.find_reference_folder() / "landmark_sizes.yaml")
    sizes = {
        kind: [anthropometry.LandmarkSize(**{**row, "ends": tuple(row["ends"])}) for row in rows]
        for kind, rows in table.items()
    }
    sides = (
        replace(size, ends=(side + size.ends[0], side + size.ends[1]))
        for size in sizes["sides"]
        for side in "RL"
    )
    return sizes | {"sides": [*sides]}


def _measure_sizes(
    trial: Trial, people: anthropometry.DimensionPrior, *, standing: bool
) -> abc.Iterator[_Measured]:
    step = max(1, trial.n_frames // witnesses.FRAMES)
    where = {
        role: (label, trial.position(label)[::step]) for label, role in findings.list_roles(trial).items()
    }
    sizes = _read_sizes()
    for size in (*sizes["sides"], *sizes["across"]):
        if all(end in where for end in size.ends):
            (a, one), (b, other) = (where[end] for end in size.ends)
            found = _compare(size, (a, b), np.linalg.norm(one - other, axis=1), people)
            if found is not None:
                yield found
    if standing and _is_upright({role: at for role, (_, at) in where.items()}):
        for size in sizes["standing"]:
            high, low = ([end] if end in where else [f"R{end}", f"L{end}"] for end in size.ends)
            if all(end in where for end in (*high, *low)):
                heights = [np.mean([where[end][1][:, 1] for end in ends], axis=0) for ends in (high, low)]
                found = _compare(size, tuple(where[end][0] for end in high), heights[0] - heights[1], people)
                if found is not None:
                    yield found


def _is_upright(where: abc.Mapping[str, Array]) -> bool:
    """Whether legs and trunk are upright, as far as they are known; Y up."""
    middles = [
        np.mean([where[f"{side}{name}"] for side in "RL"], axis=0)
        for name in ("LM", "LFE", "ASIS", "SHO")
        if all(f"{side}{name}" in where for side in "RL")
    ]
    rises = [np.nanmean(high - low, axis=0) for low, high in pairwise(middles)]
    return len(rises) > 1 and all(rise[1] > _UPRIGHT * np.linalg.norm(rise) for rise in rises)


def _compare(
    size: anthropometry.LandmarkSize,
    labels: tuple[str, ...],
    values: Array,
    people: anthropometry.DimensionPrior,
) -> _Measured | None:
    known = values[np.isfinite(values)]
    if not len(known) or np.median(known) <= 0.0:
        return None
    terms = {name if name in people.names else f"{name}_r": share for name, share in size.terms.items()}
    usual = size.offset_m + sum(share * people.value(name) for name, share in terms.items())
    slopes = np.zeros(len(people.names))
    for name, share in terms.items():
        slopes[people.names.index(name)] += share * people.value(name) / usual
    return _Measured(
        labels=labels,
        size_m=float(np.median(known)),
        usual_m=usual,
        slopes=slopes,
        sd_m=size.sd_m,
        at_most=size.at_most,
    )


def _ask_sizes_of(
    trial: Trial, people: anthropometry.DimensionPrior, stated: findings.Stated, *, standing: bool
) -> abc.Iterator[findings.Finding]:
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
    if stated.height_m is None:
        prior = "of unknown height, child or adult"
    else:
        kind = "by a child's or an adult's proportions" if stated.height_m < 1.5 else "by ANSUR II"
        prior = f"of {stated.height_m:.2f} m, {kind}"
    doubt = float(np.hypot(sd, misstated))
    wrong = [
        k for k, z in enumerate(deviations) if abs(z) > DEVIATIONS and not (found[k].at_most and z < 0.0)
    ]
    # A few that are wrong are labels; all of them are the scale.
    if wrong and 2 * len(set(wrong) & set(exact)) < len(exact):
        worst = max(wrong, key=lambda k: abs(deviations[k]))
        names = " and ".join(found[worst].labels)
        bound = "at most " if found[worst].at_most else ""
        yield findings.Finding(
            code="length",
            place=trial.name,
            severity="refusal",
            labels=found[worst].labels,
            problem=f"{names} are {1e3 * size[worst]:.0f} mm apart, and those of a person {prior} {bound}"
            f"{1e3 * usual[worst]:.0f} mm: {abs(deviations[worst]):.0f} standard deviations off",
            remedy="Correct the labels, one of them is of another place or person; or the person's height",
        )
    elif wrong or abs(scale) > DEVIATIONS * doubt:
        yield findings.Finding(
            code="scale",
            place=trial.name,
            severity="refusal",
            problem=f"on the whole its lengths are {np.exp(scale):.3g} times those of a person {prior}, "
            f"{abs(scale) / doubt:.1f} standard deviations off",
            remedy="Correct the recording's unit, the calibration of its volume, its labels or the person's "
            "height",
        )
    elif stated.height_m is not None and abs(scale) > DOUBTFUL * sd:
        change = f"{abs(np.expm1(scale)):.0%} {'larger' if scale > 0 else 'smaller'}"
        yield findings.Finding(
            code="scale",
            place=trial.name,
            problem=f"on the whole its lengths are {change} than those of a person {prior}, "
            f"{abs(scale) / sd:.1f} standard deviations off",
            remedy="Check the person's height and the calibration of the volume",
        )
