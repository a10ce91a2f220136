"""The catalogue that comes with the product, and catalogues that are refused."""

from __future__ import annotations

import json
import shlex
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import typer
import yaml
from pydantic import ValidationError

from scaling_service.capabilities.datasets.catalogue import Dataset, find_dataset, read_catalogue
from scaling_service.capabilities.datasets.run import list_next_commands
from scaling_service.cli.app import app
from scaling_service.core.errors import InputError
from scaling_service.documents.reading import check_document
from scaling_service.model.reference import find_reference_folder, read_reference

CATALOGUE = read_catalogue()


@pytest.mark.parametrize("name", CATALOGUE)
def test_each_subject_file_is_valid_and_names_only_what_is_there(name: str) -> None:
    dataset = CATALOGUE[name]
    subject = check_document(yaml.safe_load(dataset.subject or ""))
    named = {subject.marker_set, subject.scale_setup, subject.image_markers, *subject.trials.files}
    named |= {*subject.forces.values(), *(subject.bones.meshes.values() if subject.bones else ())}
    named |= {subject.model} if subject.model_is_file else set()
    there = {file.saved_as for file in dataset.files}
    there |= {"image_markers.csv"} if dataset.image_markers_from else set()
    assert named - {None} <= there
    assert subject.subject.id == name


@pytest.mark.parametrize("name", CATALOGUE)
def test_the_next_commands_exist_and_name_what_is_there(name: str, tmp_path: Path) -> None:
    dataset, known = CATALOGUE[name], typer.main.get_command(app)
    there = {"subject.yaml", *(file.saved_as for file in dataset.files)}
    for command in list_next_commands(dataset, tmp_path / "a folder"):
        program, verb, *words = shlex.split(command)
        assert program == "scaling-service"
        assert verb in known.list_commands(typer.Context(known))
        inside = [w for w in words if w.startswith(f"{tmp_path}/a folder/")]
        assert inside
        assert {Path(w).relative_to(tmp_path / "a folder").as_posix() for w in inside} <= there


def test_sources_are_those_that_were_verified(shared_data: Path) -> None:
    verified = json.loads((shared_data / "sources.json").read_text(encoding="utf-8"))
    ours = {
        name: {
            "repository": d.repository,
            "commit": d.commit,
            "files": [file.model_dump(by_alias=True) for file in d.files],
        }
        for name, d in CATALOGUE.items()
    }
    assert ours == verified


def test_an_unknown_name_gets_the_close_one() -> None:
    with pytest.raises(InputError, match=r"no dataset 'JIA'.*There are jia_mri, functional"):
        find_dataset("JIA", CATALOGUE)
    with pytest.raises(InputError, match="Did you mean 'gait2354'"):
        find_dataset("Gait2345", CATALOGUE)


def _file(**changes: object) -> Callable[[dict[str, Any]], None]:
    return lambda dataset: dataset["files"][0].update(changes)


def _top(**changes: object) -> Callable[[dict[str, Any]], None]:
    return lambda dataset: dataset.update(changes)


@pytest.mark.parametrize(
    ("spoil", "said"),
    [
        (_file(**{"as": "../elsewhere"}), "within its folder"),
        (_file(**{"as": "/etc/passwd"}), "within its folder"),
        (_file(**{"as": "subject.yaml"}), "two files have the same name"),
        (_file(sha256="abc"), "sha256"),
        (_file(bytes=0), "bytes"),
        (_top(commit="main"), "commit"),
        (_top(image_markers_from="none.osim"), r"no file 'none\.osim'"),
        (_top(surprise=1), "surprise"),
    ],
)
def test_a_dataset_that_cannot_be_used(spoil: Callable[[dict[str, Any]], None], said: str) -> None:
    document = read_reference(find_reference_folder() / "datasets.yaml")["datasets"]["functional"]
    spoil(document)
    with pytest.raises(ValidationError, match=said):
        Dataset.model_validate(document)


def test_sizes_add_up() -> None:
    dataset: Dataset = CATALOGUE["functional"]
    assert dataset.total_bytes == 3742208 + 2046464
