"""Read-only mappings that can be sent to other processes, which Python by itself refuses."""

from __future__ import annotations

import copyreg
from collections.abc import Mapping
from types import MappingProxyType
from typing import Any


def freeze(contents: Mapping[Any, Any]) -> MappingProxyType[Any, Any]:
    """A read-only copy.

    Examples
    --------
    >>> import pickle
    >>> pickle.loads(pickle.dumps(freeze({"femur_r": 0.41})))
    mappingproxy({'femur_r': 0.41})
    """
    return MappingProxyType(dict(contents))


def let_mappings_be_sent() -> None:
    """From now on read-only mappings are pickled by what they hold."""
    copyreg.pickle(MappingProxyType, lambda mapping: (freeze, (dict(mapping),)))
