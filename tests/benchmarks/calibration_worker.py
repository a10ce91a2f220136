"""Our calibrations of the virtual person of ``demo``: the least CPU time of five, and what was reached."""

from __future__ import annotations

import time
from typing import Any

from scaling_service.capabilities.scaling.methods.table import calibrate
from scaling_service.capabilities.shared.settings import PAPER
from scaling_service.virtual.example import make_demo_session
from tests.peers.worker import serve


def _calibrate(_: dict[str, Any]) -> dict[str, Any]:
    session, _truth = make_demo_session(0)
    known = {"MB": calibrate(session, "MB")}
    found = {}
    for method in ("MB_am", "MB_lam"):
        spent = []
        for _repeat in range(5):
            start = time.process_time()
            result = calibrate(session, method, PAPER, known)
            spent.append(time.process_time() - start)
        found[method] = {
            "s": min(spent),
            "steps": result.iterations,
            "parameters": len(result.parameters),
            "frames": PAPER.n_frames,
            "cost": result.cost,
        }
    return found


if __name__ == "__main__":
    serve(_calibrate)
