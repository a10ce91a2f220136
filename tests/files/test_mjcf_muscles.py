"""Muscles in MJCF: beside OpenSim's over every coordinate's range, and running in MuJoCo."""

from __future__ import annotations

import csv
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np
import pytest

from scaling_service.capabilities.scaling.exporting import export_models
from scaling_service.capabilities.scaling.muscles.engine import UNKNOWN
from scaling_service.core.errors import DependencyMissing
from scaling_service.documents.engines import EngineMuscleDocument
from scaling_service.files.osim.models import read_osim, render_osim
from scaling_service.model.body import BodyModel
from scaling_service.model.scaling import scale_model
from tests.files.osim.muscled import WRAPS, make_muscled
from tests.peers.scaled_models import scaled_gait2354, scaled_rajagopal

MODELS = {
    "Rajagopal": "rajagopal_walk/Rajagopal2016.osim",
    "gait2354": "gait2354/gait2354_simbody.osim",
}
PERSONS = {"short": (0.88, 1), "tall": (1.12, 2), "recorded": None}
"""Size, and the seed of how segments and axes differ from it, by up to 5 %; none: OpenSim's own scaling to
the person of the model's public recording."""

RECORDED = {"Rajagopal": scaled_rajagopal, "gait2354": scaled_gait2354}

ROOT = ("pelvis_tilt", "pelvis_list", "pelvis_rotation", "pelvis_tx", "pelvis_ty", "pelvis_tz")


@pytest.fixture(autouse=True)
def elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """MuJoCo writes its warnings into the working directory."""
    pytest.importorskip("mujoco")
    pytest.importorskip("opensim")
    monkeypatch.chdir(tmp_path)


def make_person(file: Path, size: float, seed: int) -> tuple[BodyModel, str]:
    """A generic model scaled to a person by OpenSim; both sides alike."""
    generic, rng = read_osim(file), np.random.default_rng(seed)
    drawn: dict[str, tuple[float, ...]] = {}
    for name in generic.segment_names:
        side = name.removesuffix("_l") + "_r" if name.endswith("_l") else name
        drawn.setdefault(side, tuple(float(v) for v in size * rng.uniform(0.95, 1.05, 3)))
    factors = {
        name: drawn[name.removesuffix("_l") + "_r" if name.endswith("_l") else name]
        for name in generic.segment_names
    }
    model = scale_model(generic, factors)
    return model, render_osim(model, source=file, factors=factors)


def export(folder: Path, model: BodyModel, osim: str) -> tuple[Path, EngineMuscleDocument]:
    export_models(folder, model, osim, ("mjcf",))
    text = (folder / "model_muscles.json").read_text(encoding="utf-8")
    return folder / "model.xml", EngineMuscleDocument.model_validate_json(text)


def simulate(file: Path, seconds: float) -> float:
    """Hang the body at its pelvis, all muscles passive: by how much ties are off at most, rad or m."""
    import mujoco

    root = ET.parse(file).getroot()
    world, ties, key = root.find("worldbody"), root.find("equality"), root.find("keyframe/key")
    assert world is not None
    assert ties is not None
    assert key is not None
    start = dict(zip((j.get("name") for j in world.iter("joint")), str(key.get("qpos")).split(), strict=True))
    for name in ROOT:
        if name in start:
            ET.SubElement(ties, "joint", joint1=name, polycoef=f"{start[name]} 0 0 0 0")
    model = mujoco.MjModel.from_xml_string(ET.tostring(root, encoding="unicode"))
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    assert model.opt.timestep == 1e-3
    tied = [k for k in range(model.neq) if model.eq_obj2id[k] >= 0]
    followers, leaders = model.eq_obj1id[tied], model.eq_obj2id[tied]
    powers, worst = np.arange(5), 0.0
    for _ in range(int(seconds / model.opt.timestep)):
        mujoco.mj_step(model, data)
        laws = np.sum(model.eq_data[tied, :5] * data.qpos[leaders][:, None] ** powers, axis=1)
        worst = max(worst, float(np.abs(data.qpos[followers] - laws).max(initial=0.0)))
    assert np.isfinite(data.qpos).all()
    assert not any(warning.number for warning in data.warning)
    assert np.abs(data.qvel).max() < 1.0  # it hangs nearly still
    return worst


