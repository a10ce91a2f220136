"""What methods cost the muscles: the document tells what the written courses show."""

from __future__ import annotations

import json
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest

from scaling_service.capabilities.scaling.job import ScalingRequest
from scaling_service.capabilities.scaling.options import ComparisonOptions
from scaling_service.capabilities.scaling.result import Results
from scaling_service.capabilities.scaling.run import compare
from scaling_service.capabilities.scaling.saving import save
from scaling_service.capabilities.shared.settings import Settings
from scaling_service.core.errors import SubjectInvalid
from scaling_service.documents.results import ComparisonDocument, MuscleDifference
from scaling_service.files.sto import read_sto
from tests.jobs.recorded import imaged_walker_document, walker_document
from tests.report.reading import held, read

pytestmark = pytest.mark.skipif(find_spec("opensim") is None, reason="the opensim library is not installed")

WITH_MUSCLES = ComparisonOptions(muscles=True)


def subject(folder: Path, document: dict[str, object]) -> Path:
    path = folder / "subject.json"
    path.write_text(json.dumps(document), encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def compared(shared_data: Path, tmp_path_factory: pytest.TempPathFactory):
    """A walker with bones of the right leg, by MB and EB."""
    document, folder = imaged_walker_document(shared_data), tmp_path_factory.mktemp("muscles")
    results = compare(subject(folder, document), ("MB", "EB"), Settings(), WITH_MUSCLES)
    return results, save(results, folder), folder


def course(folder: Path, method: str, reported: MuscleDifference) -> tuple[np.ndarray, np.ndarray]:
    """Times and values as written, in the unit that is told."""
    name, column = {
        "moment arm": ("moment_arms", f"{reported.muscle}.{reported.coordinate}"),
        "length": ("muscle_lengths", reported.muscle),
        "joint moment": ("joint_moments", f"{reported.coordinate}_moment"),
    }[reported.quantity]
    table = read_sto(folder / method / f"{reported.trial}_{name}.sto")
    return table.times, table.column(column) * (1e3 if reported.unit == "mm" else 1.0)


def test_differences_are_those_of_the_written_courses(
    compared: tuple[Results, ComparisonDocument, Path],
) -> None:
    _, document, folder = compared
    assert document.muscles is not None
    assert {reported.quantity for reported in document.muscles.differences} == {
        "moment arm",
        "length",
        "joint moment",
    }
    for reported in document.muscles.differences:
        times, theirs = course(folder, "MB", reported)
        _, ours = course(folder, reported.method, reported)
        at = int(np.nanargmax(np.abs(ours - theirs)))
        assert times[at] == pytest.approx(reported.time_s, abs=1e-4)
        assert ours[at] - theirs[at] == pytest.approx(reported.difference, abs=2e-3)


def test_the_largest_differences_are_reported_in_words_everywhere(
    compared: tuple[Results, ComparisonDocument, Path],
) -> None:
    _, document, folder = compared
    assert document.muscles is not None
    arm = document.muscles.differences[0]
    said = document.muscles.summary[0]
    assert said.startswith(f"EB against MB changes the moment arm of {arm.muscle} about {arm.coordinate} by")
    assert f"{abs(arm.difference):.1f} mm" in said
    assert f"at {arm.angle_deg:.0f} degrees" in said
    assert said in (folder / "report.html").read_text(encoding="utf-8")
    root = read((folder / "report.html").read_text(encoding="utf-8"))
    assert "scene/muscles.json" in held(root)["files"]
    assert document.settings["comparison"]["muscles"] is True


def test_lengths_change_as_moment_arms_say(
    compared: tuple[Results, ComparisonDocument, Path],
) -> None:
    results, _, _ = compared
    assert results.muscles is not None
    own = results.muscles.courses["EB"]["Walking01"]
    for muscle in ("glmed1_r", "soleus_l", "bflh_r"):  # those that wrap around nothing
        lengths = own.courses("length")[muscle, ""]
        arms = {c: arm for (m, c), arm in own.geometry.arms.items() if m == muscle}
        rates = sum(-arm * np.gradient(own.angles[c], own.times) for c, arm in arms.items())
        assert np.abs(np.gradient(lengths, own.times) - rates)[2:-2].max() < 0.01  # m/s, of some 0.3


def test_muscles_of_a_model_without_any_are_refused(shared_data: Path, tmp_path: Path) -> None:
    with pytest.raises(SubjectInvalid, match=r"no \.osim model"):
        compare(subject(tmp_path, walker_document(shared_data)), ("MB",), Settings(), WITH_MUSCLES)


def test_over_http_muscles_are_asked_for_in_the_body() -> None:
    request = ScalingRequest(subject="S01", methods=["MB"], muscles=True)
    assert request.part(ComparisonOptions) == WITH_MUSCLES
