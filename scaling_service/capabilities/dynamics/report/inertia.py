"""The chapter on identified inertia: what moved, and whether held-out recordings agree."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from scaling_service.capabilities.dynamics.document import IdentificationDocument, InertialChange
from scaling_service.capabilities.dynamics.report.data import COMPONENTS
from scaling_service.report.blocks import Block, Bullets, Callout, Cell, Details, Row, Table, Text, Tone
from scaling_service.report.page import Section

_DARKEST = 3.0
"""Prior standard deviations of the darkest cell (chosen: beyond it a change is told as a surprise)."""

_NOTED = 0.1
"""Least change that is worth a row in the first table, prior standard deviations (chosen)."""

_HOW = (
    "Tables are the prior, with the scatter between them as its standard deviation. Only combinations that "
    "the recordings say more about than the tables do were free to move; every segment stays a possible body "
    "(positive mass, pseudo-inertia positive definite, centre of mass within its joints and markers)."
)


def inertia_section(found: IdentificationDocument) -> Section:
    """Parameters before and after, and the wrench that each explains."""
    return Section("Identified inertia", list(_blocks(found)), new_page=True)


def _blocks(found: IdentificationDocument) -> Iterator[Block]:
    yield _callout(found)
    yield Text(_HOW)
    yield _fits(found)
    moved = [p for p in found.parameters if abs(p.moved) >= _NOTED]
    if moved:
        yield _table(f"What moved by {_NOTED:g} prior SD or more", moved)
    if found.combinations:
        yield _combinations(found)
    yield Details(
        f"All {len(found.parameters)} numbers", [_table("All inertial parameters", found.parameters)]
    )


def _callout(found: IdentificationDocument) -> Callout:
    before, after = found.total_mass_kg
    mass = f"Total mass {before:.1f} kg" + ("" if abs(after - before) < 0.05 else f", now {after:.1f} kg")
    lines = [f"{mass}. Components used: {_used(found)}.", *found.warnings]
    headline, tone = _headline(found)
    return Callout(headline, [Bullets(lines)], tone)


def _headline(found: IdentificationDocument) -> tuple[str, Tone]:
    count = len(found.combinations)
    if not count:
        return "Nothing moved: the recordings say less about the inertia than the tables", "unknown"
    moved = f"{count} combination{'s' if count != 1 else ''} of parameters moved"
    ratio = found.held_out_ratio
    if ratio is None:
        return f"{moved}; no recording was held out to check it", "unknown"
    what = "the wrench" if all(found.components) else _used(found)
    if ratio < 1.0:
        return f"{moved}; {what} of held-out recordings is explained {_share(1 - ratio)} better", "good"
    return f"{moved}; {what} of held-out recordings is explained {_share(ratio - 1)} worse", "poor"


def _used(found: IdentificationDocument) -> str:
    return ", ".join(c for c, yes in zip(COMPONENTS, found.components, strict=True) if yes)


def _share(value: float) -> str:
    return f"{100 * value:.0f} %"


def _fits(found: IdentificationDocument) -> Table:
    rows: list[Row] = []
    for name, fit in found.trials.items():
        rows.append(Row(f"{name} ({'held out' if fit.held_out else 'used to fit'})"))
        for when in ("before", "after"):
            wrench = getattr(fit, when).model_dump()
            rows.append(Row(when, [f"{value:.1f}" for value in wrench.values()]))
    units = [f"{c}, {'N' if c.startswith('f') else 'N m'}" for c in COMPONENTS]
    return Table("RMS error of the ground wrench, before and after", ["", *units], rows)


def _table(caption: str, parameters: Sequence[InertialChange]) -> Table:
    rows = [
        Row(
            f"{p.segment} {p.quantity}, {p.unit}",
            [
                f"{p.before:.4g}",
                f"{p.after:.4g}",
                f"{p.prior_sd:.2g}",
                f"{p.sd:.2g}",
                Cell(f"{p.moved:+.2f}", shade=abs(p.moved) / _DARKEST),
                Cell("yes", tone="good") if p.identifiable else Cell("no", tone="unknown"),
            ],
        )
        for p in parameters
    ]
    return Table(
        caption,
        ["", "before", "after", "prior SD", "SD", "moved, prior SD", "determined"],
        rows,
        "Centres of mass in the segment's frame, moments of inertia about the centre of mass. Determined: "
        "the recordings say more about this number alone than the tables do.",
    )


def _combinations(found: IdentificationDocument) -> Table:
    rows = [
        Row(
            ", ".join(f"{part.weight:+.2f} {part.segment} {part.quantity}" for part in c.parts),
            [f"{c.gain:.3g}", f"{c.moved:+.2f}", f"{c.sd:.2f}"],
        )
        for c in found.combinations
    ]
    return Table(
        "Combinations that the recordings determine, best first",
        ["largest parts", "information", "moved", "SD"],
        rows,
        "Parts, change and SD in units of the prior's SD; information over that of the prior. S: second "
        "moment of the mass about its centre.",
        words=True,
    )
