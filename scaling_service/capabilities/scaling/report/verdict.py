"""The first chapter: which method to use for this person, why, and how far to trust it."""

from __future__ import annotations

from collections.abc import Iterator

from scaling_service.capabilities.scaling.comparison.verdict import RULES_IN_WORDS
from scaling_service.capabilities.scaling.comparison.verdict_evidence import Strength
from scaling_service.capabilities.scaling.report.data import SubjectData
from scaling_service.report.blocks import Block, Bullets, Callout, Cell, Details, Row, Table, Text, Tone
from scaling_service.report.methods import method_columns, number, union
from scaling_service.report.page import Section

_TONES: dict[Strength, Tone] = {"decided": "good", "leaning": "fair", "undecided": "unknown"}
_LEVELS = {"good": "good", "fair": "fair", "poor": "poor", "unknown": "not known"}
_SPEAKS: dict[str, Tone] = {"for": "good", "against": "poor", "neither": "unknown"}


def verdict_section(data: SubjectData) -> Section:
    """The verdict, its reasons, the quality gates and the rules."""
    return Section("Verdict", list(_blocks(data)))


def _blocks(data: SubjectData) -> Iterator[Block]:
    verdict = data.verdict
    yield Callout(verdict.headline, [Bullets(verdict.why)], _TONES[verdict.strength])
    yield Table(
        f"How far to trust {verdict.method}",
        ["", "trust", "because"],
        [Row(t.topic, [Cell(_LEVELS[t.level], tone=t.level), t.text]) for t in verdict.trust],
        words=True,
    )
    if data.document.truth is not None:
        yield from _truth(data)
    if verdict.gates:
        yield _gates(data)
    if verdict.findings:
        yield Details("What each rule says of each method", [_findings(data)])
    yield Details("The rules", [Bullets(RULES_IN_WORDS, numbered=True)])


def _gates(data: SubjectData) -> Table:
    gates = data.verdict.gates
    methods = list(dict.fromkeys(gate.method for gate in gates))
    rows = []
    for quantity, title in (("rms", "RMS"), ("max", "largest")):
        found = {gate.method: gate for gate in gates if gate.quantity == quantity}
        limit = 1e3 * next(iter(found.values())).limit
        cells = [
            Cell(
                f"{1e3 * found[m].value:.1f} {'passes' if found[m].passed else 'fails'}",
                tone="good" if found[m].passed else "poor",
            )
            for m in methods
        ]
        rows.append(Row(f"{title}, below {limit:.0f}", cells))
    where = "held-out trials" if all(gate.held_out for gate in gates) else "the trials that were fitted"
    return Table(
        f"Quality gates: marker error on {where}, mm",
        ["", *method_columns(methods)],
        rows,
        "Limits of OpenSim's best practices. Necessary, not sufficient: a wrong model can pass them.",
    )


def _findings(data: SubjectData) -> Table:
    rows = [
        Row(f.method, [f.rule, Cell(f.speaks, tone=_SPEAKS[f.speaks]), f.text]) for f in data.verdict.findings
    ]
    return Table("Findings", ["method", "rule", "speaks", "what was found"], rows, words=True)


def _truth(data: SubjectData) -> Iterator[Block]:
    """Of a virtual person: how the verdict fares against what is known."""
    truth = data.document.truth
    assert truth is not None
    chosen, methods = data.verdict.method, list(truth.errors)
    names = union(truth.errors.values())
    best = [
        name
        for name in names
        if truth.errors[chosen][name] <= min(errors[name] for errors in truth.errors.values())
    ]
    rows = [
        Row(
            name.rpartition("_")[0].replace("_", " ") + f", {name.rpartition('_')[2]}",
            [number(truth.errors[method].get(name)) for method in methods],
        )
        for name in names
    ]
    yield Table(
        "This person is virtual: distance from the truth on held-out trials",
        ["", *method_columns(methods)],
        rows,
    )
    yield Text(
        f"The verdict does not know these numbers. {chosen} is nearest to the truth in {len(best)} of "
        f"{len(names)} of them"
        + (f": {', '.join(_plain(name) for name in best)}." if best else ".")
        + " That the nearest markers need not make the nearest joints is why a small error alone is no proof."
    )


def _plain(name: str) -> str:
    return name.rpartition("_")[0].replace("_", " ")
