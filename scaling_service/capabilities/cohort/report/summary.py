"""What a cohort shows, in plain sentences; every one is read off the statistics."""

from __future__ import annotations

from collections.abc import Iterator

from scaling_service.capabilities.cohort.agreement import IMAGED
from scaling_service.capabilities.cohort.report.quantities import MM, p_words
from scaling_service.capabilities.cohort.scalars import ScalarComparison
from scaling_service.capabilities.cohort.statistics import CohortStatistics
from scaling_service.capabilities.cohort.subject_summary import TRUTH
from scaling_service.report.blocks import Block, Bullets, Callout, Row, Table, Text
from scaling_service.report.methods import words

_LENGTHS = "segment_length"


def summary_blocks(found: CohortStatistics) -> Iterator[Block]:
    """The headline, what it rests on, and OpenSim's limits."""
    sentences = [*_errors(found), *_lengths(found), *_nearest(found), *_angles(found)]
    yield Callout(
        f"{len(found.subjects)} subjects, {len(found.methods)} methods",
        [Bullets(sentences), Text("A small error alone is no proof of a right model: see agreement below.")],
    )
    yield _gates(found)
    if found.notes:
        yield Bullets(found.notes)


def _scalar(found: CohortStatistics, kind: str, quantity: str) -> ScalarComparison | None:
    return next((s for s in found.scalars if (s.kind, s.quantity) == (kind, quantity)), None)


def _errors(found: CohortStatistics) -> Iterator[str]:
    for role, said in (("evaluation", "on held-out trials"), ("calibration", "on trials used to fit")):
        scalar = _scalar(found, "kinematic_error", role)
        if scalar is None or len(scalar.mean) < 2:
            continue
        order = sorted(scalar.mean, key=scalar.mean.__getitem__)
        ranked = ", ".join(f"{m} {MM.factor * scalar.mean[m]:.1f}" for m in order)
        yield f"Kinematic error {said}, mm, smallest first: {ranked}.{_tested(scalar)}"


def _tested(scalar: ScalarComparison) -> str:
    if scalar.test is None:
        return f" Not tested: {scalar.note}."
    if not scalar.test.significant:
        return f" No difference between methods is found (Friedman p {p_words(scalar.test.p)})."
    return f" The methods differ (Friedman p {p_words(scalar.test.p)})."


def _lengths(found: CohortStatistics) -> Iterator[str]:
    tests = [s.test for s in found.scalars if s.kind == _LENGTHS and s.test is not None]
    if not tests:
        return
    differ = [words(t.quantity) for t in tests if t.significant]
    yield (
        f"Segment lengths differ between methods for {', '.join(dict.fromkeys(differ))}."
        if differ
        else "No segment length is found to differ between methods."
    )


def _nearest(found: CohortStatistics) -> Iterator[str]:
    """Which method's lengths lie nearest to each reference, by the RMS over lengths and subjects."""
    for reference, said in ((IMAGED, "the image"), (TRUTH, "the truth")):
        squares: dict[str, list[float]] = {}
        for item in found.agreements:
            if item.result.reference == reference and "." not in item.quantity:
                squares.setdefault(item.result.method, []).append(item.result.rmse**2)
        if squares:
            rms = {m: (sum(v) / len(v)) ** 0.5 for m, v in squares.items()}
            order = sorted(rms, key=rms.__getitem__)
            ranked = ", ".join(f"{m} {MM.factor * rms[m]:.1f}" for m in order)
            yield f"Lengths against {said}, RMS in mm, nearest first: {ranked}."


def _angles(found: CohortStatistics) -> Iterator[str]:
    tested = [c for c in found.curves if c.test is not None]
    if not tested:
        return
    differ = [words(c.coordinate) for c in tested if c.test is not None and c.test.anova.significant]
    yield (
        f"Joint angles differ between methods in the gait cycle for {'; '.join(dict.fromkeys(differ))}."
        if differ
        else "No joint angle is found to differ between methods over the gait cycle."
    )


def _gates(found: CohortStatistics) -> Table:
    rows = [
        Row(g.method, [f"{g.subjects_passed} of {g.subjects}", f"{g.trials_passed} of {g.trials}"])
        for g in found.gates
    ]
    return Table(
        "OpenSim's limits for marker errors: RMS below 20 mm, largest below 40 mm",
        ["", "subjects that keep them", "trials that keep them"],
        rows,
        "Necessary, not sufficient: fitted numbers absorb errors.",
    )
