"""How often the permutation tests find what is not there."""

from __future__ import annotations

import sys
import time

import numpy as np
import pytest

from scaling_service.numerics.statistics.waveforms import (
    WaveformSettings,
    analyse_repeated_measures,
    compare_paired,
)
from tests.evaluation.curves import smooth


def false_positives(
    experiments: int, n: int, k: int, chosen: WaveformSettings, scale: np.ndarray | float = 1.0
) -> tuple[float, float]:
    """Share of null experiments in which the analysis of variance, and a paired t test, find something."""
    found = np.zeros(2)
    for i in range(experiments):
        rng = np.random.default_rng([22, n, k, i])
        values = scale * smooth(rng, n, k) + 2.0 * smooth(rng, n, 1)
        found += (
            analyse_repeated_measures(values, rng, chosen).significant,
            compare_paired(values[:, 0], values[:, 1], rng, chosen).significant,
        )
    return tuple(found / experiments)


@pytest.mark.costly  # two thousand draws
def test_false_positives_are_five_percent() -> None:
    anova, t = false_positives(2000, 9, 3, WaveformSettings(rearrangements=200))
    assert anova == pytest.approx(0.05, abs=0.01)
    assert t == pytest.approx(0.05, abs=0.01)


def test_methods_that_scatter_differently() -> None:
    """Exchange of labels does not keep its level then, as documented."""
    scale = np.array([3.0, 1.0, 1.0])[:, None]
    labels = WaveformSettings(rearrangements=200)
    assert false_positives(300, 12, 3, labels, scale)[0] > 0.10


@pytest.mark.benchmark
@pytest.mark.parametrize(("n", "k"), [(6, 5), (10, 5), (26, 5)])
def test_false_positives_at_length(n: int, k: int) -> None:
    start = time.perf_counter()
    anova, t = false_positives(4000, n, k, WaveformSettings(rearrangements=1000))
    wall = time.perf_counter() - start
    sys.stdout.write(
        f"\n{n} subjects, {k} methods: F {anova:.4f}, t {t:.4f} false positives of 4000; {wall:.0f} s\n"
    )
    assert anova == pytest.approx(0.05, abs=0.01)
    if n > 6:  # six subjects have 32 sign patterns: the level is 1/32
        assert t == pytest.approx(0.05, abs=0.01)
    else:
        assert t == pytest.approx(1 / 32, abs=0.01)
