"""A real squat on two plates: one foot's plate withheld is found, and its force inferred."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from scaling_service.capabilities.discovery.evidence.fit import SearchContext, fit_recordings
from scaling_service.capabilities.discovery.laws.candidates import Candidate, Contact, Estimate
from scaling_service.capabilities.discovery.options import AS_MEASURED, DiscoverSettings
from scaling_service.capabilities.discovery.ordinary.forces import NOISE
from scaling_service.capabilities.discovery.start import Prepared, prepare
from scaling_service.capabilities.subject.loading import open_subject
from scaling_service.files.sto import read_sto, write_sto
from scaling_service.model.subject import Subject

WITHHELD, KEPT = "ground_force_2_", "ground_force_1_"


@pytest.fixture(scope="module")
def squat(shared_data: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Prepared, np.ndarray]:
    """A scaled model, its squat without one plate's columns, and that plate's vertical force over time."""
    folder = shared_data / "opencap_squat"
    table = read_sto(folder / "squats1_grf.mot")
    kept = [k for k, name in enumerate(table.columns) if not name.startswith(WITHHELD)]
    without = tmp_path_factory.mktemp("withheld") / "one_plate.mot"
    write_sto(
        without, replace(table, columns=tuple(table.columns[k] for k in kept), data=table.data[:, kept])
    )
    subject = Subject(
        id="squatter",
        model=str(folder / "manually_scaled.osim"),
        calibration=(folder / "squats1.trc",),
        forces={"squats1.trc": without},
    )
    prepared = prepare(open_subject(subject, AS_MEASURED), DiscoverSettings(start="none"), AS_MEASURED)
    vertical = np.column_stack([table.times, table.column(f"{WITHHELD}vy")])
    return prepared, vertical


def test_frames_of_the_foot_without_a_plate_count(squat: tuple[Prepared, np.ndarray]) -> None:
    contacts = squat[0].recordings[0].contacts
    assert contacts is not None
    assert contacts.usable.mean() > 0.95
    assert "plate_2" in contacts.ground.plates  # of a third, which nobody stands on


def test_the_force_inferred_is_the_one_that_was_measured(squat: tuple[Prepared, np.ndarray]) -> None:
    """RMSE of the vertical force within 5 % of body weight, against the plate that was taken away."""
    prepared, vertical = squat
    start, end = (float(prepared.recordings[0].trial.times[k]) for k in (0, -1))
    contact = Candidate(
        kind="external_contact", where=("calcn_l",), columns=(), trials=("squats1",),
        change=Contact(
            segment="calcn_l", start_s=start, end_s=end, point=(0.05, 0.0, 0.0), noise=tuple(NOISE)
        ),
    )  # fmt: skip
    found = fit_recordings(
        SearchContext(model=prepared.model, recordings=prepared.recordings),
        [Estimate(contact, np.zeros(0))],
    )
    item = found.wrenches[0]
    assert item.touched is not None
    inferred = item.touched[item.usable, 1]
    measured = np.interp(item.times[item.usable], vertical[:, 0], vertical[:, 1])
    weight = 9.81 * sum(s.mass for s in prepared.model.segments)
    assert np.sqrt(np.mean((inferred - measured) ** 2)) < 0.05 * weight
