"""What the search starts from: recordings as measured, the calibration's freedom, a model that fits."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from scaling_service.capabilities.discovery.checks import (
    LARGEST_M,
    UNSCALED_M,
    check_fits,
    check_lengths,
    measure_typical_distance,
)
from scaling_service.capabilities.discovery.options import AS_MEASURED, DiscoverSettings
from scaling_service.capabilities.discovery.start import prepare
from scaling_service.capabilities.subject.loading import Loaded, open_subject
from scaling_service.core.errors import TrialUnusable
from scaling_service.model.builtin import load_builtin
from scaling_service.model.scaling import scale_model
from scaling_service.model.trial import Trial
from tests.jobs.hidden_case import session
from tests.jobs.laboratory import laboratory


def test_recordings_are_neither_smoothed_nor_filled(tmp_path: Path) -> None:
    loaded = open_subject(laboratory(tmp_path), AS_MEASURED)
    for trial in loaded.session.dynamic:
        assert not {r.what for r in trial.repairs} & {"smoothing", "gap_spline", "gap_solidification"}


def test_roles_follow_the_subject_file() -> None:
    prepared = prepare(Loaded(session=session()), DiscoverSettings(start="none"), AS_MEASURED)
    assert prepared.roles == {"static": "fit", "knee_r": "fit", "knee_l": "fit", "gait_1": "held_out"}
    assert any("no recording has forces" in note for note in prepared.notes)


def test_a_few_frames_are_refused_with_what_to_do() -> None:
    trial = session().evaluation[0]

    def first(n: int) -> Trial:
        return replace(trial, times=trial.times[:n], markers=trial.markers[:n])

    check_lengths([trial, first(6)])
    with pytest.raises(TrialUnusable, match=r"too few frames for a movement, 5: .* `static:`"):
        check_lengths([trial, first(5)])


def test_without_held_out_recordings_all_fit() -> None:
    only = replace(session(), calibration=())
    prepared = prepare(Loaded(session=only), DiscoverSettings(start="none"), AS_MEASURED)
    assert prepared.roles == {"static": "fit", "gait_1": "fit"}


def test_a_model_of_the_person_fits() -> None:
    whole = session()
    check_fits(whole.model, whole.dynamic, scaled=False)
    assert measure_typical_distance(whole.model, whole.dynamic[0]) < 0.002


def test_a_model_in_other_units_is_refused_first() -> None:
    """A model whose lengths are a thousandth: every marker is then a body's size away."""
    whole = session()
    small = scale_model(
        load_builtin("lower_limb_14dof"), dict.fromkeys(whole.model.segment_names, (1e-3,) * 3)
    )
    with pytest.raises(TrialUnusable, match="does not fit this recording at all") as caught:
        prepare(Loaded(session=replace(whole, model=small)), DiscoverSettings(start="none"), AS_MEASURED)
    assert caught.value.file == "knee_r"
    assert "units" in str(caught.value.remedy)


def test_a_model_of_another_size_is_refused_where_it_is_taken_as_it_is() -> None:
    """Twice the usual spread of stature: a model of a person, but not of this one."""
    whole = session()
    tall = scale_model(
        load_builtin("lower_limb_14dof"), dict.fromkeys(whole.model.segment_names, (1.15,) * 3)
    )
    assert UNSCALED_M < measure_typical_distance(tall, whole.dynamic[0]) < LARGEST_M
    for scaled_here, said in ((False, "does not have this person's size"), (True, "does not follow")):
        with pytest.raises(TrialUnusable, match=said):
            check_fits(tall, whole.dynamic, scaled=scaled_here)


def test_a_scaling_does_not_take_exchanged_labels_for_places_of_markers() -> None:
    """Two markers of the pelvis in each other's place for a third of the recording to fit."""
    whole = session()
    faulty = next(t for t in whole.calibration if t.name == "knee_r")
    pair = [faulty.index("RASIS"), faulty.index("LPSIS")]
    rows = slice(len(faulty.times) // 3, 2 * len(faulty.times) // 3)
    markers = faulty.markers.copy()
    markers[rows, pair] = markers[rows, pair[::-1]]
    trials = tuple(replace(t, markers=markers) if t is faulty else t for t in whole.calibration)
    settings = DiscoverSettings(start="MB_am")
    right, wrong = (
        prepare(Loaded(session=replace(whole, calibration=some)), settings, AS_MEASURED)
        for some in (whole.calibration, trials)
    )
    assert any("look exchanged" in note and "scaled without" in note for note in wrong.notes)
    for marker in right.model.markers:
        there = np.array(wrong.model.marker(marker.name).nominal)
        assert np.linalg.norm(there - np.array(marker.nominal)) < 0.004
    assert wrong.recordings[1].trial.markers[rows, pair] == pytest.approx(markers[rows, pair], nan_ok=True)
