"""Fibres and tendons of scaled muscles: in their ratio, or working over the generic range."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from scaling_service.capabilities.scaling.muscles.parameters import keep_ranges
from scaling_service.files.osim.models import read_osim, render_osim
from scaling_service.files.osim.muscles import measure_muscles, read_musculature
from scaling_service.model.poses import sweep_coordinates
from scaling_service.model.scaling import scale_model
from tests.files.osim.muscled import make_muscled

LONG_SHANK = {"thigh": (1.1, 1.05, 1.1), "shank": (1.0, 1.3, 0.95)}


@pytest.fixture
def generic(tmp_path: Path) -> Path:
    pytest.importorskip("opensim")
    file = tmp_path / "leg.osim"
    file.write_text(make_muscled(), encoding="utf-8")
    return file


def scale(generic: Path, factors: dict[str, tuple[float, float, float]]) -> tuple:
    model = scale_model(read_osim(generic), factors)
    osim = render_osim(model, source=generic, factors=factors)
    return model, osim, keep_ranges(osim, model, generic)[0]


def follow(model, osim: str) -> tuple[np.ndarray, tuple]:
    """Lengths of muscles with their tendons over every coordinate's range, (n_poses, n_muscles), m."""
    q = np.concatenate(list(sweep_coordinates(model, 10).values()))
    return measure_muscles(osim, model, q).lengths, read_musculature(osim, model, q[:1]).muscles


def test_in_a_larger_copy_both_ways_are_one(generic: Path) -> None:
    whole = {"thigh": (1.2, 1.2, 1.2), "shank": (1.2, 1.2, 1.2)}
    model, by_ratio, by_range = scale(generic, whole)
    muscles = [read_musculature(text, model, np.zeros((1, 2))).muscles for text in (by_ratio, by_range)]
    for one, other in zip(*muscles, strict=True):
        assert other.fibre == pytest.approx(1.2 * 0.1, rel=1e-4)  # OpenSim wraps by iteration
        assert other.slack == pytest.approx(1.2 * 0.14, rel=1e-4)  # OpenSim wraps by iteration
        assert one.fibre == pytest.approx(other.fibre, rel=1e-4)  # OpenSim wraps by iteration


def test_fibres_keep_their_range_where_a_ratio_does_not(generic: Path) -> None:
    model, by_ratio, by_range = scale(generic, LONG_SHANK)
    before, muscles = follow(read_osim(generic), make_muscled())
    gaps = []
    for text in (by_ratio, by_range):
        after, scaled = follow(model, text)
        for k, (was, now) in enumerate(zip(muscles, scaled, strict=True)):
            fibre = (before[:, k] - was.slack) / (was.fibre * np.cos(was.pennation))
            working = (fibre > 0.5) & (fibre < 1.5)
            assert working.sum() > 2
            wanted = now.slack + fibre * now.fibre * np.cos(now.pennation)
            gaps.append(float(np.sqrt(np.mean((wanted - after[:, k])[working] ** 2))))
    ratio, kept = np.reshape(gaps, (2, -1))
    assert (kept <= ratio + 1e-9).all()
    assert (kept < ratio - 1e-3).any()
