"""Progress of work whose length nobody knows."""

from __future__ import annotations

import pytest

from scaling_service.core.progress import Steps


def test_steps_come_nearer_to_the_mark_and_never_go_back() -> None:
    reported: list[tuple[str, float]] = []
    steps = Steps(report=lambda what, share: reported.append((what, share)))
    steps.begin("searching", 0.1, 0.8)
    for _ in range(100):
        steps.advance()
    steps.begin("searching again", 0.3, 0.8)
    steps.begin("done", 1.0, 1.0)
    shares = [share for _, share in reported]
    assert shares == sorted(shares)
    assert all(share < 0.8 for share in shares[:-1])
    assert shares[100] == pytest.approx(0.8, abs=0.02)
    assert reported[-1] == ("done", 1.0)
