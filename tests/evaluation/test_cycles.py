"""Cutting cycles out of recordings; gaps are refused by name."""

from __future__ import annotations

import numpy as np
import pytest

from scaling_service.core.errors import TrialUnusable
from scaling_service.numerics.statistics.complete import ComparisonImpossible, ValueMissing
from scaling_service.numerics.statistics.waveforms import Curves, normalise_cycles

TIMES = np.arange(301) / 100.0
ANGLES = np.column_stack([np.sin(2 * np.pi * TIMES), TIMES**3 - TIMES])
NAMES = ("hip_flexion_r", "knee_angle_r")


def cut(cycles: list[tuple[float, float]], values: np.ndarray = ANGLES, nodes: int = 101) -> np.ndarray:
    return normalise_cycles(TIMES, values, cycles, NAMES, trial="Walking01", nodes=nodes)


def test_nodes_lie_evenly_between_the_events() -> None:
    cycles = [(0.123, 1.2), (0.7, 2.9999), (0.0, 3.0)]
    found = cut(cycles)
    assert found.shape == (3, 2, 101)
    for k, (start, end) in enumerate(cycles):
        t = np.linspace(start, end, 101)
        np.testing.assert_allclose(found[k, 1], t**3 - t, atol=1e-12)  # a cubic spline keeps a cubic
        np.testing.assert_allclose(found[k, 0], np.sin(2 * np.pi * t), atol=2e-5)  # h⁴ of the spline's ends
    np.testing.assert_array_equal(cut(cycles)[1], cut(cycles[1:2])[0])
    assert cut(cycles, nodes=51).shape == (3, 2, 51)


def test_a_gap_within_a_cycle_is_an_error_and_beside_it_is_none() -> None:
    gappy = ANGLES.copy()
    gappy[150, 1] = np.nan
    with pytest.raises(TrialUnusable, match=r"'knee_angle_r' has no value at 1\.5 s"):
        cut([(1.0, 2.0)], gappy)
    np.testing.assert_array_equal(cut([(0.2, 1.3)], gappy), cut([(0.2, 1.3)]))


@pytest.mark.parametrize(
    ("cycle", "message"),
    [
        ((2.0, 1.0), "ends before it starts"),
        ((1.0, 1.0), "ends before it starts"),
        ((-0.5, 1.0), "leaves the recording"),
        ((2.5, 3.2), "leaves the recording"),
        ((1.0, 1.015), "has 3 frames"),
    ],
)
def test_events_that_make_no_cycle(cycle: tuple[float, float], message: str) -> None:
    with pytest.raises(TrialUnusable, match=message):
        cut([cycle])


def test_names_that_do_not_fit() -> None:
    with pytest.raises(ValueError, match="do not fit"):
        normalise_cycles(TIMES, ANGLES, [(0.0, 1.0)], ("one",), trial="Walking01")


def test_missing_nodes_are_named() -> None:
    values = np.zeros((2, 2, 11))
    values[1, 1, 7] = np.nan
    with pytest.raises(
        ValueMissing, match="knee: no finite value at subject 'S2', method 'EB', node 7 of 11"
    ):
        Curves("knee", ("S1", "S2"), ("MB", "EB"), values)


def test_curves_that_do_not_fit() -> None:
    with pytest.raises(ComparisonImpossible, match="one node"):
        Curves("knee", ("a", "b"), ("MB", "EB"), np.zeros((2, 2, 1)))
    with pytest.raises(ComparisonImpossible, match="do not fit"):
        Curves("knee", ("a", "b"), ("MB", "EB"), np.zeros((2, 2)))


def test_curves_cannot_be_changed() -> None:
    values = np.zeros((2, 2, 5))
    curves = Curves("knee", ("a", "b"), ("MB", "EB"), values)
    values[0, 0, 0] = np.nan
    assert np.isfinite(curves.values).all()
    with pytest.raises(ValueError, match="read-only"):
        curves.values[0, 0, 0] = 1.0
