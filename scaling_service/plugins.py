"""What another distribution may import to add an effect, a method or a format of recordings.

The names of ``__all__`` stay from one minor version to the next; nothing else inside is promised. They are
loaded when they are first used: a reader of files does not load the search for effects.
"""

from __future__ import annotations

from scaling_service.core.lazy import offer_names

HOMES, __getattr__, __dir__ = offer_names(__name__, __file__)

__all__ = list(HOMES)
