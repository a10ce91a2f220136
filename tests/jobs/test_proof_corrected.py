"""Labels that look exchanged are put right by what the look itself offers, and by what the document says."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from scaling_service.capabilities.intake.result import ProofDocument
from scaling_service.capabilities.subject.loading import open_subject
from scaling_service.core.errors import InputError, MarkerMissing
from scaling_service.documents.reading import check_document
from scaling_service.model.trial import Relabelling
from scaling_service.recording.exchanged import relabel
from tests.jobs.test_proof_mended import BARE, looked, moving, standing

pytestmark = pytest.mark.usefixtures("known_bodies")

WRONG = slice(60, 140)
CYCLE = {"RLFE": "RMFE", "RMFE": "RFH", "RFH": "RLFE"}


def exchanged(folder: Path, document: Mapping[str, Any] = BARE) -> ProofDocument:
    right = moving(1, "two")
    wrong = right.markers.copy()
    a, b = right.index("RLFE"), right.index("RMFE")
    wrong[WRONG, [a, b]] = right.markers[WRONG, [b, a]]
    bad = replace(right, markers=wrong)
    return looked(folder, {"one": standing(), "two": bad, "three": moving(2, "three")}, document)


def test_the_offer_puts_it_right(tmp_path: Path) -> None:
    """Also where no distance tells, but the direction of the line between the landmarks."""
    found = exchanged(tmp_path / "lab")
    (problem,) = [p for p in found.problems if p.corrections]
    (offer,) = problem.corrections
    assert offer.labels == {"RLFE": "RMFE", "RMFE": "RLFE"}
    assert (offer.from_s, offer.to_s) == pytest.approx((0.6, 1.39), abs=0.011)
    given = {**BARE, "corrections": {offer.file: [offer.model_dump(exclude={"file"})]}}
    again = exchanged(tmp_path / "lab", given)
    assert [p for p in again.problems if "exchanged" in p.problem] == []
    assert again.proposal is not None
    assert again.proposal["corrections"] == given["corrections"]


def test_scaling_reads_the_recording_as_corrected(tmp_path: Path) -> None:
    import yaml

    found = exchanged(tmp_path / "lab")
    assert found.proposal is not None
    (offer,) = next(p.corrections for p in found.problems if p.corrections)
    document = {**found.proposal, "corrections": {offer.file: [offer.model_dump(exclude={"file"})]}}
    file = tmp_path / "lab" / "subject.yaml"
    file.write_text(yaml.safe_dump(document), encoding="utf-8")
    (two,) = [t for t in open_subject(file).session.dynamic if t.name == "two"]
    true = moving(1, "two")
    away = np.linalg.norm(two.position("RLFE") - true.position("RLFE"), axis=1)
    assert np.nanmax(away) < 0.02  # smoothing; exchanged labels are 0.1 m apart
    assert any(repair.what == "labels_exchanged" for repair in two.repairs)


def test_a_mirrored_recording_is_refused_until_the_document_says_which_it_is(tmp_path: Path) -> None:
    """The axis is the document's to say; the other reading, exchanged sides, is offered."""
    right = moving(1, "two")
    trials = {
        "one": standing(),
        "two": right.with_markers(right.markers * [-1.0, 1.0, 1.0]),
        "three": moving(2, "three"),
    }
    found = looked(tmp_path / "lab", trials)
    (problem,) = [p for p in found.problems if p.severity == "error"]
    assert problem.file == "two.trc"
    assert "mirror image" in problem.problem
    assert not any(entry.ready for entry in found.readiness)
    (offer,) = problem.corrections
    mended: list[Mapping[str, Any]] = [
        {"mirrored": {"two.trc": "x"}},
        {"corrections": {"two.trc": [offer.model_dump(exclude={"file"})]}},
    ]
    for given in mended:
        again = looked(tmp_path / "lab", trials, {**BARE, **given})
        assert [p for p in again.problems if p.severity == "error"] == []
        assert again.proposal is not None
        assert given.items() <= again.proposal.items()
        assert any(entry.ready for entry in again.readiness)


