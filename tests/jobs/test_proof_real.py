"""A look at the files of persons who were really recorded."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

from scaling_service.capabilities.intake.result import ProofDocument
from scaling_service.capabilities.intake.run import prove


def proof(data: Path, name: str, scratch: Path) -> ProofDocument:
    """All files of a dataset, uploaded without folders."""
    folder = scratch / "in"
    folder.mkdir()
    for file in (data / name).rglob("*"):
        if file.is_file():
            shutil.copy(file, folder / file.name)
    return prove(folder, {"subject": {"id": name}}, scratch)


@pytest.mark.costly
def test_a_walker_with_bones(shared_data: Path, tmp_path: Path) -> None:
    found = proof(shared_data, "jia_mri", tmp_path)
    assert [p for p in found.problems if p.severity == "error"] == []
    assert found.proposal is not None
    assert found.proposal["trials"] == {
        "static": "Static.c3d",
        "calibration": ["Walking02.c3d", "Walking04.c3d"],
        "evaluation": ["Walking01.c3d"],
    }
    assert set(found.proposal["bones"]) == {"units", "pelvis", "femur_r", "tibia_r", "talus_r"}
    assert all(m.label is not None for m in found.markers)
    walking = next(r for r in found.recordings if r.name == "Walking01")
    assert [len(p.corners_m or []) for p in walking.plates] == [4, 4]
    sizes = [np.ptp(p.corners_m or [], axis=0) for p in walking.plates]
    assert np.allclose([s[[0, 2]] for s in sizes], [0.6, 0.4], atol=0.005)  # of two such plates, lying flat
    sides = {e.label: e.segment for e in found.extra_markers}
    assert (sides["RTHI"], sides["LSHN"]) == ("femur_r", "tibia_l")


def test_a_squatter_with_a_model_of_the_whole_body(shared_data: Path, tmp_path: Path) -> None:
    found = proof(shared_data, "opencap_squat", tmp_path)
    assert found.proposal is not None
    assert found.proposal["model"] == "unscaled_generic.osim"
    assert found.proposal["forces"] == {
        "squats1.trc": "squats1_grf.mot",
        "walking1.trc": "walking1_grf.mot",
    }
    assert found.proposal["trials"]["calibration"] == ["squats1.trc"]
    walk = next(r for r in found.recordings if r.name == "walking1")
    assert walk.direction is not None
    assert walk.direction[0] > 0.99


def test_a_scale_set_up_tells_height_and_mass(shared_data: Path, tmp_path: Path) -> None:
    found = proof(shared_data, "gait2354", tmp_path)
    assert found.proposal is not None
    assert found.proposal["subject"] == {"id": "gait2354", "height_m": 1.803, "mass_kg": 72.6}
    assert found.sizes is not None
    assert found.sizes.source == ["subject01_Setup_Scale.xml"]
    assert all(entry.ready for entry in found.readiness)


def test_a_walker_whose_forearms_show_no_marker_is_ready(shared_data: Path, tmp_path: Path) -> None:
    """His legs are fine: the forearms alone are told apart, and nothing waits for them."""
    found = proof(shared_data, "rajagopal_walk", tmp_path)
    assert [entry.analysis for entry in found.readiness if entry.ready] == [
        "comparisons",
        "discoveries",
        "dynamics",
        "consistent-motions",
    ]
    assert found.headline.startswith("Everything can run")
    for entry in found.readiness:
        segments = next(need for need in entry.needs if need.name == "segments")
        assert not segments.there
        assert segments.text.startswith(
            "no marker shows right radius, left radius in the movements: how they turn is not told, "
            "all else is"
        )
