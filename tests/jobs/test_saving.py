"""What is written: complete, readable again, or nothing at all."""

from __future__ import annotations

import json
from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from scaling_service.capabilities.scaling import saving
from scaling_service.capabilities.scaling.clinical_gait import ClinicalGait
from scaling_service.capabilities.scaling.comparison.geometry import measure_geometry
from scaling_service.capabilities.scaling.result import Results
from scaling_service.capabilities.scaling.saving import save
from scaling_service.core.errors import DependencyMissing, InputError
from scaling_service.documents import writing
from scaling_service.documents.results import ComparisonDocument, ScalingDocument
from scaling_service.documents.writing import check_folder
from scaling_service.files.osim.models import read_osim
from scaling_service.files.sto import read_sto
from scaling_service.model.document import from_document
from scaling_service.model.results import Calibration

needs_opensim = pytest.mark.skipif(
    find_spec("opensim") is None, reason="the opensim library is not installed"
)


@pytest.fixture
def no_osim(monkeypatch: pytest.MonkeyPatch) -> None:
    """Leave out the slow writing of .osim files where they do not matter."""
    monkeypatch.setattr(saving, "render_scaled", lambda found, _: ["<model/>"] * len(found))


def everything(folder: Path) -> set[str]:
    return {p.relative_to(folder).as_posix() for p in folder.rglob("*")}


@pytest.mark.usefixtures("no_osim")
def test_every_method_has_its_files(results: Results, tmp_path: Path) -> None:
    save(results, tmp_path / "new" / "out")
    for method in results.scalings:
        names = {p.name for p in (tmp_path / "new" / "out" / method).iterdir()}
        assert names == {
            "model.osim",
            "model.json",
            "hips_ik.mot",
            "walk_ik.mot",
            "hips_clinical.csv",
            "walk_clinical.csv",
            "scaling.json",
        }
    assert not [p for p in tmp_path.rglob("*") if p.name.startswith(".")]


@pytest.mark.usefixtures("no_osim")
def test_documents_are_read_again_and_agree(results: Results, tmp_path: Path) -> None:
    returned = save(results, tmp_path)
    comparison = ComparisonDocument(**json.loads((tmp_path / "comparison.json").read_text(encoding="utf-8")))
    assert comparison == returned
    alone = ScalingDocument(**json.loads((tmp_path / "MB_am" / "scaling.json").read_text(encoding="utf-8")))
    inside = comparison.methods["MB_am"]
    assert alone.kinematic_error_mm == inside.kinematic_error_mm
    assert alone.parameters == inside.parameters
    assert alone.input_hashes == comparison.input_hashes
    assert set(alone.input_hashes) == {"S01.yaml", "standing.trc", "hips.trc", "walk.trc"}
    error = results.scalings["MB_am"].errors["walk"]
    written = alone.kinematic_error_mm["walk"]
    assert written.mean == pytest.approx(1e3 * error.mean, abs=1e-4)
    assert (written.role, alone.kinematic_error_mm["hips"].role) == ("evaluation", "calibration")
    assert alone.settings["calibration"]["n_frames"] == 100


@pytest.mark.usefixtures("no_osim")
def test_models_and_motions_are_read_again(results: Results, tmp_path: Path) -> None:
    save(results, tmp_path)
    scaling = results.scalings["MB_lam"]
    content = json.loads((tmp_path / "MB_lam" / "model.json").read_text(encoding="utf-8"))
    assert from_document(content) == scaling.calibration.model
    motion = scaling.motions["walk"]
    table = read_sto(tmp_path / "MB_lam" / "walk_ik.mot")
    turns = np.array([c.kind == "rotation" for c in scaling.calibration.model.coordinates])
    values = np.where(turns, np.deg2rad(table.data[:, 1:]), table.data[:, 1:])
    assert (table.columns[1:], table.in_degrees) == (motion.coordinates, True)
    np.testing.assert_allclose(values, motion.q, rtol=1e-11, atol=1e-12)  # 12 digits are written


@pytest.mark.usefixtures("no_osim")
def test_scale_alone_writes_no_comparison(results: Results, tmp_path: Path) -> None:
    save(results, tmp_path, comparison=False)
    assert not (tmp_path / "comparison.json").exists()


@pytest.mark.usefixtures("no_osim")
def test_a_folder_in_use_keeps_what_is_not_ours(results: Results, tmp_path: Path) -> None:
    (tmp_path / "MB").mkdir()
    (tmp_path / "MB" / "notes.txt").write_text("mine", encoding="utf-8")
    (tmp_path / "MB" / "old_ik.mot").write_text("of an earlier model", encoding="utf-8")
    (tmp_path / "MB" / "scaling.json").write_text("of an earlier run", encoding="utf-8")
    save(results, tmp_path)
    assert (tmp_path / "MB" / "notes.txt").read_text(encoding="utf-8") == "mine"
    assert not (tmp_path / "MB" / "old_ik.mot").exists()
    assert json.loads((tmp_path / "MB" / "scaling.json").read_text(encoding="utf-8"))["method"] == "MB"


