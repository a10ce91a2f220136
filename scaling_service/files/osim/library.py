"""The opensim library, imported only in the worker process.

It cannot live in one process with casadi, changes the working directory and is not thread-safe.
"""

from __future__ import annotations

import importlib
from functools import cache
from typing import Any

from scaling_service.core.errors import DependencyMissing


@cache
def opensim() -> Any:
    """The opensim module with its chatter silenced.

    Raises DependencyMissing if it is not installed, or its shared libraries do not load.
    """
    try:
        module = importlib.import_module("opensim")
    except ImportError as error:
        raise DependencyMissing(
            f"the opensim library cannot be imported ({error})",
            field="opensim",
            remedy="Install it with `pip install scaling-service[opensim]`",
        ) from error
    module.Logger.setLevelString("Error")
    return module
