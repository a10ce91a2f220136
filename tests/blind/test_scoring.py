"""Scores of results whose merit is plain."""

from __future__ import annotations

import json
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from scaling_service.files.sto import Table, write_sto
from tests.blind.make import UNMET
from tests.blind.run import run_one
from tests.blind.score import main
from tests.blind.scoring.matching import (
    best,
    intervals_hold,
    match,
    opposite,
    parameters_right,
    size,
    smallest_nameable,
)
from tests.blind.scoring.outcomes import Outcome, outcomes
from tests.blind.scoring.records import joined, read_records, write_records
from tests.blind.scoring.tables import confusion, detection, must_reach, remarks, upper_bound

OFFSET = {
    "kind": "marker_offset",
    "where": ["RLFE"],
    "parameters": {"x_mm": 3.0, "y_mm": 0.0, "z_mm": 4.0},
    "driver": [],
    "also_where": [],
}
LENGTH = {"kind": "segment_length", "where": ["femur_r"], "parameters": {"factor": 1.03}, "also_where": []}


def named(truth: dict[str, Any], factor: float = 1.0, sd: float = 0.0, **more: Any) -> dict[str, Any]:
    values = {k: {"value": v * factor, "sd": sd} for k, v in truth["parameters"].items()}
    return {"kind": truth["kind"], "where": truth["where"], "parameters": values, **more}


def outcome(group: str, hidden: list[dict[str, Any]], result: dict[str, Any] | None, **truth: Any) -> Outcome:
    label = {
        "id": "case",
        "group": group,
        "kinds": [h["kind"] for h in hidden] or ["white"],
        "size": "large",
        "forces": False,
    }
    return Outcome({**label, "hidden": hidden, **truth}, result, 10.0)


def test_a_match_needs_kind_and_place() -> None:
    assert match(OFFSET, named(OFFSET)) == "exact"
    assert match(OFFSET, {**named(OFFSET), "where": ["RMFE"]}) == "no"
    assert match(OFFSET, {**named(OFFSET), "kind": "skin_wobble"}) == "no"
    two = {"kind": "marker_swap", "where": ["A", "B"], "parameters": {}}
    assert match(two, {"kind": "marker_swap", "where": ["B", "A"]}) == "exact"


def test_an_interval_holds_the_truth_within_two_sd() -> None:
    assert intervals_hold(OFFSET, named(OFFSET, 1.1, sd=0.21)) == {"x_mm": True, "y_mm": True, "z_mm": True}
    assert intervals_hold(OFFSET, named(OFFSET, 1.1, sd=0.18)) == {"x_mm": True, "y_mm": True, "z_mm": False}
    assert not intervals_hold(OFFSET, named(OFFSET, 1.1))


def test_a_floor_is_reported_by_the_noise_that_was_put_in() -> None:
    gap = {"fit": {"markers_mm": {"floor": 1.2}}}
    assert outcome("null", [], {"gap": gap}, noise_left_mm=1.0).floor == pytest.approx(1.2)
    assert outcome("null", [], {"gap": gap}).floor is None


def test_a_declared_class_counts_up_to_three_members() -> None:
    other = {"kind": "joint_centre_offset", "where": ["hip_r"], "parameters": {}}
    twin = {"kind": "marker_offset", "where": ["RLFE"]}
    assert match(OFFSET, {**other, "confusable_with": [twin]}) == "class"
    crowd = [twin, *({"kind": "segment_length", "where": [s]} for s in ("femur_r", "tibia_r"))]
    assert match(OFFSET, {**other, "confusable_with": crowd}) == "no"
    assert best(OFFSET, [{**other, "confusable_with": [twin]}, named(OFFSET)])[0] == "exact"


def test_sizes() -> None:
    assert size(OFFSET) == pytest.approx(5.0)
    assert size(LENGTH) == pytest.approx(0.03)
    swap = {"kind": "marker_swap", "where": [], "parameters": {"start_s": 1.0, "end_s": 1.6}}
    assert size(swap) == pytest.approx(0.6)


def test_parameters_within_a_tenth_or_two_sd() -> None:
    """Each by itself; a component of a vector is held against the vector's length."""
    right = {"x_mm": True, "y_mm": True, "z_mm": True}
    assert parameters_right(OFFSET, named(OFFSET, 1.09)) == right
    assert parameters_right(OFFSET, named(OFFSET, 1.2)) == {"x_mm": False, "y_mm": True, "z_mm": False}
    assert parameters_right(OFFSET, named(OFFSET, 1.2, sd=0.45)) == right
    # A factor is judged by its departure from one: 1.030 against 1.034 is off by more than a tenth.
    wrong = {**LENGTH, "parameters": {"factor": {"value": 1.034, "sd": 0.0}}}
    assert parameters_right(LENGTH, wrong) == {"factor": False}
    assert parameters_right(OFFSET, {"parameters": {}}) == {}


