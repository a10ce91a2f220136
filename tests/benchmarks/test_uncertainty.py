"""Muller's whole study of one person: a minute at 100 Hz, 5 levels of 1,000 samples, 1,000 of the plates."""

from __future__ import annotations

import resource
import time

import numpy as np
import pytest

from scaling_service.capabilities.cohort.executors import workers
from scaling_service.capabilities.dynamics.uncertainty.total import propagate
from scaling_service.studies.muller2017.excitation import ExcitationSettings, make_excited_person
from scaling_service.studies.muller2017.monte_carlo import UncertaintySettings, propagate_by_samples

SECONDS, GIBIBYTES = 60.0, 2.0


@pytest.mark.benchmark
def test_one_person_takes_a_minute() -> None:
    recording = make_excited_person(1, ExcitationSettings(), ("in_order",)).performances["in_order"].recording
    clock = time.perf_counter()
    with workers(2) as executor:
        found = propagate_by_samples(recording, UncertaintySettings(), executor=executor)
    wall = time.perf_counter() - clock
    used = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    peak = (used[0].ru_maxrss + 2 * used[1].ru_maxrss) / 2**20  # kB; the largest child's counts for both
    cpu = used[1].ru_utime + used[1].ru_stime
    clock = time.process_time()
    linear = propagate(recording)
    took = time.process_time() - clock
    ratio = linear.slopes_per_cm / found.slopes_per_cm
    print(  # noqa: T201 (a benchmark's figures)
        f"\nMonte Carlo {wall:.1f} s wall, {cpu:.1f} s of workers' CPU, {peak:.2f} GiB; "
        f"R2 {found.r2.min():.3f} to {found.r2.max():.3f}; linear {took:.2f} s of CPU, "
        f"its slopes over the sampled {np.round(ratio, 3)}"
    )
    assert peak <= GIBIBYTES
    np.testing.assert_allclose(ratio, 1.0, rtol=0.1)
    assert wall <= SECONDS
