"""What inverse kinematics solves: one model, one recording, the markers to follow."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from scaling_service.capabilities.motion.ranges import Ranges, find_distinct_patterns, weigh_ranges
from scaling_service.core.arrays import Array, Mask
from scaling_service.core.errors import TrialUnusable
from scaling_service.model import compile as compiling
from scaling_service.model.body import BodyModel
from scaling_service.model.trial import Trial
from scaling_service.numerics.least_squares import problem
from scaling_service.numerics.multibody import sweep
from scaling_service.numerics.multibody import tree as trees
from scaling_service.numerics.multibody.closure import Closure


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Task:
    """What inverse kinematics solves: a compiled model, the markers to follow and how."""

    model: BodyModel
    tree: trees.Tree
    markers: tuple[str, ...]
    measured: Array
    weights: Array
    free: NDArray[np.bool_]
    bounds: tuple[Array, Array]
    p: Array
    ranges: Ranges  # what holds the coordinates that the markers do not show
    loss: problem.Loss = problem.SQUARED
    closure: Closure | None = None

    @classmethod
    def of(
        cls,
        model: BodyModel,
        trial: Trial,
        *,
        weights: Mapping[str, float] | None = None,
        loss: problem.Loss = problem.SQUARED,
        bounded: bool = True,
    ) -> Task:
        """Pair the model's markers with the trial's labels.

        Markers of weight zero and markers that the trial never shows are left out.

        Raises TrialUnusable: the model has no markers, or none of them is seen in the trial.
        """
        if not model.markers:
            raise TrialUnusable(
                f"model '{model.name}' has no markers",
                field="marker_set",
                remedy="Say where your markers sit on it: an OpenSim MarkerSet file under `marker_set:`",
            )
        weighted = weights or {}
        shown = trial.shown_labels
        found = {m.name: float(weighted.get(m.name, m.weight)) for m in model.markers if m.name in shown}
        chosen = {name: weight for name, weight in found.items() if weight > 0.0}
        if not chosen:
            raise TrialUnusable(
                f"none of the markers of model '{model.name}' is seen in trial '{trial.name}'",
                file=trial.name,
                field="markers",
                remedy="Map the labels under `markers:` in the subject file",
            )
        names, count = tuple(chosen), len(model.coordinates)
        open_ended = (np.full(count, -np.inf), np.full(count, np.inf))
        tree, measured = compiling.compile_model(model, names), trial.select(names).markers
        free = compiling.free_coordinates(model)
        heavy, p = np.array([chosen[name] for name in names]), compiling.list_parameter_values(model)
        return cls(
            model=model,
            tree=tree,
            markers=names,
            measured=measured,
            weights=heavy,
            free=free,
            bounds=compiling.list_coordinate_bounds(model) if bounded else open_ended,
            p=p,
            ranges=weigh_ranges(model, tree, measured, heavy, free, p),
            loss=loss,
            closure=compiling.compile_constraints(model),
        )

    @property
    def shown(self) -> Mask:
        """Whether each marker is seen, (n_frames, n_markers)."""
        return problem.find_seen(self.measured)

    @property
    def patterns(self) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """The first frame of every pattern of markers that are seen, and the pattern of every frame."""
        return find_distinct_patterns(self.shown)

    @property
    def is_swept(self) -> bool:
        """Whether sweeps over the tree solve it: coordinates in one link each, plain squares, no loops."""
        return sweep.is_articulated(self.tree) and self.loss is problem.SQUARED and self.closure is None

    def at(self, p: Array) -> Task:
        """The same task at other parameter values, shape (n_parameters,)."""
        return replace(self, p=p)

    def in_frames(self, rows: NDArray[np.intp] | NDArray[np.bool_]) -> Task:
        """The same task in some frames, which may come again."""
        return replace(self, measured=self.measured[rows], ranges=self.ranges.in_frames(rows))
