"""Fixtures shared by all tests."""

from __future__ import annotations

import compileall
import gc
import hashlib
import os
import pickle
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import redirect_stdout
from io import StringIO
from pathlib import Path
from typing import TYPE_CHECKING, Any

import hypothesis
import pytest
from _pytest.assertion import rewrite

import scaling_service
from scaling_service.core.threads import use_one_thread
from tests.finished import Demo, fill_once, make_once

if TYPE_CHECKING:
    from scaling_service.bones.results import BoneLandmarks
    from scaling_service.bones.whole import Mesh
    from scaling_service.capabilities.scaling.result import Results
    from scaling_service.capabilities.shared.settings import Settings
    from scaling_service.core.progress import Progress
    from scaling_service.documents.results import TruthDocument

use_one_thread()  # numpy is not imported yet

# What an example takes says nothing where other workers share the cores.
hypothesis.settings.register_profile("shared", deadline=None)
hypothesis.settings.load_profile("shared")

# Tests start the program some hundred times: a quarter of that is compiling, where nothing of it is kept.
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)


def pytest_xdist_auto_num_workers() -> int:
    """Two more than there are cores: with one more, a quarter of their time still went by in waiting."""
    return len(os.sched_getaffinity(0)) + 2


@pytest.hookimpl(wrapper=True)
def pytest_collection(session: pytest.Session) -> Iterator[None]:
    """What collecting makes stays to the end: looking through it for garbage took a seventh of all time.

    What tests make is looked through less often than usual: it is little beside arrays, and took a fiftieth.
    """
    gc.disable()
    try:
        compile_share(session.config)
        return (yield)
    finally:
        gc.freeze()
        gc.set_threshold(50_000)
        gc.enable()


def compile_share(config: pytest.Config) -> None:
    """Compile a share of all modules for all processes: each would compile every one by itself."""
    worker = getattr(config, "workerinput", None)
    if worker is None or sys.dont_write_bytecode:
        return
    places = [Path(scaling_service.__path__[0]), *map(Path, config.args)]
    modules = sorted(file for place in places for file in place.rglob("*.py"))
    for file in modules[int(worker["workerid"].removeprefix("gw")) :: worker["workercount"]]:
        if not file.name.startswith("test_"):
            compileall.compile_file(file, quiet=1)
            continue
        compiled = rewrite.get_cache_dir(file) / f"{file.stem}{rewrite.PYC_TAIL}"
        if rewrite._read_pyc(file, compiled) is None:
            compiled.parent.mkdir(exist_ok=True)
            source, code = rewrite._rewrite_test(file, config)
            rewrite._write_pyc(config.stash[rewrite.assertstate_key], code, source, compiled)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """The check of types takes longest, so it begins first: by its name it would begin last, and alone.

    What waits for a browser follows, in one process while the others compute: at the end, all would wait.
    """
    items.sort(
        key=lambda item: (
            item.path.name != "test_checks.py",
            "browser" not in getattr(item, "fixturenames", ()),
        )
    )


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """Folder of the real recordings: ``SCALING_SERVICE_DATA``, else ``../shared/data``."""
    named = os.environ.get("SCALING_SERVICE_DATA")
    folder = Path(named) if named else Path(__file__).resolve().parents[2] / "shared" / "data"
    if not folder.is_dir():
        pytest.skip(f"no recordings at {folder}; set SCALING_SERVICE_DATA")
    return folder


@pytest.fixture(scope="session")
def demo(demo_program: Path) -> Demo:
    """What ``demo`` computes: all methods on a virtual person; once in a run."""
    made: Demo = pickle.loads((demo_program / "made").read_bytes())
    return made


@pytest.fixture(scope="session", autouse=True)
def known_bones(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Landmarks of images that many tests read are found once in a run; tests of finding call it itself."""
    from scaling_service.bones import whole

    find = whole.find_landmarks

    def find_once(
        bones: Mapping[str, Mesh], *, progress: Callable[[str], None] | None = None
    ) -> dict[str, BoneLandmarks]:
        content = hashlib.sha256()
        for name, arrays in bones.items():
            content.update(name.encode())
            if progress is not None:
                progress(name)
            for array in arrays:
                content.update(f"{array.dtype} {array.shape}".encode())
                content.update(array.tobytes())
        return make_once(tmp_path_factory, f"bones_{content.hexdigest()}", lambda: find(bones))

    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(whole, "find_landmarks", find_once)
        yield


@pytest.fixture(scope="module")
def known_bodies(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Over the same points, bodies are placed once in a run: for tests of what is made of them."""
    from scaling_service.recording.identity import identify

    def remember(function: Callable[..., Any]) -> Callable[..., Any]:
        def find_once(*given: Any, **named: Any) -> Any:
            content = hashlib.sha256(pickle.dumps((given, sorted(named.items()))))
            name = f"{function.__name__}_{content.hexdigest()}"
            return make_once(tmp_path_factory, name, lambda: function(*given, **named))

        return find_once

    with pytest.MonkeyPatch.context() as patched:
        for name in ("propose_standing_bodies", "refine_standing_body"):
            patched.setattr(identify, name, remember(getattr(identify, name)))
        yield


@pytest.fixture(scope="session")
def example(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What ``scaling-service example`` writes, to be read only: ``lab``, and ``plates`` with forces."""
    from scaling_service.cli import main

    def make(folder: Path) -> None:
        assert main(["example", "--out", str(folder / "lab")]) == 0
        assert main(["example", "--plates", "--out", str(folder / "plates")]) == 0

    return fill_once(tmp_path_factory, "example", make)


@pytest.fixture(scope="session")
def demo_program(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where ``demo --out demo`` was run; what it printed is ``screen.txt``, what it computed ``made``."""
    from scaling_service.capabilities.scaling import run
    from scaling_service.cli import main
    from tests.safety.running import SCREEN

    compute = run.run_demo

    def make(folder: Path) -> None:
        def keep(settings: Settings, *, progress: Progress) -> tuple[Results, TruthDocument]:
            shares: list[tuple[str, float]] = []

            def tell(what: str, share: float) -> None:
                shares.append((what, share))
                progress(what, share)

            results, truth = compute(settings, progress=tell)
            (folder / "made").write_bytes(pickle.dumps(Demo(results, truth, shares)))
            return results, truth

        with pytest.MonkeyPatch.context() as patched, redirect_stdout(StringIO()) as screen:
            for name, value in SCREEN.items():
                patched.setenv(name, value)
            patched.chdir(folder)
            patched.setattr(run, "run_demo", keep)
            assert main(["demo", "--out", "demo"]) == 0
        (folder / "screen.txt").write_text(screen.getvalue(), encoding="utf-8")

    return fill_once(tmp_path_factory, "demo_program", make)


@pytest.fixture(scope="session")
def browser() -> Iterator[Any]:
    """Debian's Chromium without a graphics card: one for all: Playwright starts once in a process."""
    from tests.service.page.visitor import ARGUMENTS, CHROMIUM

    if not CHROMIUM.is_file():
        pytest.skip(f"no Chromium at {CHROMIUM}")
    api = pytest.importorskip("playwright.sync_api")
    with api.sync_playwright() as playwright:
        running = playwright.chromium.launch(executable_path=CHROMIUM, args=ARGUMENTS)
        yield running
        running.close()
