"""What no entry of the catalogue has is told by its law and place, and nothing is named in its stead."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from scaling_service.capabilities.discovery.disturbances import disturbance, free_marker
from scaling_service.capabilities.discovery.disturbances.disturbance import Disturbance
from scaling_service.capabilities.discovery.evidence.fit import SearchContext, fit_recordings
from scaling_service.capabilities.discovery.evidence.markers import MARKERS
from scaling_service.capabilities.discovery.evidence.scoring import ScoredCandidate, ScoredCandidates
from scaling_service.capabilities.discovery.evidence.statistics import NOTHING, Fitted, HeldOut
from scaling_service.capabilities.discovery.laws.candidates import Candidate, Masked
from scaling_service.capabilities.discovery.laws.spots import BentSpot, VolumeSpot, WarpedSpot
from scaling_service.capabilities.discovery.search.discover import discover
from scaling_service.capabilities.discovery.search.findings import Findings
from scaling_service.model.trial import Trial
from scaling_service.numerics.multibody.laws import Array
from scaling_service.numerics.signals.filters import filter_butterworth
from tests.discovery.hidden import hide, person, recorded


def changed(change: Callable[[Trial], Array]) -> Findings:
    """What is found in the person's recordings with other marker positions."""
    recordings = [
        replace(r, trial=replace(r.trial, markers=change(r.trial)))
        for r in recorded(person(), person().model)
    ]
    return discover(person().model, recordings).findings


def test_a_lens_anywhere_is_a_sum_of_the_columns_about_a_middle() -> None:
    """k s |s|2 with s = r - m - c, expanded in c by hand; what is left is linear in r, not only r itself."""
    rng = np.random.default_rng(0)
    places, middle, c, k = rng.normal(size=(7, 3, 5)), rng.normal(size=3), rng.normal(size=3), 0.3
    x, y, z = middle.tolist()
    away = places - (middle + c)[:, None]
    lens = k * away * np.square(away).sum(axis=1, keepdims=True)
    columns = [BentSpot((x, y, z), axis).field(places) for axis in (None, 0, 1, 2)]
    curved = k * columns[0] - k * np.tensordot(c, columns[1:], axes=1)
    linear = np.concatenate([places, np.ones((7, 1, 5))], axis=1).transpose(0, 2, 1).reshape(-1, 4)
    left = (lens - curved).transpose(0, 2, 1).reshape(-1, 3)
    assert np.abs(left - linear @ np.linalg.lstsq(linear, left, rcond=None)[0]).max() < 1e-12
    assert VolumeSpot().field(places) is places


def test_a_marker_that_trembles_is_reported_with_its_frequency() -> None:
    def shaken(trial: Trial) -> Array:
        markers = trial.markers.copy()
        wave = 4e-3 * np.sin(2.0 * np.pi * 11.0 * trial.times)
        markers[:, trial.index("RFH")] += wave[:, None] * np.array([0.6, 0.0, 0.8])
        return markers

    found = changed(shaken)
    assert not found.named
    assert found.verdict == "unexplained"
    assert found.unexplained[0].where == ("RFH",)
    assert "RFH trembles at 11 Hz" in found.unexplained[0].law
    assert any("repair what it describes" in note for note in found.notes)


def test_a_marker_that_comes_late_is_reported_with_its_delay() -> None:
    def late(trial: Trial) -> Array:
        markers, k = trial.markers.copy(), trial.index("RFH")
        for axis in range(3):
            markers[:, k, axis] = np.interp(trial.times - 0.04, trial.times, trial.markers[:, k, axis])
        return markers

    found = changed(late)
    assert not found.named
    assert found.unexplained[0].where == ("RFH",)
    assert "RFH comes 4" in found.unexplained[0].law
    assert "ms late" in found.unexplained[0].law


def test_markers_that_were_smoothed_are_reported_with_what_they_lack() -> None:
    """Smoothed so much that an acceleration, the first thing that is lost, says little of it."""

    def smoothed(trial: Trial) -> Array:
        markers = trial.markers.copy()
        at = [k for k, label in enumerate(trial.labels) if label in ("RFH", "RLM", "RMM")]
        rate = trial.rate_hz
        flat = markers[:, at].reshape(len(markers), -1)
        markers[:, at] = filter_butterworth(flat, rate_hz=rate, cutoff_hz=1.2, order=2).values.reshape(
            -1, len(at), 3
        )
        return markers

    found = changed(smoothed)
    assert not found.named
    assert set(found.unexplained[0].where) <= {"RFH", "RLM", "RMM"}
    assert "of what is faster than" in found.unexplained[0].law
    assert "lack" in found.unexplained[0].law