def test_the_opposite_sign_is_reported_from_a_wrong_size() -> None:
    assert opposite(OFFSET, named(OFFSET, -1.0))
    assert not opposite(OFFSET, named(OFFSET, 1.0))
    assert not opposite(OFFSET, named(OFFSET, -3.0))


def test_smallest_nameable_is_found_where_it_may_stand() -> None:
    stated = {"effects": [named(OFFSET, smallest_nameable=2.5)]}
    assert smallest_nameable(OFFSET, stated) == 2.5
    tried = {
        "tried": [{"kind": "segment_length", "where": ["femur_r"], "smallest_nameable": {"factor": 1.01}}]
    }
    assert smallest_nameable(LENGTH, tried) == pytest.approx(0.01)
    departure = {"tried": [{**tried["tried"][0], "smallest_nameable": {"factor": 0.01}}]}
    assert smallest_nameable(LENGTH, departure) == pytest.approx(0.01)
    assert smallest_nameable(OFFSET, tried) is None
    wobble = {"kind": "skin_wobble", "where": ["RLFE"], "parameters": {"frequency_hz": 5.0, "damping": 0.2}}
    reported = {"effects": [{**wobble, "smallest_nameable": {"damping": 0.1}}]}
    assert smallest_nameable(wobble, reported) is None
    assert outcome("effect", [OFFSET], stated).ratio == pytest.approx(2.0)


def test_the_bound_of_a_share_is_exact() -> None:
    # None of 59: the bound of 95 % confidence is 1 - 0.05 ** (1 / 59), close to the rule of three.
    assert upper_bound(0, 59) == pytest.approx(1 - 0.05 ** (1 / 59))
    assert upper_bound(5, 5) == 1.0


def test_the_table_counts_what_it_says() -> None:
    gap = {"held_out": {"whitened": {"before": 5.0, "after": 1.4, "floor": 1.0, "ceiling": 1.0}}}
    right = {"verdict": "found", "effects": [named(OFFSET)], "gap": gap}
    wrong = {"verdict": "found", "effects": [named(LENGTH)]}
    quiet: dict[str, Any] = {"verdict": "nothing", "effects": []}
    stranger = {**OFFSET, "kind": "marker_restuck"}
    ordinary = {"where": OFFSET["where"][0], "rms": 1.9, "floor": 1.0}  # which nobody could see
    seen = {
        "verdict": "unexplained",
        "effects": [],
        "unexplained": [
            {"where": ["RASIS"], "rms": 1.2, "floor": 1.0},
            {"where": ["RLFE"], "rms": 5.0, "floor": 1.0},
        ],
    }
    judged = [
        outcome("effect", [OFFSET], right, size="nameable"),
        outcome("effect", [OFFSET], wrong, size="nameable"),
        outcome("effect", [OFFSET], None, size="nameable"),
        outcome("effect", [OFFSET], right),
        outcome("null", [], quiet),
        outcome("null", [], wrong),
        outcome("pair", [OFFSET, LENGTH], {"effects": [named(OFFSET), named(LENGTH)]}),
        outcome("pair", [OFFSET, LENGTH], right),
        outcome("stranger", [stranger], seen),
        outcome("stranger", [stranger], wrong),
        outcome("stranger", [stranger], {**quiet, "disagreements": [ordinary]}),
    ]
    all_ = [o.record for o in judged]
    table = {row[0]: row for row in must_reach(all_)[1:]}
    assert table["named right or by class, 2 to 4 x the smallest nameable"][2:] == ["33 %", "3"]
    assert table["something named on null recordings"][2].startswith("50 %")
    assert "mean 90 %" in table["gap to the floor closed on held-out trials, named right"][2]
    assert table["both of two effects right"][2:] == ["50 %", "2"]
    assert table["strangers that stand out, called unexplained at the right place"][2:] == ["50 %", "2"]
    matrix = confusion(all_)
    row = next(r for r in matrix if r[0].startswith("marker_offset"))
    assert sorted(row[1:]) == sorted(["1", "1", "2", ".", "."])
    power = next(r for r in detection(all_) if r[0] == "marker_offset")
    assert power[4:6] == ["20: 100 %", "33 %"]


