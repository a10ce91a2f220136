"""Inertial tables on models of any size: published totals, sizes, sides, and what cannot be a body."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import yaml

from scaling_service.core.errors import InputError
from scaling_service.model.anatomy.inertia import apply_inertia_table, find_possible_tensor
from scaling_service.model.anatomy.inertia_planar import apply_to_squat
from scaling_service.model.body import BodyModel, Law
from scaling_service.model.builtin import load_builtin, load_generic_person
from scaling_service.model.inertia import TABLE_NAMES, gather_inertias, read_inertia_table, sum_mass
from scaling_service.model.reference import find_reference_folder

BODY = load_builtin("full_body_35dof")


def applied(table: str = "dumas2007", sex: str = "M", model: BodyModel = BODY):  # type: ignore[no-untyped-def]
    return apply_inertia_table(model, table, sex=sex, height_m=1.762, mass_kg=67.3)  # type: ignore[arg-type]


def larger(model: BodyModel, factor: float) -> BodyModel:
    """The same person seen through a magnifying glass."""
    segments = tuple(
        replace(
            s,
            joints=tuple(
                replace(j, law=j.law.scale(factor)) if j.kind == "translation" else j for j in s.joints
            ),
        )
        for s in model.segments
    )
    markers = tuple(
        replace(m, laws=tuple(Law(law.terms).scale(factor) for law in m.laws)) for m in model.markers
    )
    return replace(model, segments=segments, markers=markers)


@pytest.mark.parametrize("table", TABLE_NAMES)
@pytest.mark.parametrize("sex", ["F", "M"])
def test_masses_sum_to_the_persons_and_every_body_is_possible(table: str, sex: str) -> None:
    result = applied(table, sex)
    assert sum_mass(result.model) == pytest.approx(67.3, rel=1e-12)
    for tensor in gather_inertias(result.model).tensor:
        assert not find_possible_tensor(tensor)[1]
        assert (np.linalg.eigvalsh(tensor) > 0).all()
    assert result.notes[: len(read_inertia_table(table).notes)] == read_inertia_table(table).notes


@pytest.mark.parametrize(
    ("table", "sums"),
    [
        ("dumas2007", {"F": 99.9, "M": 100.2}),
        ("dumas_wojtusch2018", {"F": 100.4, "M": 100.2}),
        ("deleva1996", {"F": 99.99, "M": 100.0}),
        ("winter2009", {"F": 100.0, "M": 100.0}),
    ],
)
def test_rows_sum_to_what_the_publications_sum_to(table: str, sums: dict[str, float]) -> None:
    for sex, total in sums.items():
        rows = [r for r in read_inertia_table(table).rows if r.sex == sex]
        limbs = {"upper_arm", "forearm", "hand", "thigh", "shank", "foot"}
        found = sum(r.mass_pct * (2 if r.segment in limbs else 1) for r in rows)
        assert found == pytest.approx(total, abs=0.011)


def test_without_a_sex_inertia_lies_midway_and_says_so() -> None:
    woman, man = (applied("dumas2007", sex).model for sex in "FM")
    result = apply_inertia_table(BODY, "dumas2007", sex=None, height_m=1.762, mass_kg=67.3)
    assert sum_mass(result.model) == pytest.approx(67.3)
    assert any("sex is not given" in note for note in result.notes)
    for one, other, between in zip(
        gather_inertias(woman).tensor,
        gather_inertias(man).tensor,
        gather_inertias(result.model).tensor,
        strict=True,
    ):
        np.testing.assert_allclose(between, 0.5 * (one + other), atol=1e-12)
        assert not find_possible_tensor(between)[1]


def test_the_built_in_models_are_the_table_at_their_own_size() -> None:
    # Feet, head, pelvis and hands have lengths of the mean subject there, and here the model's own.
    result = applied()
    factor = sum_mass(result.model) / sum_mass(BODY)
    for name in ("femur_r", "tibia_l", "abdomen", "torso", "humerus_r", "ulna_l", "calcn_r", "head"):
        ours, own = result.model.segment(name), BODY.segment(name)
        assert ours.mass == pytest.approx(factor * own.mass, rel=1e-9)
        np.testing.assert_allclose(ours.com, own.com, atol=1e-4)
        np.testing.assert_allclose(ours.inertia, factor * np.array(own.inertia), rtol=2e-3, atol=1e-9)


def test_a_thigh_is_that_of_the_table_by_hand() -> None:
    thigh = applied("deleva1996", "F").model.segment("femur_r")
    mass, length = 0.1478 * 67.3 / 0.9999, 0.43245
    assert thigh.mass == pytest.approx(mass)
    np.testing.assert_allclose(thigh.com, [0, -0.3612 * length, 0], atol=1e-12)
    radii = np.array([0.369, 0.162, 0.364]) * length
    np.testing.assert_allclose(thigh.inertia, [*(mass * radii**2), 0, 0, 0], atol=1e-12)


@pytest.mark.parametrize("table", TABLE_NAMES)
def test_twice_the_size_is_twice_the_arm_and_four_times_the_inertia(table: str) -> None:
    once = apply_inertia_table(BODY, table, sex="F", height_m=1.1, mass_kg=60).model
    twice = apply_inertia_table(larger(BODY, 2.0), table, sex="F", height_m=2.2, mass_kg=60).model
    for small, large in zip(once.segments, twice.segments, strict=True):
        np.testing.assert_allclose(large.com, 2 * np.array(small.com), atol=1e-12)
        np.testing.assert_allclose(large.inertia, 4 * np.array(small.inertia), rtol=1e-9, atol=1e-15)


def test_left_is_the_mirror_image_of_right() -> None:
    model = applied("dumas_wojtusch2018", "F").model
    for segment in model.segments:
        if segment.name.endswith("_r"):
            left = model.segment(f"{segment.name[:-2]}_l")
            np.testing.assert_allclose(left.com, np.array(segment.com) * [1, 1, -1], atol=1e-12)
            mirrored = np.array(segment.inertia) * [1, 1, 1, 1, -1, -1]
            np.testing.assert_allclose(left.inertia, mirrored, atol=1e-12)


def test_the_womens_torso_of_2007_cannot_be_a_body_and_is_made_one() -> None:
    row = read_inertia_table("dumas2007").row("torso", "F")
    r, v = np.array([29.0, 27, 29]), np.array(row.products_pct)
    tensor = np.diag(r**2)
    for (i, j), value in zip(((0, 1), (0, 2), (1, 2)), np.sign(v) * v**2, strict=True):
        tensor[i, j] = tensor[j, i] = value
    np.testing.assert_allclose(np.linalg.eigvalsh(tensor), [295, 843, 1272], atol=1.0)
    mended, changed = find_possible_tensor(tensor)
    assert changed
    a, b, c = np.linalg.eigvalsh(mended)
    assert c <= a + b + 1e-9
    assert not find_possible_tensor(0.5 * (mended + np.diag([1e3] * 3)))[1]
    every = [r for name in TABLE_NAMES for r in read_inertia_table(name).rows if None not in r.radii_pct]
    assert [f"{r.segment} {r.sex}" for r in every if broken(r)] == ["torso F"]


def broken(row) -> bool:  # type: ignore[no-untyped-def]  # a row whose radii are all given
    tensor = np.diag(np.array(row.radii_pct, dtype=float) ** 2)
    v = np.array(row.products_pct)
    for (i, j), value in zip(((0, 1), (0, 2), (1, 2)), np.sign(v) * v**2, strict=True):
        tensor[i, j] = tensor[j, i] = value
    return find_possible_tensor(tensor)[1]


def test_legs_without_a_trunk_say_what_mass_they_lack() -> None:
    result = applied(model=load_builtin("lower_limb_feet_18dof"))
    assert any("no segment for 49.2 %" in note for note in result.notes)
    with pytest.raises(InputError, match="does not show the landmark OMPH of segment 'pelvis'"):
        applied("deleva1996", model=load_builtin("lower_limb_14dof"))


@pytest.mark.parametrize("table", TABLE_NAMES)
def test_the_squats_parts_weigh_what_the_table_says(table: str) -> None:
    squat = load_builtin("squat_4dof")
    result = apply_to_squat(squat, table, sex="M", height_m=1.68, mass_kg=64.0)
    assert sum_mass(result.model) == pytest.approx(64.0)
    for segment in result.model.segments:
        assert segment.com[2] == segment.inertia[4] == segment.inertia[5] == 0.0


def test_the_squat_of_winter_is_the_built_in_one_and_that_of_dumas_its_planar_facts() -> None:
    squat = load_builtin("squat_4dof")
    winter = apply_to_squat(squat, "winter2009", sex="M", height_m=1.68, mass_kg=64.0).model
    for ours, own in zip(winter.segments, squat.segments, strict=True):
        np.testing.assert_allclose(ours.com, own.com, atol=1e-12)
        np.testing.assert_allclose(ours.inertia, own.inertia, atol=1e-12)
    dumas = apply_to_squat(squat, "dumas2007", sex="M", height_m=1.68, mass_kg=64.0).model
    shank, thigh = dumas.segment("shank"), dumas.segment("thigh")
    assert shank.com[1] == pytest.approx(0.590 * 0.4133, abs=1e-4)
    assert thigh.com[1] == pytest.approx(0.571 * 0.4116, abs=1e-4)
    assert shank.mass == pytest.approx(0.096 * 64 / 1.002)
    assert shank.inertia[2] == pytest.approx(shank.mass * (0.28 * 0.4133) ** 2, rel=1e-2)
    with pytest.raises(InputError, match="is not the planar squat"):
        apply_to_squat(BODY, "dumas2007", sex="M", height_m=1.68, mass_kg=64.0)


def test_the_squats_own_numbers_are_winters() -> None:
    document = yaml.safe_load((find_reference_folder() / "squat_4dof.yaml").read_text(encoding="utf-8"))
    for entry in document["segments"]:
        row = {"foot": "foot", "shank": "shank", "thigh": "thigh"}.get(entry["name"])
        if row:
            printed = read_inertia_table("winter2009").row(row, "M")
            assert entry["inertia"]["mass_pct"] == pytest.approx(2 * printed.mass_pct)
            assert entry["inertia"]["radii_pct"][2] == printed.radii_pct[2]


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"mass_kg": 0.0}, r"subject\.mass_kg: 0 kg"),
        ({"mass_kg": 1000.0}, r"subject\.mass_kg: 1000 kg"),
        ({"height_m": 176.0}, r"subject\.height_m: 176 m"),
        ({"table": "zatsiorsky"}, "there is no inertial table 'zatsiorsky'"),
        ({"model": load_builtin("squat_4dof")}, "segment 'foot' is none that inertial tables know"),
    ],
)
def test_what_cannot_be_applied_is_refused(change: dict[str, object], said: str) -> None:
    asked = {"model": BODY, "table": "dumas2007", "sex": "M", "height_m": 1.762, "mass_kg": 67.3} | change
    with pytest.raises(InputError, match=said):
        apply_inertia_table(**asked)  # type: ignore[arg-type]


def test_the_generic_person_is_the_one_the_tests_use() -> None:
    person = load_generic_person("full_body_35dof")
    assert (person.height_m, person.mass_kg) == (1.762, 67.3)
