"""Bones from markers, skin and what is published of joints, beside closed forms and bones of known pose."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from scaling_service.capabilities.discovery.bones import BoneKnowledge, learn_bones, without_undetermined
from scaling_service.capabilities.discovery.effects.catalogue import propose_candidates
from scaling_service.capabilities.discovery.evidence.fit import Recording, SearchContext, fit_recordings
from scaling_service.capabilities.discovery.laws.candidates import Estimate
from scaling_service.capabilities.discovery.options import AS_MEASURED, DiscoverSettings
from scaling_service.capabilities.discovery.start import prepare
from scaling_service.capabilities.motion.bones import Posed, estimate_bones, learn_skin_sizes
from scaling_service.capabilities.motion.inverse_kinematics import Task
from scaling_service.capabilities.motion.run import ik, track
from scaling_service.capabilities.motion.uncertainty import SkinField, list_skin_fields
from scaling_service.capabilities.subject.loading import open_subject
from scaling_service.core.arrays import Array
from scaling_service.core.progress import show_nothing
from scaling_service.model.anatomy.secondary import list_secondary_rotations
from scaling_service.model.body import BodyModel, Coordinate, Expectation, Joint, Law, Marker, Segment
from scaling_service.model.compile import compile_model, evaluate_law, list_parameter_values
from scaling_service.model.document import from_document, to_document
from scaling_service.model.poses import pose_segments
from scaling_service.model.trial import Trial
from scaling_service.numerics.multibody.tree import pose_markers
from tests.capabilities.test_skin import HELD_OUT, true_rotations

AXES = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}


def _leg(side: str = "r", markers: int = 6, pins: bool = True) -> BodyModel:
    """Pelvis, femur and tibia with balls for joints; four pins (or skin markers) on each but the femur."""
    rng = np.random.default_rng(4)
    root = [Joint("rotation", AXES[a], Law.of(f"root_{a}")) for a in "zxy"]
    root += [Joint("translation", AXES[a], Law.of(f"root_t{a}")) for a in "xyz"]
    segments, names = (
        [Segment(name="pelvis", parent="ground", joint_name="root", joints=tuple(root))],
        [f"root_{a}" for a in "zxy"],
    )
    for name, parent, joint in (("femur", "pelvis", "hip"), ("tibia", "femur", "knee")):
        down = Joint("translation", AXES["y"], Law.constant(-0.4 if name == "tibia" else -0.1))
        turns = tuple(Joint("rotation", AXES[a], Law.of(f"{joint}_{a}")) for a in "zxy")
        tail = "" if parent == "pelvis" else f"_{side}"
        segments.append(
            Segment(
                name=f"{name}_{side}",
                parent=parent + tail,
                joint_name=f"{joint}_{side}",
                joints=(down, *turns),
            )
        )
        names += [f"{joint}_{a}" for a in "zxy"]
    coordinates = [Coordinate(name=n) for n in names]
    coordinates += [Coordinate(name=f"root_t{a}", kind="translation") for a in "xyz"]
    label = "{}_{}_pin" if pins else "{}_{}"
    placed = [
        Marker.at(label.format(s, k) if s != f"femur_{side}" else f"skin_{k}", s, at, weight=1.0)
        for s, middle in (("pelvis", 0.0), (f"femur_{side}", -0.2), (f"tibia_{side}", -0.2))
        for k, at in enumerate(
            [(x, middle + y, z) for x, y, z in rng.uniform(-0.1, 0.1, (markers, 3)).tolist()]
        )
    ]
    return BodyModel(
        name="leg", segments=tuple(segments), coordinates=tuple(coordinates), markers=tuple(placed)
    )


def _recorded(model: BodyModel, skin: Array | None = None, frames: int = 300) -> tuple[Task, Array]:
    """Joints that swing, 0.2 mm of noise, and skin (n_frames, n_markers, 3), m, in ground."""
    rng, time = np.random.default_rng(1), np.arange(frames) / 100.0
    q = np.zeros((frames, len(model.coordinates)))
    for k in range(q.shape[1] - 3):
        q[:, k] = 0.3 * np.sin(2.0 * np.pi * (0.3 + 0.1 * k) * time)
    markers = pose_markers(compile_model(model, model.marker_names), q, list_parameter_values(model))
    markers += rng.normal(0.0, 2e-4, markers.shape) + (0.0 if skin is None else skin)
    return Task.of(
        model, Trial(name="t", times=time, labels=model.marker_names, markers=markers, rate_hz=100.0)
    ), q


def _field(task: Task, sd: float, names: str = "") -> SkinField:
    rows = np.array([k for k, name in enumerate(task.markers) if name.startswith(names)])
    return SkinField(rows, sd**2 * np.eye(len(rows)))


def test_markers_that_err_alike_and_nothing_expected_give_the_plain_motion() -> None:
    model = _leg(pins=False)
    noise = np.random.default_rng(2).normal(0.0, 5e-3, (300, len(model.markers), 3))
    task, _ = _recorded(model, noise)
    plain = track(
        model,
        Trial(
            name="t", times=np.arange(300) / 100.0, labels=task.markers, markers=task.measured, rate_hz=100.0
        ),
        skin=False,
    )
    held = np.zeros(plain.motion.q.shape, dtype=bool)
    found = estimate_bones(Posed(task, plain.motion.q + 0.01, held), [_field(task, 0.01)])
    assert np.abs(found.q - plain.motion.q).max() < 1e-4


def test_an_expectation_counts_by_the_inverse_of_its_variance() -> None:
    """One angle, measured with one deviation and expected with another: the posterior of two Gaussians."""
    joint = Joint("rotation", AXES["z"], Law.of("angle"))
    body = BodyModel(
        name="pointer",
        segments=(Segment(name="arm", parent="ground", joint_name="pivot", joints=(joint,)),),
        coordinates=(Coordinate(name="angle"),),
        markers=(Marker.at("tip", "arm", (1.0, 0.0, 0.0)),),
        expectations=(Expectation("angle", Law.constant(0.03), 0.02),),
    )
    at, sd = 0.01, float(np.hypot(0.01, 1e-3))  # 1 mm: what cameras add
    tip = np.array([[[np.cos(at), np.sin(at), 0.0]]])
    task = Task.of(body, Trial(name="t", times=np.zeros(1), labels=("tip",), markers=tip, rate_hz=100.0))
    found = estimate_bones(Posed(task, np.zeros((1, 1)), np.zeros((1, 1), dtype=bool)), [_field(task, 0.01)])
    weights = np.array([sd**-2, 0.02**-2])
    assert found.q[0, 0] == pytest.approx(weights @ [at, 0.03] / weights.sum(), abs=1e-5)
    assert found.sd[0, 0] == pytest.approx(weights.sum() ** -0.5, rel=1e-3)


def test_sizes_of_skin_between_pinned_bones_are_those_put_in_and_without_pins_none_are_learnt() -> None:
    rng = np.random.default_rng(3)
    for pins in (True, False):
        model = _leg(pins=pins)
        names = [m.name for m in model.markers]
        true = {n: 2e-3 * (1 + k) for k, n in enumerate(n for n in names if n.startswith("skin"))}
        sd = np.array([true.get(n, 0.0) for n in names])
        task, q = _recorded(model, rng.normal(size=(300, len(names), 3)) * sd[:, None])
        held = np.zeros(q.shape, dtype=bool)
        fields = [_field(task, 8e-3, "skin")] if pins else list(list_skin_fields(task))
        learnt = learn_skin_sizes([Posed(task, q, held)], [fields])
        assert set(learnt) == (set(true) if pins else set())
        for name, size in learnt.items():
            assert size == pytest.approx(true[name], rel=0.15), name


@pytest.mark.parametrize("side", ["r", "l"])
def test_a_tibia_turns_inwards_as_its_knee_flexes(side: str) -> None:
    """Walker 1988: 13.2 deg at 60 deg of flexion, inwards on either side."""
    model = _leg(side)
    found = {r.coordinate: r for r in list_secondary_rotations(model)}
    assert set(found) == {"knee_x", "knee_y"}
    assert found["knee_x"].law == Law()
    law = found["knee_y"].law
    inwards = np.degrees([evaluate_law(law, {"knee_z": np.radians(-f)}) for f in (0.0, 60.0)])
    assert inwards == pytest.approx([0.0, 13.18 if side == "r" else -13.18], abs=0.02)


def test_a_model_keeps_what_is_known_of_its_bones_on_paper() -> None:
    model = _leg()
    rotation = next(r for r in list_secondary_rotations(model) if r.law.terms)
    known = BoneKnowledge({"skin_0": 0.004}, (Expectation(rotation.coordinate, rotation.law, 0.07),))
    kept = known.add_to(model)
    assert from_document(to_document(kept)) == kept != model
    assert known.add_to(kept) == kept
    assert BoneKnowledge().add_to(kept) == model


def test_what_could_as_well_be_moving_skin_does_not_move_the_bones() -> None:
    """A marker's offset that cannot be told from skin is believed only where nothing else is left."""
    model = _leg(pins=False)
    task, _ = _recorded(model)
    trial = Trial(
        name="t", times=np.arange(300) / 100.0, labels=task.markers, markers=task.measured, rate_hz=100.0
    )
    fit = fit_recordings(SearchContext(model=model, recordings=[Recording(trial, "fit")]))
    kinds = ("marker_offset", "soft_tissue_artefact")
    offset, skin = (
        next(c for c in propose_candidates(fit.scene, [k]) if c.where == ("skin_0",) and not c.trials)
        for k in kinds
    )
    fit = replace(fit, effects=(Estimate(offset, np.full(3, 0.005)),))
    for equivalents, left_mm, kept in (({skin: 0.3}, 5.0, False), ({skin: 0.3}, 1.1, True), ({}, 5.0, True)):
        levels = {"skin_0": SimpleNamespace(after=left_mm / 1e3, floor=1e-3)}
        gap = SimpleNamespace(places=levels)
        named = (SimpleNamespace(key=offset.key, equivalents=equivalents),)
        found: Any = SimpleNamespace(named=named, fit=gap, held_out=gap)
        lasting, left_out = without_undetermined(fit, found)
        assert (len(lasting.effects) == 1) is kept
        assert left_out == (() if kept else (offset.name,))


