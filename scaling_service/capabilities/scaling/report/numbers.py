"""The chapters on fitted numbers and on where everything comes from."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping

from scaling_service.capabilities.scaling.report.tables import fitted_table
from scaling_service.documents.results import ComparisonDocument, FittedParameter, MethodResult
from scaling_service.report.blocks import Block, Cell, Details, Row, Table, Text
from scaling_service.report.page import Section
from scaling_service.report.provenance import input_blocks, repair_blocks, warning_blocks

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
    yield from warning_blocks(document.all_warnings)
    yield from repair_blocks(document)
    yield from input_blocks(document)
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
