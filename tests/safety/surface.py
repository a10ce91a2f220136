"""The public surface in a reduced form: options of commands, Python names, the HTTP interface."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

SURFACES: Mapping[str, Callable[[], Any]] = {}