@pytest.fixture(scope="module")
def living(shared_data: Path) -> dict[str, tuple[float, float]]:
    """Set to the error of the bones (deg) before and after, held out; sizes learnt without a search."""
    root, found = shared_data / "living_bone", {}
    if not root.is_dir():
        pytest.skip("recordings over bones of known pose are not here")
    for name, trial in HELD_OUT.items():
        loaded = open_subject(root / name / "subject.yaml", AS_MEASURED)
        made = prepare(loaded, DiscoverSettings(start="none"), AS_MEASURED, 0.5, show_nothing)
        model = made.model
        known = learn_bones(model, fit_recordings(SearchContext(model=model, recordings=made.recordings)))
        before = ik(root / name / "model.osim", [root / name / f"{trial}.trc"])
        measured = before.loaded.session.evaluation[0]
        true = true_rotations(root / name / f"{trial}_bones.csv")
        after = track(known.add_to(replace(before.loaded.session.model)), measured)
        found[name] = (
            _bone_error(before.loaded.session.model, before.trials[trial].motion.q, true),
            _bone_error(model, after.motion.q, true),
        )
    return found


def test_bones_come_nearer_to_where_pins_and_fluoroscopy_saw_them(
    living: dict[str, tuple[float, float]],
) -> None:
    ratios = {name: after / before for name, (before, after) in living.items()}
    assert np.exp(np.mean(np.log(list(ratios.values())))) <= 0.75, ratios
    assert max(ratios.values()) <= 1.03, ratios


def _bone_error(model: BodyModel, q: Array, true: dict[str, Array]) -> float:
    """RMS angle between found and true turn of every bone against its parent, deg."""
    poses, names = pose_segments(model, q), list(model.segment_names)
    squares = []
    for parent, child in zip(true, list(true)[1:], strict=False):
        found = [_matrices(poses[:, names.index(bone), 3:]) for bone in (parent, child)]
        n = min(len(q), len(true[child]))
        turns = [np.einsum("nji,njk->nik", a[:n], b[:n]) for a, b in (found, (true[parent], true[child]))]
        cosine = (np.einsum("nij,nij->n", *turns) - 1.0) / 2.0
        squares.append(np.arccos(np.clip(cosine, -1.0, 1.0)) ** 2)
    return float(np.degrees(np.sqrt(np.nanmean(squares))))


def _matrices(quaternions: Array) -> Array:
    """Rotation matrices (n, 3, 3) of quaternions x y z w."""
    x, y, z, w = quaternions.T
    rows = (
        (1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)),
        (2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)),
        (2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)),
    )
    return np.moveaxis(np.array(rows), -1, 0)
