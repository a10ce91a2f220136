"""Recordings that do not suit each other, the model or a scale set-up are refused by name."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from scaling_service.capabilities.subject.checks import (
    refuse_one_spot,
    refuse_repeated,
    require_landmarks,
)
from scaling_service.capabilities.subject.reading import hash_input_files, load_subject
from scaling_service.core.errors import InputError, MarkerMissing, SubjectInvalid, TrialUnusable
from scaling_service.model.subject import Measurement, ScaleSetup, Session, Subject
from scaling_service.model.trial import Trial
from scaling_service.recording.scale_setup import require_measurements
from tests.jobs.laboratory import document, known_person, laboratory, write_subject

SESSION = known_person(0.3).session
SETUP = Path("scale.xml")


def _without(session: Session, *labels: str) -> Session:
    def cut(trial: Trial) -> Trial:
        return trial.select([label for label in trial.labels if label not in labels])

    assert session.static is not None
    return replace(
        session,
        static=cut(session.static),
        calibration=tuple(map(cut, session.calibration)),
        evaluation=tuple(map(cut, session.evaluation)),
    )


@pytest.mark.parametrize("marker", ["RASIS", "LASIS", "RLFE", "LLFE", "RLM", "LLM"])
def test_a_landmark_that_is_missing_alone_has_another_name(marker: str) -> None:
    with pytest.raises(MarkerMissing) as caught:
        require_landmarks(_without(SESSION, marker))
    assert caught.value.marker == marker
    assert marker in str(caught.value)


def test_the_back_of_the_pelvis_needs_one_marker() -> None:
    with pytest.raises(MarkerMissing) as caught:
        require_landmarks(_without(SESSION, "RPSIS", "LPSIS"))
    assert caught.value.marker == "RPSIS"
    require_landmarks(_without(SESSION, "LPSIS"))


@pytest.mark.parametrize(
    "labels",
    [
        (),
        ("RMFE", "LMFE", "RMM", "LMM"),  # many laboratories mark the outer side only
        ("LLFE", "LMFE", "LFH", "LLM", "LMM"),  # one leg
        ("RASIS", "LASIS", "RPSIS", "LPSIS"),  # no pelvis
        ("RLM", "RMM", "LLM", "LMM"),  # thighs only
    ],
)
def test_what_was_not_marked_at_all_is_nobodys_mistake(labels: tuple[str, ...]) -> None:
    require_landmarks(_without(SESSION, *labels))


def test_the_sacrum_stands_for_both_posterior_spines() -> None:
    session = _without(SESSION, "RPSIS", "LPSIS")
    assert session.static is not None
    with pytest.raises(MarkerMissing):
        require_landmarks(session)
    static = session.static
    both = np.concatenate((static.markers, static.markers[:, :1]), axis=1)
    with_sacrum = Trial(
        name="static",
        times=static.times,
        labels=(*static.labels, "SACR"),
        markers=both,
        rate_hz=static.rate_hz,
    )
    require_landmarks(replace(session, static=with_sacrum))


def test_labels_that_mean_nothing_are_offered_first() -> None:
    session = _without(SESSION, "RASIS")
    assert session.static is not None
    session = replace(session, static=session.static.relabel({"LMM": "RightFront"}))
    with pytest.raises(MarkerMissing, match="it has RightFront, "):
        require_landmarks(session)


def test_a_recording_under_two_names_is_refused_also_in_another_format() -> None:
    trial = SESSION.calibration[0]
    rounded = trial.with_markers(np.round(trial.markers, 6))  # m: as a TRC file keeps them
    subject = Subject(id="S", model="m", calibration=(Path("a.c3d"),), evaluation=(Path("b.trc"),))
    with pytest.raises(SubjectInvalid) as caught:
        refuse_repeated({Path("a.c3d"): trial, Path("b.trc"): rounded}, subject)
    assert caught.value.field == "trials.evaluation.0"
    moved = trial.with_markers(trial.markers + 1e-3 * (np.arange(trial.n_frames) > 5)[:, None, None])
    refuse_repeated({Path("a.c3d"): trial, Path("b.trc"): moved}, subject)
    refuse_repeated({Path("a.c3d"): trial, Path("b.trc"): SESSION.evaluation[0]}, subject)


def test_two_labels_of_one_ball_are_refused() -> None:
    trial = SESSION.calibration[0]
    refuse_one_spot(SESSION.model, trial)
    markers = trial.markers.copy()
    markers[:, trial.index("RMFE")] = markers[:, trial.index("RLFE")] + 5e-4
    with pytest.raises(TrialUnusable, match="'RLFE' and 'RMFE' lie on one spot"):
        refuse_one_spot(SESSION.model, trial.with_markers(markers))


def _setup(
    pair: tuple[str, str] = ("RASIS", "LASIS"),
    axes: dict[str, str] | None = None,
    time_range: tuple[float, float] | None = None,
) -> ScaleSetup:
    measurement = Measurement("width", (pair,), axes or {"pelvis": "Z"})
    return ScaleSetup(
        measurements=(measurement,),
        manual={},
        order=("measurements",),
        time_range=time_range,
        preserve_mass_distribution=True,
        mass_kg=None,
        placement=None,
    )


@pytest.mark.parametrize(
    ("setup", "field", "problem"),
    [
        (_setup(("RASIS", "NOBODY")), "measurement width", "'NOBODY', which the model does not have"),
        (_setup(time_range=(7.0, 8.0)), "ModelScaler.time_range", "no frame between 7 and 8 s"),
        (_setup(("RASIS", "RMM")), "RASIS, RMM", "never seen together"),
        (_setup(("RASIS", "LMM")), "markers.LMM", "has no marker 'LMM'"),
    ],
)
def test_a_set_up_that_cannot_be_followed_is_refused(setup: ScaleSetup, field: str, problem: str) -> None:
    static = SESSION.static
    assert static is not None
    markers = static.markers.copy()
    markers[:, static.index("RMM")] = np.nan
    trial = static.with_markers(markers).select([n for n in static.labels if n != "LMM"])
    with pytest.raises(InputError, match=problem) as caught:
        list(require_measurements(setup, SESSION.model, trial, SETUP))
    assert caught.value.field == field
    assert caught.value.remedy


def test_a_set_up_for_segments_that_are_not_there_is_reported() -> None:
    assert SESSION.static is not None
    assert list(require_measurements(_setup(), SESSION.model, SESSION.static, SETUP)) == []
    (said,) = require_measurements(_setup(axes={"plevis": "Z"}), SESSION.model, SESSION.static, SETUP)
    assert "plevis" in str(said)


def test_a_time_range_between_two_frames_is_followed() -> None:
    static = SESSION.static
    assert static is not None
    between = (static.times[3] + 0.001, static.times[3] + 0.002)
    assert list(require_measurements(_setup(time_range=between), SESSION.model, static, SETUP)) == []


def test_a_link_keeps_its_own_name(tmp_path: Path) -> None:
    """Stores such as git-annex keep recordings under hashes, behind links with their names."""
    store = tmp_path / "store"
    store.mkdir()
    laboratory(tmp_path)
    (tmp_path / "walk.trc").rename(store / "MD5-0a1b.trc")
    (tmp_path / "walk.trc").symlink_to(store / "MD5-0a1b.trc")
    file = write_subject(tmp_path, document())
    subject = load_subject(file)
    assert [path.stem for path in subject.evaluation] == ["walk"]
    assert set(hash_input_files(subject, file)) == {"S01.yaml", "standing.trc", "hips.trc", "walk.trc"}
