"""Skeletons written for other engines, read by these: the same frames, markers and masses in random poses."""

from __future__ import annotations

import locale
import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from scaling_service.capabilities.scaling.options import ComparisonOptions
from scaling_service.capabilities.scaling.run import run
from scaling_service.capabilities.scaling.saving import save
from scaling_service.capabilities.shared.settings import Settings
from scaling_service.capabilities.subject.loading import Loaded
from scaling_service.files.biomod import write_biomod
from scaling_service.files.limbs import list_limbs
from scaling_service.files.mjcf import write_mjcf
from scaling_service.files.osim.models import read_osim
from scaling_service.files.polynomials import ease_laws
from scaling_service.model.body import BodyModel
from scaling_service.model.builtin import BUILTIN_NAMES, load_builtin
from scaling_service.model.poses import place_markers, pose_segments
from tests.calibration.people import person
from tests.files.osim.hand_made import hand_made

N_POSES = 1000
ATOL = 1e-6  # m

Placing = Callable[[BodyModel, np.ndarray], tuple[np.ndarray, np.ndarray]]
"""Values of all axes, (n_poses, n_axes) -> origins of segments and markers, (n_poses, n, 3) each."""


@pytest.fixture(autouse=True)
def elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """MuJoCo writes its warnings into the working directory."""
    monkeypatch.chdir(tmp_path)


def in_mujoco(model: BodyModel, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    mujoco = pytest.importorskip("mujoco")
    loaded = mujoco.MjModel.from_xml_string(write_mjcf(model).text)
    state = mujoco.MjData(loaded)
    names = [axis.name for limb in list_limbs(ease_laws(model).model) for axis in limb.axes]
    rows = [loaded.joint(name).qposadr[0] for name in names]
    bodies = [loaded.body(s.name).id for s in model.segments]
    sites = [loaded.site(m.name).id for m in model.markers]
    assert loaded.body_mass[bodies] == pytest.approx([s.mass for s in model.segments], abs=2e-6)
    origins, markers = [], []
    for pose in values:
        state.qpos[rows] = pose
        mujoco.mj_kinematics(loaded, state)
        origins.append(state.xpos[bodies].copy())
        markers.append(state.site_xpos[sites].copy())
    return np.array(origins), np.array(markers)


def in_biorbd(model: BodyModel, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    biorbd = pytest.importorskip("biorbd")
    with tempfile.NamedTemporaryFile("w", suffix=".bioMod") as file:
        file.write(write_biomod(model).text)
        file.flush()
        loaded = biorbd.Model(file.name)
    locale.setlocale(locale.LC_ALL, "")  # biorbd leaves C's, in which no text of other programs can be read
    assert loaded.nbQ() == values.shape[1]
    names = [segment.name().to_string() for segment in loaded.segments()]
    rows = [names.index(s.name) for s in model.segments]
    assert loaded.mass() == pytest.approx(sum(s.mass for s in model.segments))
    origins, markers = [], []
    for pose in values:
        frames = loaded.allGlobalJCS(pose)
        origins.append([frames[row].to_array()[:3, 3] for row in rows])
        markers.append([marker.to_array() for marker in loaded.markers(pose)])
    return np.array(origins), np.array(markers)


ENGINES: dict[str, Placing] = {"mujoco": in_mujoco, "biorbd": in_biorbd}

REAL = {
    "Rajagopal": "rajagopal_walk/Rajagopal2016.osim",
    "gait2354": "gait2354/gait2354_simbody.osim",
    "opencap": "opencap_squat/unscaled_generic.osim",
}


def check_poses(model: BodyModel, engine: str) -> None:
    """Segments' origins, which joint centres are fixed to, and markers in random poses."""
    rng, written = np.random.default_rng(8), model
    lower, upper = (
        np.array([c.default if c.locked else limit(getattr(c, end), bound) for c in model.coordinates])
        for end, limit, bound in (("lower", max, -1.5), ("upper", min, 1.5))
    )
    q = rng.uniform(lower, np.maximum(lower, upper), (N_POSES, len(lower)))
    columns = dict(zip(model.coordinate_names, q.T, strict=True))
    if engine == "mujoco":  # which holds laws as polynomials; how near these are is asked elsewhere
        eased = ease_laws(model)
        columns = eased.fill(columns)
        q = np.column_stack([columns[name] for name in eased.model.coordinate_names])
        model = eased.model
    axes = [axis for limb in list_limbs(model) for axis in limb.axes]
    values = np.stack([np.broadcast_to(axis.value(columns), N_POSES) for axis in axes], axis=1)
    origins, markers = ENGINES[engine](written, values)
    np.testing.assert_allclose(origins, pose_segments(model, q)[..., :3], rtol=0, atol=ATOL)
    wanted = place_markers(model, model.marker_names, q)
    np.testing.assert_allclose(markers.reshape(wanted.shape), wanted, rtol=0, atol=ATOL)


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("which", [*BUILTIN_NAMES, "hand made"])
def test_an_engine_has_every_segment_and_marker_where_we_have_it(which: str, engine: str) -> None:
    check_poses(hand_made() if which == "hand made" else load_builtin(which), engine)


def test_what_is_not_carried_is_listed() -> None:
    said = " ".join(write_mjcf(hand_made()).left_out)
    following = [
        a.name for limb in list_limbs(ease_laws(hand_made()).model) for a in limb.axes if not a.leads
    ]
    assert following
    assert all(name in write_mjcf(hand_made()).text for name in following)
    assert "laws are followed by polynomials, off by up to" in said
    assert "by a polynomial of degree 16, off its law by up to" in write_mjcf(hand_made()).text
    assert all(line in write_biomod(hand_made()).text for line in write_biomod(hand_made()).left_out)


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("which", REAL)
def test_an_engine_has_a_real_model_where_we_have_it(which: str, engine: str, shared_data: Path) -> None:
    pytest.importorskip("opensim")
    check_poses(read_osim(shared_data / REAL[which]), engine)


def test_a_scaled_model_is_exported_beside_its_osim_file(tmp_path: Path) -> None:
    who = person(3, seconds=1.0)
    loaded = Loaded(session=who.session)
    results = run(loaded, ("MB",), Settings(), ComparisonOptions(export=("mjcf", "biomod")))
    document = save(results, tmp_path, report=False)
    model = results.scalings["MB"].calibration.model
    assert (tmp_path / "MB" / "model.xml").read_text(encoding="utf-8") == write_mjcf(model).text
    assert (tmp_path / "MB" / "model.bioMod").read_text(encoding="utf-8") == write_biomod(model).text
    assert {"model.xml", "model.bioMod"} <= set(document.methods["MB"].files)
