"""Imported by the fork server before any job: what jobs need, so that none pays for importing it."""

from scaling_service.core.threads import use_one_thread

use_one_thread()  # before numpy is imported

from importlib import import_module  # noqa: E402

import pyvista  # noqa: E402, F401 (imported late by those who need it)

from scaling_service.service.jobs.kinds import KINDS  # noqa: E402

for _kind in KINDS.values():
    import_module(_kind.work.path)