def test_every_kind_of_point_and_surface_is_opensims(tmp_path: Path) -> None:
    (tmp_path / "leg.osim").write_text(make_muscled(), encoding="utf-8")
    file, found = export(tmp_path, read_osim(tmp_path / "leg.osim"), make_muscled())
    rows = {row.muscle: row for row in found.muscles}
    assert set(rows) == {*WRAPS, "fixed", "conditional", "moving"}
    assert {name for name, row in rows.items() if row.wraps} == set(WRAPS)
    assert all(row.within for row in found.muscles)
    near = ("fixed", "conditional", "sphere")  # which nothing stands for
    assert all(max(rows[name].length_mm, rows[name].moment_arm_mm) < 0.01 for name in near)
    changed = " ".join(found.changed)
    assert "ellipsoid_surface, an ellipsoid, is a cylinder of" in changed
    assert "torus_surface, a torus, is a cylinder of" in changed
    with (tmp_path / "model_muscles.csv").open(encoding="utf-8", newline="") as stream:
        table = [row for row in csv.DictReader(stream) if row["muscle"] == "conditional"]
    gaps = [abs(float(row["length_mujoco_mm"]) - float(row["length_opensim_mm"])) for row in table]
    assert max(gaps) == pytest.approx(rows["conditional"].length_mm, abs=2e-3)
    assert simulate(file, 2.0) < 1e-3


def test_a_muscles_force_is_opensims_at_optimal_length(tmp_path: Path) -> None:
    import mujoco

    (tmp_path / "leg.osim").write_text(make_muscled(), encoding="utf-8")
    file, _ = export(tmp_path, read_osim(tmp_path / "leg.osim"), make_muscled())
    model = mujoco.MjModel.from_xml_path(str(file))
    muscle = model.actuator("fixed")
    optimal = 0.14 + 0.1 * np.cos(0.2)  # slack length and the fibre along the tendon, rigid
    gain = mujoco.mju_muscleGain(optimal, 0.0, muscle.lengthrange, muscle.acc0[0], muscle.gainprm[:9])
    assert gain == pytest.approx(-800.0 * np.cos(0.2), rel=1e-6)
    slack = mujoco.mju_muscleBias(optimal, muscle.lengthrange, muscle.acc0[0], muscle.gainprm[:9])
    assert slack == pytest.approx(0.0, abs=1e-9)


def test_without_opensim_the_report_compares_with_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "leg.osim").write_text(make_muscled(), encoding="utf-8")
    model = read_osim(tmp_path / "leg.osim")

    def refuse(*_: object) -> None:
        raise DependencyMissing(
            "the opensim library cannot be imported", field="opensim", remedy="Install it"
        )

    monkeypatch.setattr("scaling_service.capabilities.scaling.muscles.engine.measure_muscles", refuse)
    _, found = export(tmp_path, model, make_muscled())
    assert found.reference is None
    assert found.share_within is None
    assert "opensim library cannot be imported" in found.summary[0]
    monkeypatch.setattr("scaling_service.capabilities.scaling.exporting.read_musculature", refuse)
    said = " ".join(export_models(tmp_path, model, make_muscled(), ("mjcf",)))
    assert "muscles were not exported" in said
    assert "<muscle" not in (tmp_path / "model.xml").read_text(encoding="utf-8")


@pytest.mark.costly
def test_it_runs_in_mjx_as_in_mujoco(tmp_path: Path) -> None:
    """Compiled by jax in a minute; numbers are of single precision there."""
    mjx = pytest.importorskip("mujoco.mjx", reason="mujoco-mjx is not installed")
    jax = pytest.importorskip("jax")
    import mujoco

    (tmp_path / "leg.osim").write_text(make_muscled(), encoding="utf-8")
    file, _ = export(tmp_path, read_osim(tmp_path / "leg.osim"), make_muscled())
    model = mujoco.MjModel.from_xml_path(str(file))
    state = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, state, 0)
    mujoco.mj_forward(model, state)
    theirs, run = mjx.put_data(model, state), jax.jit(mjx.step)
    compiled = mjx.put_model(model)
    for _ in range(50):
        theirs = run(compiled, theirs)
        mujoco.mj_step(model, state)
    np.testing.assert_allclose(np.asarray(theirs.qpos), state.qpos, rtol=0, atol=1e-5)


@pytest.mark.parametrize("person", PERSONS)
@pytest.mark.parametrize("which", MODELS)
@pytest.mark.costly
def test_muscles_are_opensims(which: str, person: str, shared_data: Path, tmp_path: Path) -> None:
    drawn = PERSONS[person]
    if drawn is None:
        scaled = RECORDED[which](shared_data, tmp_path)
        who = read_osim(scaled), scaled.read_text(encoding="utf-8")
    else:
        who = make_person(shared_data / MODELS[which], *drawn)
    file, found = export(tmp_path, *who)
    assert found.share_within is not None
    assert found.share_within >= 0.95
    assert found.share_moment_arms_within is not None
    assert found.share_moment_arms_within >= 0.95
    assert all(row.causes and UNKNOWN not in row.causes for row in found.muscles if not row.within)
    assert simulate(file, 10.0) < 1e-3
