"""How far methods agree with the image, and with the truth where it is known."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

from scaling_service.capabilities.cohort.agreement import CohortAgreement
from scaling_service.report.blocks import Block, Details, Row, Table, Text
from scaling_service.report.methods import words

_MM = 1e3


def agreement_blocks(agreements: Sequence[CohortAgreement]) -> Iterator[Block]:
    """A table for each reference: lengths first, joint centres when asked for."""
    references = list(dict.fromkeys(item.result.reference for item in agreements))
    if not references:
        yield Text("Too few subjects were imaged, and no truth is known, so agreement cannot be stated.")
        return
    yield Text(
        "Bias is the method minus the reference, with its 95 % interval; 95 % of the differences lie within "
        "the limits (Bland and Altman). ICC is that of absolute agreement."
    )
    for reference in references:
        own = [item for item in agreements if item.result.reference == reference]
        lengths = [item for item in own if "." not in item.quantity]
        centres = [item for item in own if "." in item.quantity]
        name = "the image (EB)" if reference == "EB" else reference
        if lengths:
            yield _table(f"Segment lengths against {name}, mm", lengths)
        if centres:
            yield Details(
                f"Joint centres against {name}", [_table(f"Joint centres against {name}, mm", centres)]
            )


def _table(caption: str, items: Sequence[CohortAgreement]) -> Table:
    rows = []
    for item in items:
        found = item.result.bland_altman
        rows.append(
            Row(
                f"{_quantity(item.quantity)}, {item.result.method}",
                [
                    str(len(item.subjects)),
                    f"{_signed(found.bias.value)} ({_signed(found.bias.low)} to {_signed(found.bias.high)})",
                    f"{_signed(found.lower.value)} to {_signed(found.upper.value)}",
                    f"{_MM * item.result.rmse:.1f}",
                    _icc(item),
                ],
            )
        )
    return Table(caption, ["", "subjects", "bias (95 %)", "limits of agreement", "RMS", "ICC"], rows)


def _signed(metres: float) -> str:
    return f"{_MM * metres:+.1f}"


def _quantity(name: str) -> str:
    joint, _, axis = name.partition(".")
    return f"{words(joint)} {axis}".strip()


def _icc(item: CohortAgreement) -> str:
    found = item.result.icc_agreement
    if not item.varies or not math.isfinite(found.value):
        return "–"
    interval = f" ({found.low:.2f} to {found.high:.2f})" if math.isfinite(found.low) else ""
    return f"{found.value:.2f}{interval}"
