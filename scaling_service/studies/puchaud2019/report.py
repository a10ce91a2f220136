"""The page of Puchaud 2019 done again: claims first, then the paper's tables and figures beside ours."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from scaling_service.capabilities.cohort.report import (
    build_angle_blocks,
    build_statistics_sections,
    describe_quantity,
)
from scaling_service.core.text import format_p
from scaling_service.report.blocks import Cell, Grid, Page, Row, Section, Table
from scaling_service.report.figures import Figure, draw_grouped_bars
from scaling_service.report.methods import FAINT, list_method_columns, list_styles
from scaling_service.studies.claims import build_study_page
from scaling_service.studies.puchaud2019.paper import Beside, Puchaud2019Document


def build_page(document: Puchaud2019Document) -> Page:
    """The page of the study."""
    return build_study_page(
        "Puchaud et al. 2019",
        document,
        [
            Section("The paper's tables beside ours", list(make_tables(document)), new_page=True),
            Section("The paper's figures beside ours", [_build_figures(document)], new_page=True),
            Section(
                f"Figure 6: joint angles of {len(document.walkers)} walkers",
                list(build_angle_blocks(document.walkers_statistics.joint_angles)),
                new_page=True,
            ),
            *build_statistics_sections(document.statistics),
        ],
    )


def make_tables(document: Puchaud2019Document) -> Iterator[Table]:
    """The paper's tables beside ours."""
    yield _tabulate_beside("Table 2: segment lengths, mm", document.segment_lengths_mm)
    yield _tabulate_beside("Table 3: knee axes, degrees", document.knee_axis_deg)
    literature = ", ".join(f"{who} {value:.1f}" for who, value in document.literature_error_mm.items())
    yield _tabulate_beside(
        "Table 5 and figure 5: kinematic error on hip and knee movements, mm",
        document.kinematic_error_mm,
        f"Others, as table 5 gives them: {literature} mm.",
    )
    yield _tabulate_beside("Marker shifts (section 3.1), mm", document.marker_shift_mm)


def _by_quantity(cells: Sequence[Beside]) -> dict[str, dict[str, Beside]]:
    """Quantity to method to its cell."""
    found: dict[str, dict[str, Beside]] = {}
    for cell in cells:
        found.setdefault(cell.quantity, {})[cell.method] = cell
    return found


def _tabulate_beside(caption: str, cells: Sequence[Beside], note: str = "") -> Table:
    methods = list(dict.fromkeys(cell.method for cell in cells))
    rows: list[Row] = []
    for quantity, of in _by_quantity(cells).items():
        rows.append(Row(f"{describe_quantity(quantity)}, paper", [_format_paper(of.get(m)) for m in methods]))
        rows.append(Row("here", [_format_ours(of.get(m)) for m in methods]))
    said = "Mean ± SD over subjects. A star: differs from EB (Tukey's HSD after Friedman's test)."
    return Table(
        caption=caption, columns=["", *list_method_columns(methods)], rows=rows, note=f"{said} {note}".strip()
    )


def _format_paper(cell: Beside | None) -> str:
    if cell is None or cell.paper_mean is None:
        return "–"
    return f"{cell.paper_mean:.1f} ± {cell.paper_sd or 0.0:.1f}{cell.paper_stars}"


def _format_ours(cell: Beside | None) -> Cell:
    if cell is None:
        return Cell("–")
    tested = f" (p {format_p(cell.p_from_EB)})" if cell.p_from_EB is not None and cell.significant else ""
    return Cell(f"{cell.mean:.1f} ± {cell.sd:.1f}{'*' if cell.significant else ''}{tested}")


def _build_figures(document: Puchaud2019Document) -> Grid:
    return Grid(
        [
            _draw_bars("Figure 4: length minus that of EB, mm", document.length_difference_mm),
            _draw_bars("Figure 5: kinematic error, mm", document.kinematic_error_mm),
        ]
    )


def _draw_bars(caption: str, cells: Sequence[Beside]) -> Figure:
    """The paper's means in grey, ours in the method's colour, each with its SD."""
    known = list_styles(list(dict.fromkeys(cell.method for cell in cells)))
    many = len({cell.quantity for cell in cells}) > 1
    names = [f"{describe_quantity(c.quantity)} {c.method}" if many else c.method for c in cells]
    figure = draw_grouped_bars(
        names,
        [
            ("paper", FAINT, [cell.paper_mean for cell in cells]),
            ("here", [known[cell.method].colour for cell in cells], [cell.mean for cell in cells]),
        ],
        [[cell.paper_sd for cell in cells], [cell.sd for cell in cells]],
        y_title="mm",
    )
    described = "; ".join(
        f"{name}: paper {_format_paper(cell)}, here {cell.mean:.1f} ± {cell.sd:.1f}"
        for name, cell in zip(names, cells, strict=True)
    )
    return Figure(figure, f"{caption}. Grey: the paper.", f"{caption}. {described}.", 320)
