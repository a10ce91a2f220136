"""A batch of subject files: what is written, what is kept, what is refused."""

from __future__ import annotations

import csv
import json
import shutil
from pathlib import Path

import numpy as np
import pytest
import yaml

from scaling_service.capabilities.cohort import outcomes
from scaling_service.capabilities.cohort.job import BatchRequest, summarise
from scaling_service.capabilities.cohort.outcomes import Outcome, read_record
from scaling_service.capabilities.cohort.result import CohortDocument
from scaling_service.capabilities.cohort.run import BatchResult, batch
from scaling_service.capabilities.cohort.saving import list_tables
from scaling_service.capabilities.scaling import saving
from scaling_service.capabilities.shared.settings import Settings
from scaling_service.core.errors import InputError
from tests.jobs.cohorts import FAST, someone, table

METHODS = ("MB", "MB_am")
NAMES = ("A", "B", "C")


@pytest.fixture(autouse=True)
def _quick(monkeypatch: pytest.MonkeyPatch) -> None:
    """Writing .osim files takes a second each, and is tested elsewhere."""
    monkeypatch.setattr(saving, "render_scaled", lambda found, _: ["<model/>"] * len(found))


@pytest.fixture(scope="module")
def sound(tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp("sound")
    for name in NAMES:
        someone(root, name)
    table(root, *NAMES)
    return root


@pytest.fixture
def root(sound: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(sound, tmp_path / "cohort"))


class Watched:
    """Remembers what it is told."""

    def __init__(self) -> None:
        self.stages: list[str] = []
        self.outcomes: dict[str, Outcome] = {}

    def start(self, count: int, workers: int) -> None:
        self.size = (count, workers)

    def stage(self, name: str, *_: object) -> None:
        self.stages.append(name)

    def finish(self, outcome: Outcome) -> None:
        self.outcomes[outcome.name] = outcome


def _batch(cohort: Path, out: Path, methods=METHODS, settings: Settings = FAST, **options) -> BatchResult:
    return batch(cohort, out, methods, settings, **({"worker_count": 1} | options))


def _statuses(result: BatchResult) -> dict[str, str]:
    return {s.id: "kept" if s.kept else s.status for s in result.document.subjects}


def test_subjects_and_their_cohort_are_written(root: Path, tmp_path: Path) -> None:
    out, watcher = tmp_path / "out", Watched()
    result = _batch(root / "cohort.csv", out, watcher=watcher)
    assert _statuses(result) == dict.fromkeys(NAMES, "done")
    assert watcher.size == (3, 1)
    assert set(watcher.stages) == set(watcher.outcomes) == set(NAMES)
    assert result.files == ("angles.csv", "cohort.json", "errors.csv", "lengths.csv", "report.html")
    assert {p.name for p in out.iterdir()} == {*NAMES, *result.files}
    written = CohortDocument.model_validate_json((out / "cohort.json").read_text(encoding="utf-8"))
    assert written == result.document
    assert [s.groups for s in written.subjects] == [{"site": "north"}] * 3
    femur = next(q for q in written.statistics.segment_lengths_mm if q.quantity == "femur_r")
    own = {}
    for name in NAMES:
        comparison = json.loads((out / name / "comparison.json").read_text(encoding="utf-8"))
        assert set(comparison["methods"]) == set(METHODS)
        assert (out / name / "MB_am" / "hips_ik.mot").is_file()
        own[name] = comparison["methods"]["MB"]["segment_lengths_mm"]["femur_r"]
    assert {s: by["MB"] for s, by in femur.values.items()} == own
    assert femur.mean["MB"] == pytest.approx(np.mean(list(own.values())), abs=1e-4)
    assert femur.sd["MB"] == pytest.approx(np.std(list(own.values()), ddof=1), abs=1e-4)


def test_tables_hold_the_same_numbers(root: Path, tmp_path: Path) -> None:
    result = _batch(root / "cohort.csv", tmp_path / "out")
    rows = {name: _rows(tmp_path / "out" / name) for name in ("lengths.csv", "errors.csv", "angles.csv")}
    values = {q.quantity: q.values for q in result.document.statistics.segment_lengths_mm}
    assert len(rows["lengths.csv"]) == 3 * 2 * 5
    for row in rows["lengths.csv"]:
        assert float(row["length_mm"]) == values[row["segment"]][row["subject"]][row["method"]]
        assert row["group_site"] == "north"
    assert {(r["trial"], r["role"]) for r in rows["errors.csv"]} == {
        ("hips", "calibration"),
        ("walk", "evaluation"),
    }
    assert rows["angles.csv"] == []  # nobody here walks, and the reason is told
    assert all("stays in place" in s.no_strides["r"] for s in result.document.subjects)


def _rows(file: Path) -> list[dict[str, str]]:
    with file.open(encoding="utf-8", newline="") as stream:
        return list(csv.DictReader(stream))


@pytest.mark.costly
def test_workers_do_not_change_a_number(root: Path, tmp_path: Path) -> None:
    shutil.rmtree(root / "C")
    one = _batch(table(root, "B", "A"), tmp_path / "one")
    two = _batch(root, tmp_path / "two", worker_count=2)
    assert one.document.statistics == two.document.statistics
    for name in ("lengths.csv", "errors.csv"):
        ours = [{k: v for k, v in r.items() if k != "group_site"} for r in _rows(tmp_path / "one" / name)]
        theirs = _rows(tmp_path / "two" / name)
        assert sorted(ours, key=str) == sorted(theirs, key=str)


def test_what_is_unchanged_is_kept_and_gives_the_same_numbers(
    root: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    first = _batch(root / "cohort.csv", tmp_path / "out")
    text = (root / "A" / "subject.yaml").read_text(encoding="utf-8")
    (root / "A" / "subject.yaml").write_text(f"# a remark\n{text}", encoding="utf-8")
    monkeypatch.setattr(outcomes, "compare", lambda *_, **__: pytest.fail("done again"))
    second = _batch(root / "cohort.csv", tmp_path / "out")
    assert _statuses(second) == dict.fromkeys(NAMES, "kept")
    assert second.document.statistics == first.document.statistics


def _measured_again(root: Path) -> None:
    file = root / "B" / "walk.trc"
    lines = file.read_text(encoding="utf-8").splitlines()
    file.write_text("\n".join(lines[:-1]) + "\n", encoding="utf-8")


def _taller(root: Path) -> None:
    file = root / "B" / "subject.yaml"
    content = yaml.safe_load(file.read_text(encoding="utf-8"))
    content["subject"]["height_m"] = 1.71
    file.write_text(yaml.safe_dump(content), encoding="utf-8")


@pytest.mark.parametrize("change", [_measured_again, _taller])
def test_only_what_changed_is_done_again(root: Path, tmp_path: Path, change) -> None:
    _batch(root / "cohort.csv", tmp_path / "out")
    change(root)
    assert _statuses(_batch(root / "cohort.csv", tmp_path / "out")) == {"A": "kept", "B": "done", "C": "kept"}


def test_other_settings_methods_and_force_do_all_again(root: Path, tmp_path: Path) -> None:
    cohort, out = table(root, "A"), tmp_path / "out"
    assert _statuses(_batch(cohort, out, ("MB",))) == {"A": "done"}
    assert _statuses(_batch(cohort, out, ("MB",))) == {"A": "kept"}
    assert _statuses(_batch(cohort, out, ("MB",), Settings())) == {"A": "done"}
    assert _statuses(_batch(cohort, out, METHODS, Settings())) == {"A": "done"}
    assert _statuses(_batch(cohort, out, METHODS, Settings(), force=True)) == {"A": "done"}


@pytest.mark.parametrize("damage", ["MB/scaling.json", "comparison.json", "batch.json"])
def test_missing_results_are_made_again(root: Path, tmp_path: Path, damage: str) -> None:
    cohort, out = table(root, "A"), tmp_path / "out"
    _batch(cohort, out, ("MB",))
    (out / "A" / damage).unlink()
    assert _statuses(_batch(cohort, out, ("MB",))) == {"A": "done"}
    assert (out / "A" / damage).is_file()


def test_half_a_record_is_none(root: Path, tmp_path: Path) -> None:
    _batch(table(root, "A"), tmp_path / "out", ("MB",))
    record = tmp_path / "out" / "A" / "batch.json"
    assert read_record(record.parent) is not None
    record.write_text(record.read_text(encoding="utf-8")[:-40], encoding="utf-8")
    assert read_record(record.parent) is None
    record.write_text('{"specification": 3}', encoding="utf-8")
    assert read_record(record.parent) is None


def test_failures_and_skips_are_reported_and_stop_nobody(root: Path, tmp_path: Path) -> None:
    (root / "B" / "walk.trc").write_text("no recording\n", encoding="utf-8")
    still = yaml.safe_load((root / "C" / "subject.yaml").read_text(encoding="utf-8"))
    del still["trials"]["calibration"]
    (root / "C" / "subject.yaml").write_text(yaml.safe_dump(still), encoding="utf-8")
    someone(root, "D", model="legs")
    result = _batch(root, tmp_path / "out", ("MB_am",))
    assert _statuses(result) == {"A": "done", "B": "failed", "C": "skipped", "D/subject.yaml": "failed"}
    reasons = {s.id: s.reason for s in result.document.subjects}
    assert "walk.trc" in reasons["B"]
    assert reasons["C"] == "MB_am: no calibration trial"
    assert "no built-in model 'legs'" in reasons["D/subject.yaml"]
    assert {p.name for p in (tmp_path / "out").iterdir() if p.is_dir()} == {"A"}
    assert "nothing to compare" in result.document.statistics.segment_lengths_mm[0].note


def test_an_interruption_leaves_what_is_finished(
    root: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole = outcomes.compare

    def interrupted(file: Path, *rest, **options):
        if file.parent.name == "C":
            raise KeyboardInterrupt
        return whole(file, *rest, **options)

    monkeypatch.setattr(outcomes, "compare", interrupted)
    with pytest.raises(KeyboardInterrupt):
        _batch(root / "cohort.csv", tmp_path / "out")
    assert {p.name for p in (tmp_path / "out").iterdir()} == {"A", "B"}
    monkeypatch.setattr(outcomes, "compare", whole)
    assert _statuses(_batch(root / "cohort.csv", tmp_path / "out")) == {"A": "kept", "B": "kept", "C": "done"}


def test_an_interruption_before_anything_is_done_leaves_nothing(
    root: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupted(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(outcomes, "compare", interrupted)
    with pytest.raises(KeyboardInterrupt):
        _batch(root / "cohort.csv", tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_two_subjects_of_one_id_are_refused_with_both_files(root: Path, tmp_path: Path) -> None:
    shutil.copytree(root / "A", root / "other")
    content = (root / "other" / "subject.yaml").read_text(encoding="utf-8").replace("id: A", "id: a")
    (root / "other" / "subject.yaml").write_text(content, encoding="utf-8")
    with pytest.raises(InputError) as caught:
        _batch(table(root, "A", "other"), tmp_path / "out")
    assert "A/subject.yaml" in str(caught.value)
    assert "other/subject.yaml" in str(caught.value)
    assert not (tmp_path / "out").exists()


def test_methods_that_nobody_can_do_are_refused(root: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"no subject can be done by EB, EB_am .*no bones"):
        _batch(root / "cohort.csv", tmp_path / "out", ("EB", "EB_am"))
    assert not (tmp_path / "out").exists()


def test_a_folder_of_somebody_else_is_refused_and_left_alone(root: Path, tmp_path: Path) -> None:
    cohort, out = root / "cohort.csv", tmp_path / "out"
    with pytest.raises(InputError, match="'A' there holds something else"):
        _batch(cohort, root)  # its folders are those of the recordings
    out.mkdir()
    (out / "lengths.csv").write_text("mine", encoding="utf-8")
    with pytest.raises(InputError, match=r"'lengths.csv' there was not written by a batch"):
        _batch(cohort, out)
    (out / "lengths.csv").rename(out / "cohort.json")
    with pytest.raises(InputError, match=r"'cohort.json' there was not written by a batch"):
        _batch(cohort, out)
    (out / "cohort.json").rename(out / "B")
    with pytest.raises(InputError, match="'B' there holds something else"):
        _batch(cohort, out)
    assert (out / "B").read_text(encoding="utf-8") == "mine"
    assert [p.name for p in out.iterdir()] == ["B"]


def test_results_of_compare_may_be_taken_over(root: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    _batch(table(root, "A"), out, ("MB",))
    for name in ("cohort.json", "report.html", "lengths.csv", "errors.csv", "angles.csv", "A/batch.json"):
        (out / name).unlink()
    (out / "notes.txt").write_text("mine", encoding="utf-8")
    assert _statuses(_batch(root / "cohort.csv", out, ("MB",))) == {"A": "done"}
    assert (out / "notes.txt").read_text(encoding="utf-8") == "mine"


def test_the_services_job_says_what_the_command_says(root: Path, tmp_path: Path) -> None:
    """Members were scaled elsewhere: their documents and records are all that the job reads."""
    alone = _batch(root / "cohort.csv", tmp_path / "out").document
    inputs, outputs = tmp_path / "inputs", tmp_path / "outputs"
    outputs.mkdir()
    for name in NAMES:
        (inputs / name).mkdir(parents=True)
        shutil.copy(tmp_path / "out" / name / "batch.json", inputs / name)
    groups = {name: {"site": "north"} for name in NAMES}
    asked = {"subjects": NAMES, "groups": groups, "methods": METHODS}
    request = BatchRequest.model_validate(asked).model_copy(update={"settings": FAST})
    ended = [
        {
            "request": {"subject": name},
            "state": "done",
            "result": {"status": "done", "reason": "", "wall_s": 1.0},
        }
        for name in NAMES
    ]
    (inputs / ".parts.json").write_text(json.dumps(ended), encoding="utf-8")
    found = CohortDocument.model_validate(summarise(request, inputs, outputs, lambda *_: None))
    assert found.statistics == alone.statistics
    assert [s.id for s in found.subjects] == list(NAMES)
    assert [s.groups for s in found.subjects] == [s.groups for s in alone.subjects]
    assert {p.name for p in outputs.iterdir()} == {"cohort.json", "report.html", *list_tables()}
    for name in list_tables():
        assert (outputs / name).read_bytes() == (tmp_path / "out" / name).read_bytes()
    (inputs / ".parts.json").write_text(
        json.dumps(
            [e | {"result": {"status": "skipped", "reason": "EB: no bones", "wall_s": 0.0}} for e in ended]
        )
    )
    with pytest.raises(InputError, match="no subject can be done by MB, MB_am \\(EB: no bones\\)"):
        summarise(request, inputs, outputs, lambda *_: None)
