"""The report of a subject's dynamics: the verdict first, then what it rests on."""

from __future__ import annotations

from collections.abc import Iterator

from scaling_service.capabilities.dynamics.document import DynamicsDocument
from scaling_service.capabilities.dynamics.report.data import DynamicsData, told
from scaling_service.capabilities.dynamics.report.inertia import inertia_section
from scaling_service.capabilities.dynamics.report.residuals import residuals_section
from scaling_service.capabilities.dynamics.report.uncertainty import uncertainty_section
from scaling_service.report.blocks import Block, Bullets, Callout, Details, Row, Table, Text, Tone
from scaling_service.report.page import Page, Section
from scaling_service.report.provenance import input_blocks, repair_blocks, warning_blocks


def dynamics_page(data: DynamicsData) -> Page:
    """The page of one person's dynamics.

    Parameters
    ----------
    data : DynamicsData
    """
    document = data.document
    inertial = [inertia_section(document.inertial)] if document.inertial is not None else []
    return Page(
        f"Dynamics of {document.subject}",
        [
            Section("Verdict", list(_verdict(document))),
            residuals_section(data),
            uncertainty_section(data),
            *inertial,
            Section("Joint loads", list(_loads(document)), new_page=True),
            Section("Where this comes from", list(_provenance(document)), new_page=True),
        ],
        subtitle=_subtitle(document),
        footer=f"scaling-service {document.code_version}. The numbers are in dynamics.json, too.",
    )


def _subtitle(document: DynamicsDocument) -> str:
    model = "The given model as it is" if document.start == "none" else f"Model scaled by {document.start}"
    inertia = "its own inertia" if document.inertia == "model" else f"inertia of {document.inertia}"
    return f"{model}, {inertia}, {document.mass_kg:.1f} kg, {document.height_m:.2f} m"


_HEADLINES: tuple[tuple[str, Tone], ...] = (
    ("These recordings cannot tell this person's inertia better than a table", "unknown"),
    ("These recordings can tell this person's inertia in part", "fair"),
    ("These recordings can tell this person's inertia", "good"),
)
"""For no component of any recording, some, or all."""


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
