"""What faulty instruments leave untold, as their own readings show, and what rests on the unexplained."""

from __future__ import annotations

from dataclasses import replace
from typing import cast

import numpy as np
import pytest

from scaling_service.capabilities.discovery.evidence.fit import SearchTrial
from scaling_service.capabilities.discovery.laws.scene import Scene
from scaling_service.capabilities.discovery.observations.wrench import ContactAssignment
from scaling_service.capabilities.discovery.options import AS_MEASURED, DiscoverSettings
from scaling_service.capabilities.discovery.search.body import DRIFTS
from scaling_service.capabilities.discovery.search.discover import Discovery, discover
from scaling_service.capabilities.discovery.start import Prepared, leave_out_untold, prepare
from scaling_service.capabilities.subject.loading import open_subject
from scaling_service.core.names import say_name
from scaling_service.model.anatomy.lengths import find_segment
from scaling_service.model.trial import Repair
from tests.discovery.hidden import hide, person, recorded
from tests.jobs.force_laboratory import force_laboratory


@pytest.fixture(scope="module")
def laboratory(tmp_path_factory: pytest.TempPathFactory) -> Prepared:
    """Two recordings on two plates."""
    file = force_laboratory(tmp_path_factory.mktemp("forces"))
    return prepare(open_subject(file, AS_MEASURED), DiscoverSettings(start="none"), AS_MEASURED)


@pytest.fixture(scope="module")
def recordings(laboratory: Prepared) -> tuple[SearchTrial, ...]:
    return laboratory.recordings


def contacts(recording: SearchTrial) -> ContactAssignment:
    return cast("ContactAssignment", recording.contacts)


def test_sound_instruments_leave_all_as_it_is(recordings: tuple[SearchTrial, ...]) -> None:
    assert leave_out_untold(recordings) == (recordings, ())
    assert all(contacts(r).usable.any() for r in recordings)


@pytest.mark.parametrize("what", ["dead_channel", "saturated"])
def test_a_plate_at_fault_in_one_recording_is_so_in_all(
    recordings: tuple[SearchTrial, ...], what: str
) -> None:
    ground = contacts(recordings[0]).ground
    plate = ground.plates[0]
    faulty = ground.change(Repair(what, f"{plate} fz", ""))
    first = replace(recordings[0], contacts=replace(contacts(recordings[0]), ground=faulty))
    kept, (note,) = leave_out_untold((first, *recordings[1:]))
    assert note == f"{say_name(plate)}: what it bears is known in no recording, and was not compared"
    for before, after in zip(recordings, kept, strict=True):
        bears = contacts(before).ground.in_contact()[:, 0]
        assert (contacts(after).usable == contacts(before).usable & ~bears).all()
        assert not any(step.plate == plate for step in contacts(after).steps)


@pytest.mark.costly  # all else of both recordings is a rival
def test_a_plate_that_needs_another_gain_in_every_recording_has_none(laboratory: Prepared) -> None:
    made = []
    for r, factor in zip(laboratory.recordings, (1.15, 0.9), strict=True):
        ground, gain = contacts(r).ground, np.array([factor, 1.0])[:, None]
        ground = replace(ground, force=gain * ground.force, moment=gain * ground.moment)
        made.append(replace(r, contacts=replace(contacts(r), ground=ground)))
    findings = discover(laboratory.model, made)
    assert not findings.named
    (place,) = findings.unexplained
    assert place.where == ["plate_1"]
    assert place.law == "most like plate gain, but " + DRIFTS.partition("but ")[2]


def offset(*unsteady: str) -> Discovery:
    """What is found of a marker 28 mm off in one recording, the cameras being unsteady in some."""
    _, truth = hide("marker_offset", "RFH", numbers=(20.0, 0.0, 20.0))
    made = []
    for before, after in zip(recorded(person(), person().model), recorded(person(), truth), strict=True):
        trial = (after if before.trial.name == "gait_1" else before).trial
        shaken = Repair("shaking", "all markers", "tremble", off=1e-3)
        repairs = [shaken] if trial.name in unsteady else []
        made.append(SearchTrial(trial.with_markers(trial.markers, *repairs), before.role))
    return discover(person().model, made)


def test_cameras_at_fault_in_one_recording_tell_of_no_marker_in_any() -> None:
    assert [one.effect.candidate.where for one in offset().named] == [("RFH",)]
    findings = offset("gait_2")
    assert not findings.named
    (place,) = findings.unexplained
    assert place.where == ["markers"]
    assert place.law is not None
    assert place.law.startswith("in gait_2 they tremble; of the body and the forces nothing is told")


def test_what_markers_do_bears_on_segments_beside_theirs() -> None:
    scene = Scene(model=person().model, markers=("RFH",), moving=(), trials=(), plates=())
    shank, thigh, foot = (find_segment(person().model, role, "r") for role in ("tibia", "femur", "foot"))
    joints = {s.name: s.joint_name for s in person().model.segments}
    assert shank is not None
    assert scene.list_bearing(["RFH"]) == {shank, joints[shank]}
    beside = {name for name in (shank, thigh, foot) if name is not None}
    assert scene.list_bearing(["RFH"], beside=True) == beside | {joints[name] for name in beside}
