"""The report of one person: the verdict first, then what it rests on."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping

from scaling_service.capabilities.scaling.comparison.curves import (
    Gait,
    angle_curves,
    error_curves,
    gait_curves,
)
from scaling_service.capabilities.scaling.comparison.evidence import Evidence, Gate, Strength, Verdict
from scaling_service.capabilities.scaling.comparison.verdict import RULES_IN_WORDS
from scaling_service.capabilities.scaling.methods.table import METHODS
from scaling_service.capabilities.scaling.report.angles import angles_section, clinical_section
from scaling_service.capabilities.scaling.report.bodies import errors_section, geometry_section
from scaling_service.capabilities.scaling.report.muscles import muscles_section
from scaling_service.capabilities.scaling.report.tables import fitted_table, plain_measure, truth_table
from scaling_service.capabilities.scaling.result import Results
from scaling_service.capabilities.scaling.scene import overlay
from scaling_service.documents.results import ComparisonDocument, FittedParameter, MethodResult, TruthDocument
from scaling_service.model.trial import Trial
from scaling_service.report.blocks import Block, Bullets, Callout, Cell, Details, Row, Table, Text, Tone
from scaling_service.report.methods import method_columns, union
from scaling_service.report.page import Page, Section
from scaling_service.report.provenance import origin_blocks

_TONES: dict[Strength, Tone] = {"decided": "good", "leaning": "fair", "undecided": "unknown"}
_SPEAKS: dict[str, Tone] = {"for": "good", "against": "poor", "neither": "unknown"}
_HOW_TO_READ = (
    "Black dots are the measured markers. Each model stands where it follows them best; rings are its "
    "markers, dots its joint centres, dashed lines its knee axes. Drag to turn. Floor lines are 25 cm apart; "
    "the view goes along with the person."
)


def report_page(results: Results, document: ComparisonDocument, evidence: Evidence, verdict: Verdict) -> Page:
    """The report as one page that needs nothing else.

    ``document``: what is written as ``comparison.json``; the report's tables take their numbers from it.
    """
    methods, trial = document.methods, shown_trial(results)
    reference = None if evidence.reference is None else evidence.reference.method
    titles = {name: METHODS[name].title for name in methods}
    return Page(
        f"Scaled models of {document.subject}",
        [
            Section("Verdict", list(_verdict(verdict, document.truth))),
            Section("The models in space", list(_in_space(results, trial, verdict)), new_page=True),
            errors_section(methods, error_curves(results)),
            geometry_section(document, reference, evidence.imaged_lengths),
            angles_section(
                list(methods),
                () if trial is None else angle_curves(results, trial),
                Gait(reason="no movement was recorded")
                if trial is None
                else gait_curves(results, verdict.method),
            ),
            clinical_section(methods, verdict.method),
            *_muscles(results, document),
            numbers_section(methods),
            provenance_section(document, titles),
        ],
        subtitle=f"Methods: {', '.join(methods)}",
        footer=f"scaling-service {document.code_version}. The numbers are in comparison.json, too.",
    )


def _muscles(results: Results, document: ComparisonDocument) -> Iterator[Section]:
    if results.muscles is not None and document.muscles is not None:
        yield muscles_section(results.muscles, document.muscles)


def shown_trial(results: Results) -> Trial | None:
    """The trial that the overlay shows: the first that was held out, else the first of all."""
    trials = sorted(results.session.dynamic, key=lambda trial: trial.name not in results.held_out)
    return trials[0] if trials else None


def _in_space(results: Results, trial: Trial | None, verdict: Verdict) -> Iterator[Block]:
    scene = None if trial is None else overlay(results, trial, verdict.method)
    if scene is None:
        yield Text("No movement was recorded, so there is nothing to show.")
    else:
        yield Text(_HOW_TO_READ)
        yield scene


def _verdict(verdict: Verdict, truth: TruthDocument | None) -> Iterator[Block]:
    """Which method to use for this person, why, and how far to trust it; the quality gates and the rules."""
    yield Callout(verdict.headline, [Bullets(verdict.why)], _TONES[verdict.strength])
    yield Table(
        f"How far to trust {verdict.method}",
        ["", "trust", "because"],
        [
            Row(t.topic, [Cell("not known" if t.level == "unknown" else t.level, tone=t.level), t.text])
            for t in verdict.trust
        ],
        words=True,
    )
    if truth is not None:
        yield from _truth(verdict.method, truth)
    if verdict.gates:
        yield _gates(verdict.gates)
    if verdict.findings:
        rows = [
            Row(f.method, [f.rule, Cell(f.speaks, tone=_SPEAKS[f.speaks]), f.text]) for f in verdict.findings
        ]
        table = Table("Findings", ["method", "rule", "speaks", "what was found"], rows, words=True)
        yield Details("What each rule says of each method", [table])
    yield Details("The rules", [Bullets(RULES_IN_WORDS, numbered=True)])


def _gates(gates: tuple[Gate, ...]) -> Table:
    rows: dict[tuple[str, float], list[Cell]] = {}
    for gate in gates:
        cell = Cell(
            f"{1e3 * gate.value:.1f} {'passes' if gate.passed else 'fails'}",
            tone="good" if gate.passed else "poor",
        )
        rows.setdefault(("RMS" if gate.quantity == "rms" else "largest", 1e3 * gate.limit), []).append(cell)
    where = "held-out trials" if all(gate.held_out for gate in gates) else "the trials that were fitted"
    return Table(
        f"Quality gates: marker error on {where}, mm",
        ["", *method_columns(list(dict.fromkeys(gate.method for gate in gates)))],
        [Row(f"{title}, below {limit:.0f}", cells) for (title, limit), cells in rows.items()],
        "Limits of OpenSim's best practices. Necessary, not sufficient: a wrong model can pass them.",
    )


def _truth(chosen: str, truth: TruthDocument) -> Iterator[Block]:
    """Of a virtual person: how the verdict fares against what is known."""
    names = union(truth.errors.values())
    best = [
        plain_measure(name)
        for name in names
        if truth.errors[chosen][name] <= min(errors[name] for errors in truth.errors.values())
    ]
    yield truth_table(truth)
    which = f": {', '.join(best)}." if best else "."
    yield Text(
        f"The verdict does not know these numbers. {chosen} is nearest to the truth in {len(best)} of "
        f"{len(names)} of them{which} That the nearest markers need not make the nearest joints is why a "
        "small error alone is no proof."
    )


_SHOWN = {"m": ("mm", 1e3, 1), "rad": ("°", 180.0 / math.pi, 1), "1": ("", 1.0, 3)}
"""Unit of a parameter to the unit shown, the factor and the digits."""


def numbers_section(methods: Mapping[str, MethodResult]) -> Section:
    """How many numbers were fitted, how many of them mean little, and each of them."""
    return Section("Fitted numbers", list(_numbers(methods)), new_page=True)


def _numbers(methods: Mapping[str, MethodResult]) -> Iterator[Block]:
    fitted = {name: m for name, m in methods.items() if m.parameters}
    if not fitted:
        yield Text("No method fitted any number.")
        return
    yield fitted_table(methods)
    for name, method in fitted.items():
        yield Details(
            f"{name}: all {len(method.parameters)}",
            [
                Table(
                    f"Fitted numbers of {name}",
                    ["", "value", "SD", "determined", "at a bound"],
                    [_parameter(p) for p in method.parameters],
                    long=True,
                )
            ],
        )


def _parameter(parameter: FittedParameter) -> Row:
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


def provenance_section(document: ComparisonDocument, titles: Mapping[str, str]) -> Section:
    """What was repaired, skipped or warned of, and what is needed to get the same results again."""
    return Section("Where this comes from", list(_provenance(document, titles)), new_page=True)


def _provenance(document: ComparisonDocument, titles: Mapping[str, str]) -> Iterator[Block]:
    yield Table(
        "Methods",
        ["method", "what it does"],
        [Row(name, [titles[name]]) for name in document.methods],
        words=True,
    )
    yield from origin_blocks(document, document.all_warnings)
    times = [
        Row(
            name,
            [str(m.iterations), f"{m.wall_s.calibration:.2f}", f"{m.wall_s.inverse_kinematics:.2f}"],
        )
        for name, m in document.methods.items()
    ]
    yield Details(
        "Computing time",
        [Table("Iterations and seconds", ["", "iterations", "fitting, s", "following, s"], times)],
    )
