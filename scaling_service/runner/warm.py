"""Imported by the fork server before any job: what jobs need, so that none pays for importing it."""

from scaling_service.core.threads import use_one_thread

use_one_thread()  # before numpy is imported

from importlib import import_module  # noqa: E402
from pkgutil import iter_modules  # noqa: E402

import pyvista  # noqa: E402, F401 (imported late by those who need it)

from scaling_service.runner import work  # noqa: E402

for _module in iter_modules(work.__path__):
    import_module(f"{work.__name__}.{_module.name}")
