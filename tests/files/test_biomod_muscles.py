"""Muscles in bioMod: read by biorbd, and as long as OpenSim's where nothing else is said."""

from __future__ import annotations

import locale
import re
from pathlib import Path

import numpy as np
import pytest

from scaling_service.capabilities.scaling.exporting import export_models
from scaling_service.files.limbs import list_limbs
from scaling_service.files.osim.models import read_osim
from scaling_service.files.osim.muscles import measure_muscles
from scaling_service.model.poses import sweep_coordinates
from tests.files.osim.muscled import WRAPS, make_muscled

STEPS = 25  # of each range, other than those that the export looks at
NEAR_M = 1.5e-3  # the most that is not said, 1 mm, and what lies between two steps

REAL = {"Rajagopal": "rajagopal_walk/Rajagopal2016.osim", "gait2354": "gait2354/gait2354_simbody.osim"}


def export(file: Path, folder: Path) -> tuple[dict[str, float], dict[str, float], str]:
    """By how much each muscle's length differs from OpenSim's, what is said of it, m, and the text."""
    biorbd = pytest.importorskip("biorbd")
    pytest.importorskip("opensim")
    model, osim = read_osim(file), file.read_text(encoding="utf-8")
    said = " ".join(export_models(folder, model, osim, ("biomod",)))
    loaded = biorbd.Model(str(folder / "model.bioMod"))
    locale.setlocale(locale.LC_ALL, "")  # biorbd leaves C's, in which no text of other programs can be read
    q = np.concatenate(list(sweep_coordinates(model, STEPS).values()))
    columns = dict(zip(model.coordinate_names, q.T, strict=True))
    axes = [axis for limb in list_limbs(model) for axis in limb.axes]
    values = np.stack([np.broadcast_to(axis.value(columns), len(q)) for axis in axes], axis=1)
    muscles = [loaded.muscle(k) for k in range(loaded.nbMuscles())]
    lengths = []
    for pose in values:
        loaded.updateMuscles(pose, True)
        lengths.append([muscle.musculoTendonLength(loaded, pose, False) for muscle in muscles])
    theirs = measure_muscles(osim, model, q)
    names = [muscle.name().to_string() for muscle in muscles]
    assert sorted(names) == sorted(theirs.muscles)
    order = [names.index(name) for name in theirs.muscles]
    off = np.abs(np.array(lengths)[:, order] - theirs.lengths).max(axis=0)
    told = {name: 1e-3 * float(mm) for name, mm in re.findall(r"(\w+) (\d+) mm", said)}
    return dict(zip(theirs.muscles, off.tolist(), strict=True)), told, said


def test_what_biorbd_lacks_is_said_of_each_muscle(tmp_path: Path) -> None:
    import biorbd

    (tmp_path / "leg.osim").write_text(make_muscled(), encoding="utf-8")
    off, told, said = export(tmp_path / "leg.osim", tmp_path)
    assert set(off) == {*WRAPS, "fixed", "conditional", "moving"}
    assert off["fixed"] < 1e-6
    assert {"conditional", "moving", "cylinder"} <= set(told)
    for name in off:
        assert off[name] == pytest.approx(told.get(name, 0.0), abs=NEAR_M)
    assert "no points that move" in said
    assert "no points that are passed in part of a range" in said
    loaded = biorbd.Model(str(tmp_path / "model.bioMod"))
    (fixed,) = (m for m in map(loaded.muscle, range(loaded.nbMuscles())) if m.name().to_string() == "fixed")
    own = fixed.characteristics()
    assert own.forceIsoMax() == pytest.approx(800.0)
    assert own.optimalLength() == pytest.approx(0.1)
    assert own.tendonSlackLength() == pytest.approx(0.14)
    assert own.pennationAngle() == pytest.approx(0.2)


@pytest.mark.parametrize("which", ["gait2354", pytest.param("Rajagopal", marks=pytest.mark.costly)])
def test_muscles_that_are_not_named_are_opensims(which: str, shared_data: Path, tmp_path: Path) -> None:
    off, told, _ = export(shared_data / REAL[which], tmp_path)
    assert max(off[name] for name in off if name not in told) < NEAR_M
    text = (shared_data / REAL[which]).read_text(encoding="utf-8")
    plain = [
        name
        for name, muscle in re.findall(r'<\w+Muscle name="(\w+)">(.*?)</\w+Muscle>', text, re.DOTALL)
        if name in off and not re.search("<PathWrap |<ConditionalPathPoint |<MovingPathPoint ", muscle)
    ]
    assert len(plain) > 0.4 * len(off)
    assert max(off[name] for name in plain) < 1e-6
    assert all(off[name] == pytest.approx(told[name], abs=max(NEAR_M, 0.2 * told[name])) for name in told)
