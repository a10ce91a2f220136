"""A cohort without files: the same numbers in any process, and nobody's failure is anybody else's."""

from __future__ import annotations

import threading
import time
from collections.abc import Mapping
from concurrent.futures import Future, ProcessPoolExecutor, ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from multiprocessing import get_context
from os import _exit

import numpy as np
import pytest

from scaling_service.capabilities.cohort.executors import report_stage, workers
from scaling_service.capabilities.cohort.outcomes import (
    Done,
    NothingPossible,
    Outcome,
    run_members,
    select_possible_methods,
)
from scaling_service.capabilities.cohort.result import StatisticsDocument
from scaling_service.capabilities.cohort.run import BatchResult, summarise_cohort
from scaling_service.capabilities.cohort.saving import tabulate_outcomes
from scaling_service.capabilities.cohort.summary import TRUTH, MethodSummary, SubjectSummary, summarise
from scaling_service.capabilities.scaling.run import run
from scaling_service.capabilities.subject.loading import Loaded
from scaling_service.core.errors import InputError, SubjectInvalid
from scaling_service.core.threads import Serial
from scaling_service.model.anatomy.lengths import measure_segment_lengths
from scaling_service.model.subject import Subject
from scaling_service.studies.puchaud2019.run import VirtualPerson
from scaling_service.virtual.subject import VirtualSettings, make_virtual_subject
from tests.calibration.people import imaged, person

SHORT = VirtualSettings(functional_s=3.0, gait_trials=1)
METHODS = ("MB", "MB_am")


@dataclass(frozen=True)
class Told:
    """An item that ends as it is told to."""

    name: str
    how: str = "done"
    groups: Mapping[str, str] = field(default_factory=dict)
    shown: str = ""

    def work(self, *_: object) -> Done:
        if self.how == "refused":
            raise InputError("the knee is missing", file="S.yaml", field="knee", remedy="Find it")
        if self.how == "impossible":
            raise NothingPossible("EB: no bones")
        if self.how == "defect":
            raise ZeroDivisionError("by zero")
        if self.how == "crash":
            _exit(3)
        if self.how == "interrupt":
            raise KeyboardInterrupt
        length = 0.4 + 0.01 * len(self.name)
        return Done(
            SubjectSummary(
                subject=self.name, methods={m: MethodSummary(lengths={"femur_r": length}) for m in METHODS}
            )
        )


def run_cohort(members, executor, methods, **watched) -> BatchResult:
    outcomes = run_members(members, executor, methods, **watched)
    return summarise_cohort(outcomes, methods, cohort="people", started=time.perf_counter())


def _numbers(found):
    return [(o.name, o.status) for o in found.outcomes], found.document.statistics


@pytest.fixture(scope="module")
def people():
    return [VirtualPerson(seed=seed, settings=SHORT, groups={"site": "north"}) for seed in (3, 1, 2)]


@pytest.fixture(scope="module")
def alone(people):
    return run_cohort(people, Serial(), METHODS)


def test_virtual_people_are_measured_against_the_truth(people, alone):
    assert [o.status for o in alone.outcomes] == ["done"] * 3
    assert [o.groups for o in alone.outcomes] == [{"site": "north"}] * 3
    assert [s.id for s in alone.document.subjects] == ["virtual_3", "virtual_1", "virtual_2"]
    truth = measure_segment_lengths(make_virtual_subject(1, SHORT).model)
    summary = alone.outcomes[1].summary
    assert summary is not None
    assert summary.true_lengths == truth
    found = {(a.quantity, a.method): a for a in alone.document.statistics.agreement}
    gaps = [
        s.methods["MB"].lengths["femur_l"] - s.true_lengths["femur_l"]
        for s in (o.summary for o in alone.outcomes)
    ]
    assert found["femur_l", "MB"].bias_mm.value == pytest.approx(1e3 * np.mean(gaps), abs=1e-4)
    centre = summary.centres[TRUTH]["MB_am"]["hip_r"]
    true = summary.centres[TRUTH][TRUTH]["hip_r"]
    # The mean place is no further from the truth than the mean distance of the places.
    assert np.linalg.norm(np.subtract(centre, true)) < 2 * summary.methods["MB_am"].from_truth_m["hip_centre"]
    assert summary.strides["r"] >= 1
    assert set(summary.methods["MB"].curves) == set(summary.methods["MB_am"].curves)
    assert summary.methods["MB"].marker_shifts == {}
    assert len(summary.methods["MB_am"].marker_shifts) == 14


