"""The chapter on muscles: what the choice of a method does to lengths, moment arms and joint moments."""

from __future__ import annotations

from collections.abc import Iterator

from scaling_service.capabilities.scaling.muscles.compare import MuscleComparison
from scaling_service.documents.results import MuscleDifference, MuscleDocument, MuscleQuantity
from scaling_service.report.blocks import Block, Bullets, Details, Grid, Heading, Row, Table, Text
from scaling_service.report.figures import Figure, draw_lines, make_chart
from scaling_service.report.methods import format_signed, make_method_legend, number, spell_name
from scaling_service.report.page import Section

MOST_CURVES = 6
"""Of each quantity. Chosen: two rows of a page."""

_TITLES: dict[MuscleQuantity, tuple[str, str]] = {
    "moment arm": ("Moment arms", "mm"),
    "length": ("Lengths of muscle and tendon", "mm"),
    "joint moment": ("Joint moments", "N m"),
}
_METRES = {"mm": 1e3, "N m": 1.0}


def build_muscles_section(found: MuscleComparison, document: MuscleDocument) -> Section:
    """Largest differences in words, tables of them, and the curves in which they stand."""
    return Section("Muscles", list(_build_blocks(found, document)), new_page=True)


def _build_blocks(found: MuscleComparison, document: MuscleDocument) -> Iterator[Block]:
    yield Text(
        f"Muscle paths by OpenSim in each method's model and motion, over {', '.join(document.trials)}; "
        f"differences against {document.reference}."
    )
    yield Bullets([*document.summary, *(f"{note}." for note in document.notes)])
    yield make_method_legend(list(found.courses))
    for quantity, (title, unit) in _TITLES.items():
        differences = [each for each in document.differences if each.quantity == quantity]
        if differences:
            yield Heading(f"{title}, {unit}")
            yield Grid([_draw_curve(found, each) for each in _list_distinct(differences)])
            yield Details("The largest differences", [tabulate_differences(document, quantity)])


def _list_distinct(differences: list[MuscleDifference]) -> list[MuscleDifference]:
    """The largest of all methods, each muscle and coordinate once."""
    largest: dict[tuple[str, str], MuscleDifference] = {}
    for each in sorted(differences, key=lambda each: -abs(each.difference)):
        largest.setdefault((each.muscle, each.coordinate), each)
    return list(largest.values())[:MOST_CURVES]


def tabulate_differences(document: MuscleDocument, quantity: MuscleQuantity) -> Table:
    """The largest differences of one quantity."""
    title, unit = _TITLES[quantity]
    rows = [
        Row(
            f"{each.method}: {_name(each)}",
            [
                format_signed(each.difference),
                number(each.reference),
                number(each.rms),
                "–" if each.angle_deg is None else f"{each.angle_deg:.0f}",
                f"{each.trial}, {each.time_s:.2f} s",
            ],
        )
        for each in document.differences
        if each.quantity == quantity
    ]
    return Table(
        caption=f"{title}, {unit}: largest difference from {document.reference}",
        columns=["", "difference", document.reference, "RMS", "at, degrees", "where"],
        rows=rows,
        note="RMS of the difference over the trial.",
    )


def _name(each: MuscleDifference) -> str:
    return ", ".join(filter(None, (each.muscle, spell_name(each.coordinate) if each.coordinate else "")))


def _draw_curve(found: MuscleComparison, each: MuscleDifference) -> Figure:
    title, unit = _TITLES[each.quantity]
    values, times = {}, found.courses[each.method][each.trial].times
    for method, trials in found.courses.items():
        course = trials[each.trial].courses(each.quantity).get((each.muscle, each.coordinate))
        if course is not None:
            values[method] = _METRES[unit] * course
    return Figure(
        make_chart(draw_lines(times, values), x_title="time, s", y_title=unit),
        _name(each),
        f"{title}: {_name(each)} over time in {each.trial} by method, {unit}. {each.sentence}",
        210,
    )
