"""Names of uploaded files: plain, without folders, the same on every system."""

from __future__ import annotations

import re

from scaling_service.core.errors import InputError

DOCUMENT = "subject.json"  # under this name a subject's document lies beside its files when a job computes

PARTS = ".parts.json"
"""Under this name it stands among the inputs how the parts of a job ended; no subject is called so."""

_PLAIN = re.compile(r"\w[\w .()+=@,\-]{0,199}")
_MOST_BYTES = 255  # of a name, on the usual file systems


def require_plain_name(name: str, field: str = "name") -> str:
    """The name, if it is one that an uploaded file can have.

    Raises InputError: it has a folder or a special character in it, is too long, or is reserved.

    Examples
    --------
    >>> require_plain_name("Walking01.c3d")
    'Walking01.c3d'
    """
    good = _PLAIN.fullmatch(name) is not None and not name.endswith((" ", "."))
    if not good or len(name.encode()) > _MOST_BYTES or name.casefold() == DOCUMENT:
        raise InputError(
            f"'{name[:60]}' cannot be the name of an uploaded file",
            field=field,
            remedy="Use up to 200 letters, digits, spaces, dots and hyphens, without folders"
            + (f"; '{DOCUMENT}' is taken" if name.casefold() == DOCUMENT else ""),
        )
    return name
