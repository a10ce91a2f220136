"""Run by itself as a script: parse one C3D file with ezc3d and leave arrays and parameters behind.

``python c3d_worker.py RECORDING.c3d RESULT.npz`` exits 0, or 3 with one line of text on standard error. It
imports nothing of the package, so it starts quickly and whatever happens to it happens to it alone.
"""

from __future__ import annotations

import json
import sys
from typing import Any

import numpy as np

MEMORY_BYTES = 4 << 30
"""Chosen: far above any recording; a damaged header can ask for more than the machine has."""

REFUSED = 3


def main(source: str, target: str) -> int:
    """Parse ``source`` into ``target`` and return the exit code."""
    _limit_memory()
    import ezc3d

    try:
        content = ezc3d.c3d(source)
        arrays, facts = _read_points(content), _read_facts(content)
        arrays["analog"] = np.asarray(content["data"]["analogs"], float)[0].T
    except (
        OSError,
        RuntimeError,
        ValueError,
        KeyError,
        IndexError,
        TypeError,
        MemoryError,
        ArithmeticError,
    ) as error:
        sys.stderr.write((" ".join(str(error).split()) or type(error).__name__) + "\n")
        return REFUSED
    np.savez(target, facts=np.array(json.dumps(facts)), **arrays)
    return 0


def _limit_memory() -> None:
    try:
        import resource
    except ImportError:  # Windows has no such limit
        return
    _, hard = resource.getrlimit(resource.RLIMIT_AS)
    limit = MEMORY_BYTES if hard == resource.RLIM_INFINITY else min(MEMORY_BYTES, hard)
    resource.setrlimit(resource.RLIMIT_AS, (limit, hard))


def _read_points(content: Any) -> dict[str, Any]:
    points = np.asarray(content["data"]["points"], float)
    residuals = np.asarray(content["data"]["meta_points"]["residuals"], float)[0]
    return {"points": np.moveaxis(points[:3], 0, -1).swapaxes(0, 1), "residuals": residuals.T}


def _read_facts(content: Any) -> dict[str, Any]:
    header = content["header"]
    return {
        "parameters": {
            group: {name: _make_plain(entry) for name, entry in entries.items() if name != "__METADATA__"}
            for group, entries in content["parameters"].items()
        },
        "header_rate": float(header["points"]["frame_rate"]),
        "first_frame": int(header["points"]["first_frame"]),
        "n_rotations": int(np.shape(content["data"]["rotations"])[2]),
    }


def _make_plain(entry: Any) -> Any:
    value = entry["value"]
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, (list, tuple)):
        return [_decode_text(item) for item in value]
    return value


def _decode_text(item: Any) -> Any:
    """Text whose bytes are not UTF-8 is taken as Latin-1."""
    if not isinstance(item, str):
        return item
    content = item.encode("utf-8", "surrogateescape")
    try:
        return content.decode("utf-8")
    except UnicodeDecodeError:
        return content.decode("latin-1")


if __name__ == "__main__":
    sys.exit(main(sys.argv[1], sys.argv[2]))
