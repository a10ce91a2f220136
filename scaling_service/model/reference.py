"""Where the data that come with the product are."""

from __future__ import annotations

from collections.abc import Iterator
from importlib import resources
from importlib.resources.abc import Traversable
from pathlib import Path
from typing import Any

import yaml

_LOADER = getattr(yaml, "CSafeLoader", yaml.SafeLoader)  # libyaml, where it is: ten times as fast


def find_reference_folder() -> Traversable:
    """The folder ``reference_models``: inside the installed package, or beside it in a working copy."""
    installed = resources.files("scaling_service") / "reference_models"
    return installed if installed.is_dir() else Path(__file__).resolve().parents[2] / "reference_models"


def read_reference(file: Traversable) -> Any:
    """What a YAML file of the reference folder holds."""
    return yaml.load(file.read_text(encoding="utf-8"), Loader=_LOADER)


def list_marker_set_files() -> Iterator[tuple[str, Traversable]]:
    """Name and file of every marker set that comes with the product, by name."""
    folder = find_reference_folder() / "marker_sets"
    for file in sorted(folder.iterdir(), key=lambda file: file.name):
        yield file.name.removesuffix(".yaml"), file
