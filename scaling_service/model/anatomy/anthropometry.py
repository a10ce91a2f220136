"""What is known of a person's dimensions before anything is measured: sizes given stature, mass, sex and age.

Body measures of ANSUR II, and lengths between joint centres that follow from them by stated offsets, are
jointly Gaussian in their logarithms, so that measuring some tells of others. Children have the proportions of
their stature. The numbers and their sources are in ``reference_models``: ``anthropometry_ansur2.yaml``,
``anthropometry_lengths.yaml``.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from functools import cache
from itertools import product
from types import MappingProxyType
from typing import Any

import numpy as np

from scaling_service.core.arrays import Array
from scaling_service.core.errors import InputError
from scaling_service.model import reference
from scaling_service.model.inertia import Sex

GROWING_YEARS = (14.0, 18.0)
"""Until the first age a child's proportions hold, from the second on an adult's; mixed between (chosen)."""

STATED_SD: Mapping[str, float] = MappingProxyType({"stature": 0.006, "mass": 0.02})
"""Relative standard deviation of stature and mass measured on the day (chosen: 10 mm, 1.4 kg)."""

MEASURED_SD = 0.006
"""Relative standard deviation of a size measured with tape or calliper (chosen: 5 mm of a leg)."""


@dataclasses.dataclass(frozen=True, slots=True)
class LandmarkSize:
    """A distance between landmarks by measures of the body, and its doubt by where markers sit; m."""

    ends: tuple[str, str]
    terms: Mapping[str, float]
    offset_m: float
    sd_m: float
    _: dataclasses.KW_ONLY
    at_most: bool = False  # a bound that posture falls short of


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class DimensionPrior:
    """Gaussian distribution of the logarithms of a person's dimensions.

    Examples
    --------
    >>> alike = np.array([[0.0025, 0.0024], [0.0024, 0.0025]])
    >>> legs = DimensionPrior(("shank_r", "shank_l"), np.log([0.40, 0.40]), alike)
    >>> known = legs.condition({"shank_r": (0.42, 0.002)})
    >>> f"{legs.sd('shank_l'):.3f} {known.value('shank_l'):.3f} {known.sd('shank_l'):.3f}"
    '0.020 0.419 0.006'
    """

    names: tuple[str, ...]
    mean: Array  # (n,): of log(m); of log(kg) for mass
    covariance: Array  # (n, n): of the logarithms; positive definite

    def value(self, name: str) -> float:
        """Median of a dimension, m (kg for ``mass``)."""
        return float(np.exp(self.mean[self._index(name)]))

    def sd(self, name: str) -> float:
        """Standard deviation of a dimension to first order, m (kg for ``mass``)."""
        i = self._index(name)
        return self.value(name) * float(np.sqrt(self.covariance[i, i]))

    def select(self, names: tuple[str, ...]) -> DimensionPrior:
        """The joint distribution of some of the dimensions, in the order given."""
        rows = [self._index(name) for name in names]
        return DimensionPrior(names, self.mean[rows], self.covariance[np.ix_(rows, rows)])

    def condition(self, measured: Mapping[str, tuple[float, float]]) -> DimensionPrior:
        """What is known once some dimensions were measured; exact for Gaussian logarithms.

        ``measured``: dimension to (value, standard deviation), m (kg for ``mass``); independent errors.
        InputError: there is no such dimension, or value or standard deviation is not a positive number.
        """
        return self.weigh(measured)[0]

    def weigh(self, measured: Mapping[str, tuple[float, float]]) -> tuple[DimensionPrior, float]:
        """Condition, and say how well the distribution had foreseen what was measured.

        Returns what :meth:`condition` does, and the logarithm of the density of the measured logarithms.
        """
        if not measured:
            return self, 0.0
        for name, pair in measured.items():
            if not all(0.0 < number < np.inf for number in pair):
                raise InputError(
                    f"{pair[0]:g} with standard deviation {pair[1]:g} is no size",
                    field=name,
                    remedy="Give both in m (mass in kg), above zero",
                )
        rows = [self._index(name) for name in measured]
        values, sds = np.array(list(measured.values())).T
        innovation = self.covariance[np.ix_(rows, rows)] + np.diag((sds / values) ** 2)
        surprise = np.log(values) - self.mean[rows]
        gain = np.linalg.solve(innovation, self.covariance[rows]).T
        kept = np.eye(len(self.names))
        kept[:, rows] -= gain
        noise = gain * (sds / values)
        covariance = (
            kept @ self.covariance @ kept.T + noise @ noise.T
        )  # Joseph's form: stays positive definite
        evidence = -0.5 * (
            surprise @ np.linalg.solve(innovation, surprise) + np.linalg.slogdet(2.0 * np.pi * innovation)[1]
        )
        return DimensionPrior(self.names, self.mean + gain @ surprise, covariance), float(evidence)

    def _index(self, name: str) -> int:
        if name not in self.names:
            raise InputError(
                f"there is no dimension '{name}'", field=name, remedy=f"There are {', '.join(self.names)}"
            )
        return self.names.index(name)


def predict_dimensions(
    *,
    sex: Sex | None,
    height_m: float | None,
    mass_kg: float | None,
    age_years: float | None = None,
    sizes: Mapping[str, float | tuple[float, float]] | None = None,
    stated_sd: Mapping[str, float] = STATED_SD,
) -> DimensionPrior:
    """Dimensions to expect of a person of whom some or none of these are known.

    ``sex``: unknown: the mixture of both by how well they explain what is known, with its mean and
        covariance.
    ``height_m``, ``mass_kg``: unknown ones are the public's (or children's of the age), not soldiers'.
    ``age_years``: below 14 a child's proportions are taken, from 18 on an adult's, between them their
        mixture. Unknown: adult and child are mixed by how well they explain what is known.
    ``sizes``: measured dimensions, m, alone or with their standard deviation.
    ``stated_sd``: relative standard deviation of ``stature`` and ``mass`` as given.
    Measures of the body (``stature``, ``mass``, ``trochanterion_height`` …), lengths without side
        (``inter_hip``, ``trunk`` …) and with ``_r`` and ``_l`` (``femur_r``, ``shank_l`` …).
    Raises InputError: a size is unknown or not positive.

    Offsets turn heights of landmarks into joint centres, to first order about the person's expected measures.
    The population is American: soldiers of 2012 for proportions, citizens for stature and mass.

    Examples
    --------
    >>> man = predict_dimensions(sex="M", height_m=1.76, mass_kg=75.0)
    >>> f"{man.value('femur_r'):.3f} {man.sd('femur_r'):.3f}"
    '0.427 0.022'
    """
    declared = {"stature": height_m, "mass": mass_kg}
    known = {n: (v, v * stated_sd[n]) for n, v in declared.items() if v is not None}
    measured = {
        name: size if isinstance(size, tuple) else (size, MEASURED_SD * size)
        for name, size in (sizes or {}).items()
    }
    sexes: tuple[Sex, ...] = ("F", "M") if sex is None else (sex,)
    share = _read_rules()["children"]["share"]
    if age_years is not None:
        share = float(np.interp(age_years, GROWING_YEARS, (1.0, 0.0)))
    parts: list[DimensionPrior] = []
    scores: list[float] = []
    for one, child in product(sexes, (False, True)):
        weight = share if child else 1.0 - share
        if weight == 0.0:
            continue
        people = _estimate_children(one, height_m, age_years) if child else _estimate_adults(one)
        body, of_body = people.weigh(known)
        whole, of_sizes = _with_lengths(body, one, child).weigh(measured)
        parts.append(whole)
        scores.append(np.log(weight) + of_body + of_sizes)
    # The Gaussian with the mean and covariance of the mixture
    weights = np.exp(np.array(scores) - max(scores))
    weights = weights / weights.sum()
    means = np.array([part.mean for part in parts])
    mean = weights @ means
    apart = np.sqrt(weights)[:, None] * (means - mean)
    within = sum(w * part.covariance for w, part in zip(weights, parts, strict=True))
    return DimensionPrior(parts[0].names, mean, within + apart.T @ apart)


def read_soldiers(sex: Sex) -> DimensionPrior:
    """The body measures of ANSUR II's soldiers of a sex, without lengths between joint centres."""
    table = _read_statistics()
    entry = table[sex]
    n = len(table["names"])
    correlation = np.eye(n)
    correlation[np.tril_indices(n, -1)] = [value for row in entry["correlation"] for value in row]
    correlation = correlation + correlation.T - np.eye(n)
    spread = np.array(entry["spread"])
    return DimensionPrior(
        tuple(table["names"]), np.array(entry["mean"]), spread[:, None] * correlation * spread
    )


