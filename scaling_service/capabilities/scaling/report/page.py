"""The report of one person: the verdict first, then what it rests on."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping

from scaling_service.capabilities.scaling.comparison.curves import (
    Gait,
    make_angle_curves,
    make_error_curves,
    make_gait_curves,
)
from scaling_service.capabilities.scaling.comparison.evidence import Evidence, Strength, Verdict
from scaling_service.capabilities.scaling.methods.table import METHODS
from scaling_service.capabilities.scaling.muscles.compare import MuscleComparison
from scaling_service.capabilities.scaling.report.angles import build_angles_section, build_clinical_section
from scaling_service.capabilities.scaling.report.bodies import build_errors_section, build_geometry_section
from scaling_service.capabilities.scaling.report.tables import name_measure, tabulate_fitted, tabulate_truth
from scaling_service.capabilities.scaling.result import Results
from scaling_service.capabilities.scaling.scene import make_overlay
from scaling_service.documents.results import (
    ComparisonDocument,
    FittedParameter,
    MethodResult,
    MuscleDifference,
    MuscleDocument,
    MuscleQuantity,
    TruthDocument,
)
from scaling_service.model.trial import Trial
from scaling_service.report.blocks import (
    Block,
    Bullets,
    Callout,
    Cell,
    Details,
    Grid,
    Heading,
    Page,
    Row,
    Section,
    Table,
    Text,
    Tone,
)
from scaling_service.report.figures import Figure, draw_lines, make_chart
from scaling_service.report.methods import (
    format_signed,
    make_method_legend,
    number,
    spell_name,
    unite_keys,
)
from scaling_service.report.provenance import build_origin_blocks

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


_TONES: dict[Strength, Tone] = {"decided": "good", "leaning": "fair", "undecided": "unknown"}
_HOW_TO_READ = (
    "Black dots are the measured markers. Each model stands where it follows them best; rings are its "
    "markers, dots its joint centres, dashed lines its knee axes. Drag to turn. Floor lines are 25 cm apart; "
    "the view goes along with the person."
)


def report_page(results: Results, document: ComparisonDocument, evidence: Evidence, verdict: Verdict) -> Page:
    """The report as one page that needs nothing else.

    ``document``: what is written as ``comparison.json``; the report's tables take their numbers from it.
    """
    methods, trial = document.methods, choose_shown_trial(results)
    reference = None if evidence.reference is None else evidence.reference.method
    titles = {name: METHODS[name].title for name in methods}
    return Page(
        f"Scaled models of {document.subject}",
        [
            Section("Verdict", list(_build_verdict(verdict, document.truth))),
            Section("The models in space", list(_in_space(results, trial, verdict)), new_page=True),
            build_errors_section(methods, make_error_curves(results)),
            build_geometry_section(document, reference, evidence.imaged_lengths),
            build_angles_section(
                list(methods),
                () if trial is None else make_angle_curves(results, trial),
                Gait(reason="no movement was recorded")
                if trial is None
                else make_gait_curves(results, verdict.method),
            ),
            build_clinical_section(methods, verdict.method),
            *_build_muscles(results, document),
            build_numbers_section(methods),
            build_provenance_section(document, titles),
        ],
        subtitle=f"Methods: {', '.join(methods)}",
        footer=f"scaling-service {document.code_version}. The numbers are in comparison.json, too.",
    )


def _build_muscles(results: Results, document: ComparisonDocument) -> Iterator[Section]:
    if results.muscles is not None and document.muscles is not None:
        yield build_muscles_section(results.muscles, document.muscles)


def choose_shown_trial(results: Results) -> Trial | None:
    """The trial that the overlay shows: the first that was held out, else the first of all."""
    trials = sorted(results.session.dynamic, key=lambda trial: trial.name not in results.held_out)
    return trials[0] if trials else None


def _in_space(results: Results, trial: Trial | None, verdict: Verdict) -> Iterator[Block]:
    scene = None if trial is None else make_overlay(results, trial, verdict.method)
    if scene is None:
        yield Text("No movement was recorded, so there is nothing to show.")
    else:
        yield Text(_HOW_TO_READ)
        yield scene


def _build_verdict(verdict: Verdict, truth: TruthDocument | None) -> Iterator[Block]:
    """Which method to use for this person, why, and how far to trust it."""
    yield Callout(verdict.headline, [Bullets(verdict.why)], _TONES[verdict.strength])
    yield Table(
        caption=f"How far to trust {verdict.method}",
        columns=["", "trust", "because"],
        rows=[
            Row(t.topic, [Cell("not known" if t.level == "unknown" else t.level, tone=t.level), t.text])
            for t in verdict.trust
        ],
        words=True,
    )
    if truth is not None:
        yield from _build_truth(verdict.method, truth)


def _build_truth(chosen: str, truth: TruthDocument) -> Iterator[Block]:
    """Of a virtual person: how the verdict fares against what is known."""
    names = unite_keys(truth.errors.values())
    best = [
        name_measure(name)
        for name in names
        if truth.errors[chosen][name] <= min(errors[name] for errors in truth.errors.values())
    ]
    yield tabulate_truth(truth)
    which = f": {', '.join(best)}." if best else "."
    yield Text(
        f"The verdict does not know these numbers. {chosen} is nearest to the truth in {len(best)} of "
        f"{len(names)} of them{which} That the nearest markers need not make the nearest joints is why a "
        "small error alone is no proof."
    )


_SHOWN = {"m": ("mm", 1e3, 1), "rad": ("°", 180.0 / math.pi, 1), "1": ("", 1.0, 3)}
"""Unit of a parameter to the unit shown, the factor and the digits."""


def build_numbers_section(methods: Mapping[str, MethodResult]) -> Section:
    """How many numbers were fitted, how many of them mean little, and each of them."""
    return Section("Fitted numbers", list(_build_numbers(methods)), new_page=True)


def _build_numbers(methods: Mapping[str, MethodResult]) -> Iterator[Block]:
    fitted = {name: m for name, m in methods.items() if m.parameters}
    if not fitted:
        yield Text("No method fitted any number.")
        return
    yield tabulate_fitted(methods)
    for name, method in fitted.items():
        yield Details(
            f"{name}: all {len(method.parameters)}",
            [
                Table(
                    caption=f"Fitted numbers of {name}",
                    columns=["", "value", "SD", "determined", "at a bound"],
                    rows=[_make_parameter_row(p) for p in method.parameters],
                    long=True,
                )
            ],
        )


def _make_parameter_row(parameter: FittedParameter) -> Row:
    unit, factor, digits = _SHOWN[parameter.unit]
    sd = "not known" if parameter.sd is None else f"{factor * parameter.sd:.{digits}f}"
    return Row(
        f"{parameter.name}{', ' + unit if unit else ''}",
        [
            f"{factor * parameter.value:.{digits}f}",
            sd,
            Cell("yes", tone="good") if parameter.identifiable else Cell("no", tone="poor"),
            Cell("yes", tone="poor") if parameter.at_bound else "no",
        ],
    )


def build_provenance_section(document: ComparisonDocument, titles: Mapping[str, str]) -> Section:
    """What was repaired, skipped or warned of, and what is needed to get the same results again."""
    return Section("Where this comes from", list(_build_provenance(document, titles)), new_page=True)


def _build_provenance(document: ComparisonDocument, titles: Mapping[str, str]) -> Iterator[Block]:
    yield Table(
        caption="Methods",
        columns=["method", "what it does"],
        rows=[Row(name, [titles[name]]) for name in document.methods],
        words=True,
    )
    yield from build_origin_blocks(document, document.all_warnings)
    times = [
        Row(name, [str(m.iterations), f"{m.wall_s.calibration:.2f}", f"{m.wall_s.inverse_kinematics:.2f}"])
        for name, m in document.methods.items()
    ]
    yield Details(
        "Computing time",
        [
            Table(
                caption="Iterations and seconds",
                columns=["", "iterations", "fitting, s", "following, s"],
                rows=times,
            )
        ],
    )
