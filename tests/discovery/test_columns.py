"""Columns are the derivatives of the markers: against differences of the body with the effect put into it."""

from __future__ import annotations

import numpy as np
import pytest

from scaling_service.capabilities.discovery.evidence.fit import SearchContext, fit_recordings
from scaling_service.capabilities.discovery.laws.apply import with_effects, with_inertial_changes
from scaling_service.capabilities.discovery.laws.candidates import Candidate, Column, Estimate
from scaling_service.capabilities.discovery.laws.loads import Inertial, differentiate_load
from scaling_service.capabilities.discovery.laws.profiles import evaluate_profiles
from scaling_service.capabilities.discovery.laws.spots import Generators
from scaling_service.model.body import GROUND
from scaling_service.model.compile import compile_model, list_parameter_values
from scaling_service.model.inertia import gather_inertias
from scaling_service.numerics.multibody.motion import TENSOR
from scaling_service.numerics.multibody.tree import pose_markers
from tests.discovery.hidden import choice, person, recorded

NEAR_M = 0.1
"""Of a load from its segment's centre of mass: within it the columns' tensor is off by 10 g m2 per kg."""

KINDS = (
    "marker_offset",
    "soft_tissue_artefact",
    "segment_length",
    "joint_centre_offset",
    "joint_axis_tilt",
    "coupled_motion",
)


@pytest.mark.parametrize("kind", KINDS)
def test_a_column_is_what_a_small_effect_does(kind: str) -> None:
    someone = person()
    item = fit_recordings(
        SearchContext(model=someone.model, recordings=recorded(someone, someone.model)[:1])
    ).tracked[0]
    for candidate in [c for c in choice() if c.kind == kind and not c.trials][:4]:
        for k, column in enumerate(candidate.columns):
            step = np.zeros(len(candidate.columns))
            step[k] = 1e-6
            sides = []
            for sign in (1.0, -1.0):
                body = with_effects(someone.model, [Estimate(candidate, sign * step)], "")
                tree = compile_model(body, item.markers)
                sides.append(pose_markers(tree, item.q, list_parameter_values(body)))
            wanted = (sides[0] - sides[1]) / 2e-6
            spots = [part.spot for part in column.parts]
            _, _, made = Generators.of(item, spots).at(item, slice(0, len(item.q)))
            courses = evaluate_profiles([part.profile for part in column.parts], item)
            gains = np.array([part.gain for part in column.parts])
            got = np.einsum("nsr,sn,s->nr", made, courses, gains).reshape(wanted.shape)
            np.testing.assert_allclose(got, wanted, atol=2e-6)


def test_a_load_is_a_point_mass_but_for_the_square_of_its_way_from_the_centre() -> None:
    segment = next(s for s in person().model.segments if s.parent != GROUND)
    per_kg, *per_moment = np.array(differentiate_load(segment))
    for kg, away in ((2.0, np.zeros(3)), (3.0, NEAR_M * np.array([0.6, 0.0, -0.8]))):
        at = np.array(segment.com) + away
        made = kg * per_kg + sum(kg * at[k] * per_moment[k] for k in range(3))
        point = [kg * (float(k == j) * at @ at - at[k] * at[j]) for k, j in TENSOR]
        left = [kg * (float(k == j) * away @ away - away[k] * away[j]) for k, j in TENSOR]
        np.testing.assert_allclose(made, [kg, *(kg * at), *np.subtract(point, left)], atol=1e-12)


def test_a_load_put_into_the_model_is_that_point_mass() -> None:
    model = person().model
    segment = next(s for s in model.segments if s.parent != GROUND)
    kg, at = 3.0, np.add(segment.com, (0.06, 0.2, -0.08))
    columns = tuple(
        Column(name=f"number_{k}", unit=1.0, load=Inertial(segment.name, change))
        for k, change in enumerate(differentiate_load(segment))
    )
    load = Estimate(
        Candidate(kind="carried_load", where=(segment.name,), columns=columns), kg * np.array([1, *at])
    )
    row = model.segment_names.index(segment.name)
    before, after = (
        gather_inertias(one).parameters()[row] for one in (model, with_inertial_changes(model, [load]))
    )
    tensor = [kg * (float(k == j) * at @ at - at[k] * at[j]) for k, j in TENSOR]
    np.testing.assert_allclose(after - before, [kg, *(kg * at), *tensor], atol=1e-9)
