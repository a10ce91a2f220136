"""The report of a subject's dynamics: the verdict first, then what it rests on."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence

import numpy as np
import plotly.graph_objects as go

from scaling_service.capabilities.dynamics.document import (
    DynamicsDocument,
    IdentificationDocument,
    InertialChange,
    TrialDynamicsDocument,
    merge_warnings,
)
from scaling_service.capabilities.kinetics.inverse_dynamics import COMPONENTS, HICKS
from scaling_service.numerics.multibody.laws import Array
from scaling_service.report.blocks import (
    Block,
    Bullets,
    Callout,
    Cell,
    Details,
    Grid,
    Heading,
    Legend,
    Page,
    Row,
    Section,
    Table,
    Text,
    Tone,
)
from scaling_service.report.figures import Figure, make_chart
from scaling_service.report.methods import FAINT, INK
from scaling_service.report.provenance import build_origin_blocks

_HEADLINES: tuple[tuple[str, Tone], ...] = (
    ("These recordings cannot tell this person's inertia better than a table", "unknown"),
    ("These recordings can tell this person's inertia in part", "fair"),
    ("These recordings can tell this person's inertia", "good"),
)
"""For no component of any recording, some, or all."""

_WRONG_MASS: tuple[str, Tone] = (
    "The declared mass is wrong: until it is right, nothing is said about the inertia",
    "fair",
)

_DARKEST = 3.0
"""Prior standard deviations of the darkest cell (chosen: beyond it a change counts as a surprise)."""

_NOTED = 0.1
"""Least change that is worth a row in the first table, prior standard deviations (chosen)."""


def build_dynamics_page(document: DynamicsDocument, curves: Curves) -> Page:
    """The page of one person's dynamics."""
    model = "The given model as it is" if document.start == "none" else f"Model scaled by {document.start}"
    inertia = "its own inertia" if document.inertia == "model" else f"inertia of {document.inertia}"
    chapters = {
        "Residuals": build_residual_blocks(document, curves),
        "Residual against its uncertainty": build_uncertainty_blocks(document),
    }
    if document.inertial is not None:
        chapters["Identified inertia"] = _build_inertia(document.inertial)
    chapters |= {"Joint loads": _build_loads(document), "Where this comes from": _build_provenance(document)}
    return Page(
        f"Dynamics of {document.subject}",
        [
            Section("Verdict", list(_build_verdict(document))),
            *(Section(title, list(blocks), new_page=True) for title, blocks in chapters.items()),
        ],
        subtitle=f"{model}, {inertia}, {document.mass_kg:.1f} kg, {document.height_m:.2f} m",
        footer=f"scaling-service {document.code_version}. The numbers are in dynamics.json, too.",
    )


def _build_verdict(document: DynamicsDocument) -> Iterator[Block]:
    supported = [yes for trial in document.trials.values() for yes in trial.calibration_supported]
    headline, tone = _WRONG_MASS if document.weight.differs else _HEADLINES[any(supported) + all(supported)]
    yield Callout(headline, [Text(document.verdict), Bullets(merge_warnings(document))], tone)


def _build_loads(document: DynamicsDocument) -> Iterator[Block]:
    trials = document.trials
    loads = [trial.joint_loads for trial in trials.values()]
    rows = [
        Row(f"{name}, {load.unit}", [f"{of[name].peak:.1f} ({of[name].rms:.1f})" for of in loads])
        for name, load in loads[0].items()
    ]
    yield Table(
        caption="Generalised forces: largest size (RMS)",
        columns=["", *trials],
        rows=rows,
        note="Those of the root's coordinates are the residual in the root's own axes. Over time: "
        "TRIAL_id.sto.",
        long=len(trials) < 3,
    )


def _build_provenance(document: DynamicsDocument) -> Iterator[Block]:
    yield from build_origin_blocks(document, document.warnings)
    seconds = Row("seconds in all", [f"{document.wall_s:.1f}"])
    yield Details("Computing time", [Table(caption="Computing time", columns=["", ""], rows=[seconds])])


