"""Fixtures of the HTTP layer's tests."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.api.served import Served, serving, settings_in
from tests.runner.tiny import TINY


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
