"""Scales multibody body models to persons from motion capture, and says how far to trust the result.

What is named in ``__all__`` is the Python interface; it is loaded when it is first used, so that the
worker processes of single modules stay light.
"""

from __future__ import annotations

from scaling_service.core.frozen import let_mappings_be_sent
from scaling_service.core.lazy import offer_names

HOMES, __getattr__, __dir__ = offer_names(__name__, __file__)

__all__ = list(HOMES)

let_mappings_be_sent()  # results have some