def _build_inertia(found: IdentificationDocument) -> Iterator[Block]:
    """Inertial parameters before and after, and the wrench that each explains."""
    before, after = found.total_mass_kg
    mass = f"Total mass {before:.1f} kg" + ("" if abs(after - before) < 0.05 else f", now {after:.1f} kg")
    headline, tone = _write_headline(found)
    yield Callout(
        headline, [Bullets([f"{mass}. Components used: {_describe_used(found)}.", *found.warnings])], tone
    )
    yield Text(
        "Tables are the prior, with the scatter between them as its standard deviation. Only combinations "
        "that the recordings say more about than the tables do were free to move; every segment stays a "
        "possible body (positive mass, pseudo-inertia positive definite, centre of mass within its joints "
        "and markers)."
    )
    yield from make_inertial_tables(found)
    if found.combinations:
        yield _tabulate_combinations(found)
    yield Details(
        f"All {len(found.parameters)} numbers",
        [_tabulate_parameters("All inertial parameters", found.parameters)],
    )


def make_inertial_tables(found: IdentificationDocument, most: int | None = None) -> Iterator[Table]:
    """The wrench that each inertia explains, and what moved, ``most`` numbers of it at most."""
    yield _tabulate_fits(found)
    moved = [p for p in found.parameters if abs(p.moved) >= _NOTED]
    if moved:
        largest = moved if most is None else sorted(moved, key=lambda p: -abs(p.moved))[:most]
        yield _tabulate_parameters(f"What moved by {_NOTED:g} prior SD or more", largest)


def _write_headline(found: IdentificationDocument) -> tuple[str, Tone]:
    count = len(found.combinations)
    if not count:
        return "Nothing moved: the recordings say less about the inertia than the tables", "unknown"
    moved = f"{count} combination{'s' if count != 1 else ''} of parameters moved"
    ratio = found.held_out_ratio
    if ratio is None:
        return f"{moved}; no recording was held out to check it", "unknown"
    what = "the wrench" if all(found.components) else _describe_used(found)
    better = ratio < 1.0
    how = f"{100 * abs(ratio - 1):.0f} % {'better' if better else 'worse'}"
    return f"{moved}; {what} of held-out recordings is explained {how}", "good" if better else "poor"


def _describe_used(found: IdentificationDocument) -> str:
    return ", ".join(c for c, yes in zip(COMPONENTS, found.components, strict=True) if yes)


def _tabulate_fits(found: IdentificationDocument) -> Table:
    rows: list[Row] = []
    for name, fit in found.trials.items():
        rows.append(Row(f"{name} ({'held out' if fit.held_out else 'used to fit'})"))
        for when, wrench in (("before", fit.before), ("after", fit.after)):
            rows.append(Row(when, [f"{value:.1f}" for value in wrench.model_dump().values()]))
    units = [f"{c}, {'N' if c.startswith('f') else 'N m'}" for c in COMPONENTS]
    return Table(caption="RMS error of the ground wrench, before and after", columns=["", *units], rows=rows)


def _tabulate_parameters(caption: str, parameters: Sequence[InertialChange]) -> Table:
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
        caption=caption,
        columns=["", "before", "after", "prior SD", "SD", "moved, prior SD", "determined"],
        rows=rows,
        note="Centres of mass in the segment's frame, moments of inertia about the centre of mass. "
        "Determined: the recordings say more about this number alone than the tables do.",
    )


def _tabulate_combinations(found: IdentificationDocument) -> Table:
    rows = [
        Row(
            ", ".join(f"{part.weight:+.2f} {part.segment} {part.quantity}" for part in c.parts),
            [f"{c.gain:.3g}", f"{c.moved:+.2f}", f"{c.sd:.2f}"],
        )
        for c in found.combinations
    ]
    return Table(
        caption="Combinations that the recordings determine, best first",
        columns=["largest parts", "information", "moved", "SD"],
        rows=rows,
        note="Parts, change and SD in units of the prior's SD; information over that of the prior. S: second "
        "moment of the mass about its centre.",
        words=True,
    )


Curves = Mapping[str, tuple[Array, Array]]
"""By trial: times (n,), s, and residual (n, 6), N and N m; NaN in frames that do not count."""

