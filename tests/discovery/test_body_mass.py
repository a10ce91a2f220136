"""Whether the declared mass is the cause, or something else that weighs as much."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest

from scaling_service.capabilities.discovery.effects import body_mass
from scaling_service.capabilities.discovery.evidence.fit import Fit, SearchContext
from scaling_service.capabilities.discovery.evidence.scoring import ScoredCandidate
from scaling_service.capabilities.discovery.evidence.statistics import NOTHING, HeldOut
from scaling_service.capabilities.discovery.laws.candidates import Candidate, Column
from scaling_service.capabilities.discovery.laws.loads import PlateGain
from scaling_service.capabilities.dynamics.weight import Weight
from tests.discovery.hidden import person

ABOVE, NOISE = 1000.0, 50.0


@dataclass(frozen=True)
class Forces:
    """Forces that disagree by so much, of which a right mass leaves little."""

    left_by_mass: float

    def above_noise(self, _fit: Fit) -> float:
        return ABOVE

    def squares(self, fit: Fit) -> float:
        return NOISE + (self.left_by_mass if fit.effects else ABOVE)

    def refit(self, fit: Fit, _free: object, effects: tuple[object, ...]) -> Fit:
        return replace(fit, effects=effects)  # type: ignore[arg-type]

    def shows(self, candidate: Candidate) -> bool:
        return candidate.seen_in == "wrench"


@pytest.mark.parametrize(
    ("left_by_mass", "left", "is_mass"),
    [(100.0, 300.0, True), (100.0, 85.0, True), (100.0, 35.0, False), (10.0, -10.0, True)],
)
def test_a_load_is_the_cause_only_where_the_mass_leaves_something_of_which_it_leaves_clearly_less(
    left_by_mass: float, left: float, is_mass: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    heavier = Weight(declared_kg=60.0, plates_kg=65.0, sd_kg=0.3, by_trial={"walk": 65.0})
    monkeypatch.setattr(body_mass, "balance_weight", lambda _fit: heavier)
    monkeypatch.setattr(body_mass, "WRENCH", Forces(left_by_mass))
    load = Candidate(
        kind="carried_load",
        where=("torso",),
        columns=(Column(name="kg", unit=1.0, load=PlateGain("plate_1")),),
    )
    unseen = HeldOut(0.9, 1e-9, folds=False)
    other = ScoredCandidate(
        candidate=load, fitted=replace(NOTHING, gain=ABOVE - left), gains=np.zeros(3), held_out=unseen
    )
    found = body_mass.question_mass(Fit(context=SearchContext(model=person().model)), [other])
    assert (found is not None) is is_mass


def test_a_cause_that_bears_the_same_weight_as_well_is_the_class_of_the_mass(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    answers = iter(
        [
            Weight(declared_kg=60.0, plates_kg=65.0, sd_kg=0.3, by_trial={"walk": 65.0}),
            Weight(declared_kg=65.0, plates_kg=65.0, sd_kg=0.3, by_trial={"walk": 65.0}),
        ]
    )
    monkeypatch.setattr(body_mass, "balance_weight", lambda _fit: next(answers))
    monkeypatch.setattr(body_mass, "WRENCH", Forces(100.0))
    unseen = HeldOut(0.9, 1e-9, folds=False)
    trunk, arm = (
        ScoredCandidate(
            candidate=Candidate(
                kind="segment_mass",
                where=(name,),
                columns=(Column(name="kg", unit=1.0, load=PlateGain("plate_1")),),
            ),
            fitted=replace(NOTHING, gain=ABOVE - left, size=np.ones(1)),
            gains=np.zeros(3),
            held_out=unseen,
        )
        for name, left in (("torso", 110.0), ("arm", 300.0))
    )
    found = body_mass.question_mass(Fit(context=SearchContext(model=person().model)), [trunk, arm])
    assert found is not None
    assert found.equivalents == (trunk.candidate,)
