"""Rate limits: in any stretch of time no caller gets more than the burst and what came back."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from scaling_service.service.http.callers import MOST_CALLERS, RateLimit


@given(
    steps=st.lists(st.floats(0.0, 3.0), min_size=1, max_size=60),
    rate=st.floats(0.1, 50.0),
    burst=st.integers(1, 20),
)
def test_nobody_gets_more_than_burst_and_rate(steps: list[float], rate: float, burst: int) -> None:
    now = 0.0
    limit = RateLimit(rate, burst, clock=lambda: now)
    taken = 0
    for step in steps:
        now += step
        wait_s = limit.take("one")
        taken += wait_s == 0.0
        assert taken <= burst + rate * now + 1e-6
        assert 0.0 <= wait_s <= 1.0 / rate + 1e-9


@given(rate=st.floats(0.1, 50.0), burst=st.integers(1, 20))
def test_who_waits_as_asked_is_let_in(rate: float, burst: int) -> None:
    now = 0.0
    limit = RateLimit(rate, burst, clock=lambda: now)
    for _ in range(burst):
        assert limit.take("one") == 0.0
    now += limit.take("one") + 1e-9
    assert limit.take("one") == 0.0


def test_strangers_do_not_fill_the_memory() -> None:
    limit = RateLimit(1.0, 1, clock=lambda: 0.0)
    for number in range(2 * MOST_CALLERS):
        limit.take(str(number))
    assert len(limit._rested_at) == MOST_CALLERS
