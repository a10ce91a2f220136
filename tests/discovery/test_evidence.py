"""Sums over blocks, against the same made column by column and frame by frame."""

from __future__ import annotations

import numpy as np
import pytest

from scaling_service.capabilities.discovery.effects.catalogue import propose_candidates
from scaling_service.capabilities.discovery.evidence.fit import SearchContext, fit_recordings
from scaling_service.capabilities.discovery.evidence.markers import MARKERS
from scaling_service.capabilities.discovery.evidence.statistics import fit_each
from scaling_service.capabilities.discovery.evidence.sums import Evidence
from scaling_service.capabilities.discovery.laws.candidates import Candidate
from scaling_service.capabilities.discovery.laws.loads import compute_columns
from scaling_service.capabilities.discovery.laws.profiles import evaluate_profiles
from scaling_service.capabilities.discovery.laws.spots import Generators
from scaling_service.capabilities.discovery.observations.tracked import TrackedTrial
from scaling_service.capabilities.discovery.options import AS_MEASURED, DiscoverSettings
from scaling_service.capabilities.discovery.start import prepare
from scaling_service.capabilities.subject.loading import open_subject
from scaling_service.numerics.multibody.laws import Array
from tests.discovery.hidden import choice, person, recorded
from tests.jobs.force_laboratory import force_laboratory

BLOCK_S = 0.5
KINDS = ("marker_offset", "segment_length", "soft_tissue_artefact", "skin_wobble", "joint_centre_offset")


@pytest.fixture(scope="module")
def picked() -> list[Candidate]:
    """Of one part and of many, of one column and of more, in all trials and in one."""
    found = [c for kind in KINDS for c in [x for x in choice() if x.kind == kind][::9]]
    found = [c for c in found if c.trials != ("gait_2",)]  # that is not among the recordings here
    return list({c.key: c for c in found}.values())[:30]


def plainly(item: TrackedTrial, candidates: list[Candidate]) -> tuple[Array, Array, Array]:
    """Columns freed of the pose (n, r, k), the gap freed of it (n, r), columns as they are (n, r, k)."""
    n = len(item.q)
    made = []
    for candidate in candidates:
        for column in candidate.columns:
            gap, pose, spots = Generators.of(item, [p.spot for p in column.parts]).at(item, slice(0, n))
            course = evaluate_profiles([p.profile for p in column.parts], item)
            gains = candidate.holds_in(item.name) * np.array([p.gain for p in column.parts])
            made.append(np.einsum("nsr,sn,s->nr", spots, course, gains))
    raw = np.stack(made, axis=2)
    q = np.linalg.qr(pose.transpose(0, 2, 1))[0]
    return raw - q @ (q.transpose(0, 2, 1) @ raw), gap - np.einsum("nrq,nsq,ns->nr", q, q, gap), raw


@pytest.fixture(scope="module")
def tracked() -> tuple[TrackedTrial, ...]:
    someone = person()
    return fit_recordings(
        SearchContext(model=someone.model, recordings=recorded(someone, someone.model))
    ).tracked[:2]


def gathered(tracked: tuple[TrackedTrial, ...], picked: list[Candidate], *, together: bool) -> Evidence:
    return MARKERS.gather(tracked, picked[:3], picked[3:], BLOCK_S, together=together)


def test_sums_are_those_of_columns_made_one_by_one(
    tracked: tuple[TrackedTrial, ...], picked: list[Candidate]
) -> None:
    found = gathered(tracked, picked, together=True)
    own = scores = raw = 0.0
    square = 0.0
    for item in tracked:
        columns, gap, plain = plainly(item, picked)
        flat = columns.reshape(-1, columns.shape[2])
        own, scores = own + flat.T @ flat, scores + flat.T @ gap.ravel()
        raw, square = raw + np.square(plain).sum(axis=(0, 1)), square + float((gap**2).sum())
    size = np.sqrt(np.diag(np.asarray(own)))
    got = sum(s.own for s in found.blocks)
    np.testing.assert_allclose(got / np.outer(size, size), own / np.outer(size, size), atol=1e-6)
    np.testing.assert_allclose(sum(s.scores for s in found.blocks) / size, scores / size, atol=1e-5)
    np.testing.assert_allclose(found.raw, raw, rtol=1e-5)
    assert sum(s.square for s in found.blocks) == pytest.approx(square, rel=1e-6)