def test_the_table_of_angles_has_every_curve_in_degrees(alone):
    rows = tabulate_outcomes("angles.csv", alone.outcomes).to_frame().to_dict("records")
    assert len(rows) == 3 * 2 * 8
    row = next(r for r in rows if (r["subject"], r["method"]) == ("virtual_1", "MB_am"))
    curve = alone.outcomes[1].summary.methods["MB_am"].curves[row["coordinate"]]
    assert [float(row[f"deg_at_{k}_percent"]) for k in (0, 50, 100)] == pytest.approx(
        np.degrees([curve[k] for k in (0, 50, 100)]), abs=1e-4
    )
    lengths = tabulate_outcomes("lengths.csv", alone.outcomes).to_frame().to_dict("records")
    assert {r["method"] for r in lengths} == {*METHODS, TRUTH}


def test_the_document_is_in_mm_and_degrees_and_is_json(alone):
    document = alone.document.statistics
    assert StatisticsDocument.model_validate_json(document.model_dump_json()) == document
    methods = [o.summary.methods["MB_am"] for o in alone.outcomes]
    axis = np.mean([method.knee_axes["r"][0] for method in methods])
    assert document.quantity("knee_axis_deg", "r_x").mean["MB_am"] == pytest.approx(
        np.degrees(axis), abs=1e-4
    )
    written = document.joint_angles[0]
    curve = np.mean([method.curves[written.coordinate] for method in methods], axis=0)
    np.testing.assert_allclose(written.mean_deg["MB_am"], np.degrees(curve), atol=1e-4)
    agreed = {(a.quantity, a.method): a for a in document.agreement}
    assert agreed["hip_r.z", "MB"].icc_agreement is not None
    # An ankle lies on the y axis of every true shank: its x does not vary, and no correlation is told.
    assert agreed["ankle_r.x", "MB"].icc_agreement is None
    assert agreed["ankle_r.x", "MB"].rmse_mm > 0.0
    # Three subjects cannot reach 5 %: said, not hidden.
    assert not written.pairs
    assert document.opensim_limits.meaning == "necessary, not sufficient"


def test_other_processes_threads_and_orders_give_the_same_numbers(people, alone):
    stages: list[tuple[str, str, float]] = []
    ended: list[str] = []
    with workers(2, lambda *stage: stages.append(stage)) as executor:
        spread = run_cohort(people, executor, METHODS, finished=lambda o: ended.append(o.name))
    assert _numbers(spread) == _numbers(alone)
    assert sorted(ended) == ["virtual_1", "virtual_2", "virtual_3"]
    assert {name for name, *_ in stages} == set(ended)
    assert all(0.0 <= share <= 1.0 for *_, share in stages)
    with ThreadPoolExecutor(2) as executor:
        turned = run_cohort(people[::-1], executor, METHODS)
    assert _numbers(turned)[1:] == _numbers(alone)[1:]


def test_every_end_has_its_reason_and_stops_nobody():
    ways = ["done", "refused", "impossible", "defect", "done"]
    items = [Told(f"S{k}{'x' * k}", how) for k, how in enumerate(ways)]
    seen: list[Outcome] = []
    found = run_cohort(items, Serial(), METHODS, finished=seen.append)
    assert [o.status for o in found.outcomes] == ["done", "failed", "skipped", "failed", "done"]
    assert list(found.outcomes) == seen
    assert found.outcomes[1].reason == "S.yaml, knee: the knee is missing. Find it"
    assert found.outcomes[2].reason == "EB: no bones"
    assert "defect" in found.outcomes[3].reason
    assert "ZeroDivisionError" in found.outcomes[3].reason
    length = found.document.statistics.quantity("segment_lengths_mm", "femur_r")
    assert length.compared.subjects == ["S0", "S4xxxx"]
    assert length.mean["MB"] == pytest.approx(440.0)


