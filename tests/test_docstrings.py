"""The examples in docstrings run, and every public name teaches how it is used."""

from __future__ import annotations

import doctest
import functools
import hashlib
import inspect
import pkgutil
import re
import shutil
from collections.abc import Callable
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import pytest
from pydantic import BaseModel

import scaling_service
from scaling_service.cli import main
from tests.finished import fill_once, make_once

# Worker processes of libraries that must stay out of this one; they have no examples.
APART = (
    "scaling_service.files.osim.worker",
    "scaling_service.__main__",
)
MODULES = [
    module.name
    for module in pkgutil.walk_packages(scaling_service.__path__, "scaling_service.")
    if not module.name.startswith(APART)
]
SHOWING = [name for name in MODULES if ">>>" in Path(find_spec(name).origin).read_text(encoding="utf-8")]
"""Those with examples: looking for some in all others took longer than running these."""

SEARCH = [f"scaling_service.capabilities.discovery.{name}" for name in ("run", "saving")]
"""Their examples search for what is missing, which takes long."""

PUBLIC = set(scaling_service.HOMES.values())


@pytest.fixture(scope="session")
def reader(example: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What the reader of the guide's first pages has made, in a folder that this process writes to."""
    folder = tmp_path_factory.mktemp("reader")
    shutil.copytree(example, folder, dirs_exist_ok=True)

    def make(made: Path) -> None:
        subject = str(folder / "lab" / "subject.json")
        assert main(["compare", subject, "--methods", "MB", "--no-report", "--out", str(made / "MB")]) == 0

    shutil.copytree(fill_once(tmp_path_factory, "compared_by_the_reader", make) / "MB", folder / "compared")
    return folder


@pytest.fixture(scope="session")
def remembered(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Callable[..., Any]]:
    """What several examples begin with, computed once in a run."""

    def remember(function: Callable[..., Any]) -> Callable[..., Any]:
        results: dict[str, Any] = {}

        @functools.wraps(function)
        def compute(*given: Any, **named: Any) -> Any:
            key = repr((given, named))
            if key not in results:
                name = f"{function.__name__}_{hashlib.sha256(key.encode()).hexdigest()}"
                results[key] = make_once(tmp_path_factory, name, lambda: function(*given, **named))
            return results[key]

        return compute

    return {name: remember(getattr(scaling_service, name)) for name in ("scale", "discover", "dynamics")}


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[pytest.mark.costly] if name in SEARCH else []) for name in SHOWING]
)
def test_examples(name: str, request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    if name in PUBLIC:
        monkeypatch.chdir(request.getfixturevalue("reader"))
        for function, remembered in request.getfixturevalue("remembered").items():
            monkeypatch.setattr(scaling_service, function, remembered)
    options = doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE
    assert doctest.testmod(import_module(name), optionflags=options).failed == 0


def test_every_module_can_be_loaded() -> None:
    for name in MODULES:
        import_module(name)


@pytest.mark.parametrize("name", scaling_service.__all__)
def test_a_public_name_is_described_whole(name: str) -> None:
    """What goes in and comes out, what is refused, and an example with it in use."""
    thing = getattr(scaling_service, name)
    text = inspect.getdoc(thing)
    sections = dict(re.findall(r"^([A-Z][a-z]+)\n-+\n(.*?)(?=^[A-Z][a-z]+\n-+$|\Z)", text, re.M | re.S))
    assert re.search(rf"^(>>>|\.\.\.) .*\b{name}\b", sections["Examples"], re.MULTILINE)
    if inspect.isfunction(thing):
        entries = re.findall(r"^(\w+) : ", sections["Parameters"], re.MULTILINE)
        assert entries == list(inspect.signature(thing).parameters)
        assert sections["Returns"].strip()
        assert sections["Raises"].strip()
    elif issubclass(thing, BaseModel):
        assert not [field for field, info in thing.model_fields.items() if not info.description]
    elif not issubclass(thing, Exception):
        entries = re.findall(r"^(\w[\w, ]*) : ", sections["Attributes"], re.MULTILINE)
        assert [e for entry in entries for e in entry.split(", ")] == list(thing.__dataclass_fields__)


def test_exports_are_exact() -> None:
    for name in scaling_service.__all__:
        assert getattr(scaling_service, name).__name__ == name
    with pytest.raises(AttributeError, match="nothing_such"):
        _ = scaling_service.nothing_such
    assert set(scaling_service.__all__) <= set(dir(scaling_service))
