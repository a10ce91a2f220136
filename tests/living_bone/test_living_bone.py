"""Bones found from skin beside bones that were seen, and the law of skin beside its data and its prior."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from scaling_service.model.anatomy.skin import LENGTH_M, expect_slopes, read_measured_skin
from tests.living_bone.errors import Way, judge_sets, leaving_out
from tests.living_bone.recordings import find_living_bone
from tests.living_bone.skin_over_knee import FILE, HEAD, list_lines

COSTLY = pytest.mark.costly  # ten seconds for all sets, with their laboratory and without


@pytest.fixture(scope="module")
def given(shared_data: Path) -> list[Way]:
    return list(judge_sets(find_living_bone(shared_data), leave_out=False))


@pytest.fixture(scope="module")
def left_out(shared_data: Path) -> list[Way]:
    return list(judge_sets(find_living_bone(shared_data), leave_out=True))


def _average(ways: list[Way]) -> float:
    return float(np.exp(np.mean(np.log([way.ratio for way in ways]))))


@COSTLY
def test_bones_come_nearer_where_their_laboratory_told_nothing_of_its_skin(left_out: list[Way]) -> None:
    assert _average(left_out) <= 0.80
    assert max(way.ratio for way in left_out) <= 1.05


@COSTLY
def test_bones_come_nearer_where_it_did(given: list[Way]) -> None:
    """The guide's table has them all; one of fourteen is 7 % farther."""
    assert _average(given) <= 0.75
    assert max(way.ratio for way in given) <= 1.10


@COSTLY
def test_intervals_hold_the_angles_between_bones_that_were_seen(
    given: list[Way], left_out: list[Way]
) -> None:
    for part in ("covered", "covered_after"):
        shares = [getattr(way, part) for way in (given if part == "covered" else left_out)]
        assert 0.90 <= np.mean(shares) <= 0.99, part
        assert min(shares) >= 0.75, part


def test_the_table_of_skin_is_what_the_recordings_say(shared_data: Path) -> None:
    root = find_living_bone(shared_data)
    assert FILE.read_text(encoding="utf-8") == HEAD + "\n".join(list_lines(root)) + "\n"


def test_the_law_is_what_many_drawn_from_its_prior_have_in_common() -> None:
    """Persons are drawn, and the mean's slope at a place regressed on what was seen of them."""
    known = read_measured_skin("shank")
    rng = np.random.default_rng(5)
    place = known.places[:1] + np.array([0.01, 0.03, 0.0])
    both = np.concatenate([place, known.places])
    squares = np.square(both[:, None] - both).sum(axis=2)
    alike = np.exp(-squares / (2.0 * LENGTH_M**2)) + 1e-10 * np.eye(len(both))
    root = np.linalg.cholesky(alike)
    reach = np.radians(26.0)
    mean = 0.015 * root @ rng.normal(size=(len(both), 200_000))
    seen = mean[1:].copy()
    for person in sorted(set(known.persons.tolist())):
        own = 0.004 / reach * (root @ rng.normal(size=mean.shape))[1:]
        seen[known.persons == person] += own[known.persons == person]
    for movement in sorted(set(known.movements.tolist())):
        noise = known.noise[:, None] * (root @ rng.normal(size=mean.shape))[1:]
        seen[known.movements == movement] += noise[known.movements == movement]
    seen += 0.003 / reach * rng.normal(size=seen.shape)
    weights = np.linalg.solve(seen @ seen.T, seen @ mean[0])
    np.testing.assert_allclose(weights @ known.slopes, expect_slopes("shank", place)[0], atol=3e-4)


def test_a_laboratory_that_is_left_out_has_no_say_and_far_from_all_nothing_is_expected() -> None:
    place = read_measured_skin("thigh").places[:1]
    whole = expect_slopes("thigh", place)
    with leaving_out("Taipei"):
        without = expect_slopes("thigh", place)
    assert np.abs(whole - without).max() > 1e-3
    assert np.abs(expect_slopes("thigh", place + 2.0)).max() < 1e-9