_AXES = (("x, forward", "#0072B2", "solid"), ("y, up", "#D55E00", "dash"), ("z, right", "#009E73", "dot"))
"""Name, colour and dash of each axis; colours of Okabe & Ito 2008."""
_PLATE = "#0072B2"
_LOW, _HIGH = 1e-4, 100.0  # %; chosen: from below any plate's noise to the whole body weight


def build_residual_blocks(document: DynamicsDocument, curves: Curves) -> Iterator[Block]:
    """Residuals of every recording over time, against published limits, and their RMS."""
    yield Text(
        "The residual is the force and moment that the motion needs and the plates do not show. Its moment "
        "is about the origin of the root segment. Grey lines: the peak that Hicks et al. 2015 allow, 5 % of "
        "the net external force, and 1 % of it times the height of the centre of mass."
    )
    yield Legend([*_AXES, ("limit of Hicks et al. 2015", FAINT, "solid")])
    for name, (times, residual) in curves.items():
        trial = document.trials[name]
        yield Heading(f"{name} ({trial.role}), forces from {trial.forces_from}")
        yield Grid(
            [
                _draw_over_time(name, trial, times, residual[:, :3], "force", "N"),
                _draw_over_time(name, trial, times, residual[:, 3:], "moment", "N m"),
            ]
        )
    yield from make_residual_tables(document.trials)


def _draw_over_time(
    name: str, trial: TrialDynamicsDocument, times: Array, residual: Array, what: str, unit: str
) -> Figure:
    limit = next(g.limit for g in trial.gates if g.name == f"peak {what}" and g.source == HICKS)
    traces = [
        go.Scatter(
            x=np.round(times, 4),
            y=np.round(residual[:, k], 2).astype(np.float32),
            name=axis,
            mode="lines",
            line={"color": colour, "dash": dash, "width": 1.5},
            hovertemplate=f"%{{y:.1f}} {unit}",
        )
        for k, (axis, colour, dash) in enumerate(_AXES)
    ]
    across = {"type": "line", "xref": "paper", "x0": 0, "x1": 1, "line": {"color": FAINT, "width": 1.5}}
    bounds = [across | {"y0": at, "y1": at} for at in (limit, -limit)]
    peaks = np.nanmax(np.abs(residual), axis=0)
    said = ", ".join(f"{axis} {peak:.0f}" for (axis, _, _), peak in zip(_AXES, peaks, strict=True))
    return Figure(
        make_chart(traces, x_title="time, s", y_title=f"residual {what}, {unit}", shapes=bounds),
        f"{name}: residual {what}",
        f"Residual {what} of {name} over time, {unit}. Largest: {said}. Limit {limit:.0f}.",
        240,
    )


def make_residual_tables(trials: Mapping[str, TrialDynamicsDocument]) -> tuple[Table, Table, Table]:
    """Residuals of every recording: their RMS, beside their uncertainty, and against published limits."""
    first = next(iter(trials.values()))
    columns = ["", *(f"{name} ({trial.role})" for name, trial in trials.items())]
    rms = Table(
        caption="RMS of the residual",
        columns=columns,
        rows=[
            *(
                Row(
                    key.replace("_", ", ").replace("Nm", "N m"),
                    [f"{getattr(trial.residual_rms, key):.1f}" for trial in trials.values()],
                )
                for key in first.residual_rms.model_dump()
            ),
            Row("frames that count", [str(t.frames) for t in trials.values()]),
            Row("frames left out", [str(t.left_out) for t in trials.values()]),
        ],
        note="Left out: frames whose motion or forces are not all known, and half a period of the "
        "filter's cutoff at both ends of the others.",
    )
    shares = Table(
        caption="Residual (its uncertainty), % of weight, of weight × height",
        columns=columns,
        rows=[
            *(
                Row(
                    component,
                    [f"{100 * t.dr[k]:.1f} ({100 * t.uncertainty.total[k]:.1f})" for t in trials.values()],
                )
                for k, component in enumerate(COMPONENTS)
            ),
            Row("marker error, mm", [f"{t.reconstruction_error_mm:.1f}" for t in trials.values()]),
        ],
    )
    gates = Table(
        caption="Residuals against published limits: value (limit)",
        columns=columns,
        rows=[
            Row(f"{gate.source}: {gate.name}, {gate.unit}", [_format_gate(t, k) for t in trials.values()])
            for k, gate in enumerate(first.gates)
        ],
        note="Hicks et al. 2015 (J Biomech Eng 137:020905, table 2) and OpenSim's simulation "
        "checklist, which holds for walking. Keeping them is necessary, not sufficient.",
    )
    return rms, shares, gates


