"""What is said when a mesh cannot be used."""

from __future__ import annotations

from scaling_service.core.errors import InputError


class MeshRefused(InputError):
    """A mesh is not the bone that it is given as, or too poor to say where its landmarks are."""
