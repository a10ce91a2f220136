"""How far off another method's coordinates are, from the posterior, beside closed forms."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from scaling_service.capabilities.motion.run import track
from scaling_service.capabilities.scaling.departures import state_departures
from scaling_service.capabilities.scaling.run import run
from scaling_service.capabilities.subject.loading import Loaded
from scaling_service.model.document import from_document, to_document
from scaling_service.studies.benchmark.persons import draw_person
from tests.oracle.coverage import record


def test_a_method_is_as_far_off_as_the_posterior_has_it_and_its_model_says_so() -> None:
    session = record(draw_person(3))
    results = run(Loaded(session=session), ("MB", "MAP"))
    plain, posterior = (results.scalings[name] for name in ("MB", "MAP"))
    model = plain.calibration.model
    assert from_document(to_document(model)) == model
    departures = dict(model.departures)
    name = "hip_rotation_r"
    k = list(model.coordinate_names).index(name)
    squares = [
        np.mean(
            (motion.q[:, k] - posterior.motions[trial].q[:, k]) ** 2 + posterior.deviations[trial][:, k] ** 2
        )
        for trial, motion in plain.motions.items()
    ]
    assert departures[name] == pytest.approx(np.sqrt(np.mean(squares)))
    assert plain.angle_sds["walk"][name] == pytest.approx(np.sqrt(squares[list(plain.motions).index("walk")]))

    size, known = (s.calibration.sizes["femur_r"] for s in (plain, posterior))
    length, mean = (s.geometry.lengths["femur_r"] for s in (plain, posterior))
    assert size.sd * length == pytest.approx(np.hypot(length - mean, known.sd * mean))

    trial = session.evaluation[0]
    without = replace(model, departures=())
    stated, sandwich = (track(m, trial, angles=True) for m in (model, without))
    square = sandwich.uncertainty.sd[:, k] ** 2
    more = np.maximum(square - np.nanmedian(square), 0.0)
    np.testing.assert_allclose(stated.uncertainty.sd[:, k], np.sqrt(departures[name] ** 2 + more))
    assert stated.angles is not None
    assert sandwich.angles is not None
    both = [np.nanmean(tracked.angles.sd["r"]["hip_internal_rotation"]) for tracked in (stated, sandwich)]
    # What is made of coordinates has the deviation, too
    assert bool(both[0] > both[1]) is bool(departures[name] ** 2 > np.nanmedian(square))


def test_without_a_posterior_nothing_is_added() -> None:
    results = run(Loaded(session=record(draw_person(3))), ("MB",))
    assert state_departures(results.scalings) == results.scalings
    assert not results.scalings["MB"].calibration.model.departures