def test_a_failure_leaves_nothing(results: Results, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(_folder: Path, gait: ClinicalGait) -> None:
        if gait is results.gait["MB_am"]:
            raise OSError("no space is left")

    monkeypatch.setattr(saving.clinical_gait, "write_clinical", refuse)
    with pytest.raises(OSError, match="no space"):
        save(results, tmp_path / "out")
    assert everything(tmp_path) == set()


def test_without_opensim_the_rest_is_written_and_said(
    results: Results, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def absent(found: Sequence[Calibration], _session: object) -> list[InputError]:
        said = DependencyMissing(
            "no opensim", remedy="Install it with `pip install scaling-service[opensim]`"
        )
        return [said] * len(found)

    monkeypatch.setattr(saving, "render_scaled", absent)
    document = save(results, tmp_path)
    for method in document.methods.values():
        assert any("model.osim was not written" in w and "[opensim]" in w for w in method.warnings)
        assert "model.osim" not in method.files
    assert (tmp_path / "MB_am" / "model.json").is_file()


@pytest.mark.usefixtures("no_osim")
def test_a_file_in_the_way_is_named(results: Results, tmp_path: Path) -> None:
    (tmp_path / "out").write_text("a file", encoding="utf-8")
    for place in (tmp_path / "out", tmp_path / "out" / "below"):
        with pytest.raises(InputError) as caught:
            check_folder(place)
        assert caught.value.file == str(place)
        with pytest.raises(InputError):
            save(results, place)
    assert everything(tmp_path) == {"out"}


def test_a_new_folder_may_be_made(tmp_path: Path) -> None:
    check_folder(tmp_path / "a" / "b")
    assert everything(tmp_path) == set()


@needs_opensim
def test_the_opensim_model_has_the_same_geometry(results: Results, tmp_path: Path) -> None:
    one = Results(
        loaded=results.loaded, settings=results.settings, scalings={"MB_am": results.scalings["MB_am"]}
    )
    save(one, tmp_path)
    ours = results.scalings["MB_am"].calibration
    theirs = read_osim(tmp_path / "MB_am" / "model.osim")
    expected, found = (
        measure_geometry(ours).lengths,
        measure_geometry(Calibration(method="MB_am", model=theirs, generic=theirs, scale_factors={})).lengths,
    )
    # The shank ends at a landmark of weight 0, and OpenSim's markers have no weight.
    for name in ("inter_hip", "femur_r", "femur_l"):
        assert found[name] == pytest.approx(expected[name], abs=1e-6)  # m
    for segment in ours.model.segments:
        assert theirs.segment(segment.name).mass == pytest.approx(segment.mass, rel=1e-9)


@pytest.fixture
def used(tmp_path: Path) -> Path:
    """A folder with results of an earlier run and something else."""
    out = tmp_path / "out"
    (out / "MB").mkdir(parents=True)
    for name in ("MB/scaling.json", "MB/old_ik.mot", "MB/notes.txt", "comparison.json"):
        (out / name).write_text(f"earlier {name}", encoding="utf-8")
    return out


def contents(folder: Path) -> dict[str, str]:
    return {
        p.relative_to(folder).as_posix(): p.read_text(encoding="utf-8")
        for p in folder.rglob("*")
        if p.is_file()
    }


@pytest.mark.usefixtures("no_osim")
@pytest.mark.parametrize("in_the_way", ["MB_am", "MB_am/scaling.json"])
def test_what_stands_in_the_way_leaves_all_as_it_was(results: Results, used: Path, in_the_way: str) -> None:
    if in_the_way == "MB_am":
        (used / in_the_way).write_text("a file", encoding="utf-8")
    else:
        (used / in_the_way).mkdir(parents=True)
    before, names = contents(used), everything(used.parent)
    with pytest.raises(InputError, match=in_the_way) as caught:
        save(results, used)
    assert caught.value.field == "--out"
    assert contents(used) == before
    assert everything(used.parent) == names


@pytest.mark.usefixtures("no_osim")
@pytest.mark.parametrize("interruption", [KeyboardInterrupt, OSError])
@pytest.mark.parametrize("after", [0, 3, 7])
def test_an_interruption_while_moving_is_undone(
    results: Results,
    used: Path,
    monkeypatch: pytest.MonkeyPatch,
    interruption: type[BaseException],
    after: int,
) -> None:
    before, names = contents(used), everything(used.parent)
    moved: list[Path] = []
    original = Path.replace

    def replace(self: Path, target: Path) -> Path:
        if len(moved) == after:
            moved.append(self)
            raise interruption
        moved.append(self)
        return original(self, target)

    monkeypatch.setattr(Path, "replace", replace)
    with pytest.raises((KeyboardInterrupt, InputError)):
        save(results, used)
    assert len(moved) > after
    assert contents(used) == before
    assert everything(used.parent) == names


@pytest.mark.usefixtures("no_osim")
def test_nothing_is_written_beside_a_folder_that_is_there(
    results: Results, used: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What is above a mounted folder is another disk, and seldom ours to write to."""
    places: list[Path] = []
    original = writing.tempfile.mkdtemp

    def mkdtemp(*given: Any, **named: Any) -> str:
        places.extend([named["dir"]] if "dir" in named else [])  # else the system's own place
        return original(*given, **named)

    monkeypatch.setattr(writing.tempfile, "mkdtemp", mkdtemp)
    save(results, used)
    assert places == [used]


def test_a_name_that_cannot_be_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError) as caught:
        check_folder(tmp_path / ("x" * 300))
    assert caught.value.field == "--out"
