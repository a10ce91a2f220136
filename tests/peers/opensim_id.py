"""OpenSim's inverse dynamics as a peer, in its own process: the tool, and its bare solver.

Run as a module it is the worker; :func:`run_opensim_id` asks it.
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


@dataclass(frozen=True, slots=True, eq=False)
class OpenSimId:
    """Generalised forces by coordinate, each (n,), and CPU seconds per frame of tool and solver."""

    times: Array
    forces: Mapping[str, Array]
    tool_s: float
    solver_s: float


def run_opensim_id(model: Path, motion: Path, loads: Path | None) -> OpenSimId:
    """Run InverseDynamicsTool without filters, and its solver on the same splines.

    Parameters
    ----------
    motion : Path
        A MOT file of all coordinates at a constant rate.
    loads : Path, optional
        An ExternalLoads document whose data file is absolute.
    """
    request = {"model": str(model), "motion": str(motion), "loads": str(loads) if loads else None}
    answer = ask("tests.peers.opensim_id", request)
    forces = {name: np.array(column) for name, column in answer["forces"].items()}
    return OpenSimId(np.array(answer["times"]), forces, answer["tool_s"], answer["solver_s"])


def write_loads(path: Path, data: Path, segments: Mapping[str, str]) -> None:
    """An ExternalLoads document: segment to the prefix of its columns in the data file."""
    parts = [
        f'<ExternalForce name="{name}"><applied_to_body>{name}</applied_to_body>'
        "<force_expressed_in_body>ground</force_expressed_in_body>"
        "<point_expressed_in_body>ground</point_expressed_in_body>"
        f"<force_identifier>{prefix}_v</force_identifier><point_identifier>{prefix}_p</point_identifier>"
        f"<torque_identifier>{prefix}_m</torque_identifier></ExternalForce>"
        for name, prefix in segments.items()
    ]
    path.write_text(
        '<?xml version="1.0" encoding="UTF-8"?><OpenSimDocument Version="40000"><ExternalLoads name="loads">'
        f"<objects>{''.join(parts)}</objects><groups/><datafile>{data.resolve()}</datafile>"
        "</ExternalLoads></OpenSimDocument>"
    )


def _answer(request: dict[str, Any]) -> dict[str, Any]:
    import opensim as osim

    osim.Logger.setLevelString("Error")
    tool = osim.InverseDynamicsTool()
    model = osim.Model(request["model"])
    model.updForceSet().clearAndDestroy()  # muscles give no force to inverse dynamics, and cost time
    motion = osim.Storage(request["motion"])
    tool.setModel(model)
    tool.setCoordinatesFileName(request["motion"])
    tool.setLowpassCutoffFrequency(-1.0)
    tool.setStartTime(motion.getFirstTime())
    tool.setEndTime(motion.getLastTime())
    tool.setResultsDir(".")
    tool.setOutputGenForceFileName("forces.sto")
    if request["loads"]:
        tool.setExternalLoadsFileName(request["loads"])
    start = time.process_time()
    tool.run()
    spent = time.process_time() - start
    table = osim.TimeSeriesTable("forces.sto")
    columns = {
        label: table.getDependentColumn(label).to_numpy().tolist() for label in table.getColumnLabels()
    }
    times = list(table.getIndependentColumn())
    return {
        "times": times,
        "forces": columns,
        "tool_s": spent / len(times),
        "solver_s": _solver_seconds(osim, request["model"], motion, times),
    }


def _solver_seconds(osim: Any, path: str, motion: Any, times: list[float]) -> float:
    """CPU seconds per frame of the bare solver, the motion's splines given, nothing external."""
    model = osim.Model(path)
    model.updForceSet().clearAndDestroy()
    state = model.initSystem()
    model.getSimbodyEngine().convertDegreesToRadians(motion)
    splines = osim.GCVSplineSet(5, motion)
    functions = osim.FunctionSet()
    for k in range(model.getCoordinateSet().getSize()):
        functions.cloneAndAppend(splines.get(model.getCoordinateSet().get(k).getName()))
    solver = osim.InverseDynamicsSolver(model)
    start = time.process_time()
    for t in times:
        solver.solve(state, functions, t)
    return (time.process_time() - start) / len(times)


if __name__ == "__main__":
    serve(_answer)
