"""A search saved: files that read back, labels back in place, a model that follows what was held out."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from scaling_service.capabilities.discovery.document import FILE_NAME, DiscoveryDocument
from scaling_service.capabilities.discovery.saving import save_discovery
from scaling_service.capabilities.discovery.words import summarise
from scaling_service.capabilities.motion.inverse_kinematics import inverse_kinematics
from scaling_service.files.trc import read_trc
from scaling_service.model.document import from_document
from scaling_service.virtual.example import SLIDING, SWAPPED
from tests.jobs.hidden_case import found, session
from tests.report.reading import held, read


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("saved")
    save_discovery(found(), out)
    return out


@pytest.fixture(scope="module")
def document(folder: Path) -> DiscoveryDocument:
    return DiscoveryDocument.model_validate_json((folder / FILE_NAME).read_text(encoding="utf-8"))


def test_what_was_hidden_is_named(document: DiscoveryDocument) -> None:
    assert document.verdict == "found"
    effects = {effect.kind: effect for effect in document.effects}
    assert effects.keys() == {SLIDING.kind, SWAPPED.kind}
    for hidden in (SLIDING, SWAPPED):
        effect = effects[hidden.kind]
        assert (set(effect.where), tuple(effect.driver)) == (set(hidden.where), hidden.driver)
        size = np.linalg.norm(list(hidden.parameters.values()))
        for name, true in hidden.parameters.items():
            value = effect.parameters[name].value
            assert isinstance(value, float)
            assert abs(value - true) < 0.1 * size


def test_the_gap_closes_on_what_was_held_out(document: DiscoveryDocument) -> None:
    level = document.gap.held_out.places["RLFE"]
    assert level.before is not None
    assert level.after is not None
    assert level.floor is not None
    assert level.after < 0.1 * level.before


def test_the_model_reads_back_and_follows_better(folder: Path) -> None:
    model = from_document(json.loads((folder / "model.json").read_text(encoding="utf-8")))
    walk = session().evaluation[0]
    errors = []
    for each in (session().model, model):
        motion = inverse_kinematics(each, walk)
        errors.append(np.nanmean(motion.distances[:, motion.markers.index("RLFE")]))
    assert errors[0] > 0.003
    assert errors[1] < 0.001


def test_labels_are_back_in_place(folder: Path) -> None:
    given = next(t for t in session().calibration if t.name == SWAPPED.trial)
    mended = read_trc(folder / "corrected" / f"{given.name}.trc")
    start, end = SWAPPED.parameters["start_s"], SWAPPED.parameters["end_s"]
    inside = (given.times >= start - 1e-9) & (given.times <= end + 1e-9)
    first, second = (given.position(name) for name in SWAPPED.where)
    np.testing.assert_allclose(mended.position(SWAPPED.where[0])[inside], second[inside], atol=1e-7)
    np.testing.assert_allclose(mended.position(SWAPPED.where[1])[inside], first[inside], atol=1e-7)
    np.testing.assert_allclose(mended.position(SWAPPED.where[0])[~inside], first[~inside], atol=1e-7)
    np.testing.assert_allclose(mended.position("RLFE"), given.position("RLFE"), atol=1e-7)


def test_all_files_are_reported(folder: Path, document: DiscoveryDocument) -> None:
    there = {p.relative_to(folder).as_posix() for p in folder.rglob("*") if p.is_file()}
    assert there == {*document.files, FILE_NAME}
    assert {"model.json", "report.html", "corrected/gait_1.trc"} <= there
    assert any("soft tissue artefact" in note for note in document.notes)


def test_what_an_earlier_search_wrote_goes(tmp_path: Path) -> None:
    """Corrected recordings of another run would be taken for this one's."""
    save_discovery(found(), tmp_path, report=False)
    (tmp_path / "mine.txt").write_text("kept")
    nothing = replace(found(), after=found().before, findings=replace(found().findings, named=()))
    save_discovery(nothing, tmp_path, report=False)
    assert not list((tmp_path / "corrected").glob("*"))
    assert (tmp_path / "mine.txt").is_file()
    assert (tmp_path / "model.json").is_file()


def test_the_report_tells_the_story(folder: Path, document: DiscoveryDocument) -> None:
    html = (folder / "report.html").read_text(encoding="utf-8")
    assert document.headline in html
    assert document.effects[0].name.split(":")[0] in html
    inside = held(read(html))
    assert "scene/scene.json" in inside["files"]


def test_nothing_found_is_a_page_too(document: DiscoveryDocument) -> None:
    empty = document.model_copy(
        update={"verdict": "nothing", "effects": [], "held_out_trials": [], "unexplained": []}
    )
    html = summarise(empty).html()
    assert "The gap, RMS" in html
    assert "The missing effects" not in html