def test_a_volume_warped_to_one_side_is_reported() -> None:
    def warped(trial: Trial) -> Array:
        markers = trial.markers.copy()
        x, y, z = np.moveaxis(trial.markers - [0.3, 0.9, 0.1], -1, 0)
        markers += np.stack([0.05 * y**2 + 0.03 * x * y, -0.04 * y * z, 0.06 * y**2], axis=-1)
        return markers

    found = changed(warped)
    assert not found.named
    assert found.unexplained[0].where == ("markers",)
    assert "warped" in found.unexplained[0].law


def test_a_product_of_coordinates_about_a_middle_moves_places_along_one_axis() -> None:
    moved = WarpedSpot((1.0, 0.0, 2.0), (0, 2), 1).field(np.array([[[3.0], [5.0], [7.0]]]))
    np.testing.assert_allclose(moved[0, :, 0], [0.0, 10.0, 0.0])


def test_a_marker_that_came_off_is_reported_alone() -> None:
    def restuck(trial: Trial) -> Array:
        markers = trial.markers.copy()
        late = trial.times > trial.times.mean()
        markers[late, trial.index("RFH")] += np.array([0.0, 0.025, 0.0])
        return markers

    found = changed(restuck)
    assert not found.named
    assert [u.where for u in found.unexplained] == [("RFH",)]


@pytest.mark.parametrize(("share", "reported"), [(0.2, False), (0.3, True)])
def test_only_what_explains_much_of_the_disagreement_ends_the_search(
    share: float, reported: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Where much is wrong, a law of a few more numbers than the right effect explains more than it."""
    _, truth = hide("marker_offset", "RFH", numbers=(10.0, 0.0, 10.0))
    now = fit_recordings(SearchContext(model=person().model, recordings=recorded(person(), truth)))
    # White noise of 1 mm adds a square of one for every number that the residuals are.
    above = sum(i.square - i.freedom for i in now.tracked if i.role == "fit")
    law = Disturbance(where=("markers",), law="any law", expected=share * above, p=0.0, held_out=0.0)
    monkeypatch.setattr(disturbance, "_judge_laws", lambda *_: iter([law]))
    found = disturbance.find_disturbance(now, ScoredCandidates([], 1))
    assert found is (law if reported else None)


@pytest.mark.parametrize(("share", "yields"), [(0.8, False), (1.2, True)])
def test_an_effect_yields_to_a_law_that_explains_more(
    share: float, yields: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    _, truth = hide("marker_offset", "RFH", numbers=(10.0, 0.0, 10.0))
    without, known = (
        fit_recordings(SearchContext(model=person().model, recordings=recorded(person(), body)))
        for body in (truth, person().model)
    )
    taken = MARKERS.squares(without) - MARKERS.squares(known)
    law = Disturbance(where=("markers",), law="any law", expected=share * taken, p=0.0, held_out=0.0)
    monkeypatch.setattr(disturbance, "_judge_laws", lambda *_: iter([law]))
    assert disturbance.is_better_than_effects(law, without, known) is yields


@pytest.mark.parametrize(("there", "is_free"), [(0.9, False), (0.2, True)])
def test_a_marker_on_its_own_way_in_a_held_out_recording_is_compared_with_what_laws_explain_there(
    there: float, is_free: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    model = person().model
    fit = fit_recordings(SearchContext(model=model, recordings=recorded(person(), model)))
    square = sum(item.square for item in fit.tracked if item.role == "held_out")
    alone = Candidate(
        kind=free_marker.KIND, where=("RFH",), columns=(), trials=("gait_2",), change=Masked("RFH")
    )
    own = Fitted.of_any_course(0.95 * square, 0.0, 1e-9)
    monkeypatch.setattr(free_marker, "_fit_markers", lambda _fit: [(alone, own)])
    skin = replace(NOTHING, gain=0.01 * square)  # little where it was fitted
    law = ScoredCandidate(
        candidate=Candidate(kind="soft_tissue_artefact", where=("RFH",), columns=()),
        fitted=skin,
        gains=None,
        held_out=HeldOut(there, 1e-9, False),
    )
    found = free_marker.find_free_marker(fit, ScoredCandidates([law], 100))
    assert (found is not None) is is_free
