"""The catalogue: its kinds, and what another distribution adds."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from scaling_service.capabilities.discovery.effects import catalogue
from scaling_service.capabilities.discovery.effects.catalogue import find_effects
from scaling_service.capabilities.discovery.effects.masses import is_within_reach, make_nearest_bone_test
from tests.discovery.hidden import person


def test_a_load_hangs_within_reach_and_at_its_own_bone() -> None:
    assert is_within_reach(np.array([2.0, 0.6, 0.0, 0.0]))
    assert not is_within_reach(np.array([2.0, 0.0, -7.0, 0.0]))
    near = make_nearest_bone_test(person().model)
    thigh, shank = near("femur_r"), near("tibia_r")
    assert shank(np.array([2.0, 0.1, -0.4, 0.0]))  # 0.2 m down the shank
    assert not thigh(np.array([2.0, 0.1, -1.2, 0.0]))  # the same place
    assert thigh(np.array([2.0, 0.1, -0.4, 0.0]))  # half way down the thigh
    assert not shank(np.array([2.0, 0.0, 0.4, 0.0]))  # half way up it


def test_an_effect_of_another_distribution_is_known(monkeypatch: pytest.MonkeyPatch) -> None:
    """By an entry point of an object with the attributes of an effect; of a module all the same."""
    lift = SimpleNamespace(
        kind="shoe_lift", meaning="the shoes raise the feet", candidates=lambda _: iter(())
    )
    points = {"scaling_service.effects": [SimpleNamespace(load=lambda: lift)]}
    monkeypatch.setattr(catalogue, "entry_points", lambda group: points[group])
    catalogue.find_effects.cache_clear()
    try:
        assert catalogue.find_effects()["shoe_lift"].meaning == lift.meaning
        assert len(catalogue.find_effects()) == 23
    finally:
        catalogue.find_effects.cache_clear()


def test_every_effect_has_a_meaning() -> None:
    assert len(find_effects()) == 22
    assert all(len(effect.meaning) > 10 for effect in find_effects().values())
