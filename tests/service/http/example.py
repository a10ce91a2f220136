"""The person of the documented examples: recordings and a bone, as files."""

from __future__ import annotations

from pathlib import Path

import trimesh

from scaling_service.client import Client
from scaling_service.service.http.subjects import EXAMPLE
from tests.bones.bones import femur
from tests.jobs.force_laboratory import document, force_laboratory
from tests.jobs.laboratory import laboratory


def example_files(folder: Path) -> list[Path]:
    """All files that the examples name, in a folder that is made."""
    folder.mkdir(parents=True)
    laboratory(folder)
    trimesh.Trimesh(*femur(), process=False).export(folder / "femur_r.stl")
    return [folder / name for name in ("standing.trc", "hips.trc", "walk.trc", "femur_r.stl")]


def put_example(client: Client, files: list[Path]) -> None:
    """The documented subject with its files, and one with forces."""
    client.put_subject(EXAMPLE)
    for file in files:
        client.upload("S01", file)
    put_forces(client, files[0].parent / "forces")


def put_forces(client: Client, folder: Path) -> None:
    """A subject S02 on force plates, in a folder that is made."""
    folder.mkdir()
    force_laboratory(folder)
    content = document()
    client.put_subject(content | {"subject": content["subject"] | {"id": "S02"}})
    for file in folder.iterdir():
        if file.suffix != ".yaml":
            client.upload("S02", file)
