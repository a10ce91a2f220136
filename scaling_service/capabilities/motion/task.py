"""What inverse kinematics solves: one model, one recording, the markers to follow and how."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from scaling_service.core.errors import TrialUnusable
from scaling_service.model.body import BodyModel
from scaling_service.model.compile import (
    compile_model,
    free_coordinates,
    list_coordinate_bounds,
    list_parameter_values,
)
from scaling_service.model.trial import Trial
from scaling_service.numerics.least_squares.problem import SQUARED, Loss
from scaling_service.numerics.multibody.laws import Array
from scaling_service.numerics.multibody.tree import Tree


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Task:
    """What inverse kinematics solves: a compiled model, the markers to follow and how."""

    model: BodyModel
    tree: Tree
    markers: tuple[str, ...]
    measured: Array
    weights: Array
    free: NDArray[np.bool_]
    bounds: tuple[Array, Array]
    p: Array
    loss: Loss = SQUARED

    @classmethod
    def of(
        cls,
        model: BodyModel,
        trial: Trial,
        *,
        weights: Mapping[str, float] | None = None,
        loss: Loss = SQUARED,
        bounded: bool = True,
    ) -> Task:
        """Pair the model's markers with the trial's labels.

        Markers of weight zero and markers that the trial never shows are left out.

        Raises TrialUnusable: no marker of the model is seen in the trial.
        """
        chosen = _list_usable(model, trial, weights or {})
        if not chosen:
            raise TrialUnusable(
                f"none of the markers of model '{model.name}' is seen in trial '{trial.name}'",
                file=trial.name,
                field="markers",
                remedy="Map the labels under `markers:` in the subject file",
            )
        names = tuple(chosen)
        count = len(model.coordinates)
        open_ended = (np.full(count, -np.inf), np.full(count, np.inf))
        return cls(
            model=model,
            tree=compile_model(model, names),
            markers=names,
            measured=trial.select(names).markers,
            weights=np.array([chosen[name] for name in names]),
            free=free_coordinates(model),
            bounds=list_coordinate_bounds(model) if bounded else open_ended,
            p=list_parameter_values(model),
            loss=loss,
        )

    def at(self, p: Array) -> Task:
        """The same task at other parameter values, shape (n_parameters,)."""
        return replace(self, p=p)

    def in_frames(self, rows: NDArray[np.intp]) -> Task:
        """The same task in some frames."""
        return replace(self, measured=self.measured[rows])


def _list_usable(model: BodyModel, trial: Trial, weights: Mapping[str, float]) -> dict[str, float]:
    shown = trial.shown_labels
    found = {m.name: float(weights.get(m.name, m.weight)) for m in model.markers if m.name in shown}
    return {name: weight for name, weight in found.items() if weight > 0.0}
