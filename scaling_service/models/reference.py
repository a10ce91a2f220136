"""Where the data that come with the product are."""

from __future__ import annotations

from importlib import resources
from importlib.resources.abc import Traversable
from pathlib import Path


def reference_folder() -> Traversable:
    """The folder ``reference_models``: inside the installed package, or beside it in a working copy."""
    installed = resources.files("scaling_service") / "reference_models"
    return installed if installed.is_dir() else Path(__file__).resolve().parents[2] / "reference_models"
