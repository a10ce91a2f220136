"""A volume that moves, and frames that are shown again, against what was put in."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from scaling_service.capabilities.discovery.disturbances.repeats import _Steps
from scaling_service.capabilities.discovery.disturbances.volume import find_moving_volume
from scaling_service.capabilities.discovery.evidence.fit import Fit, SearchContext, fit_recordings
from scaling_service.capabilities.discovery.search.discover import discover
from scaling_service.model.trial import Trial
from scaling_service.numerics.multibody.laws import Array
from tests.discovery.hidden import person, recorded


def breathing(trial: Trial) -> Array:
    """A zoom that hunts."""
    return trial.markers * (1.0 + 0.01 * np.sin(2.0 * np.pi * 1.3 * trial.times))[:, None, None]


def pushed(trial: Trial) -> Array:
    """A camera that is pushed half way: sheared along X by the height from then on."""
    markers = trial.markers.copy()
    after = trial.times > trial.times.mean()
    markers[after, :, 0] += 0.03 * trial.markers[after, :, 1]
    return markers


def rolling(trial: Trial) -> Array:
    """Rows of a sensor read one after the other: the later the higher."""
    markers = trial.markers.copy()
    for m in range(markers.shape[1]):
        then = trial.times - 0.08 * trial.markers[:, m, 1]
        for axis in range(3):
            markers[:, m, axis] = np.interp(then, trial.times, trial.markers[:, m, axis])
    return markers


def fitted(change: Callable[[Trial], Array]) -> Fit:
    """The person's recordings with other marker positions, tracked."""
    recordings = [
        replace(r, trial=replace(r.trial, markers=change(r.trial)))
        for r in recorded(person(), person().model)
    ]
    return fit_recordings(SearchContext(model=person().model, recordings=recordings))


@pytest.mark.parametrize("change", [breathing, pushed, rolling])
def test_a_volume_that_moves_is_reported_whatever_its_course(change: Callable[[Trial], Array]) -> None:
    fit = fitted(change)
    found = discover(fit.model, fit.context.recordings).findings
    assert not found.named
    assert found.unexplained[0].where == ("markers",)
    assert "the measured volume moves" in found.unexplained[0].law


def lost_for_a_while(trial: Trial) -> Array:
    """Nothing is seen in some frames."""
    markers = trial.markers.copy()
    markers[5:9] = np.nan
    return markers


@pytest.mark.parametrize("change", [lambda trial: trial.markers, lost_for_a_while])
def test_noise_alone_moves_no_volume(change: Callable[[Trial], Array]) -> None:
    assert not list(find_moving_volume(fitted(change)))


def test_frames_that_are_shown_again_are_left_out() -> None:
    """Where the body moves, they are found, and the motion between the others is the true one."""

    def again(trial: Trial) -> Array:
        k = np.arange(len(trial.times))
        return np.asarray(trial.markers[k - np.maximum(k % 15 - 11, 0)])

    for item, true in zip(fitted(again).tracked, fitted(lambda trial: trial.markers).tracked, strict=True):
        steps, k = _Steps.of(item), np.arange(len(item.q))
        repeated = k % 15 > 11
        assert steps.along[repeated[1:]].sum() > 5.0 * steps.across[repeated[1:]].sum()
        assert steps.shown_again[repeated].mean() > 0.8
        assert steps.shown_again[~repeated].mean() < 0.05
        off, left = item.q - true.q, steps.leave_out(item).q - true.q
        assert np.square(left[repeated]).sum() < 0.2 * np.square(off[repeated]).sum()