def test_a_worker_that_dies_is_reported():
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as executor:
        found = run_cohort([Told("S1", "crash")], executor, METHODS)
    assert found.outcomes[0].status == "failed"
    assert "worker process ended abruptly" in found.outcomes[0].reason


def test_an_interruption_leaves_at_once_and_counts_what_ended():
    seen: list[str] = []
    items = [Told("S1"), Told("S2", "interrupt"), Told("S3")]
    with pytest.raises(KeyboardInterrupt):
        run_cohort(items, Serial(), METHODS, finished=lambda o: seen.append(o.name))
    assert seen == ["S1"]


def test_a_batch_that_stops_stops_its_workers():
    """Tasks under way hear of it at their next word, so leaving the block does not wait for their end."""
    begun = threading.Event()
    kept: list[Future[None]] = []
    with pytest.raises(KeyboardInterrupt):
        _interrupted(begun, kept)
    assert isinstance(kept[0].exception(), KeyboardInterrupt)


def _interrupted(begun: threading.Event, kept: list[Future[None]]) -> None:
    with workers(2, lambda *_: begun.set()) as executor:
        kept.append(executor.submit(_talk_for_ever))
        assert begun.wait(60)
        raise KeyboardInterrupt


def _talk_for_ever() -> None:
    while True:
        report_stage("S1", "talking", 0.5)


def test_an_unknown_method_is_refused_before_any_work():
    with pytest.raises(SubjectInvalid, match="no method 'XB'"):
        run_cohort([Told("S1", "crash")], Serial(), ["MB", "XB"])


def test_methods_are_possible_with_what_there_is(tmp_path):
    bare = Subject(id="S", model="lower_limb_14dof")
    assert select_possible_methods(bare)[0] == ("MB", "MAP")
    assert select_possible_methods(bare)[1]["EB_am"] == "no bones"
    moved = replace(bare, calibration=(tmp_path / "hips.trc",))
    assert select_possible_methods(moved, ["MB_am", "EB"]) == (("MB_am",), {"EB": "no bones"})
    whole = replace(moved, bones={"pelvis": tmp_path / "pelvis.stl"})
    assert select_possible_methods(whole)[1] == {}
    assert select_possible_methods(replace(whole, model=str(tmp_path / "m.osim")))[1] == {}
    assert "built-in" in select_possible_methods(replace(whole, model=str(tmp_path / "m.json")))[1]["EB"]


def test_a_leg_that_was_not_imaged_has_no_image_based_length():
    someone = person(2, seconds=1.0)
    session = replace(someone.session, images=imaged(someone, {"knee_r": (0.0, 0.0, 0.0)}, sides="r"))
    summary = summarise(run(Loaded(session=session), ["MB", "EB"]))
    assert set(summary.methods["MB"].lengths) == {"inter_hip", "femur_r", "shank_r", "femur_l", "shank_l"}
    assert set(summary.methods["EB"].lengths) == {"femur_r", "shank_r"}
    assert set(summary.methods["EB"].knee_axes) == {"r"}
    assert set(summary.centres["EB"]["MB"]) == {"hip_r", "knee_r", "ankle_r"}
    true = measure_segment_lengths(someone.truth)
    assert summary.methods["EB"].lengths["femur_r"] == pytest.approx(true["femur_r"], abs=1e-6)


def test_what_an_image_shows_counts_where_the_leg_is_not_whole():
    someone = person(2, seconds=1.0)
    whole = imaged(someone, {"knee_r": (0.0, 0.0, 0.0)}, sides="r")
    centres = {name: at for name, at in whole.centres.items() if name != "ankle_r"}
    summary = summarise(
        run(Loaded(session=replace(someone.session, images=replace(whole, centres=centres))), ["MB", "EB"])
    )
    assert set(summary.methods["EB"].lengths) == {"femur_r"}
    assert set(summary.methods["EB"].knee_axes) == {"r"}
    assert set(summary.centres["EB"]["MB"]) == {"hip_r", "knee_r"}