def _estimate_adults(sex: Sex) -> DimensionPrior:
    """The soldiers' proportions with the public's stature and mass."""
    army, public = read_soldiers(sex), _read_rules()["public"][sex]
    slopes, rest = _regress(army)
    spread = np.array(public["spread"])
    within = np.diag(spread**2) + public["correlation"] * np.prod(spread) * np.array([[0, 1], [1, 0]])
    shift = np.log([public["stature"], public["mass"]]) - army.mean[:2]
    return DimensionPrior(army.names, army.mean + slopes @ shift, rest + slopes @ within @ slopes.T)


def _estimate_children(sex: Sex, height_m: float | None, age_years: float | None) -> DimensionPrior:
    """Children's measures: proportions by stature, spread as adults' and wider."""
    rules, army = _read_rules()["children"], read_soldiers(sex)
    if age_years is None:
        middle, spread = np.log(rules["unknown_age"]["stature"]), rules["unknown_age"]["spread"]
    else:
        middle = np.interp(age_years, rules["age_years"], np.log(rules["stature"][sex]))
        spread = rules["stature_spread"]
    about = middle if height_m is None else np.log(height_m)
    exponents = np.array([rules["growth"].get(name, (1.0, 1.0)) for name in army.names])
    turn, mass = np.log(rules["turn_m"]), rules["mass"]
    below, above = min(about - turn, 0.0), max(about, turn) - army.mean[0]
    line = army.mean + exponents @ np.array([below, above])
    line[1] = np.log(mass["at_1_5_m"]) + mass["exponent"] * (about - turn)
    along = exponents[:, 0 if about < turn else 1].copy()
    along[1] = mass["exponent"]
    slopes, rest = _regress(army)
    trend = rules["trend_spread"] * (exponents - 1.0) @ np.array([below, above])
    covariance = (
        rules["widened"] * rest
        + np.outer(trend, trend)
        + np.outer(along, along) * spread**2
        + np.outer(slopes[:, 1], slopes[:, 1]) * mass["spread"] ** 2
    )
    return DimensionPrior(army.names, line + along * (middle - about), covariance)


