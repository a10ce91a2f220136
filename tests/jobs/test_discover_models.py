"""The corrected model, in OpenSim's file: read back by OpenSim, it stands where ours does."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest

from scaling_service.capabilities.discovery.effects.catalogue import propose_candidates
from scaling_service.capabilities.discovery.evidence.fit import Fit, SearchContext
from scaling_service.capabilities.discovery.laws.candidates import Candidate, Column, Estimate, FreeMotion
from scaling_service.capabilities.discovery.laws.loads import Inertial, PlateGain, Tilt
from scaling_service.capabilities.discovery.laws.scene import Scene
from scaling_service.capabilities.discovery.models import (
    correct_model,
    make_own_models,
    plan_osim,
    write_corrected_osim,
)
from scaling_service.capabilities.discovery.start import Prepared
from scaling_service.capabilities.scaling.methods.osim_image_based import Registration
from scaling_service.capabilities.subject.loading import Loaded
from scaling_service.core.arrays import Array
from scaling_service.files.osim.models import read_osim, write_osim
from scaling_service.model.body import BodyModel
from scaling_service.model.builtin import load_builtin
from scaling_service.model.compile import compile_model, list_parameter_values
from scaling_service.model.poses import straighten
from scaling_service.model.results import Calibration
from scaling_service.numerics.multibody.tree import pose_markers
from tests.jobs.hidden_case import session

NEEDS_OPENSIM = pytest.mark.skipif(find_spec("opensim") is None, reason="opensim is not installed")

MODEL = load_builtin("lower_limb_14dof")
SCENE = Scene(
    model=MODEL, markers=MODEL.marker_names, moving=("hip_flexion_r", "knee_angle_r"), trials=("a", "b")
)


def one(found: Iterable[Candidate], size: list[float], *where: str, trials: tuple[str, ...] = ()) -> Estimate:
    """The first candidate at a place, of known size (SI)."""
    candidate = next(c for c in found if c.where == where and c.trials == trials)
    return Estimate(candidate, np.array(size))


TILT = one(propose_candidates(SCENE, ["joint_axis_tilt"]), [0.05, -0.03], "knee_r")
LENGTH = one(propose_candidates(SCENE, ["segment_length"]), [0.04], "femur_r")
OFFSET = one(propose_candidates(SCENE, ["marker_offset"]), [0.01, -0.02, 0.005], "RFH")
CENTRE = one(propose_candidates(SCENE, ["joint_centre_offset"]), [0.004, 0.01, -0.006], "hip_l")
GLIDE = one(propose_candidates(SCENE, ["coupled_motion"]), [0.005, 0.002, 0.0], "knee_r")
SKIN = one(propose_candidates(SCENE, ["soft_tissue_artefact"]), [0.01, 0.0, 0.02], "RLFE")
ONCE = one(propose_candidates(SCENE, ["marker_offset"]), [0.01, 0.0, 0.0], "LFH", trials=("b",))
FREE = Estimate(
    Candidate(
        kind="missing_dof", where=("knee_l",), columns=(), note="extra turn",
        change=FreeMotion("tibia_l", "before", "rotation", (0.0, 1.0, 0.0)),
    ),
    np.zeros(0),
)  # fmt: skip
HEAVIER = Estimate(
    Candidate(
        kind="segment_mass",
        where=("tibia_r",),
        columns=(Column(name="kg", unit=1.0, load=Inertial("tibia_r", (1.0, *([0.0] * 9)))),),
    ),
    np.array([0.5]),
)


ONE = np.array([0.05])


def fit_of(*effects: Estimate, model: BodyModel = MODEL) -> Fit:
    return Fit(context=SearchContext(model=model), effects=effects, tracked=())


def prepared(model: BodyModel = MODEL, source: Path | None = None) -> Prepared:
    whole = session()
    subject = whole.subject if source is None else replace(whole.subject, model=str(source))
    return Prepared(
        loaded=Loaded(session=replace(whole, model=model, subject=subject)),
        start="none",
        model=model,
        recordings=(),
    )


def placed(model: BodyModel, coordinates: tuple[str, ...], q: Array) -> Array:
    """All of the generic markers at poses of the coordinates named, the others at zero."""
    names = tuple(m for m in MODEL.marker_names)
    wide = np.zeros((len(q), len(model.coordinates)))
    for k, name in enumerate(coordinates):
        wide[:, model.coordinate_names.index(name)] = q[:, k]
    return pose_markers(compile_model(model, names), wide, list_parameter_values(model))


@NEEDS_OPENSIM
def test_opensim_has_what_was_found(tmp_path: Path) -> None:
    """Lengths, centres, axes, glides, a freed turn, marker places and masses all at once."""
    what = fit_of(TILT, LENGTH, OFFSET, CENTRE, GLIDE, FREE, HEAVIER)
    notes = write_corrected_osim(tmp_path / "model.osim", what, prepared())
    assert notes == ()
    read = read_osim(tmp_path / "model.osim")
    ours = correct_model(what)
    q = np.random.default_rng(0).uniform(-0.5, 0.5, (20, len(ours.coordinates)))
    np.testing.assert_allclose(
        placed(read, ours.coordinate_names, q), placed(ours, ours.coordinate_names, q), atol=2e-6
    )
    assert (
        np.abs(
            placed(ours, ours.coordinate_names, q) - placed(MODEL, MODEL.coordinate_names, q[:, :14])
        ).max()
        > 0.01
    )
    assert read.segment("tibia_r").mass == pytest.approx(MODEL.segment("tibia_r").mass + 0.5)
    assert "knee_l_extra_turn" in read.coordinate_names


def test_what_opensim_cannot_hold_is_left_out_and_said() -> None:
    plan = plan_osim(fit_of(SKIN, OFFSET), prepared())
    assert [said.split(":")[0].split(" at ")[0] for said in plan.left_out] == [
        "soft tissue artefact",
    ]
    assert all(law.is_constant for m in plan.model.markers for law in m.laws)
    assert plan.model.marker("RFH").nominal == correct_model(fit_of(OFFSET)).marker("RFH").nominal
    assert not all(law.is_constant for law in correct_model(fit_of(SKIN)).marker("RLFE").laws)


@NEEDS_OPENSIM
def test_the_file_that_the_model_came_from_is_changed(tmp_path: Path) -> None:
    """Sizes, centres, axes, markers and masses: then muscles and meshes of the file stay."""
    source = tmp_path / "source.osim"
    write_osim(source, MODEL)
    generic = read_osim(source)
    what = fit_of(TILT, LENGTH, CENTRE, OFFSET, HEAVIER, model=generic)
    assert plan_osim(what, prepared(generic, source)).changes is not None
    assert plan_osim(fit_of(GLIDE, model=generic), prepared(generic, source)).changes is None
    assert write_corrected_osim(tmp_path / "model.osim", what, prepared(generic, source)) == ()
    read, ours = read_osim(tmp_path / "model.osim"), correct_model(what)
    q = np.random.default_rng(1).uniform(-0.5, 0.5, (20, len(ours.coordinates)))
    np.testing.assert_allclose(
        placed(read, ours.coordinate_names, q), placed(ours, ours.coordinate_names, q), atol=2e-6
    )


@NEEDS_OPENSIM
def test_joints_that_an_image_moved_stay_moved(tmp_path: Path) -> None:
    """What was found comes on top of an image-based model, in the file that it was made from."""
    source = tmp_path / "source.osim"
    write_osim(source, MODEL)
    generic = read_osim(source)
    found = Registration(generic)
    found.resize({"femur_r": (1.05,) * 3, "tibia_r": (0.97,) * 3})
    found.shift(found.model.segment("tibia_r"), np.array([0.004, 0.002, -0.003]))
    values = straighten(found.model)
    found.turn(found.model.segment("tibia_r"), np.array([0.1, -0.05, 0.99]), values)
    found.turn_child(found.model.segment("tibia_r"), np.array([0.05, 0.0, -0.02]), np.array([0.0, 0.01, 0.0]))
    imaged = Calibration(
        method="EB", model=found.model, generic=generic, scale_factors=found.ratios, joint_moves=found.moves
    )
    before = replace(prepared(generic, source), calibration=imaged, model=found.model)
    what = fit_of(TILT, LENGTH, CENTRE, OFFSET, HEAVIER, model=found.model)
    assert plan_osim(what, before).changes is not None
    assert write_corrected_osim(tmp_path / "model.osim", what, before) == ()
    read, ours = read_osim(tmp_path / "model.osim"), correct_model(what)
    q = np.random.default_rng(2).uniform(-0.5, 0.5, (20, len(ours.coordinates)))
    np.testing.assert_allclose(
        placed(read, ours.coordinate_names, q), placed(ours, ours.coordinate_names, q), atol=2e-6
    )


def test_what_is_not_the_models_leaves_its_file_alone() -> None:
    """A plate's fault is taken out of the recording; a vertical that leans is OpenSim's gravity."""
    source = prepared(source=Path("given.osim"))
    plate = Estimate(
        Candidate(
            kind="plate_gain",
            where=("plate_1",),
            columns=(Column(name="factor", unit=1.0, load=PlateGain("plate_1")),),
        ),
        ONE,
    )
    leaning = Estimate(
        Candidate(
            kind="gravity_tilt", where=("world",), columns=(Column(name="x_deg", unit=57.3, load=Tilt(0)),)
        ),
        ONE,
    )
    plan = plan_osim(fit_of(plate, leaning), source)
    assert plan.changes is not None
    assert plan.model == correct_model(fit_of())
    assert len(plan.left_out) == 1
    assert "gravity" in plan.left_out[0]


def test_what_holds_in_one_recording_only_has_a_model_of_its_own() -> None:
    what = fit_of(OFFSET, ONCE)
    assert correct_model(what).marker("LFH") == MODEL.marker("LFH")
    own = make_own_models(what)
    assert own.keys() == {"b"}
    assert own["b"].marker("LFH").nominal[0] == pytest.approx(MODEL.marker("LFH").nominal[0] + 0.01)
    assert own["b"].marker("RFH") == correct_model(what).marker("RFH")
