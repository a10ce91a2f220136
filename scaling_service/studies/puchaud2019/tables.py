"""The tables and figures of Puchaud et al. 2019, cell by cell, with a cohort's numbers beside them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from scaling_service.capabilities.cohort.groups import ScalarComparison
from scaling_service.capabilities.cohort.statistics import CohortStatistics
from scaling_service.studies.puchaud2019.paper import AXES, LENGTHS, METHODS, Spread, paper


@dataclass(frozen=True, slots=True)
class Cell:
    """One mean of the paper beside ours, m or rad."""

    quantity: str
    method: str
    paper: Spread | None  # None where the paper gives no number
    ours: Spread
    stars: str = ""  # the paper's mark of a difference from EB
    p_from_EB: float | None = None  # ours, by Tukey's HSD; None where it was not tested
    significant: bool | None = None  # after Friedman's test


def lengths(cohort: CohortStatistics) -> Iterator[Cell]:
    """Table 2."""
    known = paper()
    for name in LENGTHS:
        found = cohort.scalar("segment_length", name)
        for method in METHODS:
            stars = known.differs_from_EB.get(method, {}).get(name, "")
            yield _against_image(found, method, known.lengths[method][name], stars)


def knee_axes(cohort: CohortStatistics) -> Iterator[Cell]:
    """Table 3."""
    for method, row in paper().knee_axes.items():
        for name in AXES:
            yield _cell(cohort.scalar("knee_axis", name), method, row[name])


def errors(cohort: CohortStatistics) -> Iterator[Cell]:
    """Figure 5, of which table 5 repeats some means."""
    found = cohort.scalar("kinematic_error", "calibration")
    return (_against_image(found, method, paper().errors[method]) for method in METHODS)


def length_differences(cohort: CohortStatistics) -> Iterator[Cell]:
    """Figure 4: method minus EB."""
    for method in ("MB", "MB_lam"):
        for name in LENGTHS:
            values = cohort.scalar("segment_length", name).values
            gaps = np.array([of[method] - of["EB"] for of in values.values()])
            ours = Spread(float(gaps.mean()), float(gaps.std(ddof=1)))
            yield Cell(name, method, paper().length_differences[method].get(name), ours)


def marker_shifts(cohort: CohortStatistics) -> Iterator[Cell]:
    """Section 3.1. The paper's scatter is over coordinates, ours over subjects."""
    found = cohort.scalar("marker_shift", "mean_over_markers")
    return (_cell(found, method, spread) for method, spread in paper().shifts.items())


def _cell(found: ScalarComparison, method: str, theirs: Spread | None) -> Cell:
    return Cell(found.quantity, method, theirs, Spread(found.mean[method], found.sd[method]))


def _against_image(found: ScalarComparison, method: str, theirs: Spread, stars: str = "") -> Cell:
    plain = _cell(found, method, theirs)
    if method == "EB" or found.test is None:
        return plain
    pair = found.test.pair(method, "EB")
    return Cell(plain.quantity, method, plain.paper, plain.ours, stars, pair.p, pair.significant)


def p_of_friedman(cohort: CohortStatistics) -> Mapping[str, float]:
    """Length to the p of Friedman's test; those that were not tested are not there."""
    tests = {name: cohort.scalar("segment_length", name).test for name in LENGTHS}
    return {name: test.p for name, test in tests.items() if test is not None}
