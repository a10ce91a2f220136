"""Muscles that follow the surface: a model whose own femur is a known distortion of the person's."""

from __future__ import annotations

import json
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
from pyvista import PolyData

from scaling_service.capabilities.scaling.options import ComparisonOptions
from scaling_service.capabilities.scaling.result import Results
from scaling_service.capabilities.scaling.run import compare, run
from scaling_service.capabilities.scaling.saving import save
from scaling_service.capabilities.shared.settings import Settings
from scaling_service.capabilities.subject.loading import open_subject
from scaling_service.core.errors import SubjectInvalid
from scaling_service.files.mesh import read_mesh
from scaling_service.files.osim.models import read_osim
from scaling_service.files.osim.muscles import read_attachments
from scaling_service.model.anatomy.lengths import measure_segment_lengths
from tests.jobs.recorded import imaged_walker_document, walker_document

pytestmark = pytest.mark.skipif(find_spec("opensim") is None, reason="the opensim library is not installed")

ON_SURFACE = ComparisonOptions(muscle_points="surface")
Array = np.ndarray


def broaden(points: Array) -> Array:
    """The person's femur to the model's: 15 % broader and bowed forward by 10 mm; both centres stay."""
    along = -points[:, 1] / 0.39
    return points * (1.15, 1.0, 1.15) + np.stack(
        [0.04 * along * (1.0 - along), 0.0 * along, 0.0 * along], axis=1
    )


@pytest.fixture(scope="module")
def followed(shared_data: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Results, Path]:
    folder = tmp_path_factory.mktemp("surface")
    document = imaged_walker_document(shared_data)
    document["trials"] |= {"calibration": [], "evaluation": []}
    model = folder / "model.osim"
    model.write_bytes(Path(document["model"]).read_bytes())
    file = folder / "subject.json"
    file.write_text(json.dumps(document | {"model": str(model)}), encoding="utf-8")
    loaded = open_subject(file)
    plain = run(loaded, ("EB",))
    save(plain, folder / "plain", comparison=False)
    person = read_mesh(folder / "plain" / "EB" / "bones" / "femur_r.stl")
    size = plain.scalings["EB"].calibration.scale_factors["femur_r"]
    (folder / "Geometry").mkdir()
    own = PolyData.from_regular_faces(broaden(person.vertices) / size, person.faces)
    own.save(folder / "Geometry" / "r_femur.vtp")
    results = run(loaded, ("EB",), options=ON_SURFACE)
    save(results, folder / "out", comparison=False)
    return results, folder


def test_attachments_go_where_the_known_map_takes_them(followed: tuple[Results, Path]) -> None:
    results, folder = followed
    (segment, moved), *others = results.scalings["EB"].attachments.items()
    assert segment == "femur_r"
    assert not others
    after = np.array([point.at for point in moved.points])
    off = 1e3 * np.linalg.norm(broaden(after) - moved.before, axis=1)
    shift = 1e3 * np.linalg.norm(after - moved.before, axis=1)
    assert np.median(off) < 2.0 < 4.0 < np.median(shift)
    assert np.median(moved.distances[:, 1]) < np.median(moved.distances[:, 0])
    written, _, _ = read_attachments(
        (folder / "out" / "EB" / "model.osim").read_text(), folder / "model.osim", ("femur_r",)
    )
    there = {(point.muscle, point.number): point.at for point in written}
    for point in moved.points:
        assert there[point.muscle, point.number] == pytest.approx(point.at, abs=1e-9)


def test_the_rest_of_the_model_stays(followed: tuple[Results, Path]) -> None:
    _, folder = followed
    plain, moved = (read_osim(folder / name / "EB" / "model.osim") for name in ("plain", "out"))
    assert measure_segment_lengths(moved) == pytest.approx(measure_segment_lengths(plain), abs=1e-12)
    assert moved.markers == plain.markers


def test_what_follows_and_what_does_not_is_reported(followed: tuple[Results, Path]) -> None:
    results, folder = followed
    said = " ".join(results.scalings["EB"].calibration.warnings)
    assert "attachments on the right femur follow its surface" in said
    assert "r_tibia.vtp" in said
    assert "is not beside it" in said
    rows = (folder / "out" / "EB" / "attachments.csv").read_text().splitlines()
    moved = results.scalings["EB"].attachments["femur_r"]
    assert len(rows) == 1 + len(moved.points)
    assert float(rows[1].split(",")[-1]) == pytest.approx(1e3 * moved.distances[0, 1], abs=0.01)


def test_a_built_in_model_has_no_muscles_to_move(shared_data: Path, tmp_path: Path) -> None:
    file = tmp_path / "subject.json"
    file.write_text(json.dumps(walker_document(shared_data)), encoding="utf-8")
    with pytest.raises(SubjectInvalid, match=r"no \.osim model"):
        compare(file, ("MB",), Settings(), ON_SURFACE)
