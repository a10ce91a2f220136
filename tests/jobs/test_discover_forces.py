"""Forces for the search: who has some, and which frames the plates should explain."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from scaling_service.capabilities.discovery.effects.catalogue import propose_candidates
from scaling_service.capabilities.discovery.evidence.fit import Fit, SearchContext, fit_recordings
from scaling_service.capabilities.discovery.laws.apply import correct_forces
from scaling_service.capabilities.discovery.laws.candidates import Candidate, Column, Contact, Estimate
from scaling_service.capabilities.discovery.laws.loads import PlateBias, PlateGain
from scaling_service.capabilities.discovery.observations.performed import perform_on_plates
from scaling_service.capabilities.discovery.options import AS_MEASURED, DiscoverSettings
from scaling_service.capabilities.discovery.ordinary.forces import NOISE
from scaling_service.capabilities.discovery.saving import tabulate_forces, write_contacts, write_corrected
from scaling_service.capabilities.discovery.search.separating import find_separating_movement
from scaling_service.capabilities.discovery.start import Prepared, find_usable_frames, prepare
from scaling_service.capabilities.subject.loading import open_subject
from scaling_service.files.forces import read_forces, read_forces_from_table
from scaling_service.files.sto import read_sto
from scaling_service.model.forces import GroundForces
from scaling_service.recording.plates_feet import FootContacts
from tests.jobs.force_laboratory import force_laboratory
from tests.jobs.laboratory import laboratory


@pytest.fixture(scope="module")
def prepared(tmp_path_factory: pytest.TempPathFactory) -> Prepared:
    file = force_laboratory(tmp_path_factory.mktemp("forces"))
    return prepare(open_subject(file, AS_MEASURED), DiscoverSettings(start="none"), AS_MEASURED)


def test_recordings_with_forces_have_contacts(prepared: Prepared) -> None:
    found = {r.trial.name: r.contacts for r in prepared.recordings if r.contacts}
    assert found.keys() == prepared.forces.keys()
    assert len(found) == 2
    for name, contacts in found.items():
        np.testing.assert_array_equal(contacts.usable, prepared.forces[name].contacts.supported)
        assert contacts.usable.mean() > 0.8


def test_forces_come_back_as_they_were_written(prepared: Prepared) -> None:
    ground = next(iter(prepared.forces.values())).ground
    again = read_forces_from_table(tabulate_forces("again", ground), "again.mot")
    np.testing.assert_allclose(again.force, ground.force, atol=1e-9)
    np.testing.assert_allclose(again.moment, ground.moment, atol=1e-9)


def ground_of(loads: list[list[float]]) -> GroundForces:
    """Vertical forces of plates at 100 Hz, (n, k)."""
    force = np.zeros((*np.shape(loads), 3))
    force[..., 1] = loads
    n, k = np.shape(loads)
    return GroundForces(
        name="made", times=np.arange(n) / 100.0, plates=tuple(f"plate_{i + 1}" for i in range(k)),
            force=force,
        moment=np.zeros_like(force), surfaces=np.zeros((k, 3)), normals=np.tile([0.0, 1.0, 0.0], (k, 1)),
    )  # fmt: skip


def contacts(foot: list[list[int]], on_floor: list[list[bool]]) -> FootContacts:
    rows = np.array(foot, dtype=np.intp)
    return FootContacts(
        feet=("r", "l"),
        foot=rows,
        on_floor=np.array(on_floor),
        over_edge=np.zeros((len(rows), 2), dtype=bool),
        supported=np.ones(len(rows), dtype=bool),
        repairs=(),
    )


def test_a_step_beside_the_plates_does_not_count() -> None:
    """Left stands on the floor alone, then right on the plate; half a second each."""
    n = 50
    ground = ground_of([[0.0, 0.0]] * n + [[700.0, 0.0]] * n)
    made = contacts([[-1, -1]] * n + [[0, -1]] * n, [[True, True]] * n + [[True, False]] * n)
    assert not find_usable_frames(ground, made)[:n].any()
    assert find_usable_frames(ground, made)[n:].all()


def test_a_foot_whose_plate_was_lost_does_count() -> None:
    n = 50
    ground = ground_of([[350.0, 0.0]] * n)
    made = contacts([[0, -1]] * n, [[True, True]] * n)
    assert find_usable_frames(ground, made).all()


def test_a_load_that_is_nobodys_does_not_count() -> None:
    n = 20
    ground = ground_of([[350.0, 350.0]] * n)
    made = contacts([[0, -1]] * n, [[True, True]] * n)
    assert not find_usable_frames(ground, made).any()


def test_folders_without_forces_say_so(tmp_path: Path) -> None:
    prepared = prepare(
        open_subject(laboratory(tmp_path), AS_MEASURED), DiscoverSettings(start="none"), AS_MEASURED, 0.5
    )
    assert not prepared.forces


GAIN = Estimate(
    Candidate(
        kind="plate_gain",
        where=("plate_1",),
        columns=(Column(name="factor", unit=1.0, neutral=1.0, load=PlateGain("plate_1")),),
    ),
    np.array([0.05]),
)
TOUCH = Estimate(
    Candidate(
        kind="external_contact",
        where=("torso",),
        columns=(),
        trials=("sway",),
        change=Contact(segment="torso", start_s=0.5, end_s=1.5, point=(0.0,) * 3, noise=tuple(NOISE)),
    ),
    np.zeros(0),
)


def test_corrected_forces_are_those_of_the_file_without_the_fault(prepared: Prepared, tmp_path: Path) -> None:
    """Not filtered, and at their own rate: a plate that measures 5 % too much is divided by 1.05."""
    reported = write_corrected(
        tmp_path,
        Fit(context=SearchContext(model=prepared.model), effects=(GAIN,), tracked=()),
        prepared,
    )
    assert len(reported) == 1
    path = next(p for p in prepared.subject.calibration if p.stem == "sway")
    given = read_forces(prepared.subject.forces[path.name])
    mended = read_forces(tmp_path / "corrected" / "sway_forces.mot")
    np.testing.assert_allclose(mended.times, given.times)
    np.testing.assert_allclose(mended.force[:, 0], given.force[:, 0] / 1.05, atol=1e-6)
    np.testing.assert_allclose(mended.force[:, 1], given.force[:, 1], atol=1e-6)
    np.testing.assert_allclose(mended.centre_of_pressure()[:, 0], given.centre_of_pressure()[:, 0], atol=1e-6)
    assert (tmp_path / "corrected" / "sway.trc").is_file()


def test_a_bias_is_taken_off_readings_only() -> None:
    """Off the plate the export holds zeros; there nothing was added and nothing is taken off."""
    loads = np.full((60, 2), 350.0)
    loads[20:40, 0] = 0.0
    ground = ground_of(loads.tolist())
    column = Column(name="fx_N", unit=1.0, load=PlateBias("plate_1", 0))
    bias = Estimate(Candidate(kind="plate_bias", where=("plate_1",), columns=(column,)), np.array([12.0]))
    mended = correct_forces(ground, ground.times, [bias])
    expected = np.where(loads[:, :1] > 0.0, [-12.0, 350.0, 0.0], 0.0)
    np.testing.assert_allclose(mended.force[:, 0], expected)
    np.testing.assert_allclose(mended.force[:, 1], ground.force[:, 1])


def test_without_a_fault_nothing_is_corrected(prepared: Prepared, tmp_path: Path) -> None:
    assert (
        write_corrected(
            tmp_path,
            Fit(context=SearchContext(model=prepared.model), effects=(), tracked=()),
            prepared,
        )
        == ()
    )
    assert not (tmp_path / "corrected").exists()


def test_the_force_of_a_contact_is_written(prepared: Prepared, tmp_path: Path) -> None:
    found = fit_recordings(
        SearchContext(
            model=prepared.model, recordings=[r for r in prepared.recordings if r.trial.name == "sway"]
        ),
        [TOUCH],
    )
    assert write_contacts(tmp_path, found) == ("sway_contact.sto holds the force that was inferred",)
    table = read_sto(tmp_path / "sway_contact.sto")
    outside = (table.times < 0.4) | (table.times > 1.6)
    assert table.columns[1:] == tuple(f"contact_{c}" for c in ("fx", "fy", "fz", "mx", "my", "mz"))
    assert not table.data[outside, 1:].any()
    item = found.wrenches[0]
    assert item.touched is not None
    np.testing.assert_allclose(table.times, item.times[item.usable])
    np.testing.assert_allclose(table.data[:, 1:], item.touched[item.usable], rtol=1e-9, atol=1e-9)


def test_a_contact_in_all_trials_is_written_for_each(prepared: Prepared, tmp_path: Path) -> None:
    everywhere = replace(TOUCH, candidate=replace(TOUCH.candidate, trials=()))
    found = fit_recordings(SearchContext(model=prepared.model, recordings=prepared.recordings), [everywhere])
    write_contacts(tmp_path, found)
    assert {p.name for p in tmp_path.iterdir()} == {f"{item.name}_contact.sto" for item in found.wrenches}


def test_other_movements_are_performed_on_plates_under_the_feet(prepared: Prepared) -> None:
    """The plates give what the movement needs, and standing still that is the weight."""
    known = fit_recordings(SearchContext(model=prepared.model, recordings=prepared.recordings)).wrenches[0]
    standing, squat = (perform_on_plates(known, movement) for movement in ("quiet standing", "a squat"))
    assert standing is not None
    assert squat is not None
    for made in (standing, squat):
        np.testing.assert_allclose(made.residuals[made.usable], 0.0, atol=1e-6)
    assert standing.measured[:, 1].mean() == pytest.approx(known.mass * 9.81, rel=0.01)
    assert set(standing.contacts.ground.plates) <= set(known.contacts.ground.plates)
    heights = squat.tracked.task.measured[:, :, 1]
    assert np.ptp(heights.max(axis=1)) > 0.1  # m: the head comes down
    assert np.ptp(heights.min(axis=1)) < 0.05  # and the feet stay


def test_what_would_tell_effects_of_forces_apart_is_predicted(prepared: Prepared) -> None:
    """Standing, a tilted vertical pulls as a plate's bias does."""
    now = fit_recordings(SearchContext(model=prepared.model, recordings=prepared.recordings))
    every = list(propose_candidates(now.scene))
    tilt = next(c for c in every if c.kind == "gravity_tilt")
    biases = [c for c in every if c.kind == "plate_bias" and not c.trials]
    leaning = Estimate(tilt, np.array([0.06, 0.0]))
    assert find_separating_movement(leaning, biases[:1], now) not in ("", "quiet standing")
    assert find_separating_movement(leaning, (), now) == ""
