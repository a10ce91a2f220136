"""OpenSim as the oracle, in a process of its own; the tests skip where it is not installed."""

from __future__ import annotations

import importlib.util
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest

from scaling_service.model.body import BodyModel
from tests.peers.worker import standing

Oracle = Callable[[dict[str, Any]], dict[str, Any]]


@pytest.fixture(scope="session")
def oracle() -> Iterator[Oracle]:
    """Ask OpenSim directly, past the code under test."""
    if importlib.util.find_spec("opensim") is None:
        pytest.skip("opensim is not installed")
    with standing("tests.files.osim.oracle_worker") as ask:
        yield ask


@pytest.fixture(scope="session")
def random_poses() -> Callable[..., np.ndarray]:
    """Poses within the coordinates' ranges, shape (n, n_coordinates)."""

    def draw(model: BodyModel, n: int, beyond: float = 0.0) -> np.ndarray:
        rng = np.random.default_rng(7)
        lower = np.array([max(c.lower, -3.0) for c in model.coordinates])
        upper = np.array([min(c.upper, 3.0) for c in model.coordinates])
        reach = beyond * (upper - lower)
        return rng.uniform(lower - reach, upper + reach, (n, len(lower)))

    return draw


@pytest.fixture(scope="session")
def slow_positions() -> Callable[[BodyModel, np.ndarray], np.ndarray]:
    """Marker positions (n, markers, 3) by plain 4x4 matrices: a second, independent opinion."""
    return _slow_positions


def _slow_positions(model: BodyModel, q: np.ndarray) -> np.ndarray:
    result = []
    for pose in q:
        at = dict(zip(model.coordinate_names, pose, strict=True))
        frames = {"ground": np.eye(4)}
        for segment in model.segments:
            frame = frames[segment.parent]
            for joint in segment.joints:
                value = sum(_term(t, at) for t in joint.law.terms)
                frame = frame @ _motion(joint.kind, np.array(joint.axis), value)
            frames[segment.name] = frame
        result.append([(frames[m.segment] @ [*m.nominal, 1.0])[:3] for m in model.markers])
    return np.array(result)


def _term(term: Any, at: dict[str, float]) -> float:
    if term.surface is not None:
        return float(term.gain * _surface(term.surface, [at[name] for name in term.surface.coordinates]))
    if term.coordinate is None:
        return float(term.gain)
    x = at[term.coordinate]
    if term.shape is None:
        return float(term.gain * x)
    breaks, pieces = term.shape.breaks, term.shape.coefficients
    inside = min(max(x, breaks[0]), breaks[-1])
    k = max(i for i in range(len(pieces)) if breaks[i] <= inside)
    piece = np.polynomial.Polynomial(pieces[k][::-1])
    local = inside - breaks[k]
    return float(term.gain * (piece(local) + piece.deriv()(local) * (x - inside)))


def _surface(surface: Any, x: list[float]) -> float:
    if surface.kind == "powers":
        return float(np.prod([v**n for v, n in zip(x, surface.numbers, strict=True)]))
    name, letter = surface.kind.split("_")
    turn = lambda k, angle: _motion("rotation", np.eye(3)[k], angle)[:3, :3]  # noqa: E731
    if name == "normal":
        return float((turn(0, x[0]) @ turn(1, x[1]))["xyz".index(letter), 2])
    end = (turn(0, x[0] + surface.numbers[0]) @ turn(2, x[1] + surface.numbers[1]))[:, 1]
    aside = np.hypot(end[0], end[2])
    angle = np.arctan2(aside, end[1])
    if letter == "y":
        return float(np.sin(angle) / angle)
    return float((1.0 - np.cos(angle)) / angle * end["xyz".index(letter)] / aside)


def _motion(kind: str, axis: np.ndarray, value: float) -> np.ndarray:
    frame = np.eye(4)
    if kind == "translation":
        frame[:3, 3] = value * axis
        return frame
    k = np.array([np.cross(axis, e) for e in np.eye(3)]).T
    frame[:3, :3] = np.cos(value) * np.eye(3) + np.sin(value) * k + (1 - np.cos(value)) * np.outer(axis, axis)
    return frame
