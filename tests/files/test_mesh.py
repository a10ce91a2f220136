from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh
from pyvista import make_tri_mesh

from scaling_service.core.errors import FileUnreadable
from scaling_service.files import mesh as module
from scaling_service.files.mesh import READERS, read_mesh

BALL = trimesh.creation.icosphere(2, 30.0)


def written(path: Path) -> Path:
    if path.suffix == ".vtp":
        make_tri_mesh(np.asarray(BALL.vertices), np.asarray(BALL.faces)).save(path)
    else:
        BALL.export(path)
    return path


@pytest.mark.parametrize("suffix", READERS)
def test_every_format_gives_the_same_triangles(tmp_path: Path, suffix: str) -> None:
    mesh = read_mesh(written(tmp_path / f"ball{suffix}"))
    corners = mesh.vertices[mesh.faces]
    volume = np.einsum("ij,ij->i", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])).sum() / 6
    assert len(mesh.faces) == len(BALL.faces)
    assert volume == pytest.approx(BALL.volume, rel=1e-5)


def test_text_formats(tmp_path: Path) -> None:
    (tmp_path / "b.stl").write_text(trimesh.exchange.stl.export_stl_ascii(BALL))
    (tmp_path / "b.ply").write_bytes(trimesh.exchange.ply.export_ply(BALL, encoding="ascii"))
    for name in ("b.stl", "b.ply"):
        assert len(read_mesh(tmp_path / name).faces) == len(BALL.faces)


def test_polygons_become_triangles(tmp_path: Path) -> None:
    (tmp_path / "q.obj").write_text("v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1 2 3 4\n")
    assert len(read_mesh(tmp_path / "q.obj").faces) == 2


def test_an_obj_opens_no_other_file(tmp_path: Path) -> None:
    (tmp_path / "m.obj").write_text("mtllib /etc/passwd\nusemtl x\nv 0 0 0\nv 1 0 0\nv 1 1 0\nf 1 2 3\n")
    assert len(read_mesh(tmp_path / "m.obj").faces) == 1


@pytest.mark.parametrize("suffix", READERS)
@pytest.mark.parametrize("content", [b"", b"\x00" * 300, b"no mesh at all\n" * 20, b"solid x\nfacet normal"])
def test_damaged_files_are_refused(tmp_path: Path, suffix: str, content: bytes) -> None:
    path = tmp_path / f"bad{suffix}"
    path.write_bytes(content)
    with pytest.raises(FileUnreadable) as refusal:
        read_mesh(path)
    assert refusal.value.file == str(path)
    assert refusal.value.remedy


VERTEX = "element vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
FACE = "element face 1\nproperty list uchar int corners\n"


@pytest.mark.parametrize(
    "header",
    [
        f"ascii 1.0\n{VERTEX}{FACE}",  # the corners of faces by an unknown name
        f"binary_little_endian 1.0\nelement face 1\n{VERTEX}",  # a first element without properties
    ],
)
def test_ply_headers_that_its_reader_trips_over(tmp_path: Path, header: str) -> None:
    content = f"ply\nformat {header}end_header\n0 0 0\n1 0 0\n1 1 0\n3 0 1 2\n"
    (tmp_path / "bone.ply").write_text(content)
    with pytest.raises(FileUnreadable, match="damaged or no PLY file"):
        read_mesh(tmp_path / "bone.ply")


@pytest.mark.parametrize("suffix", READERS)
@pytest.mark.parametrize("share", [0.1, 0.5, 0.9])
def test_cut_files_are_refused_or_read_as_triangles(tmp_path: Path, suffix: str, share: float) -> None:
    path = written(tmp_path / f"ball{suffix}")
    content = path.read_bytes()
    path.write_bytes(content[: int(share * len(content))])
    try:
        mesh = read_mesh(path)
    except FileUnreadable:
        return
    assert np.isfinite(mesh.vertices).all()
    assert mesh.faces.max() < len(mesh.vertices)


def test_what_cannot_be_read_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(FileUnreadable, match="no such file"):
        read_mesh(tmp_path / "none.stl")
    with pytest.raises(FileUnreadable, match=r"'\.step' is not a format"):
        read_mesh(tmp_path / "bone.step")
    path = written(tmp_path / "ball.stl")
    monkeypatch.setattr(module, "MAX_FACES", 10)
    with pytest.raises(FileUnreadable, match="more than 10"):
        read_mesh(path)
    monkeypatch.setattr(module, "MAX_BYTES", 10)
    with pytest.raises(FileUnreadable, match="MB, more than"):
        read_mesh(path)


def test_a_surface_finer_than_needed_is_thinned_and_stays_where_it_is(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    ball = trimesh.creation.icosphere(subdivisions=6, radius=25.0)
    ball.apply_translation([40.0, -300.0, 7.0])
    for suffix in (".stl", ".ply"):
        ball.export(tmp_path / f"fine{suffix}")
    assert read_mesh(tmp_path / "fine.stl").thinned_from == 0
    monkeypatch.setattr(module, "FINE_FACES", 5000)
    for suffix in (".stl", ".ply"):
        found = read_mesh(tmp_path / f"fine{suffix}")
        assert found.thinned_from == len(ball.faces) == 81920
        assert 3000 < len(found.faces) < 8000
        edges = np.sort(found.faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
        assert (np.unique(edges, axis=0, return_counts=True)[1] % 2 == 0).all()  # closed
        radii = np.linalg.norm(found.vertices - [40.0, -300.0, 7.0], axis=1)
        assert (
            np.abs(radii - 25.0).max() < 0.05
        )  # the middle of a cell's vertices lies below a ball's surface


def test_vertices_that_are_not_numbers(tmp_path: Path) -> None:
    (tmp_path / "n.obj").write_text("v nan 0 0\nv 1 0 0\nv 1 1 0\nf 1 2 3\n")
    with pytest.raises(FileUnreadable, match="not finite"):
        read_mesh(tmp_path / "n.obj")
