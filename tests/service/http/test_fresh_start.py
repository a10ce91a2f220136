"""The service as it is started by its command, on a new data directory, with real files."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from scaling_service.cli import main
from scaling_service.client import Client
from scaling_service.files.sto import read_sto
from tests.cli.serving import served
from tests.jobs.recorded import squatter_document, walker_document
from tests.service.http.test_numbers import put, untimed, written

ROUTES = {"MB": "linear", "EB": "linear", "MB_lam": "optimised", "MB_am": "optimised", "EB_am": "optimised"}
SHOWN = {"/kinematic-error": "kinematic_error_mm", "/segment-lengths": "segment_lengths_mm"}
EXACT = (".mot", ".osim", ".stl", ".glb", ".csv")
"""Files that must be the same byte by byte; documents tell the time that it took."""


def imaged_document(data: Path) -> dict[str, Any]:
    """The person who walks, with the bones of the pelvis and the right leg."""
    folder = data / "jia_mri"
    bones = {"pelvis": "pelvis_no_sacrum.stl", "femur_r": "femur_r.stl", "tibia_r": "tibia_r.stl"}
    return walker_document(data) | {
        "bones": {"units": "mm"} | {bone: str(folder / "bones" / name) for bone, name in bones.items()},
        "image_markers": str(folder / "image_markers.csv"),
    }


def same_files(fetched: Path, there: Path) -> int:
    """How many files the service's job made that the command line's are equal to, to the last byte."""
    made = (path for path in fetched.rglob("*") if path.suffix in EXACT)
    paths = [path for path in made if "scene" not in path.relative_to(fetched).parts]  # for playback only
    for path in paths:
        name = path.relative_to(fetched)
        assert path.read_bytes() == (there / name).read_bytes(), name
    return len(paths)


def check_method(client: Client, subject: str, file: Path, method: str, folder: Path) -> None:
    """``scale`` and the route that does the same."""
    there = folder / f"{method}_there"
    assert main(["scale", str(file), "--method", method, "--out", str(there)]) == 0
    job = client.wait(client.ask(f"scalings/{ROUTES[method]}", subject=subject, method=method))
    result = client.result(job)
    assert untimed(result) == untimed(written(there / method, "scaling.json"))
    assert all(errors["mean"] > 0.0 for errors in result["kinematic_error_mm"].values())
    client.download(job, folder / method)
    assert same_files(folder / method, there) >= 2


def check_comparisons(client: Client, subject: str, file: Path, methods: list[str], folder: Path) -> None:
    """``compare`` and the four routes that show its parts."""
    there = folder / "compared_there"
    assert main(["compare", str(file), "--methods", ",".join(methods), "--out", str(there)]) == 0
    whole = written(there, "comparison.json")
    names = ("", "/kinematic-error", "/segment-lengths", "/joint-angles")
    jobs = {name: client.ask(f"comparisons{name}", subject=subject, methods=methods) for name in names}
    found = {name: client.result(client.wait(job)) for name, job in jobs.items()}
    assert untimed(found[""]) == untimed(whole)
    for method in methods:
        for name, key in SHOWN.items():
            assert found[name][key][method] == whole["methods"][method][key]
    client.download(jobs[""], folder / "compared")
    assert same_files(folder / "compared", there) >= 2 * len(methods)
    assert angles_checked(found["/joint-angles"], there) > 0


def angles_checked(found: dict[str, Any], there: Path) -> int:
    """How many differences of joint angles are those between the motion files that the command line wrote."""
    checked = 0
    for trial, angles in found["joint_angles"].items():
        for angle, entry in angles.items():
            for pair in entry["pairs"]:
                tables = [read_sto(there / method / f"{trial}_ik.mot") for method in pair["methods"]]
                first, second = (table.data[:, table.columns.index(angle)] for table in tables)
                apart = (first - second)[np.isfinite(first) & np.isfinite(second)]
                if len(apart):
                    assert pair["rms_deg"] == pytest.approx(np.sqrt(np.mean(apart**2)), abs=2e-4)
                    checked += 1
    return checked


def check_landmarks(client: Client, subject: str, document: dict[str, Any], folder: Path) -> None:
    """``landmarks`` and its route."""
    bones = {bone: path for bone, path in document["bones"].items() if bone != "units"}
    given = [word for bone, path in bones.items() for word in (f"--{bone}", path)]
    assert main(["landmarks", "--units", "mm", *given, "--out", str(folder / "landmarks")]) == 0
    job = client.wait(client.ask("scalings/mesh-landmarks", subject=subject, units="mm"))
    there = written(folder / "landmarks", "landmarks.json")
    result = client.result(job)
    assert {bone: result[bone] for bone in bones} == {bone: there[bone] for bone in bones}


def check_batch(client: Client, subject: str, file: Path, methods: list[str], folder: Path) -> None:
    """``batch`` and its route, for one subject."""
    (folder / "cohort.csv").write_text(f"subject\n{file.name}\n")
    there = folder / "batch_there"
    asked = ["--methods", ",".join(methods), "--workers", "1", "--out", str(there)]
    assert main(["batch", str(folder / "cohort.csv"), *asked]) == 0
    job = client.wait(client.ask("batches", subjects=[subject], methods=methods))
    assert untimed(client.result(job)["statistics"]) == untimed(written(there, "cohort.json")["statistics"])
    client.download(job, folder / "batch")
    assert same_files(folder / "batch", there) >= 3 + 2 * len(methods)


def subject_file(document: dict[str, Any], folder: Path) -> Path:
    file = folder / "subject.yaml"
    file.write_text(yaml.safe_dump(document), encoding="utf-8")
    return file


@pytest.mark.benchmark
@pytest.mark.parametrize(
    ("make", "methods"),
    [(imaged_document, list(ROUTES)), (squatter_document, ["MB", "MB_lam", "MB_am"])],
)
def test_every_method_and_comparison(
    make: Any, methods: list[str], shared_data: Path, tmp_path: Path
) -> None:
    document = make(shared_data)
    if make is squatter_document:
        pytest.importorskip("opensim", reason="models of OpenSim cannot be read without its library")
    file = subject_file(document, tmp_path)
    with served(tmp_path / "data") as url, Client(url) as client:
        subject = put(client, tmp_path, file)
        for method in methods:
            check_method(client, subject, file, method, tmp_path)
        check_comparisons(client, subject, file, methods, tmp_path)
        check_batch(client, subject, file, methods, tmp_path)
        if "bones" in document:
            check_landmarks(client, subject, document, tmp_path)
