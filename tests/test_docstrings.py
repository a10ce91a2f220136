"""The examples in docstrings run, and what is exported exists."""

from __future__ import annotations

import doctest
import pkgutil
from importlib import import_module

import pytest

import scaling_service

# Worker processes of libraries that must stay out of this one; they have no examples.
APART = (
    "scaling_service.files.osim.worker",
    "scaling_service.files.c3d_worker",
    "scaling_service.__main__",
)
MODULES = [
    module.name
    for module in pkgutil.walk_packages(scaling_service.__path__, "scaling_service.")
    if not module.name.startswith(APART)
]


@pytest.mark.parametrize("name", MODULES)
def test_examples(name: str) -> None:
    options = doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE
    assert doctest.testmod(import_module(name), optionflags=options).failed == 0


def test_exports_are_exact() -> None:
    for name in scaling_service.__all__:
        assert getattr(scaling_service, name).__name__ == name
    with pytest.raises(AttributeError, match="nothing_such"):
        _ = scaling_service.nothing_such
    assert set(scaling_service.__all__) <= set(dir(scaling_service))
