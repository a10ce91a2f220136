"""Bones from markers, skin and what is published of joints, beside closed forms."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from scaling_service.capabilities.discovery.bones import without_undetermined
from scaling_service.capabilities.discovery.effects.catalogue import propose_candidates
from scaling_service.capabilities.discovery.evidence.fit import SearchContext, SearchTrial, fit_recordings
from scaling_service.capabilities.discovery.laws.bones import BoneKnowledge
from scaling_service.capabilities.discovery.laws.candidates import Estimate
from scaling_service.capabilities.motion.inverse_kinematics import Task
from scaling_service.capabilities.motion.run import track
from scaling_service.core.arrays import Array
from scaling_service.model.anatomy.knees import list_knees, list_secondary_rotations
from scaling_service.model.anatomy.skin import slide_skin
from scaling_service.model.body import BodyModel, Coordinate, Expectation, Joint, Law, Marker, Segment
from scaling_service.model.builtin import load_builtin
from scaling_service.model.compile import compile_model, evaluate_law, list_parameter_values
from scaling_service.model.document import from_document, to_document
from scaling_service.model.people import read_people
from scaling_service.model.trial import Trial
from scaling_service.numerics.multibody.tree import pose_markers

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
    at = 0.01
    tip = np.array([[[np.cos(at), np.sin(at), 0.0]]])
    found = track(body, Trial(name="t", times=np.zeros(1), labels=("tip",), markers=tip, rate_hz=100.0))
    people = read_people()
    # The one marker of a segment: its turn about itself moves nothing
    sd = np.sqrt(people.skin("arm").shift ** 2 + people.skin("arm").single ** 2 + people.noise**2)
    weights = np.array([sd**-2, 0.02**-2])
    assert found.motion.q[0, 0] == pytest.approx(weights @ [at, 0.03] / weights.sum(), abs=1e-5)
    assert found.uncertainty.sd[0, 0] == pytest.approx(weights.sum() ** -0.5, rel=1e-3)


def test_what_an_expectation_follows_moves_with_it() -> None:
    """Two angles of one bone, of which one leads the other by a law: at the law's place nothing pulls."""
    model = _leg(pins=False)
    rotation = next(r for r in list_secondary_rotations(model) if r.law.terms)
    expected = Expectation(rotation.coordinate, rotation.law, np.radians(0.5))
    kept = replace(model, expectations=(expected,))
    task, q = _recorded(model, frames=60)
    names = list(model.coordinate_names)
    flexion, turn = names.index("knee_z"), names.index(rotation.coordinate)
    q[:, flexion] = -np.abs(q[:, flexion])
    q[:, turn] = evaluate_law(rotation.law, {rotation.flexion: q[:, flexion]})
    markers = pose_markers(compile_model(model, model.marker_names), q, list_parameter_values(model))
    trial = Trial(name="t", times=np.arange(60) / 100.0, labels=task.markers, markers=markers, rate_hz=100.0)
    assert np.abs(track(kept, trial).motion.q - q)[:, [flexion, turn]].max() < np.radians(0.02)
    free, held = (track(m, trial).uncertainty.sd[:, turn] for m in (model, kept))
    assert (held < free).all()


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


@pytest.mark.parametrize(("side", "sense"), [("r", 1), ("l", -1)])
def test_the_side_of_a_leg_without_a_name_is_told_by_its_shank(side: str, sense: int) -> None:
    model = load_builtin("lower_limb_14dof")
    bare = {f"femur_{side}": "femur", f"tibia_{side}": "tibia"}
    segments = [s for s in model.segments if s.name in ("pelvis", *bare)]
    markers = [m for m in model.markers if m.segment in ("pelvis", *bare)]
    used = {c for s in segments for j in s.joints for c in j.law.coordinates}
    leg = replace(
        model,
        segments=tuple(
            replace(s, name=bare.get(s.name, s.name), parent=bare.get(s.parent, s.parent)) for s in segments
        ),
        markers=tuple(
            replace(m, name=f"m{k}", segment=bare.get(m.segment, m.segment)) for k, m in enumerate(markers)
        ),
        coordinates=tuple(c for c in model.coordinates if c.name in used),
    )
    (knee,) = list_knees(leg)
    assert knee.side == sense
    thigh_only = leg.with_markers(tuple(m for m in leg.markers if m.segment != "tibia"))
    assert [k.side for k in list_knees(thigh_only)] == [0]


