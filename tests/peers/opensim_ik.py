"""OpenSim's inverse kinematics as a peer: its errors, motion and time, one thread, its own process.

For tests and benchmarks only. Run as a script it is the worker; :func:`run_opensim_ik` starts it.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


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
    def marker_rms(self) -> Array:
        """Root mean square distance over the markers seen, (n_frames,), m."""
        return np.sqrt(np.nanmean(self.squared_errors, axis=1))

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
    motion_file: Path | None = None,
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
    motion_file : Path, optional
        Where to write the motion, in OpenSim's MOT format, radians and metres.
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
    answer = _asked(request, time_limit_s)
    result = OpenSimIk(
        times=np.array(answer["times"]),
        coordinates=tuple(answer["coordinates"]),
        q=np.array(answer["q"]),
        markers=tuple(answer["markers"]),
        squared_errors=np.array(answer["squared_errors"], dtype=float),
        weights=np.array(answer["weights"]),
        cpu_s=np.array(answer["cpu_s"]),
    )
    if motion_file is not None:
        _write_motion(motion_file, result)
    return result


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
    return float(_asked(request, time_limit_s)["cpu_s_per_frame"])


def _asked(request: dict[str, Any], time_limit_s: float) -> dict[str, Any]:
    """The worker's answer, from a process and a scratch folder of its own."""
    threads = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    with tempfile.TemporaryDirectory() as scratch:
        done = subprocess.run(
            [sys.executable, str(Path(__file__).resolve())],
            input=json.dumps(request),
            capture_output=True,
            text=True,
            cwd=scratch,
            env={**os.environ, **threads},
            timeout=time_limit_s,
            check=False,
        )
    if done.returncode:
        raise RuntimeError(f"OpenSim's inverse kinematics failed: {done.stderr[-2000:]}")
    answer: dict[str, Any] = json.loads(done.stdout)
    return answer


def _write_motion(path: Path, result: OpenSimIk) -> None:
    table = np.column_stack([result.times, result.q])
    header = [
        "Coordinates",
        "version=1",
        f"nRows={len(table)}",
        f"nColumns={table.shape[1]}",
        "inDegrees=no",
        "endheader",
        "\t".join(["time", *result.coordinates]),
    ]
    rows = ["\t".join(f"{value:.12g}" for value in row) for row in table]
    path.write_text("\n".join([*header, *rows]) + "\n")


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


def _main() -> None:
    request = json.loads(sys.stdin.read())
    reply = os.dup(1)
    os.dup2(2, 1)  # OpenSim prints; only the answer may reach standard output
    text = json.dumps(_run_tool(request) if request.get("tool") else _solve(request))
    with os.fdopen(reply, "w") as out:
        out.write(text)


if __name__ == "__main__":
    _main()
