"""Muller's whole study of one person: a minute at 100 Hz, 5 levels of 1,000 samples, 1,000 of the plates."""

from __future__ import annotations

import resource
import time

import numpy as np
import pytest

from scaling_service.capabilities.dynamics.uncertainty.total import propagate
from scaling_service.studies.muller2017.excitation import ExcitationSettings, make_excited_person
from scaling_service.studies.muller2017.monte_carlo import UncertaintySettings, propagate_by_samples

SECONDS, GIBIBYTES = 150.0, 2.0


@pytest.mark.benchmark
def test_one_person_takes_two_minutes_of_one_core() -> None:
    recording = make_excited_person(1, ExcitationSettings(), ("in_order",)).performances["in_order"].recording
    clock = time.process_time()
    found = propagate_by_samples(recording, UncertaintySettings())
    cpu = time.process_time() - clock
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20  # of kB
    clock = time.process_time()
    linear = propagate(recording)
    took = time.process_time() - clock
    ratio = linear.slopes_per_cm / found.slopes_per_cm
    print(  # noqa: T201 (a benchmark's figures)
        f"\nMonte Carlo {cpu:.1f} s of CPU, {peak:.2f} GiB; "
        f"R2 {found.r2.min():.3f} to {found.r2.max():.3f}; linear {took:.2f} s of CPU, "
        f"its slopes over the sampled {np.round(ratio, 3)}"
    )
    assert peak <= GIBIBYTES
    np.testing.assert_allclose(ratio, 1.0, rtol=0.1)
    assert cpu <= SECONDS