def test_the_command_reads_folders_and_says_how_many(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    labels, results = tmp_path / "bank" / "labels", tmp_path / "results"
    labels.mkdir(parents=True)
    rng = np.random.default_rng(0)
    for k in range(4):
        truth = {
            "group": "effect",
            "kinds": ["marker_offset"],
            "size": "large",
            "forces": False,
            "hidden": [OFFSET],
        }
        (labels / f"case_{k}.json").write_text(json.dumps(truth))
        if k == 3:
            continue
        (results / f"case_{k}").mkdir(parents=True)
        result = {"verdict": "found", "effects": [named(OFFSET)] if k else []}
        (results / f"case_{k}" / "discovery.json").write_text(json.dumps(result))
        (results / f"case_{k}" / "seconds.txt").write_text(f"{rng.uniform(5, 9)}")
    (tmp_path / "bank" / UNMET).mkdir()
    (tmp_path / "bank" / UNMET / "case_9.json").write_text('["capture_scale"]')
    page = tmp_path / "score.md"
    assert main(["--bank", str(tmp_path / "bank"), "--results", str(results), "--out", str(page)]) == 0
    said = capsys.readouterr().out
    assert said.startswith("3 of 4 cases were run.")
    assert "67 %" in said
    assert "| marker_offset |" in page.read_text()
    assert "twice what their recordings can name: capture_scale 1." in page.read_text()
    records = str(tmp_path / "records.csv")
    for bank, head in (("bank", "3 of 4 cases were run."), ("none", "0 of 0 cases were run, and 3 of other")):
        main(["--bank", str(tmp_path / bank), "--results", str(results), "--records", records])
        assert capsys.readouterr().out.startswith(head)


def test_the_force_of_a_foot_without_plate_is_compared_in_the_worst_trial(tmp_path: Path) -> None:
    true, folder = tmp_path / "labels" / "a", tmp_path / "results" / "a"
    for made in (true, folder):
        made.mkdir(parents=True)
    truth = {"group": "real", "kinds": ["plate_withheld"], "forces": True, "hidden": [], "body_mass_kg": 50.0}
    true.with_suffix(".json").write_text(json.dumps(truth))
    (folder / "discovery.json").write_text("{}")
    clock = np.linspace(0.0, 1.0, 11)
    for name, wrong in (("one", 5.0), ("two", 49.05)):
        forces = np.column_stack([clock, np.full(11, 200.0)])
        write_sto(
            true / f"{name}.sto", Table(name=name, columns=("time", "fy"), data=forces, in_degrees=False)
        )
        inferred = forces[2:-2] + np.array([0.0, wrong])
        table = Table(name=name, columns=("time", "contact_fy"), data=inferred, in_degrees=False)
        write_sto(folder / f"{name}_contact.sto", table)
    (found,) = outcomes(tmp_path, tmp_path / "results")
    assert found.withheld == pytest.approx(0.1)
    assert ["the withheld foot's vertical force, RMSE", "<= 5 % BW", "10.0 % BW", "1"] in must_reach(
        [found.record]
    )
    (folder / "two_contact.sto").unlink()
    (found,) = outcomes(tmp_path, tmp_path / "results")
    assert found.withheld == np.inf


def test_running_keeps_results_and_failures_apart(tmp_path: Path) -> None:
    program = tmp_path / "program.py"
    program.write_text(
        "import pathlib, sys\n"
        "subject, out = sys.argv[2], pathlib.Path(sys.argv[sys.argv.index('--out') + 1])\n"
        "sys.exit('cannot be used') if 'bad' in subject else (out / 'discovery.json').write_text('{}')\n"
    )
    command = [sys.executable, str(program), "discover"]
    good, bad = tmp_path / "good", tmp_path / "bad"
    assert run_one(command, Path("good.yaml"), good, "none").startswith("done")
    assert run_one(command, Path("bad.yaml"), bad, "none").startswith("failed")
    assert (good / "discovery.json").is_file()
    assert not (good / "failed.txt").exists()
    assert "cannot be used" in (bad / "failed.txt").read_text()
    assert float((bad / "seconds.txt").read_text()) > 0


def test_records_outlive_their_results(tmp_path: Path) -> None:
    gap = {"held_out": {"whitened": {"before": 5.0, "after": 1.5, "floor": 1.0, "ceiling": 1.0}}}
    result = {"verdict": "found", "effects": [named(OFFSET, smallest_nameable=2.5)], "gap": gap}
    first = outcome("effect", [OFFSET], result, id="case_b", movement="gait").record
    other = outcome("null", [], None, id="case_a").record
    table = tmp_path / "records.csv"
    write_records([first, other], table)
    assert read_records(table) == [other, first]
    assert (first.ratio, first.closed, first.right, first.first_name) == (2.0, 0.875, True, "marker_offset")
    again = outcome("effect", [OFFSET], {"verdict": "nothing", "effects": []}, id="case_b").record
    both = joined(read_records(table), [again])
    assert sorted(both, key=lambda r: r.id) == [other, again]
    assert read_records(tmp_path / "none.csv") == []
    versions = [replace(first, code="aaaa"), replace(other, code="bbbb")]
    assert any("2 versions of the search, cases each: aaaa 1, bbbb 1" in line for line in remarks(versions))
    assert not any("versions" in line for line in remarks([first, other]))
