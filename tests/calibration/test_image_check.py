"""Bones against the standing trial's markers: what people's palpation allows passes, other bones do not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from scaling_service.capabilities.scaling.methods.image_check import doubt_landmarks
from scaling_service.core.arrays import Array
from scaling_service.core.errors import SubjectInvalid
from scaling_service.model.body import Vector, to_vector
from scaling_service.model.trial import ImageEvidence, Trial
from tests.calibration.people import person


def stand() -> Trial:
    static = person(3, seconds=1.0).session.static
    assert static is not None
    return static


def image(trial: Trial, width: float, turn: bool = False) -> ImageEvidence:
    """The front spines as they stand, their distance times ``width``."""
    right, left = (np.nanmean(trial.position(name), axis=0) for name in ("RASIS", "LASIS"))
    middle, half = 0.5 * (right + left), 0.5 * width * (right - left)
    places = {"RASIS": middle + half, "LASIS": middle - half}
    if turn:
        places = {name: np.array([at[2], -at[0], -at[1]]) for name, at in places.items()}
    return ImageEvidence(landmarks={name: to_vector(at) for name, at in places.items()})


def test_spines_as_wide_as_their_markers_pass_wherever_the_image_lies() -> None:
    trial = stand()
    for width in (0.95, 1.0, 1.05):
        assert doubt_landmarks(image(trial, width), trial) == []
        assert doubt_landmarks(image(trial, width, turn=True), trial) == []
    assert doubt_landmarks(image(trial, 2.0), None) == []


def test_wider_spines_are_said_and_another_unit_is_refused() -> None:
    trial = stand()
    (said,) = doubt_landmarks(image(trial, 1.25), trial)
    assert "between the front spines" in said
    with pytest.raises(SubjectInvalid) as refusal:
        doubt_landmarks(image(trial, 2.0), trial)
    assert refusal.value.field == "bones.pelvis"


def test_a_landmark_that_the_image_leaves_open_is_not_held_against_it() -> None:
    trial = stand()
    poor = replace(image(trial, 1.25), deviations={"RASIS": 0.06, "LASIS": 0.06})
    assert doubt_landmarks(poor, trial) == []


def test_hips_above_their_spines_are_refused_and_far_ones_said() -> None:
    """A pelvis of Puchaud's mean person: 173 mm between the hips; upside down it is no person's."""
    spines = {"RASIS": (0.0, 0.0, 0.117), "LASIS": (0.0, 0.0, -0.117)}
    spines |= {"RPSIS": (-0.15, 0.0, 0.045), "LPSIS": (-0.15, 0.0, -0.045)}
    for turn in (np.eye(3), np.array([[0, 0, 1.0], [-1, 0, 0], [0, -1, 0]])):
        landmarks = {name: to_vector(turn @ np.array(at)) for name, at in spines.items()}

        def doubt(y: float, landmarks: dict[str, Vector] = landmarks, turn: Array = turn) -> list[str]:
            hips = {f"hip_{s}": to_vector(turn @ [-0.048, y, z]) for s, z in (("r", 0.0865), ("l", -0.0865))}
            return doubt_landmarks(ImageEvidence(landmarks=landmarks, centres=hips), None)

        assert doubt(-0.080) == []
        assert doubt(-0.095) == []
        assert len(doubt(-0.120)) == 2
        with pytest.raises(SubjectInvalid, match=r"right hip lies 1\d\d mm from where people's hips lie"):
            doubt(0.080)
