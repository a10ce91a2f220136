"""The report of one person: the verdict first, then what it rests on."""

from __future__ import annotations

from scaling_service.capabilities.scaling.report.angles import angles_section
from scaling_service.capabilities.scaling.report.clinical import clinical_section
from scaling_service.capabilities.scaling.report.data import SubjectData
from scaling_service.capabilities.scaling.report.errors import errors_section
from scaling_service.capabilities.scaling.report.geometry import geometry_section
from scaling_service.capabilities.scaling.report.numbers import numbers_section, provenance_section
from scaling_service.capabilities.scaling.report.verdict import verdict_section
from scaling_service.report.blocks import Block, Text
from scaling_service.report.page import Page, Section

_HOW_TO_READ = (
    "Black dots are the measured markers. Each model stands where it follows them best; rings are its "
    "markers, dots its joint centres, dashed lines its knee axes. Drag to turn. Floor lines are 25 cm apart; "
    "the view goes along with the person."
)


def subject_page(data: SubjectData) -> Page:
    """The page of one person.

    Parameters
    ----------
    data : SubjectData
    """
    document = data.document
    return Page(
        f"Scaled models of {document.subject}",
        [
            verdict_section(data),
            _overlay_section(data),
            errors_section(data),
            geometry_section(data),
            angles_section(data),
            clinical_section(data),
            numbers_section(data),
            provenance_section(data),
        ],
        subtitle=f"Methods: {', '.join(document.methods)}",
        footer=f"scaling-service {document.code_version}. The numbers are in comparison.json, too.",
    )


def _overlay_section(data: SubjectData) -> Section:
    blocks: list[Block] = (
        [Text("No movement was recorded, so there is nothing to show.")]
        if data.scene is None
        else [
            Text(_HOW_TO_READ),
            data.scene,
        ]
    )
    return Section("The models in space", blocks, new_page=True)
