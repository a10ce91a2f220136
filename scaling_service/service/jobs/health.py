"""Whether a Dask scheduler or worker answers: ``python -m scaling_service.service.jobs.health ADDRESS``."""

from __future__ import annotations

import asyncio
import importlib
import sys

LONGEST_S = 5.0  # chosen: who is alive answers in milliseconds, on a busy machine within a second


def main(address: str) -> int:
    """The exit code: 0 where it says who it is in time, else 1."""
    try:
        asyncio.run(asyncio.wait_for(_ask(address), LONGEST_S))
    except (OSError, TimeoutError) as error:
        sys.stderr.write(f"{address} does not answer ({type(error).__name__})\n")
        return 1
    return 0


async def _ask(address: str) -> None:
    async with importlib.import_module("distributed.core").rpc(address, timeout=LONGEST_S) as peer:
        await peer.identity()


if __name__ == "__main__":
    sys.exit(main(sys.argv[1]))
