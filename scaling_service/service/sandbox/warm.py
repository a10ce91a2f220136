"""Imported by the fork server before any job: what jobs need, so that none pays for importing it."""

from scaling_service.core.threads import use_one_thread

use_one_thread()  # before numpy is imported

from importlib import import_module  # noqa: E402
from pkgutil import walk_packages  # noqa: E402

from scaling_service import capabilities  # noqa: E402

_SCIPY = ("interpolate", "ndimage", "optimize", "signal", "stats")
for _late in ("pyvista", "trimesh", *(f"scipy.{part}" for part in _SCIPY)):  # imported late by who needs them
    import_module(_late)

for _module in walk_packages(capabilities.__path__, f"{capabilities.__name__}."):
    if not _module.name.endswith((".command", ".screen", ".flags", ".arguments")):  # what jobs do not need
        import_module(_module.name)
