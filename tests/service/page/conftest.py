"""Fixtures of the web page's tests: a browser, visitors, services of their own."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest

from scaling_service.client import Client
from scaling_service.service.http import site
from tests.cli.serving import served
from tests.service.page.node import packages
from tests.service.page.visitor import Visitor
from tests.service.page.walker import put_walker

Visit = Callable[..., Visitor]


@pytest.fixture
def visit(browser: Any) -> Iterator[Visit]:
    """Opens the page of a service as a new visitor; at the end, no visitor may have met a defect."""
    if not (site._BUNDLE / "index.html").is_file():
        pytest.skip("this installation was built without the web page")
    with ExitStack() as stack:
        visitors = []

        def opened(url: str, **options: Any) -> Visitor:
            context = browser.new_context(**{"viewport": {"width": 1440, "height": 900}} | options)
            stack.callback(context.close)
            visitors.append(Visitor(context.new_page(), url))
            return visitors[-1]

        yield opened
        for visitor in visitors:
            visitor.met_no_defect()


@pytest.fixture(scope="session")
def url(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """The address of a service that several tests use, each with subjects of its own."""
    with served(tmp_path_factory.mktemp("page") / "data") as address:
        yield address


@pytest.fixture(scope="session")
def walked(url: str, example: Path, tmp_path_factory: pytest.TempPathFactory) -> str:
    """The job that compared a walker, ``walked``, by one method: to be looked at only."""
    with Client(url) as client:
        subject = put_walker(client, "walked", example / "lab", tmp_path_factory.mktemp("walked"))
        return client.wait(client.ask("comparisons", subject=subject, methods=["MB"])).id


@pytest.fixture(scope="session")
def npm(tmp_path_factory: pytest.TempPathFactory) -> Path | None:
    """Folder of npm's packages with those of developers; None where they cannot be fetched."""
    return packages(tmp_path_factory)
