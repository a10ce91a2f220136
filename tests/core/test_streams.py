"""Random streams by name."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from scaling_service.core.streams import stream

SNAPSHOT = [2213828928, 4019628399, 2270024390]
NAMES = st.lists(st.one_of(st.text(max_size=5), st.integers(0, 30)), max_size=4).map(tuple)


@given(seed=st.integers(0, 2**40), names=NAMES)
def test_the_same_name_gives_the_same_numbers(seed: int, names: tuple[str | int, ...]) -> None:
    np.testing.assert_array_equal(stream(seed, *names).random(4), stream(seed, *names).random(4))


@given(first=st.tuples(st.integers(0, 2**40), NAMES), second=st.tuples(st.integers(0, 2**40), NAMES))
def test_another_name_or_seed_gives_others(
    first: tuple[int, tuple[str | int, ...]], second: tuple[int, tuple[str | int, ...]]
) -> None:
    if [repr(first)] != [repr(second)]:
        a, b = (stream(seed, *names).random(4) for seed, names in (first, second))
        assert (a != b).all()


def test_names_are_not_run_together() -> None:
    paths = [("ab", "c"), ("a", "bc"), ("abc",), ("abc", ""), ("1",), (1,), (), ("",)]
    for a, b in itertools.combinations(paths, 2):
        assert stream(3, *a).random() != stream(3, *b).random()


def test_numbers_are_the_same_on_every_machine() -> None:
    """A snapshot: studies in the changelog would change with it."""
    assert stream(1, "marker", 2).integers(0, 2**32, 3).tolist() == SNAPSHOT


def test_streams_are_not_correlated() -> None:
    draws = np.array([stream(5, "draw", k).normal(size=500) for k in range(40)])
    off = np.corrcoef(draws)[~np.eye(40, dtype=bool)]
    assert np.abs(off).max() < 5.0 / np.sqrt(500)
    assert draws.std() == pytest.approx(1.0, abs=0.03)


def test_a_negative_seed_is_refused() -> None:
    with pytest.raises(ValueError, match="negative"):
        stream(-1, "a")
