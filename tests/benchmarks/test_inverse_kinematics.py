"""Inverse kinematics against its peers: time beside the error reached.

Run with ``pytest -m benchmark -s tests/benchmarks``. One thread everywhere, CPU time of each process, all
in one run. Ours is a whole call with nothing kept from the one before. The peer that it must beat is
OpenSim's InverseKinematicsSolver: its loop over the frames, without loading, set-up and first assembly.
What markers do not show our motion takes from the joint's range; the solver has the same task.
OpenSim's InverseKinematicsTool, timed as a whole, is only shown beside it: it also follows its set-up's
coordinate tasks, where there are any, and ours has none. Of several rounds the least counts, ours and
the solver's alike, for other programs only add to it.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest

from scaling_service.files.osim.models import read_osim
from scaling_service.files.trc import read_trc
from tests.peers.ik_tasks import read_ik_tasks
from tests.peers.nimble_ik import interpreter, run_nimble_ik
from tests.peers.opensim_ik import run_opensim_ik, time_opensim_ik_tool
from tests.peers.scaled_models import scaled_gait2354, scaled_rajagopal
from tests.peers.worker import ask

pytestmark = [
    pytest.mark.benchmark,
    pytest.mark.skipif(find_spec("opensim") is None, reason="the opensim library is not installed"),
]

NO_WORSE = 1.001
ROUNDS = 3
NAMES = ("gait2354", "rajagopal_walk", "opencap_squat", "opencap_walk")
MOST_WALK_S = 12e-3

FIXED_COST = (
    "Some 13 steps of about 200 NumPy calls each, whatever the number of frames: seven for the 18 that "
    "begin, five for all, one made again. Sweeps compiled by numba, kinematics included (400 lines), give "
    "the same motion to 3e-15 rad and take 4.7 ms instead of 28, the whole call 19 instead of 42.5: 14 are "
    "outside of the sweeps (what frames determine, ranges, other ways to write angles, the first guess). To "
    "start from numba's cache takes 0.4 s of CPU in every process, to compile 15 s."
)
STARTED_ANEW = (
    "The markers of its trunk are farther off than skin moves in 28 of 31 coarse frames, and whether other "
    "starts are better is asked: 38 ms for 151 frames, 12 times the solver (3.0 ms per frame)."
)
SHORT = (
    "Measured at 238 frames: 146 to 166 us per frame, 150 to 185 times the solver. Beside the sweeps stand "
    "what holds the forearm, which no marker shows, and a look at whether other starts are better."
)


@dataclass(frozen=True)
class Case:
    """A model, a recording and the tasks of its set-up."""

    name: str
    model: Path
    recording: Path
    markers: Mapping[str, float]
    coordinates: Mapping[str, float]

    @property
    def weights(self) -> dict[str, float]:
        """A weight for every marker of the model, zero for those without a task."""
        return {m.name: self.markers.get(m.name, 0.0) for m in read_osim(self.model).markers}


@dataclass(frozen=True)
class Reached:
    """CPU time per frame (s), what was used, the markers' error (m), its weighted sum of squares (m2)."""

    s_per_frame: float
    coordinates: int
    markers: frozenset[str]
    rms: float
    weighted: float
    held: Mapping[str, float]  # weight of each coordinate's range beside the markers

    def __str__(self) -> str:
        time, error = 1e6 * self.s_per_frame, 1e3 * self.rms
        return f"{self.coordinates:>7}{time:>10.1f}{error:>8.2f}{self.weighted:>10.4f}"


@dataclass(frozen=True)
class Row:
    """One case: ours, OpenSim's solver, and the CPU time per frame of OpenSim's tool (s)."""

    frames: int
    ours: Reached
    solver: Reached
    tool_s: float

    @property
    def ratio(self) -> float:
        """How many times faster ours is than the solver."""
        return self.solver.s_per_frame / self.ours.s_per_frame


@pytest.fixture(scope="module")
def cases(shared_data: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Case]:
    gait, walk, squat = (shared_data / n for n in ("gait2354", "rajagopal_walk", "opencap_squat"))
    scratch, hand_scaled = tmp_path_factory.mktemp("scaled"), squat / "manually_scaled.osim"
    tasks = read_ik_tasks(gait / "subject01_Setup_IK.xml")
    walk_tasks = read_ik_tasks(walk / "ik_setup_walk.xml")
    every = {m.name: m.weight for m in read_osim(hand_scaled).markers}
    found = (
        Case(NAMES[0], scaled_gait2354(shared_data, scratch), gait / "subject01_walk1.trc", *tasks),
        Case(NAMES[1], scaled_rajagopal(shared_data, scratch), walk / "motion_capture_walk.trc", *walk_tasks),
        Case(NAMES[2], hand_scaled, squat / "squats1.trc", every, {}),
        Case(NAMES[3], hand_scaled, squat / "walking1.trc", every, {}),
    )
    return {case.name: case for case in found}