def test_a_cycle_of_labels_is_undone() -> None:
    right = moving(3, "walk")
    columns = {name: right.index(name) for name in CYCLE}
    wrong = right.markers.copy()
    for label, true in CYCLE.items():
        wrong[WRONG, columns[label]] = right.markers[WRONG, columns[true]]
    item = Relabelling(CYCLE, float(right.times[60]), float(right.times[139]))
    np.testing.assert_array_equal(relabel(replace(right, markers=wrong), [item]).markers, right.markers)
    with pytest.raises(MarkerMissing, match="RNOSE"):
        relabel(right, [Relabelling({"RNOSE": "RLFE", "RLFE": "RNOSE"}, 0.0, 1.0)])


def test_a_marker_goes_under_another_label_for_a_while() -> None:
    """What was recorded under a label that nobody gave becomes the marker's again; a stray one goes."""
    right = moving(3, "walk")
    knee = right.index("RLFE")
    wrong = right.markers.copy()
    wrong[WRONG, knee] = np.nan
    stray = np.full((right.n_frames, 1, 3), np.nan)
    stray[WRONG, 0] = right.markers[WRONG, knee]
    spoilt = replace(right, labels=(*right.labels, "*12"), markers=np.concatenate([wrong, stray], axis=1))
    span = (float(right.times[60]), float(right.times[139]))
    again = relabel(spoilt, [Relabelling({"*12": "RLFE"}, *span)])
    np.testing.assert_array_equal(again.markers[:, :-1], right.markers)
    assert np.isnan(again.position("*12")).all()
    without = relabel(again, [Relabelling({"RLFE": None}, *span)])
    np.testing.assert_array_equal(without.markers[:, :-1], wrong)
    assert without.repairs[-1].detail.startswith("RLFE left out from 0.60 to 1.39 s")
    renamed = relabel(right, [Relabelling({"RLFE": "KNEE"}, 0.0, 1e3)])
    np.testing.assert_array_equal(renamed.position("KNEE"), right.position("RLFE"))
    assert np.isnan(renamed.position("RLFE")).all()


def test_a_trajectory_without_a_label_is_offered_for_the_gap_that_it_fills(tmp_path: Path) -> None:
    right = moving(1, "two")
    knee = right.index("RLFE")
    markers = np.concatenate([right.markers, np.full((right.n_frames, 1, 3), np.nan)], axis=1)
    markers[WRONG, -1] = right.markers[WRONG, knee]
    markers[WRONG, knee] = np.nan
    trials = {
        "one": standing(),
        "two": replace(right, labels=(*right.labels, "*12"), markers=markers),
        "three": moving(2, "three"),
    }
    found = looked(tmp_path / "lab", trials)
    (problem,) = [p for p in found.problems if p.corrections]
    (offer,) = problem.corrections
    assert offer.labels == {"*12": "RLFE"}
    assert (offer.from_s, offer.to_s) == pytest.approx((0.6, 1.39), abs=0.011)
    again = looked(
        tmp_path / "lab", trials, {**BARE, "corrections": {offer.file: [offer.model_dump(exclude={"file"})]}}
    )
    assert [p for p in again.problems if "no label" in p.problem] == []
    (two,) = [one for one in again.recordings if one.name == "two"]
    assert {one.label: one.seen for one in two.labels}["RLFE"] == 1.0


@pytest.mark.parametrize(
    ("labels", "times"),
    [
        ({"RLFE": "RMFE", "RFH": "RMFE"}, (0.0, 1.0)),
        ({"RLFE": "RLFE"}, (0.0, 1.0)),
        ({}, (0.0, 1.0)),
        (CYCLE, (2.0, 1.0)),
    ],
)
def test_what_is_no_correction_is_refused(labels: dict[str, str], times: tuple[float, float]) -> None:
    corrections = {"a.trc": [{"labels": labels, "from_s": times[0], "to_s": times[1]}]}
    document = {
        **BARE,
        "model": "lower_limb_14dof",
        "trials": {"static": "a.trc"},
        "corrections": corrections,
    }
    with pytest.raises(InputError, match=r"cannot be one marker|stands for itself|at least 1|ends before"):
        check_document(document)


def test_readiness_names_what_lacks(tmp_path: Path) -> None:
    found = looked(tmp_path / "lab", {"one": standing(), "two": moving(1, "two")})
    ready = {entry.analysis: entry for entry in found.readiness}
    assert ready["comparisons"].ready
    assert not ready["dynamics"].ready
    lacks = [need.name for need in ready["dynamics"].needs if need.required and not need.there]
    assert lacks == ["forces", "feet", "whole body"]  # what is proposed without forces has legs alone
    assert found.headline.startswith("2 of 4 analyses can run")
