"""Joint angles over the gait cycle of a cohort, compared between methods node by node."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from scaling_service.capabilities.cohort.scalars import too_few
from scaling_service.capabilities.cohort.subject_summary import SubjectSummary
from scaling_service.core.streams import stream
from scaling_service.model.results import Array
from scaling_service.numerics.statistics.complete import Panel, panels
from scaling_service.numerics.statistics.cycles import Curves
from scaling_service.numerics.statistics.waveforms import (
    WaveformComparison,
    WaveformSettings,
    compare_waveforms,
)

REFERENCES = ("EB_am", "MB_am")
"""What others are compared to: Puchaud 2019 (section 2.3) takes EB_am; where nobody was imaged, MB_am, which
the paper found to come nearest to it."""


@dataclass(frozen=True, slots=True, eq=False)
class CurveComparison:
    """One joint angle over the gait cycle, over a cohort.

    Parameters
    ----------
    coordinate : str
    panel : Panel
        Who walked and has all methods; the others with the reason.
    strides : mapping
        Subject to the number of strides behind its curve.
    reference : str, optional
        The method that pairs are tested against; None where neither of :data:`REFERENCES` is there, and all
        pairs are tested.
    mean, sd : mapping
        Method to its curve over subjects, (n_nodes,), rad; ``sd`` (n - 1) is empty for a single subject.
    test : WaveformComparison, optional
        Repeated-measures analysis of variance by permutation, and the pairs after it.
    note : str
        Why there is no test, or why it could not have found anything.
    """

    coordinate: str
    panel: Panel
    strides: Mapping[str, int]
    reference: str | None
    mean: Mapping[str, Array]
    sd: Mapping[str, Array]
    test: WaveformComparison | None
    note: str = ""


def compare_curves(
    subjects: Sequence[SubjectSummary],
    methods: Sequence[str],
    seed: int,
    settings: WaveformSettings | None = None,
) -> Iterator[CurveComparison]:
    """Every joint angle over every panel that the cohort allows.

    Parameters
    ----------
    seed : int
        Each comparison draws its rearrangements from a stream of its own, named after it.
    """
    coordinates = dict.fromkeys(c for s in subjects for m in s.methods.values() for c in m.curves)
    for coordinate in coordinates:
        has = {
            s.subject: [name for name, method in s.methods.items() if coordinate in method.curves]
            for s in subjects
        }
        for panel in panels(has, methods):
            rng = stream(seed, "cohort", "curves", coordinate, *panel.methods)
            yield _compared(coordinate, _explained(panel, coordinate, subjects), subjects, rng, settings)


def _explained(panel: Panel, coordinate: str, subjects: Sequence[SubjectSummary]) -> Panel:
    """The panel with the reason of those who did not walk."""
    side = coordinate.rpartition("_")[2]
    reasons = {s.subject: s.no_strides[side] for s in subjects if side in s.no_strides}
    return replace(panel, excluded={s: reasons.get(s, why) for s, why in panel.excluded.items()})


def _compared(
    coordinate: str,
    panel: Panel,
    subjects: Sequence[SubjectSummary],
    rng: np.random.Generator,
    settings: WaveformSettings | None,
) -> CurveComparison:
    counted = [s for s in subjects if s.subject in panel.subjects]
    values = np.array([[s.methods[m].curves[coordinate] for m in panel.methods] for s in counted])
    side = coordinate.rpartition("_")[2]
    reference = next((m for m in REFERENCES if m in panel.methods), None)
    note, test = too_few(panel), None
    if not note:
        curves = Curves(coordinate, tuple(s.subject for s in counted), panel.methods, values)
        test = compare_waveforms(curves, rng, reference=reference, settings=settings)
        note = _undecidable(test)
    return CurveComparison(
        coordinate=coordinate,
        panel=panel,
        strides={s.subject: s.strides[side] for s in counted},
        reference=reference,
        mean={m: values[:, k].mean(axis=0) for k, m in enumerate(panel.methods)} if counted else {},
        sd={m: values[:, k].std(axis=0, ddof=1) for k, m in enumerate(panel.methods)}
        if len(counted) > 1
        else {},
        test=test,
        note=note,
    )


def _undecidable(test: WaveformComparison) -> str:
    """A word where too few subjects make significance impossible."""
    n = len(test.subjects)
    if not test.anova.can_decide:
        return f"{n} subjects are too few for any difference to be significant"
    if any(not pair.test.can_decide for pair in test.pairs):
        return f"{n} subjects are too few for any pair to be significant after {test.n_pairs} comparisons"
    return ""