@pytest.fixture(scope="module")
def rows(cases: Mapping[str, Case]) -> dict[str, Row]:
    """Every case measured once; the table goes to the terminal."""
    found = {name: measured(case) for name, case in cases.items()}
    reached = f"{'coord.':>7}{'us/frame':>10}{'RMS mm':>8}{'w. m2':>10}"
    head = (
        f"\n{'':<34}{'ours':<35}{'the solver':<43}the tool\n"
        f"{'':<15}{'frames':>7}{'markers':>8}{reached}{reached}{'ratio':>8}{'us/frame':>10}{'ratio':>8}\n"
    )
    sys.stdout.write(head + "".join(line(name, row) for name, row in found.items()))
    return found


def line(name: str, row: Row) -> str:
    tool = f"{1e6 * row.tool_s:>10.1f}{row.tool_s / row.ours.s_per_frame:>8.0f}"
    counts = f"{row.frames:>7}{len(row.ours.markers):>8}"
    return f"{name:<15}{counts}{row.ours}{row.solver}{row.ratio:>8.0f}{tool}\n"


def measured(case: Case) -> Row:
    times = read_trc(case.recording).times
    span = (float(times[0]), float(times[-1]))
    mine = [ours(case) for _ in range(ROUNDS)]
    rounds = [(one, solver(case, span, one.held)) for one in mine]
    mine, theirs = (min(reached, key=lambda one: one.s_per_frame) for reached in zip(*rounds, strict=True))
    tool_s = time_opensim_ik_tool(case.model, case.recording, case.markers, case.coordinates, time_range=span)
    return Row(len(times), mine, theirs, tool_s)


def ours(case: Case) -> Reached:
    """The least CPU time of 15 calls in one process."""
    found = ask(
        "tests.benchmarks.motion_worker",
        {"model": str(case.model), "trc": str(case.recording), "weights": case.weights, "repeats": 15},
    )
    return Reached(
        found["s_per_frame"],
        found["coordinates"],
        frozenset(found["markers"]),
        found["rms"],
        found["weighted"],
        found["held"],
    )


def solver(case: Case, span: tuple[float, float], held: Mapping[str, float]) -> Reached:
    peer = run_opensim_ik(case.model, case.recording, case.markers, held, time_range=span)
    rms = float(np.sqrt(np.nanmean(peer.squared_errors)))
    weighted = float(peer.weighted_squared_errors.sum())
    used = frozenset(peer.markers)
    return Reached(float(peer.cpu_s.mean()), len(peer.coordinates), used, rms, weighted, held)


@pytest.mark.parametrize("name", NAMES)
def test_the_error_is_no_worse_than_that_of_opensims_solver(rows: Mapping[str, Row], name: str) -> None:
    row = rows[name]
    assert row.ours.markers == row.solver.markers
    assert row.ours.weighted <= NO_WORSE * row.solver.weighted


@pytest.mark.parametrize(
    ("name", "at_least"),
    [
        pytest.param(
            "gait2354",
            100.0,
            marks=pytest.mark.xfail(reason=STARTED_ANEW, raises=AssertionError, strict=True),
        ),
        pytest.param(
            "rajagopal_walk",
            200.0,
            marks=pytest.mark.xfail(reason=SHORT, raises=AssertionError, strict=True),
        ),
        ("opencap_squat", 200.0),
    ],
)
def test_it_is_many_times_faster_than_opensims_solver(
    rows: Mapping[str, Row], name: str, at_least: float
) -> None:
    assert rows[name].ratio >= at_least


@pytest.mark.xfail(reason=FIXED_COST, raises=AssertionError, strict=True)
def test_a_walk_of_131_frames_takes_little(rows: Mapping[str, Row]) -> None:
    walk = rows["opencap_walk"]
    assert walk.frames * walk.ours.s_per_frame <= MOST_WALK_S


@pytest.mark.skipif(interpreter() is None, reason="SCALING_SERVICE_NIMBLE names no interpreter")
def test_it_is_many_times_faster_than_nimblephysics(cases: Mapping[str, Case]) -> None:
    python, case = interpreter(), cases["rajagopal_walk"]
    assert python is not None
    trial = read_trc(case.recording)
    seen = {name: weight for name, weight in case.markers.items() if name in trial.labels}
    mine = ours(case)
    peer = run_nimble_ik(python, case.model, trial.labels, trial.markers, seen)
    weights = np.array([seen[name] for name in peer.markers])
    theirs = float(np.nansum(weights * peer.squared_errors))
    ratio = float(peer.cpu_s.mean()) / mine.s_per_frame
    sys.stdout.write(
        f"\n{case.name}: ours {1e6 * mine.s_per_frame:.1f} us per frame, "
        f"weighted error {mine.weighted:.4f} m2; "
        f"nimblephysics {1e3 * peer.cpu_s.mean():.2f} ms per frame, {theirs:.4f} m2; ratio {ratio:.0f}\n"
    )
    assert set(peer.markers) == mine.markers
    assert mine.weighted <= NO_WORSE * theirs
    assert ratio >= 30.0