def _format_gate(trial: TrialDynamicsDocument, k: int) -> Cell:
    gate = trial.gates[k]
    return Cell(
        f"{gate.value:.0f} ({gate.limit:.0f}) {'kept' if gate.passed else 'broken'}",
        tone="good" if gate.passed else "poor",
    )


def build_uncertainty_blocks(document: DynamicsDocument) -> Iterator[Block]:
    """Residual indicator and uncertainty of every recording."""
    yield Text(
        "Errors of markers and plates alone give a residual, whatever the inertia. Where the residual stands "
        "below that, nothing can be learnt of the inertia from it: an identification would fit noise. "
        "Motions with a larger reconstruction error are drawn and filtered as the measured one; the "
        "dispersion of their residuals grows in proportion to the added error. At an added error as large "
        "as the recording's own it is the kinematic uncertainty (Muller et al. 2017)."
    )
    colours = {"residual": INK, "uncertainty by the motion": FAINT, "uncertainty by the plates": _PLATE}
    yield Legend([(name, colour, "solid") for name, colour in colours.items()])
    yield Grid([_draw_bars(name, trial) for name, trial in document.trials.items()])
    for name, trial in document.trials.items():
        yield _tabulate_shares(name, trial)


def _draw_bars(name: str, trial: TrialDynamicsDocument) -> Figure:
    sets = (
        ("residual", trial.dr, INK),
        ("by the motion", trial.uncertainty.kinematic, FAINT),
        ("by the plates", trial.uncertainty.plate, _PLATE),
    )
    traces = [
        go.Bar(
            x=list(COMPONENTS),
            y=[max(100.0 * v, _LOW) for v in values],
            name=title,
            marker={"color": colour},
            hovertemplate="%{y:.3g} %",
        )
        for title, values, colour in sets
    ]
    ticks = [10.0**k for k in range(-4, 3)]
    drawn = make_chart(traces, y_title="% of weight, of weight × height", barmode="group")
    # whole decades, at least up to the body weight
    top = math.ceil(math.log10(max(100.0 * max(*trial.dr, *trial.uncertainty.kinematic), _HIGH)))
    drawn.update_yaxes(
        type="log", range=[math.log10(_LOW), top], tickvals=ticks, ticktext=[f"{t:g}" for t in ticks]
    )
    said = ", ".join(
        f"{c} {100 * d:.2g} against {100 * u:.2g}"
        for c, d, u in zip(COMPONENTS, trial.dr, trial.uncertainty.total, strict=True)
    )
    return Figure(
        drawn,
        f"{name}, logarithmic",
        f"Residual of {name} against its uncertainty, % of body weight or of weight times height: {said}.",
        300,
    )


def _tabulate_shares(name: str, trial: TrialDynamicsDocument) -> Table:
    spread = trial.uncertainty
    shares = zip(trial.dr, spread.kinematic, spread.plate, spread.total, trial.slopes_per_cm, strict=True)
    cells = [[f"{100.0 * share:.3g}" for share in row] for row in shares]
    rows = [
        Row(c, [*row, f"{r2:.3f}", Cell("yes", tone="good") if yes else Cell("no", tone="unknown")])
        for c, row, r2, yes in zip(COMPONENTS, cells, trial.r2, trial.calibration_supported, strict=True)
    ]
    columns = ["residual", "motion", "plates", "uncertainty", "slope per cm", "R²", "can calibrate inertia"]
    return Table(
        caption=f"{name}: shares of body weight (forces) and of weight times height (moments), %",
        columns=["", *columns],
        rows=rows,
        note=f"Mean reconstruction error {trial.reconstruction_error_mm:.1f} mm.",
    )