@pytest.mark.parametrize("most", [7, 16, 10**6])
def test_how_many_frames_are_looked_at_at_once_makes_no_difference(
    tracked: tuple[TrackedTrial, ...], picked: list[Candidate], most: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Parts of a block, a block or some, and whole recordings."""
    usual = gathered(tracked, picked, together=True)
    monkeypatch.setattr("scaling_service.capabilities.discovery.evidence.markers._FRAMES", (most, most))
    changed = gathered(tracked, picked, together=True)
    assert [block.trial for block in changed.blocks] == [block.trial for block in usual.blocks]
    np.testing.assert_allclose(changed.raw, usual.raw, rtol=1e-5)  # a yardstick, in single precision
    for one, other in zip(changed.blocks, usual.blocks, strict=True):
        np.testing.assert_allclose(one.own, other.own, atol=1e-9 * np.abs(other.own).max())
        assert (one.square, one.freedom) == pytest.approx((other.square, other.freedom), rel=1e-9)


def test_groups_by_themselves_are_parts_of_all_together(
    tracked: tuple[TrackedTrial, ...], picked: list[Candidate]
) -> None:
    every, apart = (gathered(tracked, picked, together=together) for together in (True, False))
    for one, other in zip(fit_each(every, picked[3:]), fit_each(apart, picked[3:]), strict=True):
        np.testing.assert_allclose(one.size, other.size, rtol=1e-6)
        assert one.gain == pytest.approx(other.gain, rel=1e-6)


def test_a_rough_look_is_a_tenth_of_all_frames(
    tracked: tuple[TrackedTrial, ...], picked: list[Candidate]
) -> None:
    closely, rough = (
        MARKERS.gather(tracked, (), picked, BLOCK_S, together=False, rough=rough) for rough in (False, True)
    )
    numbers = [sum(s.freedom for s in found.blocks) for found in (closely, rough)]
    assert numbers[1] / numbers[0] == pytest.approx(0.1, rel=0.1)
    np.testing.assert_allclose(rough.raw / closely.raw, 0.1, rtol=0.3)


def test_arranged_anew_is_as_gathered_so(tracked: tuple[TrackedTrial, ...], picked: list[Candidate]) -> None:
    """Some of what was looked at as nuisances, and the rest in another order."""
    every = MARKERS.gather(tracked, (), picked, BLOCK_S, together=True)
    known, others = picked[3:6], [*picked[8:], *picked[:3]]
    rows = {c.key: np.r_[span] for c, span in zip(picked, every.groups, strict=True)}
    arranged = every.arrange(np.concatenate([rows[c.key] for c in known]), [rows[c.key] for c in others])
    wanted = MARKERS.gather(tracked, known, others, BLOCK_S, together=True)
    assert (arranged.nuisances, arranged.groups) == (wanted.nuisances, wanted.groups)
    np.testing.assert_allclose(arranged.raw, wanted.raw, rtol=1e-9)
    for one, other in zip(arranged.blocks, wanted.blocks, strict=True):
        np.testing.assert_allclose(one.own, other.own, rtol=1e-9, atol=1e-9 * np.abs(one.own).max())
        np.testing.assert_allclose(one.cross, other.cross, rtol=1e-9, atol=1e-9 * np.abs(one.own).max())


def test_loads_made_together_are_those_made_one_by_one(tmp_path_factory: pytest.TempPathFactory) -> None:
    file = force_laboratory(tmp_path_factory.mktemp("forces"))
    prepared = prepare(open_subject(file, AS_MEASURED), DiscoverSettings(start="none"), AS_MEASURED, BLOCK_S)
    now = fit_recordings(SearchContext(model=prepared.model, recordings=prepared.recordings))
    wrench = now.wrenches[0]
    loads = [
        column.load for c in propose_candidates(now.scene) if c.seen_in == "wrench" for column in c.columns
    ]
    loads = list(dict.fromkeys(load for load in loads if load is not None))
    assert len({type(load) for load in loads}) >= 8
    made = compute_columns(loads, wrench)
    for k, load in enumerate(loads):
        np.testing.assert_allclose(made[:, :, k], load.column(wrench), rtol=1e-9, atol=1e-9)
