"""What is said of a person's dynamics, once for terminal, page and report."""

from __future__ import annotations

from collections import abc

from scaling_service.capabilities.dynamics import result as documents
from scaling_service.capabilities.kinetics.inverse_dynamics import COMPONENTS
from scaling_service.capabilities.shared import names
from scaling_service.core.names import spell_name
from scaling_service.documents.base import Tone
from scaling_service.report import tables
from scaling_service.report.summary import Summary

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

_NOTED = 0.1
"""Least change that is worth a row in the first table, prior standard deviations (chosen)."""


def summarise(document: documents.DynamicsDocument) -> Summary:
    """The verdict on these recordings, what to beware of, residuals, and inertia where it was identified."""
    found = document.inertial
    inertial = () if found is None else make_inertial_tables(found)
    return Summary(
        title=f"Dynamics of {document.subject}",
        subtitle=f"The {describe_model(document)}, {document.height_m:.2f} m",
        headline=document.headline,
        tone=document.tone,
        why=[document.verdict, *([] if found is None else [f"{found.headline}."])],
        cautions=list_cautions(document),
        tables=[*make_residual_tables(document.trials), *inertial],
    )


def describe_model(document: documents.DynamicsDocument) -> str:
    """Which model was checked, with which inertia."""
    how = "as given" if document.start == names.AS_IT_IS else f"scaled by {document.start}"
    own = "its own inertia" if document.inertia == names.OWN else f"inertia of {document.inertia}"
    return f"model {how}, {own}, {document.mass_kg:.1f} kg"


def list_cautions(document: documents.DynamicsDocument) -> list[str]:
    """All warnings, each once."""
    found = () if document.inertial is None else document.inertial.warnings
    return list(dict.fromkeys((*document.warnings, *documents.merge_warnings(document), *found)))


def write_headline(supported: abc.Sequence[bool], *, wrong_mass: bool) -> tuple[str, Tone]:
    """Whether recordings can tell a person's inertia, and whether that is good news.

    ``supported``: of every component of every recording, whether it can.

    Examples
    --------
    >>> write_headline([True, False], wrong_mass=False)
    ("These recordings can tell this person's inertia in part", 'fair')
    """
    return _WRONG_MASS if wrong_mass else _HEADLINES[any(supported) + all(supported)]


def make_inertial_tables(
    found: documents.IdentificationDocument, most: int | None = None
) -> abc.Iterator[tables.Table]:
    """The wrench that each inertia explains, and what moved, ``most`` numbers of it at most."""
    rows: list[tables.Row] = []
    for name, fit in found.trials.items():
        rows.append(tables.Row(f"{name} ({'held out' if fit.held_out else 'used to fit'})"))
        for when, wrench in (("before", fit.before), ("after", fit.after)):
            rows.append(tables.Row(when, [f"{value:.1f}" for value in wrench.model_dump().values()]))
    units = [f"{c}, {'N' if c.startswith('f') else 'N m'}" for c in COMPONENTS]
    yield tables.Table(
        caption="RMS error of the ground wrench, before and after", columns=["", *units], rows=rows
    )
    moved = [p for p in found.parameters if abs(p.moved) >= _NOTED]
    if moved:
        largest = moved if most is None else sorted(moved, key=lambda p: -abs(p.moved))[:most]
        caption = f"What moved by {_NOTED:g} prior SD or more"
        rows = [
            tables.Row(
                f"{spell_name(p.segment)}: {p.quantity}, {p.unit}",
                [
                    f"{p.before:.4g}",
                    f"{p.after:.4g}",
                    f"{p.prior_sd:.2g}",
                    f"{p.sd:.2g}",
                    f"{p.moved:+.2f}",
                    tables.Cell("yes", tone="good") if p.identifiable else tables.Cell("no", tone="unknown"),
                ],
            )
            for p in largest
        ]
        yield tables.Table(
            caption=caption,
            columns=["", "before", "after", "prior SD", "SD", "moved, prior SD", "determined"],
            rows=rows,
            note="Centres of mass in the segment's frame, moments of inertia about the centre of mass. "
            "Determined: the recordings say more about this number alone than the tables do.",
        )


def write_inertial_headline(
    combinations: int, held_out_ratio: float | None, components: abc.Sequence[bool]
) -> tuple[str, Tone]:
    """What an identification of inertia found, and whether that is good news."""
    count = combinations
    if not count:
        return "Nothing moved: the recordings say less about the inertia than the tables", "unknown"
    moved = f"{count} combination{'s' if count != 1 else ''} of parameters moved"
    ratio = held_out_ratio
    if ratio is None:
        return f"{moved}; no recording was held out to check it", "unknown"
    what = (
        "the wrench"
        if all(components)
        else ", ".join(c for c, yes in zip(COMPONENTS, components, strict=True) if yes)
    )
    percent, better = round(100 * abs(ratio - 1.0)), ratio < 1.0
    if not percent:
        return f"{moved}; {what} of held-out recordings is explained no better", "fair"
    how = f"{percent} % {'better' if better else 'worse'}"
    return f"{moved}; {what} of held-out recordings is explained {how}", "good" if better else "poor"


def make_residual_tables(
    trials: abc.Mapping[str, documents.TrialDynamicsDocument],
) -> tuple[tables.Table, tables.Table, tables.Table]:
    """Residuals of every recording: their RMS, beside their uncertainty, and against published limits."""
    first = next(iter(trials.values()))
    columns = ["", *(f"{name} ({trial.role})" for name, trial in trials.items())]
    rms = tables.Table(
        caption="RMS of the residual",
        columns=columns,
        rows=[
            *(
                tables.Row(
                    key.replace("_", ", ").replace("Nm", "N m"),
                    [f"{getattr(trial.residual_rms, key):.1f}" for trial in trials.values()],
                )
                for key in first.residual_rms.model_dump()
            ),
            tables.Row("frames that count", [str(t.frames) for t in trials.values()]),
            tables.Row("frames left out", [str(t.left_out) for t in trials.values()]),
        ],
        note="Left out: frames whose motion or forces are not all known, and half a period of the "
        "filter's cutoff at both ends of the others.",
    )
    shares = tables.Table(
        caption="Residual (its uncertainty), % of weight, of weight × height",
        columns=columns,
        rows=[
            *(
                tables.Row(
                    component,
                    [f"{100 * t.dr[k]:.1f} ({100 * t.uncertainty.total[k]:.1f})" for t in trials.values()],
                )
                for k, component in enumerate(COMPONENTS)
            ),
            tables.Row("marker error, mm", [f"{t.reconstruction_error_mm:.1f}" for t in trials.values()]),
        ],
    )
    gates = tables.Table(
        caption="Residuals against published limits: value (limit)",
        columns=columns,
        rows=[
            tables.Row(
                f"{gate.source}: {gate.name}, {gate.unit}",
                [
                    tables.Cell(
                        f"{g.value:.0f} ({g.limit:.0f}) {'kept' if g.passed else 'broken'}",
                        tone="good" if g.passed else "poor",
                    )
                    for g in (trial.gates[k] for trial in trials.values())
                ],
            )
            for k, gate in enumerate(first.gates)
        ],
        note="Hicks et al. 2015 (J Biomech Eng 137:020905, table 2) and OpenSim's simulation "
        "checklist, which holds for walking. Keeping them is necessary, not sufficient.",
    )
    return rms, shares, gates
