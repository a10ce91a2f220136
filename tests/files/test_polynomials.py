"""Laws that MuJoCo holds as polynomials: how near they are is what is said of them."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from scaling_service.files.polynomials import ease_laws
from scaling_service.model.body import BodyModel, Coordinate, Joint, Law, Segment, Shape, Term
from scaling_service.model.poses import pose_segments


def make_sliding(shape: Shape) -> BodyModel:
    """A sledge that slides along x by a law of a turn which nothing else moves by."""
    joint = Joint("translation", (1.0, 0.0, 0.0), Law((Term(0.5, coordinate="turn", shape=shape),)))
    turn = Coordinate(name="turn", lower=-2.0, upper=0.2)
    sledge = Segment(name="sledge", parent="ground", joint_name="rail", joints=(joint,), mass=1.0)
    return BodyModel(name="rail", segments=(sledge,), coordinates=(turn,))


def slide(model: BodyModel, columns: dict[str, np.ndarray]) -> np.ndarray:
    q = np.column_stack([columns[name] for name in model.coordinate_names])
    return pose_segments(model, q)[:, 0, 0]


@pytest.mark.parametrize(("degree", "helpers"), [(3, 0), (4, 0), (6, 2), (8, 2)])
def test_a_polynomial_up_to_the_eighth_degree_is_held_exactly(degree: int, helpers: int) -> None:
    coefficients = tuple(np.random.default_rng(degree).normal(size=degree + 1) * 0.01)
    shape = Shape((-2.0, 0.2), (coefficients,))
    eased = ease_laws(make_sliding(shape))
    assert len(eased.helpers) == helpers
    assert eased.followed[0].off < 1e-9
    x = np.linspace(-2.0, 0.2, 50)
    wanted = slide(make_sliding(shape), {"turn": x})
    np.testing.assert_allclose(slide(eased.model, eased.fill({"turn": x})), wanted, rtol=0, atol=1e-9)


def test_what_a_spline_is_off_by_is_said() -> None:
    knots = np.linspace(-2.0, 0.2, 9)
    spline = CubicSpline(knots, 0.02 * np.random.default_rng(2).normal(size=9))
    shape = Shape(tuple(knots), tuple(tuple(piece) for piece in spline.c.T))
    eased = ease_laws(make_sliding(shape))
    x = np.linspace(-2.0, 0.2, 777)
    off = np.abs(slide(eased.model, eased.fill({"turn": x})) - 0.5 * spline(x)).max()
    assert off == pytest.approx(eased.followed[0].off, rel=0.02)
    assert off > 1e-4
