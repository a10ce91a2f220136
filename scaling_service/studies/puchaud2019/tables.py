"""The tables and figures of Puchaud et al. 2019, cell by cell, with a cohort's numbers beside them."""

from __future__ import annotations

import math

import numpy as np

from scaling_service.capabilities.cohort.groups import ScalarComparison
from scaling_service.capabilities.cohort.statistics import CohortStatistics
from scaling_service.studies.puchaud2019.document import Beside
from scaling_service.studies.puchaud2019.paper import AXES, LENGTHS, METHODS, Spread, paper

_MM, _DEG = 1e3, 180.0 / math.pi


def lengths(cohort: CohortStatistics) -> list[Beside]:
    """Table 2, mm."""
    known = paper()
    return [
        _against_image(
            cohort.scalar("segment_length", name),
            method,
            known.lengths[method][name],
            known.differs_from_EB.get(method, {}).get(name, ""),
        )
        for name in LENGTHS
        for method in METHODS
    ]


def knee_axes(cohort: CohortStatistics) -> list[Beside]:
    """Table 3, degrees."""
    return [
        _cell(cohort.scalar("knee_axis", name), method, row[name], _DEG)
        for method, row in paper().knee_axes.items()
        for name in AXES
    ]


def errors(cohort: CohortStatistics) -> list[Beside]:
    """Figure 5, of which table 5 repeats some means, mm."""
    found = cohort.scalar("kinematic_error", "calibration")
    return [_against_image(found, method, paper().errors[method]) for method in METHODS]


def length_differences(cohort: CohortStatistics) -> list[Beside]:
    """Figure 4: method minus EB, mm."""
    cells = []
    for method in ("MB", "MB_lam"):
        for name in LENGTHS:
            values = cohort.scalar("segment_length", name).values
            gaps = np.array([of[method] - of["EB"] for of in values.values()])
            ours = Spread(float(gaps.mean()), float(gaps.std(ddof=1)))
            cells.append(_beside(name, method, paper().length_differences[method].get(name), ours, _MM))
    return cells


def marker_shifts(cohort: CohortStatistics) -> list[Beside]:
    """Section 3.1, mm. The paper's scatter is over coordinates, ours over subjects."""
    found = cohort.scalar("marker_shift", "mean_over_markers")
    return [_cell(found, method, spread, _MM) for method, spread in paper().shifts.items()]


def _cell(found: ScalarComparison, method: str, theirs: Spread, unit: float) -> Beside:
    return _beside(found.quantity, method, theirs, Spread(found.mean[method], found.sd[method]), unit)


def _beside(quantity: str, method: str, theirs: Spread | None, ours: Spread, unit: float) -> Beside:
    return Beside(
        quantity=quantity,
        method=method,
        paper_mean=None if theirs is None else unit * theirs.mean,
        paper_sd=None if theirs is None else unit * theirs.sd,
        mean=unit * ours.mean,
        sd=unit * ours.sd,
    )


def _against_image(found: ScalarComparison, method: str, theirs: Spread, stars: str = "") -> Beside:
    plain = _cell(found, method, theirs, _MM)
    if method == "EB" or found.test is None:
        return plain
    pair = found.test.pair(method, "EB")
    tested = {"paper_stars": stars, "p_from_EB": pair.p, "significant": pair.significant}
    return plain.model_copy(update=tested)
