"""The joint posterior on persons whose bodies are known, drawn by code of its own (``tests/oracle``)."""

from __future__ import annotations

import json
from functools import cache

import numpy as np
import pytest

from scaling_service.capabilities.motion.run import track
from scaling_service.capabilities.scaling.methods.table import calibrate
from scaling_service.capabilities.subject.loading import open_subject
from scaling_service.model.anatomy.lengths import measure_segment_lengths
from scaling_service.model.builtin import load_builtin
from scaling_service.model.document import from_document, to_document
from scaling_service.model.results import Calibration
from scaling_service.model.subject import Session, Subject
from scaling_service.model.trial import Trial
from tests.oracle.persons import RATE_HZ, Person, World, draw_person

N_PERSONS = 12
LENGTHS = {"femur_r": "femur_r", "femur_l": "femur_l", "shank_r": "tibia_r", "shank_l": "tibia_l"}


def record(person: Person) -> Session:
    model = load_builtin("lower_limb_14dof")
    trials = {
        name: Trial(
            name=name, times=t, labels=tuple(at), markers=np.stack(list(at.values()), axis=1), rate_hz=RATE_HZ
        )
        for name, (t, at) in person.trials.items()
    }
    clusters = {n: s for n, s in person.segments.items() if n not in model.marker_names}
    subject = Subject("V", model.name, sex=person.sex, height_m=person.height, extra_markers=clusters)
    return Session(
        subject=subject,
        model=model,
        static=trials["static"],
        calibration=(trials["functional_r"], trials["functional_l"]),
        evaluation=(trials["walk"],),
    )


@cache
def people() -> tuple[tuple[Person, dict[str, Calibration]], ...]:
    found = []
    for seed in range(N_PERSONS):
        person, done = draw_person(seed), {}
        calibrate(record(person), "MAP", known=done)
        found.append((person, done))
    return tuple(found)


def errors(method: str) -> dict[str, np.ndarray]:
    """Millimetres, by length, over the persons."""
    return {
        name: np.array(
            [1e3 * (measure_segment_lengths(d[method].model)[name] - p.lengths[name]) for p, d in people()]
        )
        for name in (*LENGTHS, "inter_hip")
    }


def rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


@pytest.mark.parametrize(("kind", "names"), [("shank", ["shank_r", "shank_l"]), ("hips", ["inter_hip"])])
def test_nearer_than_linear_scaling(kind, names):
    ours, linear = errors("MAP"), errors("MB")
    assert rms([ours[n] for n in names]) < 0.8 * rms([linear[n] for n in names])


def test_femora_are_no_further_off_than_those_of_linear_scaling():
    ours, linear = errors("MAP"), errors("MB")
    assert rms([ours["femur_r"], ours["femur_l"]]) < rms([linear["femur_r"], linear["femur_l"]])


def test_stated_deviations_of_lengths_cover():
    """95 % intervals of 48 lengths; in these persons skin is at the top of what was published."""
    inside = []
    for name, segment in LENGTHS.items():
        for error, (_, done) in zip(errors("MAP")[name], people(), strict=True):
            start = measure_segment_lengths(done["MB"].model)[name]
            (sd,) = (p.sd for p in done["MAP"].parameters if p.name == f"scale.{segment}")
            inside.append(abs(error) < 1.96 * 1e3 * sd * start)
    assert np.mean(inside) > 0.85


def pooled_coverage(quantile: float) -> float:
    """Share of frames and angles of walks, not fitted, that lie within a quantile of the stated deviation."""
    inside = []
    for person, done in people():
        model = from_document(json.loads(json.dumps(to_document(done["MAP"].model))))
        found = track(model, record(person).evaluation[0])
        for name, true in person.angles["walk"].items():
            k = found.motion.coordinates.index(name)
            off = np.abs(found.motion.q[:, k] - true)
            inside.append(np.mean(off <= quantile * found.uncertainty.sd[:, k]))
    return float(np.mean(inside))


@pytest.mark.parametrize(("quantile", "low", "high"), [(1.96, 0.88, 0.99), (0.6745, 0.40, 0.62)])
def test_stated_deviations_of_angles_cover(quantile, low, high):
    """Of a walk that was not fitted, by the model as it is read again from its file."""
    assert low <= pooled_coverage(quantile) <= high


@pytest.mark.parametrize("skin", [0.3, 1.8])
def test_how_much_skin_moves_is_learnt(skin):
    """Where cameras are as noisy as the estimate takes them to be; less noise is taken for less skin."""
    levels = [
        calibrate(record(draw_person(3, World(skin=size, noise_m=0.0005))), "MAP").model.posterior.skin
        for size in (skin, 1.0)
    ]
    assert levels[0] / levels[1] == pytest.approx(skin, rel=0.15)


def test_where_skin_hardly_moves_bones_are_found():
    person = draw_person(3, World(skin=0.02))
    model = calibrate(record(person), "MAP").model
    for name in ("femur_r", "femur_l"):
        assert abs(measure_segment_lengths(model)[name] - person.lengths[name]) < 0.003


def test_recordings_say_more_than_people_do():
    for _, done in people():
        known = {p.name: p for p in done["MAP"].parameters}
        assert known["scale.tibia_r"].identifiable
        assert known["scale.tibia_r"].sd < 0.02


def test_real_patient_of_whom_there_are_images(jia_without_images, shared_data):
    """Markers alone, against the expert's joint centres on her MRI: within two stated deviations."""
    done: dict[str, Calibration] = {}
    found = calibrate(jia_without_images, "MAP", known=done)
    expert = json.loads((shared_data / "jia_mri" / "reference_joints.json").read_text())["manual"]
    at = {joint: np.array(entry["centre_mm"]) for joint, entry in expert.items()}
    ours, start = (measure_segment_lengths(c.model) for c in (found, done["MB"]))
    sds = {p.name: p.sd for p in found.parameters}
    for name, segment, ends in (
        ("femur_r", "femur_r", ("hip_r", "knee_r")),
        ("shank_r", "tibia_r", ("knee_r", "ankle_r")),
    ):
        true = float(np.linalg.norm(at[ends[0]] - at[ends[1]]))
        assert abs(1e3 * ours[name] - true) < 2.0 * 1e3 * sds[f"scale.{segment}"] * start[name]
    assert abs(1e3 * ours["shank_r"] - np.linalg.norm(at["knee_r"] - at["ankle_r"])) < 6.0


@pytest.fixture
def jia_without_images(tmp_path, shared_data) -> Session:
    folder = shared_data / "jia_mri"
    clusters = {
        s + n: f"{b}_{s.lower()}"
        for s in "RL"
        for n, b in (("THI", "femur"), ("TUB", "tibia"), ("SHN", "tibia"))
    }
    file = tmp_path / "subject.yaml"
    trials = {"static": "Static.c3d", "calibration": ["Walking02.c3d"], "evaluation": ["Walking01.c3d"]}
    paths = {
        k: [str(folder / f) for f in v] if isinstance(v, list) else str(folder / v) for k, v in trials.items()
    }
    document = {
        "subject": {"id": "patient", "height_m": 1.62, "mass_kg": 63.0},
        "model": "lower_limb_14dof",
        "extra_markers": clusters,
        "trials": paths,
    }
    file.write_text(json.dumps(document))
    return open_subject(file).session
