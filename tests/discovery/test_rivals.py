"""What was named early is looked at again when more is known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from scaling_service.capabilities.discovery.effects.catalogue import propose_candidates
from scaling_service.capabilities.discovery.evidence.fit import Fit, Recording, SearchContext, fit_recordings
from scaling_service.capabilities.discovery.evidence.scoring import ScoredCandidate
from scaling_service.capabilities.discovery.evidence.settings import DiscoverySettings
from scaling_service.capabilities.discovery.evidence.statistics import Fitted, HeldOut
from scaling_service.capabilities.discovery.laws.candidates import Candidate, Contact, Estimate
from scaling_service.capabilities.discovery.options import AS_MEASURED, DiscoverSettings
from scaling_service.capabilities.discovery.search.estimation import compute_misfit, estimate
from scaling_service.capabilities.discovery.search.findings import NamedEffect
from scaling_service.capabilities.discovery.search.rivals import find_better_rival, rename
from scaling_service.capabilities.discovery.start import Prepared, prepare
from scaling_service.capabilities.subject.loading import open_subject
from scaling_service.model.body import Vector
from tests.discovery.hidden import passed
from tests.jobs.force_laboratory import force_laboratory

POINT = (0.08, 0.25, -0.1)
START_S, END_S = 0.5, 1.9


def named_anew(option: ScoredCandidate, _: Fit) -> NamedEffect:
    """As if it had passed."""
    return passed(Estimate(option.candidate, option.fitted.size))


def touching(segment: str, point: Vector) -> NamedEffect:
    """A contact that was named."""
    change = Contact(segment, START_S, END_S, point)
    candidate = Candidate(
        kind="external_contact", where=(segment,), columns=(), trials=("sway",), change=change
    )
    return passed(Estimate(candidate, np.zeros(0)))


@pytest.fixture(scope="module")
def prepared(tmp_path_factory: pytest.TempPathFactory) -> Prepared:
    file = force_laboratory(tmp_path_factory.mktemp("forces"))
    return prepare(open_subject(file, AS_MEASURED), DiscoverSettings(start="none"), AS_MEASURED, 0.5)


def pushed(prepared: Prepared) -> list[Recording]:
    """Recordings in one of which something pushes the trunk, by what the plates bear less."""
    (item,) = (
        w
        for w in fit_recordings(SearchContext(model=prepared.model, recordings=prepared.recordings)).wrenches
        if w.name == "sway"
    )
    course = np.clip(np.minimum(item.times - START_S, END_S - item.times) / 0.2, 0.0, 1.0)
    angle = 2.0 * np.pi * (item.times - START_S)
    force = 30.0 * course[:, None] * np.stack([np.cos(angle), 0.3 + 0.0 * angle, np.sin(angle)], axis=1)
    origin, axes = item.segment_frame("torso")
    place = origin + np.einsum("njk,j->nk", axes, np.array(POINT))
    ground = item.contacts.ground
    half = 0.5 * force[:, None]
    borne = replace(ground, force=ground.force - half, moment=ground.moment - np.cross(place[:, None], half))
    footing = replace(item.contacts, ground=borne)
    return [replace(r, contacts=footing) if r.trial.name == "sway" else r for r in prepared.recordings]


def scaled(recording: Recording, gain: float) -> Recording:
    """As if the first plate measured too much."""
    assert recording.contacts is not None
    ground = recording.contacts.ground
    factor = np.where(np.array(ground.plates) == "plate_1", gain, 1.0)[:, None]
    ground = replace(ground, force=factor * ground.force, moment=factor * ground.moment)
    return replace(recording, contacts=replace(recording.contacts, ground=ground))


@pytest.mark.parametrize(("gain", "plate"), [(1.1, "plate_1"), (2.0, "plate_2")])
def test_a_better_rival_gets_the_name_unless_no_laboratory_could_meet_it(
    prepared: Prepared, gain: float, plate: str
) -> None:
    recordings = [scaled(r, gain) for r in prepared.recordings]
    start = fit_recordings(SearchContext(model=prepared.model, recordings=recordings))
    choice = [c for c in propose_candidates(start.scene) if not c.trials]
    right, wrong = (c for c in choice if c.kind == "plate_gain")
    other = next(c for c in choice if c.kind == "plate_position")
    early = replace(passed(Estimate(wrong, np.zeros(1))), rivals=(wrong, right))
    later = passed(Estimate(other, np.zeros(len(other.columns))))
    now = estimate(start, [early.effect, later.effect])
    kept, after = rename([early, later], now, named_anew)
    assert kept[0].effect.candidate.where == (plate,)
    assert {e.candidate.key for e in after.effects} == {n.effect.candidate.key for n in kept}


def test_a_rival_that_needs_fewer_numbers_for_more_gets_the_name(prepared: Prepared) -> None:
    """A bias that is as large as the weight makes it is a gain."""
    recordings = [scaled(r, 1.1) for r in prepared.recordings]
    start = fit_recordings(SearchContext(model=prepared.model, recordings=recordings))
    choice = [c for c in propose_candidates(start.scene) if not c.trials and c.where == ("plate_1",)]
    bias = next(c for c in choice if c.kind == "plate_bias")
    gain = next(c for c in choice if c.kind == "plate_gain")
    turn = next(c for c in choice if c.kind == "plate_rotation")
    early = replace(passed(Estimate(bias, np.zeros(len(bias.columns)))), rivals=(bias, gain))
    later = passed(Estimate(turn, np.zeros(len(turn.columns))))
    now = estimate(start, [early.effect, later.effect])
    kept, _ = rename([early, later], now, named_anew)
    assert [n.effect.candidate.kind for n in kept] == ["plate_gain", "plate_rotation"]


@pytest.mark.parametrize(
    ("p", "unseen_p", "gain", "taken"),
    [(1e-4, 1e-4, 0.1, True), (0.5, 1e-4, 0.1, False), (1e-4, 0.5, 0.1, False), (1e-4, 1e-4, -0.1, False)],
)
def test_a_rival_that_would_be_dropped_gets_no_name(
    p: float, unseen_p: float, gain: float, taken: bool
) -> None:
    """As long as chance does as much, or it does no good where it was not fitted."""
    mine, rival = (Candidate(kind="marker_offset", where=(marker,), columns=()) for marker in ("C7", "RSHO"))
    level = np.linspace(0.9, 1.1, 20)

    def option(candidate: Candidate, size: float, fitted_p: float) -> ScoredCandidate:
        fitted = Fitted(
            size=np.zeros(1),
            covariance=np.eye(1),
            gain=size,
            by_chance=1.0,
            p=fitted_p,
            identifiable=1.0,
            freedom=15.0,
        )
        return ScoredCandidate(
            candidate=candidate,
            fitted=fitted,
            gains=size * level,
            held_out=HeldOut(gain, unseen_p, folds=False),
        )

    options = [option(rival, 60.0, p), option(mine, 20.0, 1e-4)]
    found = find_better_rival(passed(Estimate(mine, np.zeros(1))), options, DiscoverySettings())
    assert (found is options[0]) == taken
    assert found is None or taken


@pytest.mark.parametrize(("segment", "point"), [("pelvis", (0.0, 0.1, 0.0)), ("torso", (0.0, 0.0, 0.1))])
def test_a_contact_is_placed_anew(prepared: Prepared, segment: str, point: Vector) -> None:
    recordings = pushed(prepared)
    scene = fit_recordings(SearchContext(model=prepared.model, recordings=recordings)).scene
    load = next(c for c in propose_candidates(scene) if c.kind == "plate_gain" and not c.trials)
    early = touching(segment, point)
    later = passed(Estimate(load, np.zeros(1)))
    now = fit_recordings(
        SearchContext(model=prepared.model, recordings=recordings), (), [early.effect, later.effect]
    )
    kept, after = rename([early, later], now, named_anew)
    contact = kept[0].effect.candidate.change
    assert isinstance(contact, Contact)
    assert contact.segment == "torso"
    assert np.linalg.norm(np.subtract(contact.point, POINT)) < 0.02
    assert len(after.effects) == len(kept) == 2
    assert compute_misfit(after) < compute_misfit(now)