def _regress(army: DimensionPrior) -> tuple[Array, Array]:
    """Slopes of all measures on log stature and log mass, shape (n, 2), and the covariance that is left."""
    slopes = np.linalg.solve(army.covariance[:2, :2], army.covariance[:2]).T
    return np.asarray(slopes, float), army.covariance - slopes @ army.covariance[:2]


def _with_lengths(body: DimensionPrior, sex: Sex, child: bool) -> DimensionPrior:
    """Add the lengths between joint centres, linearised about the mean, and their sides."""
    rules = _read_rules()
    offsets, lengths = rules["offsets"], rules["lengths"]
    usual, spread = np.array([(offset[sex], offset["spread"]) for offset in offsets.values()]).T
    for name, offset in rules["children"]["offsets"].items() if child else ():
        place = list(offsets).index(name)
        usual[place], spread[place] = offset["mean"], offset["spread"]
    of_offsets = np.array([[terms.get(o, 0.0) for o in offsets] for terms in lengths.values()])
    of_measures = np.array([[terms.get(m, 0.0) for m in body.names] for terms in lengths.values()])
    of_measures[:, 0] += of_offsets @ usual
    parts = of_measures * np.exp(body.mean)
    size = parts.sum(axis=1)
    relative = np.exp(body.mean[0]) / size[:, None] * of_offsets * spread
    own = relative @ relative.T + np.diag([terms["own"] ** 2 for terms in lengths.values()])
    palpation = np.array([rules["palpation"].get(m, 0.0) for m in body.names])
    palpated = np.diag((palpation * np.exp(body.mean[0] - body.mean)) ** 2)

    names, copies, unlike = _open_sides()
    k = len(body.names)
    loads = np.vstack([np.eye(k), copies @ (parts / size[:, None])])
    covariance = loads @ (body.covariance - palpated) @ loads.T
    covariance[:k, :k] = body.covariance
    covariance[k:, k:] += copies @ own @ copies.T + unlike @ unlike.T
    return DimensionPrior(body.names + names, np.concatenate([body.mean, copies @ np.log(size)]), covariance)


@cache
def _open_sides() -> tuple[tuple[str, ...], Array, Array]:
    """Names with sides; which length each is, and half its asymmetry, shapes (n_names, n_lengths)."""
    lengths, sides = list(_read_rules()["lengths"]), _read_rules()["sides"]
    names, copies, unlike = [], [], []
    for length, row in zip(lengths, np.eye(len(lengths)), strict=True):
        for suffix, half in (("_r", 0.5), ("_l", -0.5)) if length in sides else (("", 0.0),):
            names.append(length + suffix)
            copies.append(row)
            unlike.append(half * sides.get(length, 0.0) * row)
    return tuple(names), np.array(copies), np.array(unlike)


@cache
def _read_statistics() -> Any:
    return reference.read_reference(reference.find_reference_folder() / "anthropometry_ansur2.yaml")


@cache
def _read_rules() -> Any:
    return reference.read_reference(reference.find_reference_folder() / "anthropometry_lengths.yaml")
