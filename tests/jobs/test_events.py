"""Heel strikes and toe-offs: a file's own against the plates, what plates say, and what a person says."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from scaling_service.capabilities.intake.tables import Contact, list_events
from scaling_service.capabilities.scaling.comparison.gait_cycles import find_gait_cycles
from scaling_service.core.errors import InputError
from scaling_service.documents.reading import check_document
from scaling_service.files.recording import read_recording
from scaling_service.files.sto import read_sto
from scaling_service.model.trial import GaitEvent, Trial
from tests.jobs.test_proof_mended import BARE

WALKS = ("Walking01", "Walking02", "Walking04")


def still(*events: GaitEvent) -> Trial:
    """Two seconds at 100 Hz in which nobody moves."""
    times, markers = np.arange(200) / 100.0, np.zeros((200, 1, 3))
    return Trial(name="walk", times=times, labels=("RHEE",), markers=markers, rate_hz=100.0, events=events)


@pytest.mark.parametrize("walk", WALKS)
def test_events_of_a_file_are_those_of_its_plates(shared_data: Path, walk: str) -> None:
    """From strike to off, a foot loads its plate, in forces that others cut at the first strike."""
    trial = read_recording(shared_data / "jia_mri" / f"{walk}.c3d")
    assert [(event.side, event.kind) for event in trial.events] == [
        ("r", "strike"),
        ("r", "off"),
        ("r", "strike"),
    ]
    first, off, second = (event.time_s for event in trial.events)
    forces = read_sto(shared_data / "jia_mri" / f"{walk}_kinetics.mot")
    loaded = [
        forces.times[column > 20.0]
        for name, column in zip(forces.columns, forces.data.T, strict=True)
        if name.endswith("_vy")
    ]
    ends = [times[-1] for times in loaded if times[0] == forces.times[0]]  # of the foot that struck
    assert min(abs(end - (off - first)) for end in ends) < 0.012  # a frame
    assert find_gait_cycles(trial, "r").cycles == ((first, second),)


def test_strides_are_cut_by_what_is_said() -> None:
    told = [GaitEvent("r", "strike", at) for at in (0.1, 1.2)]
    found = find_gait_cycles(still(*told), "r")
    assert found.cycles == ((0.1, 1.2),)
    assert found.reason == ""
    assert find_gait_cycles(still(*told), "l").cycles == ()  # of the other foot nothing is said
    apart = [GaitEvent("r", "strike", at) for at in (0.1, 9.0)]
    assert find_gait_cycles(still(*apart), "r").cycles == ()  # two passes over the plates


def test_plates_tell_what_nobody_says() -> None:
    """A contact of one foot gives two events; one of both feet, or at the recording's end, does not."""
    contacts = [Contact(20, 80, ("r",)), Contact(70, 200, ("l",)), Contact(30, 60, ("r", "l"))]
    found = list_events(still(GaitEvent("r", "off", 0.78)), contacts, given=False)
    assert [(one.side, one.kind, one.time_s, one.source) for one in found] == [
        ("r", "strike", 0.2, "plates"),
        ("l", "strike", 0.7, "plates"),
        ("r", "off", 0.78, "file"),
    ]
    (only,) = list_events(still(GaitEvent("r", "off", 0.78)), contacts, given=True)
    assert only.source == "document"


def test_more_than_anybody_gives_is_refused() -> None:
    document = {**BARE, "model": "lower_limb_14dof", "trials": {"static": "a.trc"}}
    out = {"labels": {"RKNE": None}, "from_s": 0.0, "to_s": 1.0}
    event = {"side": "r", "kind": "strike", "time_s": 0.5}
    for more in ({"corrections": {"a.trc": [out] * 201}}, {"events": {"a.trc": [event] * 20_001}}):
        with pytest.raises(InputError, match="at most"):
            check_document({**document, **more})


def test_events_of_no_recording_are_refused() -> None:
    event = {"side": "r", "kind": "strike", "time_s": 0.5}
    trials = {"trials": {"static": "a.trc"}, "events": {"b.trc": [event]}}
    document = {**BARE, "model": "lower_limb_14dof", **trials}
    with pytest.raises(InputError, match="no trial has this file name"):
        check_document(document)