def test_where_the_side_is_not_known_neither_is_the_sense_of_turning() -> None:
    model = _leg("r")
    names = {"femur_r": "femur", "tibia_r": "tibia"}
    bare = replace(
        model,
        segments=tuple(
            replace(s, name=names.get(s.name, s.name), parent=names.get(s.parent, s.parent))
            for s in model.segments
        ),
        markers=tuple(replace(m, segment=names.get(m.segment, m.segment)) for m in model.markers),
    )
    known, unknown = (
        next(r for r in list_secondary_rotations(m) if r.coordinate == "knee_y") for m in (model, bare)
    )
    assert unknown.law == Law()
    assert unknown.sd > 2.0 * known.sd


def test_skin_slides_as_a_mirror_image_on_the_other_side_and_pins_stay() -> None:
    right, left = (slide_skin(_mirror(_leg(side, pins=False), side)) for side in ("r", "l"))
    assert right
    for name, laws in right.items():
        gains = [law.terms[0].gain for law in laws]
        assert [law.terms[0].gain for law in left[name]] == pytest.approx([gains[0], gains[1], -gains[2]])
    assert set(slide_skin(_leg())) == {m.name for m in _leg().markers if m.name.startswith("skin")}


def _mirror(model: BodyModel, side: str) -> BodyModel:
    """Markers of the other side where it is the left."""
    if side == "r":
        return model
    markers = [
        Marker.at(m.name, m.segment, (m.nominal[0], m.nominal[1], -m.nominal[2])) for m in model.markers
    ]
    return model.with_markers(tuple(replace(m, name=m.name.replace("_l_", "_r_")) for m in markers))


def test_a_model_keeps_what_is_known_of_its_bones_on_paper() -> None:
    model = _leg()
    rotation = next(r for r in list_secondary_rotations(model) if r.law.terms)
    expectation = Expectation(rotation.coordinate, rotation.law, 0.07)
    kept = BoneKnowledge(slide_skin(model), (expectation,)).add_to(model)
    assert from_document(to_document(kept)) == kept != model
    assert slide_skin(kept) == {}, "skin that slides already does not slide twice"


def test_what_could_as_well_be_moving_skin_does_not_move_the_bones() -> None:
    """A marker's offset that cannot be told from skin is believed only where nothing else is left."""
    model = _leg(pins=False)
    task, _ = _recorded(model)
    trial = Trial(
        name="t", times=np.arange(300) / 100.0, labels=task.markers, markers=task.measured, rate_hz=100.0
    )
    fit = fit_recordings(SearchContext(model=model, recordings=[SearchTrial(trial, "fit")]))
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


def test_a_shank_of_a_thousand_markers_is_looked_at_at_once() -> None:
    """All triples of them would be a billion."""
    model = _leg("r")
    bare = {"femur_r": "femur", "tibia_r": "tibia"}
    places = np.random.default_rng(0).uniform(-0.3, 0.0, (1000, 3)).tolist()
    crowded = replace(
        model,
        segments=tuple(
            replace(s, name=bare.get(s.name, s.name), parent=bare.get(s.parent, s.parent))
            for s in model.segments
        ),
        markers=tuple(Marker.at(f"m{k}", "tibia", (x, y, z)) for k, (x, y, z) in enumerate(places)),
    )
    assert [knee.side for knee in list_knees(crowded)] == [0]
