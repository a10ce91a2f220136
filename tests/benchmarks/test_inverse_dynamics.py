"""CPU time of inverse dynamics beside OpenSim's, one run, one thread, and how far they differ."""

from __future__ import annotations

import time
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest

from scaling_service.model.builtin import load_builtin
from scaling_service.model.compile import list_parameter_values
from scaling_service.model.inertia import compile_mechanism
from scaling_service.numerics import wrench
from scaling_service.numerics.multibody.motion import Motion
from tests.capabilities.motion.test_inverse_dynamics import RECORDINGS, differences, opensims, recorded

pytestmark = pytest.mark.benchmark

ROUNDS = 5


@pytest.mark.skipif(find_spec("opensim") is None, reason="the opensim library is not installed")
@pytest.mark.parametrize("name", RECORDINGS)
def test_inverse_dynamics_beside_opensims(
    shared_data: Path, tmp_path: Path, name: str, capsys: pytest.CaptureFixture[str]
) -> None:
    path, model, ours, loads = recorded(shared_data, name)
    mechanism, p, rates = compile_mechanism(model), list_parameter_values(model), ours.motion.rates
    spent = (
        min(_seconds(lambda: wrench.compute_inverse_dynamics(mechanism, rates, p)) for _ in range(ROUNDS))
        / rates.n
    )
    theirs = opensims(path, model, ours, loads, tmp_path)
    worst = max(differences(model, ours, theirs).values())
    with capsys.disabled():
        print(  # noqa: T201
            f"\n{name}: ours {1e6 * spent:.1f} µs a frame; OpenSim's solver {1e6 * theirs.solver_s:.0f} "
            f"({theirs.solver_s / spent:.0f} times), its tool {1e6 * theirs.tool_s:.0f} "
            f"({theirs.tool_s / spent:.0f} times); largest difference {worst:.1e} of body weight"
        )
    assert theirs.solver_s > 10 * spent


def test_net_wrench_of_many_samples(capsys: pytest.CaptureFixture[str]) -> None:
    mechanism = compile_mechanism(load_builtin("full_body_35dof"))
    n = 60_000
    motion = Motion(*np.random.default_rng(0).uniform(-0.5, 0.5, (3, 35, n)))
    spent = (
        min(_seconds(lambda: wrench.compute_root_wrench(mechanism, motion, np.zeros(0))) for _ in range(3))
        / n
    )
    with capsys.disabled():
        print(f"\n35 degrees of freedom, net wrench: {1e6 * spent:.1f} µs a frame")  # noqa: T201
    assert spent < 10e-6


def _seconds(work) -> float:  # type: ignore[no-untyped-def]  # any function without arguments
    start = time.process_time()
    work()
    return time.process_time() - start
