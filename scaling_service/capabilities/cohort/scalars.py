"""Single numbers of a cohort compared between methods: lengths, errors, axes, shifts, gaps to the truth."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from scaling_service.capabilities.cohort.groups import GroupComparison, compare_groups
from scaling_service.capabilities.cohort.subject_summary import MethodSummary, SubjectSummary
from scaling_service.numerics.statistics.complete import Panel, panels

Values = Mapping[str, Mapping[str, float]]
"""Subject to method to value."""


@dataclass(frozen=True, slots=True)
class ScalarComparison:
    """One number per subject and method, over a cohort.

    Parameters
    ----------
    kind : str
        A key of :data:`KINDS`.
    quantity : str
        ``femur_r``, ``evaluation`` …
    panel : Panel
        Whose values are counted.
    values : mapping
        Subject to method to value, of the panel: m or rad.
    mean, sd : mapping
        Method to the value over the panel's subjects (n - 1); ``sd`` is absent for a single subject.
    test : GroupComparison, optional
        Friedman's test with Tukey's HSD.
    note : str
        Why there is no test.
    """

    kind: str
    quantity: str
    panel: Panel
    values: Values
    mean: Mapping[str, float]
    sd: Mapping[str, float]
    test: GroupComparison | None
    note: str = ""


def _errors(method: MethodSummary) -> dict[str, float]:
    """Mean kinematic error over the trials of each role, every trial counting the same, m.

    Chosen: Puchaud 2019 defines the error of a trial, and does not say how trials are pooled.
    """
    by_role: dict[str, list[float]] = {}
    for trial in method.trials.values():
        if np.isfinite(trial.mean):
            by_role.setdefault(trial.role, []).append(trial.mean)
    return {role: float(np.mean(errors)) for role, errors in by_role.items()}


def _axes(method: MethodSummary) -> dict[str, float]:
    return {
        f"{side}_{axis}": turn
        for side, turns in method.knee_axes.items()
        for axis, turn in zip("xy", turns, strict=True)
    }


def _shift(method: MethodSummary) -> dict[str, float]:
    shifts = list(method.marker_shifts.values())
    return {"mean_over_markers": float(np.mean(shifts))} if shifts else {}


KINDS: Mapping[str, Callable[[MethodSummary], Mapping[str, float]]] = MappingProxyType(
    {
        "segment_length": lambda method: method.lengths,
        "kinematic_error": _errors,
        "knee_axis": _axes,
        "marker_shift": _shift,
        "from_truth_m": lambda method: method.from_truth_m,
        "from_truth_rad": lambda method: method.from_truth_rad,
    }
)
"""Kind of quantity to where a method's summary holds it; ``knee_axis`` and ``from_truth_rad`` are in rad, the
others in m."""


def compare_scalars(
    subjects: Sequence[SubjectSummary], methods: Sequence[str], alpha: float
) -> Iterator[ScalarComparison]:
    """Every quantity of every kind, over every panel that the cohort allows.

    Parameters
    ----------
    methods : sequence of str
        In the order to show.
    alpha : float
        Of each test; quantities are not corrected for each other, as in Puchaud 2019 (section 2.3).
    """
    for kind, read in KINDS.items():
        tables = {s.subject: {name: read(m) for name, m in s.methods.items()} for s in subjects}
        quantities = dict.fromkeys(
            q for by_method in tables.values() for of_method in by_method.values() for q in of_method
        )
        for quantity in quantities:
            table = {
                subject: {
                    m: of[quantity] for m, of in by_method.items() if np.isfinite(of.get(quantity, np.nan))
                }
                for subject, by_method in tables.items()
            }
            for panel in panels(table, methods):
                yield _compared(kind, quantity, panel, table, alpha)


def _compared(kind: str, quantity: str, panel: Panel, table: Values, alpha: float) -> ScalarComparison:
    values = {s: {m: table[s][m] for m in panel.methods} for s in panel.subjects}
    columns = {m: np.array([values[s][m] for s in panel.subjects]) for m in panel.methods}
    n = len(panel.subjects)
    note = too_few(panel)
    return ScalarComparison(
        kind=kind,
        quantity=quantity,
        panel=panel,
        values=values,
        mean={m: float(column.mean()) for m, column in columns.items()} if n else {},
        sd={m: float(column.std(ddof=1)) for m, column in columns.items()} if n > 1 else {},
        test=None if note else compare_groups(values, panel.methods, quantity=quantity, alpha=alpha),
        note=note,
    )


def too_few(panel: Panel) -> str:
    """Why a panel cannot be tested; empty where it can."""
    if len(panel.methods) < 2:
        return f"only {panel.methods[0]} gives a value: nothing to compare"
    if len(panel.subjects) < 2:
        count = len(panel.subjects)
        return f"{count} subject{'s' if count != 1 else ''} with all of {', '.join(panel.methods)}: no test"
    return ""
