"""The study of Puchaud 2019 on few virtual persons: what is written, and that it says the same everywhere."""

from __future__ import annotations

from pathlib import Path

import pytest

from scaling_service.capabilities.shared.settings import Settings
from scaling_service.cli import main
from scaling_service.core.errors import InputError
from scaling_service.studies.claims import draw_person_seeds, save_study
from scaling_service.studies.puchaud2019.claims import CLAIMS
from scaling_service.studies.puchaud2019.result import (
    METHODS,
    Beside,
    Puchaud2019Document,
    read_paper,
    summarise,
)
from scaling_service.studies.puchaud2019.run import reproduce_puchaud2019
from tests.report.reading import Node, read

costly = pytest.mark.costly
WALKERS = 2  # looked at alone; the paper's six, and one more, take twice as long
PERSONS = WALKERS + 1


@pytest.fixture(scope="module")
def result() -> Puchaud2019Document:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("scaling_service.studies.puchaud2019.run.WALKERS", WALKERS)
        return reproduce_puchaud2019(Settings(), subjects=PERSONS, worker_count=2)


@pytest.fixture(scope="module")
def page(result: Puchaud2019Document, tmp_path_factory: pytest.TempPathFactory) -> Node:
    folder = tmp_path_factory.mktemp("study")
    assert save_study(result, summarise(result), folder) == ("report.html", "study.json")
    written = Puchaud2019Document.model_validate_json((folder / "study.json").read_bytes())
    assert written == result
    return read((folder / "report.html").read_text(encoding="utf-8"))


def _cell(cells: list[Beside], quantity: str, method: str) -> Beside:
    (found,) = [c for c in cells if (c.quantity, c.method) == (quantity, method)]
    return found


@costly
def test_tables_hold_the_papers_numbers_and_ours(result: Puchaud2019Document) -> None:
    femur = _cell(result.segment_lengths_mm, "femur_r", "MB_lam")
    assert (femur.paper_mean, femur.paper_sd, femur.paper_stars) == (440.2, 23.3, "**")
    ours = result.statistics.quantity("segment_lengths_mm", "femur_r")
    assert femur.mean == pytest.approx(ours.mean["MB_lam"], abs=1e-3)
    assert len(result.segment_lengths_mm) == 5 * len(METHODS)
    error = _cell(result.kinematic_error_mm, "calibration", "MB")
    assert error.paper_mean == pytest.approx(read_paper()["kinematic_error_mm"]["MB"][0])
    gap = _cell(result.length_difference_mm, "femur_l", "MB")
    lengths = result.statistics.quantity("segment_lengths_mm", "femur_l")
    assert gap.mean == pytest.approx(lengths.mean["MB"] - lengths.mean["EB"], abs=1e-3)


@costly
def test_lengths_of_images_are_near_the_truth(result: Puchaud2019Document) -> None:
    from_truth = result.statistics.quantity("from_truth_mm", "lengths").mean
    assert from_truth["EB"] < 3.0 < from_truth["MB"]


@costly
def test_every_claim_is_answered(result: Puchaud2019Document) -> None:
    assert [c.claim for c in result.claims] == [said["claim"] for said in CLAIMS.said["claims"].values()]
    assert len(result.walkers) == WALKERS
    assert len(result.subjects) == PERSONS


@costly
def test_the_page_says_what_the_document_says(result: Puchaud2019Document, page: Node) -> None:
    claims = next(t for t in page.all("table") if t.attributes["aria-label"] == "Claim by claim")
    rows = [[cell.text for cell in (*row.all("th"), *row.all("td"))] for row in claims.all("tr")[1:]]
    word = {True: "holds", False: "does not hold", None: "undecided"}
    assert rows == [[c.where, c.claim, word[c.holds], c.paper, c.ours] for c in result.claims]
    said = page.all("main")[0].text
    assert "Table 2: segment lengths, mm" in said
    assert "Table 5 and figure 5: kinematic error" in said


@costly
def test_another_seed_is_other_persons(result: Puchaud2019Document) -> None:
    assert result.subjects[0] == "virtual_1"
    assert not set(draw_person_seeds(0, 26)) & set(draw_person_seeds(1, 26))


def test_too_few_subjects_are_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(InputError, match="too few"):
        reproduce_puchaud2019(subjects=6)
    assert main(["reproduce", "puchaud2019", "--subjects", "3", "--out", str(tmp_path / "s")]) == 2
    assert "--subjects" in capsys.readouterr().err
    assert not (tmp_path / "s").exists()
