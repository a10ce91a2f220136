"""OpenSim's inverse kinematics as a peer: its errors, motion and time, one thread, its own process.

For tests and benchmarks only. Run as a module it is the worker; :func:`run_opensim_ik` asks it.
"""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tests.peers.worker import ask, serve

Array = NDArray[np.float64]

_WORKER = "tests.peers.opensim_ik"


@dataclass(frozen=True, slots=True, eq=False)
class OpenSimIk:
    """What OpenSim's inverse kinematics reaches.

    Parameters
    ----------
    times : (n_frames,), s
    coordinates : tuple of str
        All of OpenSim's, dependent ones included.
    q : (n_frames, n_coordinates), rad or m
    markers : tuple of str
        Those that the solver used.
    squared_errors : (n_frames, n_markers), m2
        NaN where the marker was not seen.
    weights : (n_markers,)
    cpu_s : (n_frames,)
        Process time of each frame's solve, without import, loading and the first assembly's set-up.
    """

    times: Array
    coordinates: tuple[str, ...]
    q: Array
    markers: tuple[str, ...]
    squared_errors: Array
    weights: Array
    cpu_s: Array

    @property
    def weighted_squared_errors(self) -> Array:
        """Sum of weight times squared distance, (n_frames,), m2."""
        return np.nansum(self.weights * self.squared_errors, axis=1)


def run_opensim_ik(
    model: Path,
    trc: Path,
    marker_weights: Mapping[str, float],
    coordinate_weights: Mapping[str, float] | None = None,
    *,
    time_range: tuple[float, float] | None = None,
    accuracy: float = 1e-5,
    constraint_weight: float = float("inf"),
    time_limit_s: float = 600.0,
) -> OpenSimIk:
    """Track a TRC file frame by frame with OpenSim's InverseKinematicsSolver.

    Parameters
    ----------
    marker_weights, coordinate_weights : mapping
        Tasks; coordinates are drawn to their default values. Markers absent from the file are left out.
    time_range : (first, last), s, optional
        The whole file by default. (OpenSim's own tool stops at 2.0 s without one.)
    accuracy, constraint_weight : float
        As in the InverseKinematicsTool; its defaults.
    """
    request = {
        "model": str(model.resolve()),
        "trc": str(trc.resolve()),
        "marker_weights": dict(marker_weights),
        "coordinate_weights": dict(coordinate_weights or {}),
        "time_range": time_range,
        "accuracy": accuracy,
        "constraint_weight": constraint_weight,
    }
    answer = ask(_WORKER, request, time_limit_s=time_limit_s)
    return OpenSimIk(
        times=np.array(answer["times"]),
        coordinates=tuple(answer["coordinates"]),
        q=np.array(answer["q"]),
        markers=tuple(answer["markers"]),
        squared_errors=np.array(answer["squared_errors"], dtype=float),
        weights=np.array(answer["weights"]),
        cpu_s=np.array(answer["cpu_s"]),
    )


def time_opensim_ik_tool(
    model: Path,
    trc: Path,
    marker_weights: Mapping[str, float],
    coordinate_weights: Mapping[str, float] | None = None,
    *,
    time_range: tuple[float, float],
    time_limit_s: float = 600.0,
) -> float:
    """CPU seconds per frame of OpenSim's InverseKinematicsTool as a whole (accuracy 1e-5), model loaded."""
    request = {
        "tool": True,
        "model": str(model.resolve()),
        "trc": str(trc.resolve()),
        "marker_weights": dict(marker_weights),
        "coordinate_weights": dict(coordinate_weights or {}),
        "time_range": time_range,
    }
    return float(ask(_WORKER, request, time_limit_s=time_limit_s)["cpu_s_per_frame"])


def _references(osim: Any, request: dict[str, Any], model: Any) -> tuple[Any, Any]:
    """Marker and coordinate references of OpenSim's solver."""
    weights = osim.SetMarkerWeights()
    for name, weight in request["marker_weights"].items():
        weights.cloneAndAppend(osim.MarkerWeight(name, weight))
    markers = osim.MarkersReference(request["trc"], weights, osim.Units("m"))
    coordinates = osim.SimTKArrayCoordinateReference()
    for name, weight in request["coordinate_weights"].items():
        target = osim.Constant(model.getCoordinateSet().get(name).getDefaultValue())
        reference = osim.CoordinateReference(name, target)
        reference.setWeight(weight)
        coordinates.push_back(reference)
    return markers, coordinates


def _solve(request: dict[str, Any]) -> dict[str, Any]:
    import opensim as osim

    osim.Logger.setLevelString("Error")
    model = osim.Model(request["model"])
    state = model.initSystem()
    markers, coordinates = _references(osim, request, model)
    times = _times(request["trc"])
    first, last = request["time_range"] or (times[0], times[-1])
    times = times[(times >= first - 1e-9) & (times <= last + 1e-9)]
    solver = osim.InverseKinematicsSolver(model, markers, coordinates, request["constraint_weight"])
    solver.setAccuracy(request["accuracy"])
    state.setTime(float(times[0]))
    solver.assemble(state)
    names = [solver.getMarkerNameForIndex(k) for k in range(solver.getNumMarkersInUse())]
    every = [model.getCoordinateSet().get(k) for k in range(model.getCoordinateSet().getSize())]
    q, errors, cpu = [], [], []
    for t in times:
        state.setTime(float(t))
        start = time.process_time()
        solver.track(state)
        cpu.append(time.process_time() - start)
        errors.append([solver.computeCurrentSquaredMarkerError(name) for name in names])
        q.append([c.getValue(state) for c in every])
    return {
        "times": times.tolist(),
        "coordinates": [c.getName() for c in every],
        "q": q,
        "markers": names,
        "squared_errors": errors,
        "weights": [request["marker_weights"].get(name, 1.0) for name in names],
        "cpu_s": cpu,
    }


def _run_tool(request: dict[str, Any]) -> dict[str, Any]:
    import opensim as osim

    osim.Logger.setLevelString("Error")
    tool = osim.InverseKinematicsTool()
    model = osim.Model(request["model"])
    for kind, weights in (
        (osim.IKMarkerTask, request["marker_weights"]),
        (osim.IKCoordinateTask, request["coordinate_weights"]),
    ):
        for name, weight in weights.items():
            task = kind()
            task.setName(name)
            task.setApply(True)
            task.setWeight(weight)
            tool.getIKTaskSet().cloneAndAppend(task)
    tool.setModel(model)
    tool.setMarkerDataFileName(request["trc"])
    tool.setStartTime(request["time_range"][0])
    tool.setEndTime(request["time_range"][1])
    tool.setOutputMotionFileName("motion.mot")
    start = time.process_time()
    tool.run()
    cpu = time.process_time() - start
    return {"cpu_s_per_frame": cpu / osim.Storage("motion.mot").getSize()}


def _times(trc: str) -> Array:
    """The time column of a TRC file."""
    rows = (line.split("\t") for line in Path(trc).read_text().splitlines()[5:])
    return np.array([float(row[1]) for row in rows if len(row) > 2 and row[0].strip().isdigit()])


def _answer(request: dict[str, Any]) -> dict[str, Any]:
    return _run_tool(request) if request.get("tool") else _solve(request)


if __name__ == "__main__":
    serve(_answer)
