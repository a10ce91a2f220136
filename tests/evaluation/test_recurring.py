"""What persons share is told where none of them alone would tell it, and only that."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from scaling_service.capabilities.discovery.effects.joints import (
    propose_axis_tilts,
    propose_centre_offsets,
    propose_coupled_motions,
)
from scaling_service.capabilities.discovery.laws.apply import with_effects
from scaling_service.capabilities.discovery.laws.candidates import Candidate, Column, Estimate
from scaling_service.capabilities.discovery.laws.scene import Scene
from scaling_service.capabilities.discovery.mirror import flip_name, mirror_numbers
from scaling_service.capabilities.discovery.pooling import Pooled, Shared
from scaling_service.capabilities.discovery.search.leanings import Leanings
from scaling_service.cli import main
from scaling_service.model.body import BodyModel
from scaling_service.model.builtin import load_builtin
from scaling_service.model.poses import pose_neutral_frames

SD, TRUE, NOISE = 0.1, 0.2, 0.08  # of a segment's mass, a share
HEAVY = Candidate(kind="segment_mass", where=("torso",), columns=(Column(name="kg", unit=1.0),))
MIRROR = np.diag([1.0, 1.0, -1.0])


def lean(measured: float) -> Leanings:
    """Of a person whose recordings say a number with the same deviation."""
    posterior = 1.0 / (1.0 / SD**2 + 1.0 / NOISE**2)
    return Leanings.of(
        HEAVY, np.array([posterior * measured / NOISE**2]), np.array([[posterior]]), np.array([SD])
    )


def pool(*persons: Leanings) -> Pooled:
    """Of persons who share one number for each candidate."""
    first = persons[0]
    shared = [
        Shared(candidate, first.sd[at], {candidate.key: np.eye(len(first.sd[at]))})
        for candidate, at in first.rows()
    ]
    return Pooled(shared, {str(k): (one.score, one.information) for k, one in enumerate(persons)})


def test_many_persons_tell_what_one_does_not() -> None:
    measured = TRUE + NOISE * np.random.default_rng(1).normal(size=12)
    alone = [pool(lean(value)).list_odds([])[0] for value in measured]
    together = pool(*map(lean, measured))
    assert max(alone) < 6.0
    assert together.list_odds([])[0] > 6.0
    ((_, size, sd),) = together.split([0])
    assert size[0] == pytest.approx(TRUE, abs=3.0 * NOISE / np.sqrt(12))
    assert sd[0] == pytest.approx((1.0 / SD**2 + 12 / NOISE**2) ** -0.5)


def test_a_person_speaks_for_a_size_or_against_it() -> None:
    persons = pool(*(lean(TRUE) for _ in range(6)), lean(-TRUE))
    assert persons.ask("0", [0]) > 0.0 > persons.ask("6", [0])


def test_what_one_person_alone_shows_does_not_recur() -> None:
    loud, silent = lean(3.0 * TRUE), Leanings((HEAVY,), np.zeros(1), np.zeros((1, 1)), np.array([SD]))
    alone = pool(loud, silent, silent)
    assert alone.list_odds([])[0] > 6.0
    assert not alone.is_of_many(0, [])
    assert pool(loud, lean(TRUE), silent).is_of_many(0, [])


def test_what_another_effect_explains_is_not_named_beside_it() -> None:
    """Two numbers that do nearly the same to the recordings: the second has no odds once the first is in."""
    other = Candidate(kind="segment_com", where=("torso",), columns=(Column(name="x_mm", unit=1e3),))
    alike = np.array([[1.0, 0.98], [0.98, 1.0]]) / NOISE**2
    one = Leanings((HEAVY, other), alike @ np.array([TRUE, 0.0]), alike, np.full(2, SD))
    persons = pool(*(one for _ in range(8)))
    assert min(persons.list_odds([]).values()) > 6.0
    assert persons.list_odds([0])[1] < 1.0


def list_paired(model: BodyModel) -> list[tuple[Candidate, Candidate]]:
    names = tuple(c.name for c in model.coordinates)
    scene = Scene(model=model, markers=model.marker_names, moving=names, trials=("walk",))
    every = [
        c for f in (propose_centre_offsets, propose_axis_tilts, propose_coupled_motions) for c in f(scene)
    ]
    by_place = {(c.kind, c.where, c.driver, c.note): c for c in every}
    pairs = []
    for c in every:
        where, driver = (tuple(map(flip_name, names)) for names in (c.where, c.driver))
        if c.where[0].endswith("_r"):
            pairs.append((c, by_place[c.kind, where, driver, c.note]))
    return pairs


def pose_with(model: BodyModel, candidate: Candidate, size: np.ndarray) -> dict[str, tuple[np.ndarray, ...]]:
    """Frames of a model that moves both sides alike, with one effect."""
    changed = with_effects(model, [Estimate(candidate, size)], "walk")
    bent = {
        c.name: 0.1 + 0.05 * (len(flip_name(c.name)) % 7)
        for c in model.coordinates
        if c.name[-2:] in ("_r", "_l")
    }
    return dict(pose_neutral_frames(changed, bent))


@pytest.mark.parametrize("name", ["lower_limb_14dof", "lower_limb_feet_18dof", "full_body_35dof"])
def test_the_left_side_is_the_mirror_image_of_the_right(name: str) -> None:
    """Poses of a model with the effect on the right are images of those with it, mirrored, on the left."""
    model, size = load_builtin(name), np.array([0.03, -0.02, 0.04])
    pairs = list_paired(model)
    assert {c.kind for c, _ in pairs} == {"joint_centre_offset", "joint_axis_tilt", "coupled_motion"}
    for right, left in pairs:
        turn = mirror_numbers(right, left, model)
        assert turn is not None
        own = size[: len(right.columns)]
        rights, lefts = pose_with(model, right, own), pose_with(model, left, turn @ own)
        plain = pose_with(model, right, 0.0 * own)
        moved = 0.0
        for segment, (R, origin) in rights.items():
            image, place = lefts[flip_name(segment)]
            np.testing.assert_allclose(place, MIRROR @ origin, atol=1e-9, err_msg=f"{right.name}, {segment}")
            np.testing.assert_allclose(
                image, MIRROR @ R @ MIRROR, atol=1e-9, err_msg=f"{right.name}, {segment}"
            )
            moved = max(
                moved, float(np.abs(R - plain[segment][0]).max() + np.abs(origin - plain[segment][1]).max())
            )
        assert moved > 1e-4  # else nothing was compared


@pytest.mark.costly
def test_a_folder_of_persons_is_searched_for_what_recurs(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["example", "--persons", "2", "--out", str(tmp_path / "persons")]) == 0
    names = sorted(path.name for path in (tmp_path / "persons").iterdir() if path.is_dir())
    out = tmp_path / "found"
    assert main(["discover", str(tmp_path / "persons"), "--no-report", "--out", str(out)]) == 0
    said = capsys.readouterr().out
    assert "recurs" in said
    assert "no: log odds below 6" in said
    found = json.loads((out / "recurring.json").read_text(encoding="utf-8"))
    assert len(found["subjects"]) == len(names) == 2
    assert found["schema_version"] == 1
    assert found["code_version"]
    assert found["corrected"] == []
    assert not any(effect["named"] for effect in found["effects"])  # their bodies are the model's, scaled
    assert all((out / who / "discovery.json").is_file() for who in found["subjects"])


def test_one_person_shares_nothing(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = tmp_path / "persons" / "P1"
    assert main(["example", "--out", str(folder)]) == 0
    assert main(["discover", str(tmp_path / "persons"), "--no-report", "--out", str(tmp_path / "found")]) == 2
    assert "needs 2 persons" in capsys.readouterr().err
