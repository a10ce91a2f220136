"""A virtual person's recordings with something put into the person that the model does not have."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache

import numpy as np

from scaling_service.capabilities.discovery.effects.catalogue import propose_candidates
from scaling_service.capabilities.discovery.evidence.fit import SearchContext, SearchTrial, fit_recordings
from scaling_service.capabilities.discovery.laws.apply import with_effects
from scaling_service.capabilities.discovery.laws.candidates import Candidate, Estimate
from scaling_service.core.arrays import Array
from scaling_service.model.body import BodyModel
from scaling_service.model.compile import compile_model, list_parameter_values
from scaling_service.model.trial import Trial
from scaling_service.numerics.multibody.tree import pose_markers
from scaling_service.virtual.subject import VirtualSettings, VirtualSubject, make_virtual_subject

TRIALS = {"knee_r": "fit", "gait_1": "fit", "gait_2": "held_out"}
NOISE_M = 1e-3


@cache
def person(seed: int = 1) -> VirtualSubject:
    """Someone whose skin does not move, seen by perfect cameras."""
    return make_virtual_subject(seed, VirtualSettings(artefact=0, noise=0, gaps=0, functional_s=5.0))


def recorded(
    someone: VirtualSubject,
    truth: BodyModel,
    *,
    more: Array | None = None,
    noise_m: float = NOISE_M,
    seed: int = 0,
) -> list[SearchTrial]:
    """Recordings of the person's movements by another body, with white noise of the cameras.

    Parameters
    ----------
    more : ndarray, shape (any,), optional
        The course of a further coordinate of the truth, repeated as needed.
    """
    rng = np.random.default_rng(seed)
    made = []
    for name, role in TRIALS.items():
        trial, q = someone.trials[name], someone.motions[name]
        if more is not None:
            q = np.column_stack([q, np.resize(more, len(q))])
        places = pose_markers(compile_model(truth, trial.labels), q, list_parameter_values(truth))
        places = places + noise_m * rng.normal(size=places.shape)
        made.append(
            SearchTrial(
                Trial(
                    name=name, times=trial.times.copy(), labels=trial.labels, markers=places, rate_hz=100.0
                ),
                role,
            )
        )  # type: ignore[arg-type]
    return made


@cache
def choice(seed: int = 1) -> tuple[Candidate, ...]:
    """All that could be missing in this person's recordings."""
    someone = person(seed)
    return tuple(
        propose_candidates(
            fit_recordings(
                SearchContext(model=someone.model, recordings=recorded(someone, someone.model))
            ).scene
        )
    )


def candidate(kind: str, *where: str, driver: str | None = None) -> Candidate:
    """One of them by kind and place, in all trials."""
    return next(
        c
        for c in choice()
        if c.kind == kind and c.where == where and not c.trials and driver in (None, *c.driver)
    )


def hide(
    kind: str, *where: str, numbers: Sequence[float], driver: str | None = None
) -> tuple[Candidate, BodyModel]:
    """The candidate, and the person's body with it; ``numbers`` are as in the results."""
    effect = sized(kind, *where, numbers=numbers, driver=driver)
    return effect.candidate, with_effects(person().model, [effect], "")


def sized(kind: str, *where: str, numbers: Sequence[float], driver: str | None = None) -> Estimate:
    """One of the candidates with its size."""
    found = candidate(kind, *where, driver=driver)
    size = [(n - c.neutral) / c.unit for n, c in zip(numbers, found.columns, strict=True)]
    return Estimate(found, np.array(size))
