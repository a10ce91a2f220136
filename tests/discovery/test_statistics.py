"""How sure a candidate is: whatever nuisances could explain, in few blocks, in the fit and beyond it."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from scaling_service.capabilities.discovery.evidence.scoring import ScoredCandidate
from scaling_service.capabilities.discovery.evidence.statistics import (
    NOTHING,
    Fitted,
    HeldOut,
    explain,
    fit_columns,
    fit_each,
    try_held_out,
)
from scaling_service.capabilities.discovery.evidence.sums import Block, Evidence
from scaling_service.capabilities.discovery.laws.candidates import Candidate, Column
from scaling_service.numerics.multibody.laws import Array

ROWS, BLOCKS, NUISANCES = 40, 20, 2
CHOICE = [
    Candidate(
        kind="anything", where=("here",), columns=(Column(name="a", unit=1.0), Column(name="b", unit=1.0))
    )
]


def evidence(x: Array, y: Array, *, together: bool) -> Evidence:
    """Blocks of columns (n, k), of which the first are nuisances, and residuals (n,)."""
    group = slice(NUISANCES, x.shape[1])
    edges = np.arange(0, len(y) + 1, ROWS).tolist()
    blocks = []
    for k, (a, b) in enumerate(pairwise(edges)):
        columns, left = x[a:b], y[a:b]
        own = columns.T @ columns
        blocks.append(
            Block(
                trial="held" if k % 3 == 2 else "known",
                role="held_out" if k % 3 == 2 else "fit",
                scores=columns.T @ left,
                cross=own[:NUISANCES],
                own=own if together else own[None, group, group],
                square=float(left @ left),
                freedom=float(ROWS),
            )
        )
    return Evidence(tuple(blocks), np.square(x).sum(axis=0), NUISANCES, (group,))


def drawn() -> tuple[Array, Array, Array]:
    """Columns that are alike, what the candidate and noise leave, and what the nuisances would explain."""
    rng = np.random.default_rng(3)
    x = rng.normal(size=(ROWS * BLOCKS, NUISANCES + 2))
    x[:, NUISANCES:] += 0.8 * x[:, :NUISANCES]
    x *= 1.0 + rng.random(BLOCKS).repeat(ROWS)[:, None]  # blocks differ
    y = x[:, NUISANCES:] @ [0.2, -0.1] + rng.normal(size=len(x))
    return x, y, x[:, :NUISANCES] @ [5.0, -7.0]


def test_how_sure_a_candidate_is_does_not_depend_on_nuisances() -> None:
    x, y, more = drawn()
    (plain,) = fit_each(evidence(x, y, together=False), CHOICE)
    (moved,) = fit_each(evidence(x, y + more, together=False), CHOICE)
    assert plain.p < 0.05
    assert moved.p == pytest.approx(plain.p, rel=1e-6)
    np.testing.assert_allclose(moved.size, plain.size, rtol=1e-9)
    np.testing.assert_allclose(moved.covariance, plain.covariance, rtol=1e-6)


def test_the_size_is_that_of_ordinary_least_squares() -> None:
    x, y, more = drawn()
    known = (np.arange(len(y)) // ROWS) % 3 != 2
    best = np.linalg.lstsq(x[known], (y + more)[known], rcond=None)[0]
    (moved,) = fit_each(evidence(x, y + more, together=False), CHOICE)
    np.testing.assert_allclose(moved.size, best[NUISANCES:], rtol=1e-9)


def test_gains_are_those_beyond_the_nuisances() -> None:
    x, y, more = drawn()
    plain, moved = (evidence(x, left, together=True) for left in (y, y + more))
    known = [[s for s in e.blocks if s.role == "fit"] for e in (plain, moved)]
    gains = [explain(e, 0, some).gains for e, some in zip((plain, moved), known, strict=True)]
    np.testing.assert_allclose(gains[1], gains[0], rtol=1e-6, atol=1e-9)
    assert try_held_out(moved, 0, CHOICE[0]).p == pytest.approx(try_held_out(plain, 0, CHOICE[0]).p, rel=1e-6)


def one_sided(noise: float, *, effect: float, blocks: int = 6, rank: int = 3) -> Fitted:
    """Columns that move in one of the blocks only, fitted to an effect and white noise."""
    rng = np.random.default_rng(5)
    x = rng.normal(size=(blocks, ROWS, rank)) * np.where(np.arange(blocks) == 0, 1.0, 0.01)[:, None, None]
    y = effect * x.sum(axis=2) + noise * rng.normal(size=(blocks, ROWS))
    scores, own = np.einsum("bnk,bn->bk", x, y), np.einsum("bnk,bnl->bkl", x, x)
    squares = (y**2).sum(axis=1).tolist()
    of = [
        Block(trial="known", role="fit", scores=s, cross=o[:0], own=o, square=q, freedom=float(ROWS))
        for s, o, q in zip(scores, own, squares, strict=True)
    ]
    return fit_columns(scores, own, np.square(x).sum(axis=(0, 1)), of)


def test_what_takes_off_nearly_all_that_stands_above_the_noise_is_sure_in_a_single_block_that_moves() -> None:
    for noise in (1.0, 2.0):  # as the floors have it, and with memory
        fitted = one_sided(noise, effect=3.0 * noise)
        assert fitted.p < 1e-6
    np.testing.assert_allclose(fitted.size, 6.0, atol=4.0 * np.sqrt(fitted.covariance.max()))
    assert 3.0 <= fitted.by_chance < 0.01 * fitted.gain


@pytest.mark.parametrize(("noise", "effect"), [(1.0, 0.0), (1.0, 0.2), (2.0, 0.0)])
def test_a_single_block_that_moves_says_nothing_of_little_or_of_louder_noise(
    noise: float, effect: float
) -> None:
    assert one_sided(noise, effect=effect).p == 1.0


def scored(fit_p: float, unseen_p: float, *, folds: bool = False, outweighs: bool = True) -> ScoredCandidate:
    """Something with the given chances."""
    return ScoredCandidate(
        candidate=CHOICE[0],
        fitted=replace(NOTHING, p=fit_p),
        gains=None,
        held_out=HeldOut(0.5, unseen_p, folds, outweighs),
    )


def test_chances_of_the_fit_and_of_other_recordings_combine() -> None:
    assert scored(1e-4, 1e-5).p_family(2000) < 1e-3 < scored(1e-4, 1.0).p_family(2000)
    assert scored(1e-4, 1e-5, folds=True).p_family(2000) == pytest.approx(0.2)
    assert scored(1e-4, 1e-5, outweighs=False).p_family(2000) == pytest.approx(0.2)


def test_of_nothing_the_combined_chance_is_as_likely_as_it_says() -> None:
    p = np.random.default_rng(7).random((20_000, 2))
    both = np.array([scored(*pair).p_family(1) for pair in p])
    for level in (0.01, 0.05, 0.5):
        assert np.mean(both < level) == pytest.approx(level, abs=4.0 * np.sqrt(level / len(p)))
