"""What can be hidden in a recording, and where it enters.

An effect overrides the steps that it changes; the others pass on what they are given. The steps, in order:
the body itself, how it moves, where markers on the skin are, what touches it besides the plates, what the
cameras make of the markers, what the plates make of the forces, and what is done to the labels.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from tests.blind.body import Array, Body
from tests.blind.engine import Poses
from tests.blind.forces import Plates
from tests.blind.motions.motion import Motion

Needs = Literal["markers", "forces"]


@dataclass(frozen=True)
class Scene:
    """One trial while it happens: the true body, its motion and where its segments are."""

    body: Body
    motion: Motion
    poses: Poses

    @property
    def times(self) -> Array:
        """Of the frames, s."""
        return self.motion.times

    def marker(self, name: str) -> int:
        """Column of a marker."""
        return self.body.marker_names.index(name)


@dataclass(frozen=True, kw_only=True)
class Hidden:
    """Something hidden, with the truth about it.

    Parameters
    ----------
    kind : str
        As design section 6 calls it, or the name of a stranger.
    where : tuple of str
    parameters : mapping
        With the unit in the name; signs as in section 6.
    driver : tuple of str
        Coordinates that drive it.
    also_where : tuple of str
        Other names of the same place, for scoring strangers.
    trials : tuple of int, optional
        Numbers of the trials that it affects; None for all.
    """

    kind: str
    where: tuple[str, ...]
    parameters: dict[str, float]
    driver: tuple[str, ...] = ()
    also_where: tuple[str, ...] = ()
    trials: tuple[int, ...] | None = None

    @property
    def own_kg(self) -> float:
        """What the person weighs more than the model: who steps on scales declares it."""
        return 0.0

    def body(self, body: Body) -> Body:
        """The true body from the given one."""
        return body

    def motion(self, motion: Motion, rng: np.random.Generator) -> Motion:
        """What it really does."""
        return motion

    def on_skin(self, scene: Scene, markers: Array) -> Array:
        """Where the markers really are, (n, m, 3), m."""
        return markers

    def borne_elsewhere(self, scene: Scene) -> Array | None:
        """Wrench on the body that no plate sees, (n, 6), about the ground origin."""
        return None

    def shaken(self, scene: Scene) -> Array | None:
        """Wrench that the ground has to give besides that of the rigid body, (n, 6)."""
        return None

    def seen(self, scene: Scene, markers: Array) -> Array:
        """What the cameras say."""
        return markers

    def measured(self, plates: Plates) -> Plates:
        """What the plates say."""
        return plates

    def labelled(self, times: Array, labels: tuple[str, ...], markers: Array) -> Array:
        """What the labels have become of."""
        return markers

    def label(self) -> dict[str, Any]:
        """For the file of labels."""
        return {
            "kind": self.kind,
            "where": list(self.where),
            "parameters": {k: round(float(v), 9) for k, v in self.parameters.items()},
            "driver": list(self.driver),
            "also_where": list(self.also_where),
            "trials": None if self.trials is None else list(self.trials),
        }


@dataclass(frozen=True)
class Effect:
    """A kind of hidden effect.

    Parameters
    ----------
    kind : str
    needs : 'markers' or 'forces'
        Which recordings show it.
    unit : str
        Of the sizes.
    sizes : small, middle, large
        About 1 : 3 : 9, from what noise hides to what anybody would notice.
    draw : callable
        ``draw(body, size, rng)`` gives the hidden thing at a random place, direction and sign.
    """

    kind: str
    needs: Needs
    unit: str
    sizes: tuple[float, float, float]
    draw: Callable[[Body, float, np.random.Generator], Hidden]


def direction(rng: np.random.Generator) -> Array:
    """A random unit vector."""
    vector = rng.normal(size=3)
    unit: Array = vector / np.linalg.norm(vector)
    return unit


def sign(rng: np.random.Generator) -> float:
    """Plus or minus one."""
    return float(rng.choice([-1.0, 1.0]))


def one(rng: np.random.Generator, names: tuple[str, ...] | list[str]) -> str:
    """One of these."""
    return str(rng.choice(sorted(names)))


def xyz(vector: Array, unit: str) -> dict[str, float]:
    """Parameters named after axis and unit: ``x_mm``, ..."""
    return {f"{axis}_{unit}": float(v) for axis, v in zip("xyz", vector, strict=True)}
