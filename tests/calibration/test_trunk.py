"""A whole body with a gait laboratory's markers, none of them on the lower trunk, stands upright."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

import scaling_service as ss
from scaling_service.core.arrays import Array
from scaling_service.model.builtin import load_builtin, lock_unmarked

CHILDREN = ("HC030A", "HC031A", "HC032A", "HC033A", "HC036A", "HC038A")
UPRIGHT_DEG = 10.0  # a person who walks leans less; with the freedom left, by up to 43
LEGS_DEG = 5.0  # from the pelvis' tilt of legs alone; the rigid trunk itself pulls by up to 3.9


def test_a_trunk_bends_in_the_middle_only_where_a_marker_shows_it() -> None:
    model = load_builtin("full_body_35dof")
    own = {m.name: m.segment for m in model.markers}
    whole, notes = lock_unmarked(model, own)
    assert whole == model
    assert notes == ()
    del own["L3"]
    stiff, (note,) = lock_unmarked(model, own)
    assert [c.name for c in stiff.coordinates if c.locked] == ["thoracic_extension"]
    assert "no recording shows a marker on the abdomen" in str(note)
    lighter = {m.segment for m, before in zip(stiff.markers, model.markers, strict=True) if m != before}
    assert lighter == {"torso"}
    legs = load_builtin("lower_limb_14dof")
    assert lock_unmarked(legs, {}) == (legs, ())


@pytest.mark.costly
@pytest.mark.parametrize("child", CHILDREN)
def test_children_stand_and_walk_upright(child: str, shared_data: Path, tmp_path: Path) -> None:
    whole, legs = (
        _tilts(child, model, shared_data, tmp_path) for model in ("full_body_35dof", "lower_limb_feet_18dof")
    )
    for trial, (pelvis, trunk) in whole.items():
        assert abs(np.nanmean(pelvis + trunk)) < UPRIGHT_DEG, trial
        if trial != "standing":
            assert np.sqrt(np.nanmean((pelvis - legs[trial][0]) ** 2)) < LEGS_DEG, trial


def _tilts(child: str, model: str, data: Path, folder: Path) -> dict[str, tuple[Array, Array]]:
    """Of pelvis and, against it, trunk in every recording, deg."""
    folder_of = data / "clinic" / child
    if not folder_of.is_dir():
        pytest.skip(f"no recordings at {folder_of}")
    standing, *walks = (str(file) for file in sorted(folder_of.glob("*.c3d")))
    document = {
        "subject": {"id": child},
        "model": model,
        "trials": {"static": standing, "calibration": walks},
    }
    file = folder / f"{model}.json"
    file.write_text(json.dumps(document), encoding="utf-8")
    results = ss.scale(file, "MB")
    scaled, session = results.scalings["MB"].calibration.model, results.session
    assert session.static is not None
    found = {}
    for name, trial in (("standing", session.static), *((t.name, t) for t in session.calibration)):
        motion = ss.inverse_kinematics(scaled, trial)
        q = dict(zip(motion.coordinates, np.degrees(motion.q.T), strict=True))
        found[name] = (q["pelvis_tilt"], q.get("lumbar_extension", np.zeros(len(motion.q))))
    return found
