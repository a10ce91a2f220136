"""The report of a subject's dynamics tells what the document tells."""

from __future__ import annotations

import pytest

from scaling_service.capabilities.dynamics.result import DynamicsDocument
from scaling_service.capabilities.dynamics.run import dynamics
from scaling_service.capabilities.dynamics.saving import save_dynamics
from scaling_service.capabilities.dynamics.settings import DynamicsSettings
from tests.jobs.force_laboratory import force_laboratory
from tests.report.reading import Node, held, read


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> tuple[DynamicsDocument, Node]:
    folder = tmp_path_factory.mktemp("page")
    chosen = DynamicsSettings(start="none", identify=True, despite_verdict=True, free_mass=True)
    document = save_dynamics(dynamics(force_laboratory(folder), chosen), folder / "out")
    return document, read((folder / "out" / "report.html").read_text(encoding="utf-8"))


def tables(root: Node) -> dict[str, list[list[str]]]:
    """Caption to rows."""
    found = {}
    for figure in root.all("figure", "tabular"):
        (caption,) = figure.all("figcaption")
        found[caption.text] = [
            [cell.text for cell in row.all("th") + row.all("td")] for row in figure.all("tr")[1:]
        ]
    return found


def test_the_residuals_over_time_are_inside(written: tuple[DynamicsDocument, Node]) -> None:
    inside = held(written[1])
    assert set(inside["files"]) == {
        "scene/residuals.json",
        "scene/sway.residual.f32",
        "scene/swing.residual.f32",
    }


def test_tables_hold_the_documents_numbers(written: tuple[DynamicsDocument, Node]) -> None:
    document, root = written
    found = tables(root)
    sway, swing = document.trials["sway"], document.trials["swing"]
    assert found["RMS of the residual"][0] == [
        "fx, N",
        f"{sway.residual_rms.fx_N:.1f}",
        f"{swing.residual_rms.fx_N:.1f}",
    ]
    (shares,) = (rows for caption, rows in found.items() if caption.startswith("Residual (its uncertainty)"))
    assert [row[0] for row in shares][:6] == ["fx", "fy", "fz", "mx", "my", "mz"]
    assert shares[5][1].startswith(f"{100 * sway.dr[5]:.1f} (")
    gates = found["Residuals against published limits: value (limit)"]
    assert len(gates) == len(sway.gates)
    assert all("kept" in cell or "broken" in cell for row in gates for cell in row[1:])
    assert document.inertial is not None
    assert found["RMS error of the ground wrench, before and after"]


def test_the_verdict_and_all_warnings_are_said(written: tuple[DynamicsDocument, Node]) -> None:
    document, root = written
    said = root.text
    assert document.verdict in said
    assert document.inertial is not None
    for warning in (*document.warnings, *document.inertial.warnings):
        assert warning in said
