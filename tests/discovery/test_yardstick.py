"""By chance: what lasts counts once, however long it is looked at."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import scipy

from scaling_service.capabilities.discovery.options import DiscoverSettings
from scaling_service.capabilities.discovery.run import discover
from scaling_service.capabilities.discovery.search.yardstick import Spread, count_freedom

DRAWS = 4000


def spread(
    lasting: np.ndarray, own: np.ndarray | None = None, loose: float = 0.0, looks: float = 1.0
) -> Spread:
    return Spread(
        lasting=lasting,
        own=np.zeros((len(lasting), 0)) if own is None else own,
        loose=loose,
        looks=looks,
        frames=100.0,
    )


@pytest.mark.parametrize("recordings", [1, 4])
def test_one_direction_that_all_recordings_share_is_one_number(recordings: int) -> None:
    lasting = np.linspace(1.0, 2.0, 12)[:, None]
    assert count_freedom([spread(lasting)] * recordings) == pytest.approx(1.0)


def test_a_direction_of_each_recording_is_a_number_of_each() -> None:
    nothing, own = np.zeros((12, 1)), np.ones((12, 1))
    assert count_freedom([spread(nothing, own)] * 4) == pytest.approx(4.0)


def test_what_does_not_last_is_a_number_of_each_look() -> None:
    assert count_freedom([spread(np.zeros((12, 1)), loose=2.0, looks=9.0)] * 4) == pytest.approx(36.0)


def test_ordinary_people_stand_out_as_often_as_chance_has_it() -> None:
    rng = np.random.default_rng(5)
    n, looks = 12, 15
    parts = [
        spread(rng.normal(size=(n, 6)), 0.5 * rng.normal(size=(n, 5)), loose=4.0, looks=looks)
        for _ in range(3)
    ]
    shared = rng.normal(size=(6, DRAWS))
    square = np.zeros(DRAWS)
    for part in parts:
        strays = part.lasting @ shared + part.own @ rng.normal(size=(5, DRAWS))
        wander = part.loose / looks * np.square(rng.normal(size=(looks, DRAWS))).sum(axis=0)
        square += (np.square(strays).sum(axis=0) + wander) / len(parts)
    freedom = count_freedom(parts)
    mean = np.mean([np.square(p.lasting).sum() + np.square(p.own).sum() + p.loose for p in parts])
    p = scipy.stats.chi2.sf(freedom * square / mean, freedom)
    assert np.mean(p < 0.05) == pytest.approx(0.05, abs=0.015)
    assert np.mean(p < 0.01) == pytest.approx(0.01, abs=0.008)
    assert np.mean(p > 0.9) == pytest.approx(0.1, abs=0.03)


def test_where_nothing_is_named_real_places_are_as_chance_has_them(shared_data: Path) -> None:
    """As if every half second were news, a fifth stood above chance and half below it."""
    file = shared_data / "living_bone" / "cadaver_hip" / "subject.yaml"
    if not file.is_file():
        pytest.skip("no recordings of living bone")
    document = discover(file, DiscoverSettings(start="none")).document
    p = np.array([place.p for place in document.disagreements])
    assert document.verdict == "nothing"
    assert p.min() > 1e-3
    assert np.mean(p < 0.05) < 0.15
    assert np.mean(p > 0.95) < 0.25
