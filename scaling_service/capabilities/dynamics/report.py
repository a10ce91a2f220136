"""The report of a subject's dynamics: the verdict first, then what it rests on."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from scaling_service.capabilities.dynamics.document import (
    DynamicsDocument,
    IdentificationDocument,
    InertialChange,
)
from scaling_service.capabilities.dynamics.report_residuals import Curves, residual_blocks, uncertainty_blocks
from scaling_service.capabilities.dynamics.residuals import COMPONENTS
from scaling_service.core.text import few
from scaling_service.report.blocks import Block, Bullets, Callout, Cell, Details, Row, Table, Text, Tone
from scaling_service.report.page import Page, Section
from scaling_service.report.provenance import input_blocks, repair_blocks, warning_blocks

_HEADLINES: tuple[tuple[str, Tone], ...] = (
    ("These recordings cannot tell this person's inertia better than a table", "unknown"),
    ("These recordings can tell this person's inertia in part", "fair"),
    ("These recordings can tell this person's inertia", "good"),
)
"""For no component of any recording, some, or all."""

_DARKEST = 3.0
"""Prior standard deviations of the darkest cell (chosen: beyond it a change is told as a surprise)."""

_NOTED = 0.1
"""Least change that is worth a row in the first table, prior standard deviations (chosen)."""


def dynamics_page(document: DynamicsDocument, curves: Curves) -> Page:
    """The page of one person's dynamics."""
    model = "The given model as it is" if document.start == "none" else f"Model scaled by {document.start}"
    inertia = "its own inertia" if document.inertia == "model" else f"inertia of {document.inertia}"
    chapters = {
        "Residuals": residual_blocks(document, curves),
        "Residual against its uncertainty": uncertainty_blocks(document),
    }
    if document.inertial is not None:
        chapters["Identified inertia"] = _inertia(document.inertial)
    chapters |= {"Joint loads": _loads(document), "Where this comes from": _provenance(document)}
    return Page(
        f"Dynamics of {document.subject}",
        [
            Section("Verdict", list(_verdict(document))),
            *(Section(title, list(blocks), new_page=True) for title, blocks in chapters.items()),
        ],
        subtitle=f"{model}, {inertia}, {document.mass_kg:.1f} kg, {document.height_m:.2f} m",
        footer=f"scaling-service {document.code_version}. The numbers are in dynamics.json, too.",
    )


def told(document: DynamicsDocument) -> list[str]:
    """The recordings' warnings, what holds of several of them told once."""
    where: dict[str, list[str]] = {}
    for name, trial in document.trials.items():
        for warning in trial.warnings:
            where.setdefault(warning.removeprefix(f"{name}: "), []).append(name)
    return [f"{few(names)}: {said}" for said, names in where.items()]


def _verdict(document: DynamicsDocument) -> Iterator[Block]:
    supported = [yes for trial in document.trials.values() for yes in trial.calibration_supported]
    headline, tone = _HEADLINES[any(supported) + all(supported)]
    yield Callout(headline, [Text(document.verdict), Bullets(told(document))], tone)


def _loads(document: DynamicsDocument) -> Iterator[Block]:
    trials = document.trials
    first = next(iter(trials.values()))
    rows = [
        Row(
            f"{name}, {load.unit}",
            [f"{t.joint_loads[name].peak:.1f} ({t.joint_loads[name].rms:.1f})" for t in trials.values()],
        )
        for name, load in first.joint_loads.items()
    ]
    yield Table(
        "Generalised forces: largest size (RMS)",
        ["", *trials],
        rows,
        "Those of the root's coordinates are the residual in the root's own axes. Over time: TRIAL_id.sto.",
        long=len(trials) < 3,
    )


def _provenance(document: DynamicsDocument) -> Iterator[Block]:
    yield from warning_blocks(document.warnings)
    yield from repair_blocks(document)
    yield from input_blocks(document)
    rows = [Row("seconds in all", [f"{document.wall_s:.1f}"])]
    yield Details("Computing time", [Table("Computing time", ["", ""], rows)])


def _inertia(found: IdentificationDocument) -> Iterator[Block]:
    """Inertial parameters before and after, and the wrench that each explains."""
    before, after = found.total_mass_kg
    mass = f"Total mass {before:.1f} kg" + ("" if abs(after - before) < 0.05 else f", now {after:.1f} kg")
    headline, tone = _headline(found)
    yield Callout(headline, [Bullets([f"{mass}. Components used: {_used(found)}.", *found.warnings])], tone)
    yield Text(
        "Tables are the prior, with the scatter between them as its standard deviation. Only combinations "
        "that the recordings say more about than the tables do were free to move; every segment stays a "
        "possible body (positive mass, pseudo-inertia positive definite, centre of mass within its joints "
        "and markers)."
    )
    yield from inertial_tables(found)
    if found.combinations:
        yield _combinations(found)
    yield Details(
        f"All {len(found.parameters)} numbers", [_parameters("All inertial parameters", found.parameters)]
    )


def inertial_tables(found: IdentificationDocument, most: int | None = None) -> Iterator[Table]:
    """The wrench that each inertia explains, and what moved, ``most`` numbers of it at most."""
    yield _fits(found)
    moved = [p for p in found.parameters if abs(p.moved) >= _NOTED]
    if moved:
        largest = moved if most is None else sorted(moved, key=lambda p: -abs(p.moved))[:most]
        yield _parameters(f"What moved by {_NOTED:g} prior SD or more", largest)


def _headline(found: IdentificationDocument) -> tuple[str, Tone]:
    count = len(found.combinations)
    if not count:
        return "Nothing moved: the recordings say less about the inertia than the tables", "unknown"
    moved = f"{count} combination{'s' if count != 1 else ''} of parameters moved"
    ratio = found.held_out_ratio
    if ratio is None:
        return f"{moved}; no recording was held out to check it", "unknown"
    what = "the wrench" if all(found.components) else _used(found)
    better = ratio < 1.0
    how = f"{100 * abs(ratio - 1):.0f} % {'better' if better else 'worse'}"
    return f"{moved}; {what} of held-out recordings is explained {how}", "good" if better else "poor"


def _used(found: IdentificationDocument) -> str:
    return ", ".join(c for c, yes in zip(COMPONENTS, found.components, strict=True) if yes)


def _fits(found: IdentificationDocument) -> Table:
    rows: list[Row] = []
    for name, fit in found.trials.items():
        rows.append(Row(f"{name} ({'held out' if fit.held_out else 'used to fit'})"))
        for when, wrench in (("before", fit.before), ("after", fit.after)):
            rows.append(Row(when, [f"{value:.1f}" for value in wrench.model_dump().values()]))
    units = [f"{c}, {'N' if c.startswith('f') else 'N m'}" for c in COMPONENTS]
    return Table("RMS error of the ground wrench, before and after", ["", *units], rows)


def _parameters(caption: str, parameters: Sequence[InertialChange]) -> Table:
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
