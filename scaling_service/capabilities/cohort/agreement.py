"""How far a cohort's methods agree with the image-based reference, and with the truth where it is known."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from scaling_service.capabilities.cohort.subject_summary import TRUTH, SubjectSummary
from scaling_service.numerics.statistics.agreement import Agreement, agreement

IMAGED = "EB"
"""The reference of lengths and joint centres (Puchaud 2019, section 2.3): nothing in it is fitted."""

_STILL_M = 1e-6  # chosen: what varies less over persons than a micrometre is a constant of its frame

FEWEST = 3
"""Subjects that agreement needs: below, its intervals are not defined."""


@dataclass(frozen=True, slots=True)
class CohortAgreement:
    """A method against a reference.

    Parameters
    ----------
    quantity : str
        A segment length (``femur_r``), or a coordinate of a joint centre in the reference's proximal segment
        (``hip_r.x``), m.
    result : Agreement
    subjects : tuple of str
        Those that have both.
    excluded : tuple of str
        The others.
    reference_sd : float
        Of the reference over the subjects, m: where it is about zero (a coordinate that the segment's frame
        itself fixes), intraclass correlations say nothing.
    """

    quantity: str
    result: Agreement
    subjects: tuple[str, ...]
    excluded: tuple[str, ...]
    reference_sd: float

    @property
    def varies(self) -> bool:
        """Whether the reference differs between persons at all."""
        return self.reference_sd > _STILL_M


def agreements(
    subjects: Sequence[SubjectSummary], methods: Sequence[str], confidence: float = 0.95
) -> Iterator[CohortAgreement | str]:
    """Every method's lengths and joint centres against each reference.

    Yields
    ------
    CohortAgreement or str
        A sentence instead where fewer than three subjects have a reference at all.
    """
    for reference in (IMAGED, TRUTH):
        tables = _tables(subjects, reference)
        known = {s for table in tables.values() for s, values in table.items() if reference in values}
        if 0 < len(known) < FEWEST:
            yield (
                f"only {', '.join(sorted(known))} can be compared with {reference}: "
                f"agreement needs {FEWEST} subjects"
            )
        for quantity, table in tables.items():
            for method in methods:
                if method != reference:
                    yield from _compared(quantity, table, method, reference, confidence)


def _compared(
    quantity: str, table: Mapping[str, Mapping[str, float]], method: str, reference: str, confidence: float
) -> Iterator[CohortAgreement]:
    both = {s: values for s, values in table.items() if method in values and reference in values}
    if len(both) >= FEWEST:
        yield CohortAgreement(
            quantity,
            agreement(both, method, reference, quantity=quantity, confidence=confidence),
            tuple(both),
            tuple(s for s in table if s not in both),
            float(np.std([values[reference] for values in both.values()], ddof=1)),
        )


def _tables(subjects: Sequence[SubjectSummary], reference: str) -> dict[str, dict[str, dict[str, float]]]:
    """Quantity to subject to method (the reference among them) to value, m."""
    tables: dict[str, dict[str, dict[str, float]]] = {}
    for subject in subjects:
        for quantity, values in _quantities(subject, reference):
            row = tables.setdefault(quantity, {s.subject: {} for s in subjects})
            row[subject.subject].update(values)
    return tables


def _quantities(subject: SubjectSummary, reference: str) -> Iterator[tuple[str, dict[str, float]]]:
    for method, summary in subject.methods.items():
        for name, length in summary.lengths.items():
            yield name, {method: length}
    if reference == TRUTH:
        for name, length in subject.true_lengths.items():
            yield name, {TRUTH: length}
    for method, joints in subject.centres.get(reference, {}).items():
        for joint, place in joints.items():
            for axis, value in zip("xyz", place, strict=True):
                yield f"{joint}.{axis}", {method: value}
