"""Commands, Python names and routes are what they were, with their parameters and defaults."""

from __future__ import annotations

import pytest

from tests.safety.comparing import compare, tell_differences
from tests.safety.snapshots import load_snapshot
from tests.safety.surface import SURFACES


@pytest.mark.parametrize("name", SURFACES)
def test_the_surface_is_what_it_was(name: str) -> None:
    found = list(compare(load_snapshot(name), SURFACES[name]()))
    if found:
        advice = f"if this is intended: python -m tests.safety.renew {name}"
        pytest.fail(f"{name}: {tell_differences(found)}\n{advice}", pytrace=False)
