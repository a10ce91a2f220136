"""Over HTTP every method and comparison gives what the command line gives for the same files."""

from __future__ import annotations

import csv
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from scaling_service.cli import main
from scaling_service.client import Client
from scaling_service.files.sto import read_sto
from tests.jobs.laboratory import laboratory
from tests.service.http.served import Served, serving, settings_in
from tests.service.jobs.services import running

METHODS = ["MB", "MB_am"]


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    with serving(settings_in(tmp_path_factory.mktemp("service"))) as served, running(served.service):
        yield served


def put(client: Client, folder: Path, file: Path) -> str:
    """Upload what a subject file of the command line names, under plain names; returns the subject's id."""
    document = yaml.safe_load(file.read_text(encoding="utf-8"))
    names: dict[str, Path] = {}

    def plain(value: Any) -> Any:
        if isinstance(value, dict):
            return {key: plain(inner) for key, inner in value.items()}
        if isinstance(value, list):
            return [plain(inner) for inner in value]
        if isinstance(value, str) and (found := (file.parent / value)).is_file():
            names[found.name] = found
            return found.name
        return value

    subject = client.put_subject(plain(document)).id
    for name, path in names.items():
        client.upload(subject, path, name)
    return subject


def untimed(value: Any) -> Any:
    """A document without what differs from run to run, and without how the recordings were named."""
    if isinstance(value, dict):
        left_out = ("wall_s", "input_hashes", "file", "cohort")
        return {key: untimed(inner) for key, inner in value.items() if key not in left_out}
    return [untimed(inner) for inner in value] if isinstance(value, list) else value


def written(folder: Path, name: str) -> Any:
    return json.loads((folder / name).read_text(encoding="utf-8"))


FITTED = ["--strategy", "alternating", "--frames", "40", "--up", "+z"]
SETTINGS = {"calibration": {"strategy": "alternating", "n_frames": 40}, "up": "+z"}
"""The same for a body of HTTP."""


def test_one_method_and_its_settings(service: Served, tmp_path: Path) -> None:
    file = laboratory(tmp_path)
    client = service.client()
    subject = put(client, tmp_path, file)
    for method, route, flags, settings in (
        ("MB", "linear", [], {}),
        ("MB_am", "optimised", FITTED, SETTINGS),
    ):
        assert main(["scale", str(file), "--method", method, *flags, "--out", str(tmp_path / method)]) == 0
        job = client.wait(client.ask(f"scalings/{route}", subject=subject, method=method, settings=settings))
        there, over_http = written(tmp_path / method / method, "scaling.json"), client.result(job)
        assert untimed(over_http) == untimed(there)
        assert (over_http["settings"]["calibration"]["n_frames"] == 40) == bool(settings)
        fetched = client.download(job, tmp_path / f"{method}_http")
        for path in fetched:
            if path.suffix in (".mot", ".osim"):
                name = path.relative_to(tmp_path / f"{method}_http")
                assert path.read_bytes() == (tmp_path / method / name).read_bytes(), name


@pytest.mark.costly
def test_a_batch(service: Served, tmp_path: Path) -> None:
    client = service.client()
    (tmp_path / "files").mkdir()
    file = laboratory(tmp_path / "files")
    first = yaml.safe_load(file.read_text())
    second = first | {
        "subject": {"id": "S02"},
        "trials": {"static": "standing.trc", "calibration": ["bad.trc"]},
    }
    (tmp_path / "files" / "bad.trc").write_text("no recording")
    for document in (first, second):
        path = tmp_path / "files" / f"{document['subject']['id']}.yaml"
        path.write_text(yaml.safe_dump(document))
        put(client, tmp_path, path)
    cohort = tmp_path / "files" / "cohort.csv"
    cohort.write_text("subject,sex\nS01.yaml,F\nS02.yaml,M\n")
    out = tmp_path / "out"
    assert main(["batch", str(cohort), "--methods", "MB,MB_am", "--out", str(out), "--workers", "1"]) == 1
    groups = {"S01": {"sex": "F"}, "S02": {"sex": "M"}}
    job = client.wait(client.ask("batches", subjects=["S01", "S02"], methods=METHODS, groups=groups))
    over_http, there = client.result(job), written(out, "cohort.json")
    assert untimed(over_http["statistics"]) == untimed(there["statistics"])
    ended = [(entry["id"], entry["status"], entry["groups"]) for entry in over_http["subjects"]]
    assert ended == [("S01", "done", {"sex": "F"}), ("S02", "failed", {"sex": "M"})]
    assert "bad.trc" in over_http["subjects"][1]["reason"]
    assert "/tmp" not in json.dumps(over_http)


def compared(file: Path, out: Path) -> Any:
    """The document that the command line writes."""
    assert main(["compare", str(file), "--methods", ",".join(METHODS), "--out", str(out)]) == 0
    return written(out, "comparison.json")


def test_comparisons(service: Served, tmp_path: Path) -> None:
    file = laboratory(tmp_path)
    client, out = service.client(), tmp_path / "out"
    subject = put(client, tmp_path, file)
    there = compared(file, out)
    jobs = {
        route: client.ask(route, subject=subject, methods=METHODS)
        for route in (
            "comparisons",
            "comparisons/kinematic-error",
            "comparisons/segment-lengths",
            "comparisons/joint-angles",
        )
    }
    found = {route: client.result(client.wait(job)) for route, job in jobs.items()}
    assert untimed(found["comparisons"]["methods"]) == untimed(there["methods"])
    for name, method in there["methods"].items():
        errors = found["comparisons/kinematic-error"]
        assert errors["kinematic_error_mm"][name] == method["kinematic_error_mm"]
        assert errors["held_out_mean_mm"][name] == method["held_out_mean_mm"]
        lengths = found["comparisons/segment-lengths"]
        assert lengths["segment_lengths_mm"][name] == method["segment_lengths_mm"]
        assert lengths["joint_centres_mm"][name] == method["joint_centres_mm"]
    assert lengths["reference"] == "MB"
    femur = {name: method["segment_lengths_mm"]["femur_r"] for name, method in there["methods"].items()}
    apart = lengths["difference_mm"]["MB_am"]["femur_r"]
    assert apart == pytest.approx(femur["MB_am"] - femur["MB"], abs=1e-3)
    check_angles(found["comparisons/joint-angles"], out)
    folder = tmp_path / "fetched"
    client.download(jobs["comparisons/joint-angles"], folder)
    rows = list(csv.DictReader((folder / "joint_angles.csv").read_text(encoding="utf-8").splitlines()))
    assert len(rows) == sum(
        len(angles) for angles in found["comparisons/joint-angles"]["joint_angles"].values()
    )


def check_angles(found: dict[str, Any], out: Path) -> None:
    """Every difference is that between the motion files which the command line wrote."""
    checked = 0
    for trial, angles in found["joint_angles"].items():
        tables = [read_sto(out / method / f"{trial}_ik.mot") for method in METHODS]
        for angle, entry in angles.items():
            first, second = (table.data[:, table.columns.index(angle)] for table in tables)
            (pair,) = entry["pairs"]
            known = np.isfinite(first) & np.isfinite(second)
            assert pair["frames"] == known.sum()
            if known.any():
                apart = (first - second)[known]
                assert pair["rms_deg"] == pytest.approx(np.sqrt(np.mean(apart**2)), abs=2e-4)
                assert pair["mean_deg"] == pytest.approx(apart.mean(), abs=2e-4)
                assert entry["range_deg"]["MB"] == pytest.approx(np.ptp(first[np.isfinite(first)]), abs=2e-4)
                checked += 1
    assert checked >= 8
