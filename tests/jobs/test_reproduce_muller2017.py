"""The study of Muller 2017 on short recordings of few persons: what is written, and that claims are asked."""

from __future__ import annotations

import json

import numpy as np
import pytest

from scaling_service.core.errors import InputError
from scaling_service.studies.claims import save_study
from scaling_service.studies.muller2017.claims import CLAIMS
from scaling_service.studies.muller2017.excitation import ExcitationSettings
from scaling_service.studies.muller2017.monte_carlo import UncertaintySettings
from scaling_service.studies.muller2017.result import Muller2017Document
from scaling_service.studies.muller2017.study import reproduce_muller2017
from scaling_service.studies.muller2017.words import summarise
from tests.finished import make_once
from tests.report.reading import Node, read

costly = pytest.mark.costly  # a study, like that of Puchaud 2019
FEW = UncertaintySettings(samples=12, motions=60)
SHORT = ExcitationSettings(seconds=6.0)


@pytest.fixture(scope="module")
def document(tmp_path_factory: pytest.TempPathFactory) -> Muller2017Document:
    return make_once(
        tmp_path_factory,
        "muller2017",
        lambda: reproduce_muller2017(FEW, subjects=2, recorded=SHORT, worker_count=1),
    )


@pytest.fixture(scope="module")
def page(document: Muller2017Document, tmp_path_factory: pytest.TempPathFactory) -> Node:
    folder = tmp_path_factory.mktemp("study")
    assert save_study(document, summarise(document), folder) == ("report.html", "study.json")
    written = json.loads((folder / "study.json").read_text(encoding="utf-8"))
    assert Muller2017Document.model_validate(written) == document
    return read((folder / "report.html").read_text(encoding="utf-8"))


@costly
def test_persons_hold_equation_12_and_their_truth(document: Muller2017Document) -> None:
    assert [person.name for person in document.persons] == ["excited_1", "excited_2"]
    for person in document.persons:
        sum_of_parts = np.array(person.kinematic) + np.array(person.plate)
        np.testing.assert_allclose(person.total, sum_of_parts, atol=1e-7)
        supported = np.array(person.dr) > np.array(person.total)
        assert list(person.calibration_supported) == supported.tolist()
        # what is left in all is what both errors leave, which are independent but for chance
        parts = np.hypot(person.true_measurement_error, person.true_inertial_error)
        np.testing.assert_allclose(person.dr, parts, rtol=0.5)
        assert len(person.markers) == 10
        assert 0 < person.windows_share <= 1


@costly
def test_every_claim_is_answered_and_few_persons_decide_no_test(document: Muller2017Document) -> None:
    assert [c.claim for c in document.claims] == [said["claim"] for said in CLAIMS.said["claims"].values()]
    answered = {c.claim: c for c in document.claims}
    assert answered["Vertical force and moment are least uncertain"].holds is None
    assert answered["The plates' noise is negligible"].holds
    assert "R2" in answered["Uncertainty grows linearly with the added reconstruction error"].ours


@costly
def test_the_page_says_what_the_document_says(document: Muller2017Document, page: Node) -> None:
    claims = next(t for t in page.all("table") if t.attributes["aria-label"] == "Claim by claim")
    rows = [[cell.text for cell in (*row.all("th"), *row.all("td"))] for row in claims.all("tr")[1:]]
    word = {True: "holds", False: "does not hold", None: "undecided"}
    assert rows == [[c.where, c.claim, word[c.holds], c.paper, c.ours] for c in document.claims]
    for said in (
        "Means over persons",
        "Windows worth calibrating with",
        "true held-out error of inertia, after",
    ):
        assert said in page.all("main")[0].text


def test_no_subject_is_refused() -> None:
    with pytest.raises(InputError, match="no subject"):
        reproduce_muller2017(FEW, subjects=0)
