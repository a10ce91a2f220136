"""Whether the declared mass is right, by the momentum balance of whole recordings.

Where recordings disagree about the weight, each is taken with its own from then on: what plates miss in one
of them is no load of the body.
"""

from __future__ import annotations

from collections.abc import Mapping

from scaling_service.capabilities.discovery.effects.catalogue import Effect
from scaling_service.capabilities.discovery.effects.sizes import Range, look_up_usual_sizes
from scaling_service.capabilities.discovery.evidence.fit import Fit
from scaling_service.capabilities.discovery.laws.candidates import Candidate, Estimate, Reweighed
from scaling_service.capabilities.dynamics.weight import BLOCK_S, Weight, split_into_blocks, weigh
from scaling_service.model.body import BodyModel

KIND = "body_mass"


def make_candidate(fit: Fit, declared_kg: float) -> Candidate | None:
    """The declared mass as an effect, by the plates; None where they do not contradict it.

    Nor where they do so by more than any declaration is off: then something else is wrong.
    """
    weight = balance_weight(fit)
    if weight is None or not weight.differs_from(declared_kg):
        return None
    own = weight.by_trial if weight.disagree else {}
    change = Reweighed(
        weight.plates_kg / declared_kg,
        weight.sd_kg / declared_kg,
        tuple((trial, kg / declared_kg) for trial, kg in own.items()),
        declared_kg / weight.declared_kg,
    )
    note = ", ".join(f"{kg:.1f} kg in {trial}" for trial, kg in own.items())
    usual = _find_usual_factor(fit.model)
    candidate = Candidate(kind=KIND, where=("world",), columns=(), note=note, change=change)
    return candidate if usual.low < change.factor < usual.high else None


def find_usual_mass(model: BodyModel) -> float:
    """Prior deviation of the body's mass where it is wrong, a share."""
    usual = _find_usual_factor(model)
    return 0.25 * (usual.high - usual.low)


def _find_usual_factor(model: BodyModel) -> Range:
    usual = look_up_usual_sizes(Candidate(kind=KIND, where=("world",), columns=()), model)("factor")
    assert usual is not None
    return usual


def balance_weight(fit: Fit) -> Weight | None:
    """What the plates bear in all recordings with forces; None without any."""
    blocks = {}
    for item in fit.wrenches:
        borne, needed = (item.filter(wrench)[:, 1] for wrench in (item.measured, item.needed))
        spans = split_into_blocks(item.usable, item.times, BLOCK_S)
        blocks[item.name] = [(borne[rows], needed[rows]) for rows in spans]
    return weigh(fit.wrenches[0].mass, blocks) if blocks else None


def _find_factor(effect: Estimate, _after: Fit) -> Mapping[str, float]:
    assert isinstance(effect.candidate.change, Reweighed)
    return {"factor": effect.candidate.change.factor}


def _spread(effect: Estimate, _after: Fit) -> Mapping[str, float]:
    assert isinstance(effect.candidate.change, Reweighed)
    return {"factor": effect.candidate.change.sd}


EFFECTS = (
    Effect(
        kind=KIND,
        meaning="the person is heavier or lighter than declared",
        details=_find_factor,
        spreads=_spread,
        of_recording=True,
    ),
)
