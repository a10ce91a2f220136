"""How large a hidden thing must be to be named."""

from __future__ import annotations

import math
from importlib.util import find_spec
from pathlib import Path

import pytest

from scaling_service.capabilities.discovery.run import USUAL
from tests.blind.cases import NAMEABLE, Case
from tests.blind.making import NobodyMeetsError, make
from tests.blind.nameable import _find_crossing


def test_the_smallest_size_is_where_the_odds_reach_the_bar() -> None:
    # Odds that grow with the square of the size, less 4: they are the bar at its root.
    wanted = math.sqrt((USUAL.odds + 4.0) / 0.3)
    assert _find_crossing(lambda size: 0.3 * size**2 - 4.0, 1.0) == pytest.approx(wanted, rel=0.03)
    assert _find_crossing(lambda _: USUAL.odds - 1.0, 1.0) == math.inf


def test_odds_that_fall_again_count_from_where_they_stay() -> None:
    # Something ordinary takes over at sizes from 2 to 5.
    found = _find_crossing(lambda size: 0.0 if 2.0 < size < 5.0 else 2.0 * USUAL.odds, 1.0)
    assert 4.0 < found < 6.5


@pytest.mark.skipif(find_spec("opensim") is None, reason="the opensim library is not installed")
def test_what_nobody_meets_is_not_made(tmp_path: Path) -> None:
    """A volume off by 3 % is as large as two thighs and shanks that differ by 2 % each: twice is not met."""
    case = Case("effect", ("capture_scale",), NAMEABLE, "gait", False, 0)
    with pytest.raises(NobodyMeetsError):
        make(case, tmp_path / "subjects", tmp_path / "labels")
    assert not (tmp_path / "subjects").exists()
