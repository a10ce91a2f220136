"""One clock for all machines: the database's, in microseconds since 1970.

Workers on several machines compare leases with it, so a machine whose own clock is wrong takes no job
from another.
"""

from __future__ import annotations

from typing import Any

from sqlalchemy import BigInteger
from sqlalchemy.ext.compiler import compiles
from sqlalchemy.sql.functions import FunctionElement

US_PER_S = 1_000_000


class NowUs(FunctionElement[int]):
    """Time of the database when the statement runs (µs; SQLite's clock has a resolution of 1 ms)."""

    name = "now_us"
    type = BigInteger()
    inherit_cache = True


@compiles(NowUs, "sqlite")
def _sqlite(_element: NowUs, _compiler: Any, **_options: Any) -> str:
    # 2440587.5: the Julian day of 1970-01-01 (Meeus 1998, Astronomical Algorithms, chapter 7).
    return "CAST(ROUND((julianday('now') - 2440587.5) * 86400000.0) AS INTEGER) * 1000"


@compiles(NowUs, "postgresql")
def _postgresql(_element: NowUs, _compiler: Any, **_options: Any) -> str:
    return "CAST(EXTRACT(EPOCH FROM clock_timestamp()) * 1000000 AS BIGINT)"
