"""What a person who stands on the plates, and the pressure under each step, say of weight and plates."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import scipy

from scaling_service.capabilities.discovery.effects.sizes import look_up_usual_sizes, settle_size
from scaling_service.capabilities.discovery.evidence.fit import Fit, SearchContext, fit_recordings
from scaling_service.capabilities.discovery.evidence.settings import DiscoverySettings
from scaling_service.capabilities.discovery.laws.apply import correct_forces
from scaling_service.capabilities.discovery.laws.candidates import Candidate, Column, Estimate
from scaling_service.capabilities.discovery.laws.loads import PlateFault, PlateGain, PlateShift, PlateTurn
from scaling_service.capabilities.discovery.observations.wrench import WrenchFit
from scaling_service.capabilities.discovery.options import AS_MEASURED, DiscoverSettings
from scaling_service.capabilities.discovery.ordinary.forces import WrenchTable
from scaling_service.capabilities.discovery.ordinary.loads import score_loads
from scaling_service.capabilities.discovery.ordinary.soles import tabulate_steps
from scaling_service.capabilities.discovery.search.naming import Naming, Origin
from scaling_service.capabilities.discovery.start import Prepared, prepare
from scaling_service.capabilities.subject.loading import open_subject
from scaling_service.core.progress import Steps, show_nothing
from scaling_service.files.trc import read_trc, write_trc
from scaling_service.model.builtin import load_builtin
from scaling_service.model.inertia import sum_mass
from scaling_service.virtual.plates import write_forces
from tests.jobs.force_laboratory import document, force_laboratory, write_subject

G = 9.80665


def stand(folder: Path, share: float) -> Prepared:
    """The laboratory with a second of standing on one plate, which bears a share of the weight."""
    force_laboratory(folder)
    trial = read_trc(folder / "sway.trc")
    still = replace(trial, times=trial.times[:100], markers=np.repeat(trial.markers[:1], 100, axis=0))
    write_trc(folder / "static.trc", still, "mm")
    middle = np.nanmean(still.markers[0], axis=0)
    plate = np.zeros((100, 9))  # force, point, free moment
    plate[:, 1] = share * G * sum_mass(load_builtin("full_body_35dof"))
    plate[:, [3, 5]] = middle[[0, 2]]
    write_forces(folder / "static_grf.mot", still.times, (plate,))
    given = document()
    given["trials"]["static"] = "static.trc"
    given["forces"]["static.trc"] = "static_grf.mot"
    file = write_subject(folder, given)
    return prepare(open_subject(file, AS_MEASURED), DiscoverSettings(start="none"), AS_MEASURED)


def test_whoever_stands_on_the_plates_is_weighed_by_them(tmp_path: Path) -> None:
    """Though both feet are on one plate. Quiet standing says nothing of how forces agree in movement."""
    prepared = stand(tmp_path, 1.0)
    standing = prepared.recordings[0]
    assert standing.trial.name == "static"
    assert standing.contacts is not None
    assert standing.contacts.usable.all()
    fit = fit_recordings(SearchContext(model=prepared.model, recordings=prepared.recordings))
    assert fit.wrenches[0].residuals[20:80, 1] == pytest.approx(0.0, abs=1.0)
    np.testing.assert_array_equal(WrenchTable(fit, []).shared, [[0.0, 1.0], [1.0, 0.0], [1.0, 0.0]])


def test_plates_that_bear_half_a_person_do_not_weigh_them(tmp_path: Path) -> None:
    prepared = stand(tmp_path, 0.5)
    assert prepared.recordings[0].contacts is None
    assert any(note.startswith("static: its forces are left out") for note in prepared.notes)


@pytest.fixture(scope="module")
def fit(tmp_path_factory: pytest.TempPathFactory) -> Fit:
    file = force_laboratory(tmp_path_factory.mktemp("forces"))
    prepared = prepare(open_subject(file, AS_MEASURED), DiscoverSettings(start="none"), AS_MEASURED)
    return fit_recordings(SearchContext(model=prepared.model, recordings=prepared.recordings))


def without(item: WrenchFit, load: PlateFault, size: float) -> WrenchFit:
    """The recording with a fault put right that is not there: the fault the other way round is."""
    fault = Estimate(
        Candidate(kind="made", where=(load.plate,), columns=(Column(name="x", unit=1.0, load=load),)),
        np.array([size]),
    )
    ground = correct_forces(item.contacts.ground, item.times, [fault])
    return replace(item, contacts=replace(item.contacts, ground=ground))


@pytest.mark.parametrize(
    ("load", "size"),
    [(PlateShift("plate_1", 0), 0.04), (PlateShift("plate_1", 2), -0.03), (PlateTurn("plate_1", 1), 0.01),
     (PlateGain("plate_1"), 0.1)],
)  # fmt: skip
def test_a_plate_that_lies_elsewhere_moves_the_pressure_under_its_steps(
    fit: Fit, load: PlateFault, size: float
) -> None:
    """As its columns say; a gain does not move it."""
    assert all(len(item.contacts.steps) >= 2 for item in fit.wrenches)
    before = tabulate_steps(fit.wrenches, [(load, ())])
    after = tabulate_steps([without(item, load, size) for item in fit.wrenches], [(load, ())])
    explained = before.columns[:, 0] * size
    assert before.gap - after.gap == pytest.approx(explained, abs=0.02 * np.abs(explained).max() + 1e-9)
    assert (np.abs(explained).max() > 1.0) == isinstance(load, PlateShift)


def test_a_shift_in_one_recording_is_none_in_another(fit: Fit) -> None:
    load = PlateShift("plate_1", 0)
    sway, swing = (tabulate_steps(fit.wrenches, [(load, (name,))]).columns for name in ("sway", "swing"))
    assert not np.allclose(sway, swing)
    np.testing.assert_allclose(sway + swing, tabulate_steps(fit.wrenches, [(load, ())]).columns)


def test_forces_and_moments_are_judged_as_one_wrench(fit: Fit) -> None:
    """A fall of 30 N outweighs half a newton metre; half a newton does not."""
    gain_of = Column(name="factor", unit=1.0, neutral=1.0, load=PlateGain("plate_1"))
    candidate = Candidate(kind="plate_gain", where=("plate_1",), columns=(gain_of,))

    def press(newton: float, twist: float) -> Fit:
        made = []
        for item in fit.wrenches:
            force = np.tile([0.0, newton, 0.0], (len(item.times), 1))
            moment = np.cross(item.about, force) + np.array([0.0, 0.0, twist])
            made.append(replace(item, touched=np.concatenate([force, moment], axis=1)))
        return replace(fit, wrenches=tuple(made))

    def gain(before: Fit, after: Fit) -> float | None:
        naming = Naming(fit=before, origin=Origin(), steps=Steps(report=show_nothing))
        return naming._measure_gain(after, candidate)[0]

    share = gain(press(30.0, 0.0), press(0.0, 0.5))
    assert share is not None
    assert share > 0.5
    assert gain(press(0.5, 0.0), press(0.0, 4.0)) is None


@pytest.mark.parametrize(("course", "changes"), [("constant", False), ("late", True), ("high", True)])
def test_a_fault_that_comes_and_goes_is_not_one_of_constant_size(
    course: str, changes: bool, fit: Fit
) -> None:
    """Neither one that begins half way nor one that shows under high loads alone."""
    load, sd = PlateGain("plate_1"), np.array([0.05])
    gain = Candidate(kind="plate_gain", where=("plate_1",), columns=(Column(name="x", unit=1.0, load=load),))

    def spoil(item: WrenchFit) -> WrenchFit:
        ground, spoilt = item.contacts.ground, without(item, load, -0.2).contacts.ground
        pressing = ground.pressing[:, 0]
        when = {
            "constant": np.ones(len(pressing), dtype=bool),
            "late": item.times > item.times.mean(),
            "high": pressing > np.quantile(pressing, 0.7),
        }[course][:, None, None]
        force, moment = (np.where(when, getattr(spoilt, k), getattr(ground, k)) for k in ("force", "moment"))
        return replace(
            item, contacts=replace(item.contacts, ground=replace(ground, force=force, moment=moment))
        )

    spoilt = replace(fit, wrenches=tuple(map(spoil, fit.wrenches)))
    ways = {"mass_sd": 0.05, "weighed": False, "each": False, "touching": [], "touches": lambda _: []}
    (found,) = score_loads(spoilt, [(gain, sd)], [], **ways).scored
    named = Estimate(gain, found.size)
    loads = score_loads(spoilt, [(gain, sd)], [(Estimate(gain, np.zeros(1)), sd)], **ways)
    assert (loads.score_drift(named, sd) > DiscoverySettings().odds) == changes


@pytest.mark.parametrize(("beyond", "settles"), [(-1.0, True), (0.5, True), (1.5, True), (2.5, False)])
def test_a_size_beyond_what_is_met_is_the_likeliest_that_is(beyond: float, settles: bool, fit: Fit) -> None:
    """SciPy's truncated normal is the oracle; ``beyond``: deviations by which it lies above the range."""
    column = Column(name="factor", unit=1.0, neutral=1.0, load=PlateGain("plate_1"))
    candidate = Candidate(kind="plate_gain", where=("plate_1",), columns=(column,))
    usual, sd = look_up_usual_sizes(candidate, fit.model)("factor"), 0.01
    assert usual is not None
    size = np.array([usual.high + beyond * sd - 1.0])
    found = settle_size(candidate, size, np.array([[sd**2]]), fit.model)
    if not settles:
        assert found is None
        return
    assert found is not None
    ends = ((usual.low - 1.0 - size[0]) / sd, -beyond)
    wanted = scipy.stats.truncnorm.mean(*ends, loc=size[0], scale=sd) if beyond > 0.0 else size[0]
    assert found[0] == pytest.approx(wanted, abs=1e-9)
