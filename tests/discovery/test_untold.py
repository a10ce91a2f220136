"""Forces that faulty instruments leave untold, as their own readings show."""

from __future__ import annotations

from dataclasses import replace
from typing import cast

import pytest

from scaling_service.capabilities.discovery.evidence.fit import SearchTrial
from scaling_service.capabilities.discovery.observations.wrench import ContactAssignment
from scaling_service.capabilities.discovery.options import AS_MEASURED, DiscoverSettings
from scaling_service.capabilities.discovery.start import leave_out_untold, prepare
from scaling_service.capabilities.subject.loading import open_subject
from scaling_service.model.trial import Repair
from tests.jobs.force_laboratory import force_laboratory


@pytest.fixture(scope="module")
def recordings(tmp_path_factory: pytest.TempPathFactory) -> tuple[SearchTrial, ...]:
    """Some with forces; which plate bears what does not matter."""
    file = force_laboratory(tmp_path_factory.mktemp("forces"))
    found = prepare(open_subject(file, AS_MEASURED), DiscoverSettings(start="none"), AS_MEASURED).recordings
    return tuple(r for r in found if r.contacts is not None)


def contacts(recording: SearchTrial) -> ContactAssignment:
    return cast("ContactAssignment", recording.contacts)


def test_sound_instruments_leave_all_as_it_is(recordings: tuple[SearchTrial, ...]) -> None:
    assert leave_out_untold(recordings) == (recordings, ())
    assert all(contacts(r).usable.any() for r in recordings)


@pytest.mark.parametrize("what", ["shaking", "uneven"])
def test_cameras_that_are_unsteady_in_one_recording_leave_no_forces(
    recordings: tuple[SearchTrial, ...], what: str
) -> None:
    first = recordings[0].trial
    repair = Repair(what=what, where="all markers", detail="")
    unsteady = replace(recordings[0], trial=first.with_markers(first.markers, repair))
    kept, (note,) = leave_out_untold((unsteady, *recordings[1:]))
    assert not any(contacts(r).usable.any() or contacts(r).steps for r in kept)
    assert note == f"{first.name}: the cameras tell no accelerations, so no forces were compared"


@pytest.mark.parametrize("what", ["dead_channel", "saturated"])
def test_a_plate_at_fault_in_one_recording_is_so_in_all(
    recordings: tuple[SearchTrial, ...], what: str
) -> None:
    ground = contacts(recordings[0]).ground
    plate = ground.plates[0]
    faulty = ground.change(Repair(what=what, where=f"{plate} fz", detail=""))
    first = replace(recordings[0], contacts=replace(contacts(recordings[0]), ground=faulty))
    kept, (note,) = leave_out_untold((first, *recordings[1:]))
    assert note == f"{plate}: what it bears is known in no recording, and was not compared"
    for before, after in zip(recordings, kept, strict=True):
        bears = contacts(before).ground.in_contact()[:, 0]
        assert (contacts(after).usable == contacts(before).usable & ~bears).all()
        assert not any(step.plate == plate for step in contacts(after).steps)
