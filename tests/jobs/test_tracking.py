"""A model that exists follows recordings: whatever wrote it, and whatever is wrong with what is given."""

from __future__ import annotations

import json
import pickle
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from scaling_service.capabilities.discovery.models import correct_model
from scaling_service.capabilities.motion.options import MotionOptions
from scaling_service.capabilities.motion.run import ik
from scaling_service.capabilities.motion.saving import save_motions
from scaling_service.capabilities.scaling.run import scale
from scaling_service.capabilities.scaling.saving import save
from scaling_service.core.errors import FileUnreadable, InputError
from scaling_service.files.sto import read_sto
from scaling_service.files.trc import read_trc, write_trc
from scaling_service.model.builtin import load_builtin
from scaling_service.model.document import to_document
from tests.jobs.hidden_case import found, session
from tests.jobs.laboratory import document, laboratory, write_subject

MEASURED = MotionOptions(smooth_hz=0.0)


@pytest.fixture(scope="module")
def scaled(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A laboratory with a person scaled by one method under ``scaled``."""
    folder = tmp_path_factory.mktemp("laboratory")
    save(scale(laboratory(folder), "MB_am"), folder / "scaled")
    return folder


def test_the_scaled_model_has_the_errors_and_the_motion_that_scaling_reported(scaled: Path) -> None:
    reported = json.loads((scaled / "scaled/MB_am/scaling.json").read_text(encoding="utf-8"))[
        "kinematic_error_mm"
    ]
    tracked = ik(scaled / "scaled/MB_am/model.json", [scaled / "walk.trc", scaled / "hips.trc"])
    written = save_motions(tracked, scaled / "again")
    for trial in ("walk", "hips"):
        error = written.trials[trial].kinematic_error_mm
        assert error.mean == pytest.approx(reported[trial]["mean"], abs=1e-4)
        assert error.per_marker == pytest.approx(reported[trial]["per_marker"], abs=1e-4)
        before = read_sto(scaled / f"scaled/MB_am/{trial}_ik.mot")
        again = read_sto(scaled / f"again/{trial}_ik.mot")
        assert again.columns == before.columns == read_sto(scaled / f"again/{trial}_ik_sd.mot").columns
        assert again.data == pytest.approx(before.data, abs=1e-6)
    assert set(written.files) == {f"{t}_ik{end}.mot" for t in ("walk", "hips") for end in ("", "_sd")}
    assert written.markers_used["RLFE"] == ["S01:RKNE"]
    assert str(scaled / "walk.trc") in written.input_hashes
    sent = pickle.loads(pickle.dumps(tracked))  # to another process
    np.testing.assert_array_equal(sent.trials["walk"].motion.q, tracked.trials["walk"].motion.q)


@pytest.mark.parametrize(("size", "told"), [(1.0, set()), (1.15, {"another_person"})])
def test_a_recording_of_another_person_than_the_model_s_is_told(
    scaled: Path, tmp_path: Path, size: float, told: set[str]
) -> None:
    walk = read_trc(scaled / "walk.trc")
    write_trc(tmp_path / "walk.trc", walk.with_markers(size * walk.markers), "mm")
    tracked = ik(scaled / "scaled/MB_am/model.json", [tmp_path / "walk.trc"])
    notes = [note for note in tracked.loaded.session.notes if note.code == "another_person"]
    assert {note.code for note in notes} == told
    assert all(note.place == "walk" and "the model" in note.problem for note in notes)


def test_a_subject_file_may_name_a_model_that_scaling_wrote(scaled: Path) -> None:
    content = document(model="scaled/MB_am/model.json")
    reported = json.loads((scaled / "scaled/MB_am/scaling.json").read_text(encoding="utf-8"))[
        "kinematic_error_mm"
    ]
    results = scale(write_subject(scaled, content), "MB")
    assert results.session.model.source == load_builtin("lower_limb_14dof").source
    saved = save(results, scaled / "from_json")
    # It has this person's size, so that scaling it once more changes little.
    lengths = saved.methods["MB"].scale_factors
    assert all(factor == pytest.approx(1.0, abs=0.05) for factors in lengths.values() for factor in factors)
    assert saved.methods["MB"].kinematic_error_mm["walk"].mean < reported["walk"]["mean"] + 10.0
    assert "scaled/MB_am/model.json" in saved.input_hashes
    write_subject(scaled, document())


def test_laws_of_skin_that_the_search_named_are_followed(tmp_path: Path) -> None:
    model = correct_model(found().after)
    assert any(not law.is_constant for marker in model.markers for law in marker.laws)
    (tmp_path / "model.json").write_text(json.dumps(to_document(model)), encoding="utf-8")
    walk = session().evaluation[0]
    write_trc(tmp_path / "walk.trc", walk)
    plain = (tmp_path / "plain.json", found().before.model)
    plain[0].write_text(json.dumps(to_document(plain[1])), encoding="utf-8")
    with_skin, without = (
        ik(file, [tmp_path / "walk.trc"], MEASURED).trials["walk"]
        for file in (tmp_path / "model.json", plain[0])
    )
    assert np.isfinite(with_skin.uncertainty.sd).all()
    assert with_skin.error.mean < 0.8 * without.error.mean
    assert with_skin.error.per_marker["RLFE"] < 0.6 * without.error.per_marker["RLFE"]


def test_a_marker_that_a_recording_lacks_is_reported_and_the_rest_is_followed(
    scaled: Path, tmp_path: Path
) -> None:
    whole = read_trc(scaled / "walk.trc")
    kept = [label for label in whole.labels if label != "S01:RKNE"]
    write_trc(tmp_path / "walk.trc", replace(whole.select(kept), name="walk"))
    model = scaled / "scaled/MB_am/model.json"
    tracked = ik(model, [tmp_path / "walk.trc"])
    assert any("no recording shows RLFE" in note for note in tracked.loaded.session.warnings)
    assert "RLFE" not in tracked.trials["walk"].motion.markers
    whole_sd = ik(model, [scaled / "walk.trc"]).trials["walk"]
    knee = whole_sd.motion.coordinates.index("knee_angle_r")
    assert np.isfinite(tracked.trials["walk"].uncertainty.sd[:, knee]).all()


def test_a_label_can_be_mapped(scaled: Path, tmp_path: Path) -> None:
    whole = read_trc(scaled / "walk.trc")
    write_trc(tmp_path / "walk.trc", whole.relabel({"S01:RKNE": "mine"}))
    model = scaled / "scaled/MB_am/model.json"
    tracked = ik(model, [tmp_path / "walk.trc"], MotionOptions(markers={"RLFE": "mine"}))
    assert tracked.loaded.markers_used["RLFE"] == ("mine",)
    assert tracked.trials["walk"].error.mean == pytest.approx(
        ik(model, [scaled / "walk.trc"]).trials["walk"].error.mean, abs=1e-9
    )


WRONG: list[tuple[str, Callable[[], Any], type[InputError], str]] = [
    ("no JSON", lambda: "segments: [", FileUnreadable, "not JSON"),
    ("nested too deep", lambda: "[" * 100_000, FileUnreadable, "not JSON"),
    ("a list", lambda: "[1, 2]", FileUnreadable, "not a model"),
    (
        "results",
        lambda: {"code_version": "1", "subject": "S01", "trials": {}},
        FileUnreadable,
        "a document of results",
    ),
    ("a subject file", lambda: document(), FileUnreadable, "a subject file"),
    (
        "another version",
        lambda: to_document(load_builtin("squat_4dof")) | {"schema_version": 9},
        InputError,
        "version 9",
    ),
    (
        "an unknown key",
        lambda: to_document(load_builtin("squat_4dof")) | {"colour": "red"},
        InputError,
        "colour",
    ),
    (
        "an endless number",
        lambda: json.dumps(to_document(load_builtin("squat_4dof"))).replace("0.4", "1e999", 1),
        InputError,
        "number",
    ),
]


@pytest.mark.parametrize(("content", "kind", "said"), [w[1:] for w in WRONG], ids=[w[0] for w in WRONG])
def test_what_is_no_model_is_refused_by_name(
    content: Callable[[], Any], kind: type[InputError], said: str, tmp_path: Path
) -> None:
    made = content()
    file = tmp_path / "model.json"
    file.write_text(made if isinstance(made, str) else json.dumps(made), encoding="utf-8")
    with pytest.raises(kind, match=said) as caught:
        ik(file, [tmp_path / "walk.trc"])
    assert caught.value.file == str(file)
    assert caught.value.remedy


def test_what_does_not_go_together_is_refused(scaled: Path, tmp_path: Path) -> None:
    walk = scaled / "walk.trc"
    with pytest.raises(InputError, match="is no model"):
        ik("lower_limb_15dof", [walk])
    with pytest.raises(InputError, match="no recording is given"):
        ik("lower_limb_14dof", [])
    with pytest.raises(InputError, match="same name without suffix"):
        ik("lower_limb_14dof", [walk, tmp_path / "walk.c3d"])
    with pytest.raises(InputError, match=r"\.osim models only"):
        ik("lower_limb_14dof", [walk], marker_set=tmp_path / "markers.xml")
    with pytest.raises(FileUnreadable, match="no such file"):
        ik("lower_limb_14dof", [tmp_path / "absent.trc"])
    with pytest.raises(FileUnreadable, match="no such file"):
        ik(tmp_path / "absent.json", [walk])
