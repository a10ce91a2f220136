"""The whole way of a recording, and its order."""

from __future__ import annotations

import numpy as np
import pytest

from scaling_service.core.errors import InputError
from scaling_service.model.trial import Trial
from scaling_service.recording.orientation import Orientation, decide
from scaling_service.recording.pipeline import process, smooth
from scaling_service.recording.settings import ProcessingSettings

LABELS = ("RASIS", "LASIS", "RPSIS", "LPSIS", "HEAD")
CLUSTERS = {"pelvis": LABELS[:4]}


def _walk(frames=200, noise=0.0):
    """A body walking along -y of a laboratory with z up."""
    t = np.arange(frames) / 100
    body = np.array(
        [[0.1, 0.95, 0.12], [0.1, 0.95, -0.12], [-0.1, 0.98, 0.05], [-0.1, 0.98, -0.05], [0.05, 1.7, 0]]
    )
    ours = body + np.stack((1.2 * t, 0.02 * np.sin(12 * t), 0.02 * np.sin(6 * t)), axis=1)[:, None]
    ours = ours + np.random.default_rng(0).normal(size=ours.shape) * noise
    lab = np.stack((-ours[..., 2], -ours[..., 0], ours[..., 1]), axis=-1)
    return Trial(name="walk", times=t, labels=LABELS, markers=lab, rate_hz=100.0), ours


def _axes(trial):
    return decide(trial, roles={label: label for label in LABELS[:4]})


def test_default_way_turns_smooths_and_fills():
    trial, ours = _walk()
    markers = trial.markers.copy()
    markers[60:70, 0] = np.nan
    markers[100:150, 1] = np.nan
    markers[180:, 4] = np.nan
    holed = trial.with_markers(markers)
    result = process(holed, _axes(trial), CLUSTERS)
    kinds = [r.what for r in result.repairs]
    assert kinds == ["up_axis", "forward_axis", "smoothing", "gap_spline", "gap_solidification", "gap_left"]
    assert np.isnan(result.markers[180:, 4]).all()
    # The low pass of 10 Hz leaves a bob of 1.9 Hz as it is; ends of runs stand on their mirror image.
    np.testing.assert_allclose(result.markers[:180], ours[:180], atol=1.5e-3)
    assert holed.repairs == ()


def test_solidification_can_be_left_out_and_smoothing_too():
    trial, ours = _walk()
    markers = trial.markers.copy()
    markers[100:150, 1] = np.nan
    settings = ProcessingSettings(smoothing="none", solidify=False)
    result = process(trial.with_markers(markers), _axes(trial), CLUSTERS, settings)
    assert np.isnan(result.markers[100:150, 1]).all()
    np.testing.assert_allclose(np.delete(result.markers, 1, 1), np.delete(ours, 1, 1), atol=1e-12)


@pytest.mark.parametrize("kind", ["automatic", "butterworth"])
def test_noise_falls_and_the_motion_stays(kind):
    trial, _ = _walk(noise=1e-3)
    _, clean = _walk()
    result = process(trial, _axes(trial), CLUSTERS, ProcessingSettings(smoothing=kind))
    inner = slice(20, -20)
    error = np.sqrt(((result.markers - clean)[inner] ** 2).mean())
    assert error < 0.6e-3  # m, from 1 mm


def test_markers_are_smoothed_by_time_where_the_rate_allows_it():
    for rate, expected in (
        (200.0, "smoothing"),
        (40.0, "smoothing"),
        (39.0, "not_smoothed"),
        (6.0, "not_smoothed"),
    ):
        times = np.arange(200) / rate
        swing = np.sin(2.0 * np.pi * 2.0 * times)[:, None, None] * np.ones(3)
        trial = Trial(name="walk", times=times, labels=("RASI",), markers=swing, rate_hz=rate)
        settings = ProcessingSettings(solidify=False)
        result = process(trial, Orientation(np.eye(3)), {}, settings)
        assert expected in [r.what for r in result.repairs]
        # At any rate the movement of 2 Hz stays: a low pass of 10 Hz passes 0.9984 of it.
        inner = slice(len(times) // 4, -len(times) // 4)
        np.testing.assert_allclose(result.markers[inner], swing[inner], atol=2e-3)


def test_a_gap_before_or_after_smoothing_does_not_bend_its_neighbours():
    trial, ours = _walk()
    straight = trial.with_markers(np.where(np.isfinite(trial.markers), trial.markers, 0))
    markers = straight.markers.copy()
    markers[80:120, 4] = np.nan
    whole, holed = smooth(straight, 10.0), smooth(straight.with_markers(markers), 10.0)
    np.testing.assert_array_equal(whole.markers[:, :4], holed.markers[:, :4])
    far = np.r_[0:40, 160:200]  # the filter's memory: four periods of the cutoff
    np.testing.assert_allclose(holed.markers[far], whole.markers[far], atol=1e-5)
    assert np.isfinite(ours).all()


def test_cutoff_is_checked_and_short_runs_are_named():
    trial, _ = _walk()
    with pytest.raises(InputError, match="cutoff") as caught:
        smooth(trial, 50.0)
    assert caught.value.field == "cutoff_hz"
    markers = trial.markers.copy()
    markers[4:8, 2] = np.nan
    result = smooth(trial.with_markers(markers), 6.0)
    assert [(r.what, r.where, r.frames) for r in result.repairs][1:] == [("not_smoothed", "RPSIS", 4)]


def test_one_frame_goes_through():
    trial, ours = _walk(frames=1)
    for kind in ("automatic", "butterworth", "none"):
        result = process(trial, _axes(trial), CLUSTERS, ProcessingSettings(smoothing=kind))
        np.testing.assert_allclose(result.markers, ours, atol=1e-12)


def test_real_recordings_go_through(shared_data):
    from scaling_service.files.recording import read_recording

    trial = read_recording(shared_data / "jia_mri/Walking01.c3d")
    roles = {"RASI": "RASIS", "LASI": "LASIS", "RPSI": "RPSIS", "LPSI": "LPSIS", "RANK": "RLM", "LANK": "LLM"}
    result = process(trial, decide(trial, roles=roles), {"pelvis": ("RASI", "LASI", "RPSI", "LPSI")})
    travel = result.position("RASI")[-1] - result.position("RASI")[0]
    assert travel[0] > 1.0  # m, forward
    assert abs(travel[2]) < 0.1
    assert (result.position("C7")[:, 1] > result.position("RANK")[:, 1]).all()
    assert (result.position("RASI")[:, 2] > result.position("LASI")[:, 2]).all()
    before, after = (int(np.isnan(t.markers).any(-1).sum()) for t in (trial, result))
    noted = sum(r.frames for r in result.repairs if r.what in ("gap_spline", "gap_solidification"))
    assert before - after == noted
