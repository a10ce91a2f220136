"""Fixtures of the HTTP layer's tests."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import pytest

from scaling_service.service.jobs import example
from tests.service.http.served import Served, serving, settings_in
from tests.service.jobs.tiny import TINY


@pytest.fixture
def served(tmp_path: Path) -> Iterator[Served]:
    """A service whose jobs are real; nothing runs them."""
    with serving(settings_in(tmp_path)) as found:
        yield found


@pytest.fixture
def tiny(tmp_path: Path) -> Iterator[Served]:
    """A service whose jobs are tiny; nothing runs them."""
    with serving(settings_in(tmp_path), TINY) as found:
        yield found


@pytest.fixture
def quick_examples(monkeypatch: pytest.MonkeyPatch) -> None:
    """Examples of two small files, for what does not depend on their content."""

    def write(folder: Path, name: str, seed: int) -> None:
        document = {
            "subject": {"id": name},
            "model": "lower_limb_14dof",
            "trials": {"static": "static.trc"},
            "image_markers": "image_markers.csv",
        }
        (folder / "subject.json").write_text(json.dumps(document), encoding="utf-8")
        for file in ("static.trc", "image_markers.csv"):
            (folder / file).write_text(f"{file} {seed}", encoding="utf-8")

    monkeypatch.setattr(example, "_run", write)
