"""The demo's report in a browser, from the disk: quick, quiet, whole, and readable without JavaScript."""

from __future__ import annotations

import base64
import gzip
import json
import re
import zlib
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from scaling_service.report.onefile import BUNDLE
from tests.service.page.node import packages
from tests.service.page.visitor import Visitor

MOST_BYTES = 5e6
SOON_MS = 1000.0
"""Until something is painted. Chosen: what a person does not wait for."""

READ = ("Verdict", "Sizes", "Errors", "Angles", "Numbers")
TRIES = 5  # one of them must be quick, for the machine may be busy
PAINTED = "performance.getEntriesByName('first-contentful-paint').map((entry) => entry.startTime)"
IMAGE = re.compile(
    rb"/Subtype\s*/Image\s*/Width (\d+)\s*/Height (\d+)[^<>]*/FlateDecode\s*/Length (\d+)>> stream\r?\n"
)
"""In a PDF by Chromium: what a canvas shows, in RGB."""

PAPER = (238, 241, 245)  # what is behind the models in light
DRAWN = 0.02  # of the picture; chosen: the models cover 0.05, the floor alone 0.01
TOO_WIDE = "document.documentElement.scrollWidth - document.documentElement.clientWidth"

Open = Callable[..., Visitor]


@pytest.fixture(scope="module")
def report(demo_program: Path) -> Path:
    if not (BUNDLE / "report.js").is_file():
        pytest.skip("this installation was built without the web page")
    return demo_program / "demo" / "report.html"


@pytest.fixture(scope="module")
def headline(report: Path) -> str:
    document = json.loads(report.with_name("comparison.json").read_text(encoding="utf-8"))
    return str(document["verdict"]["headline"])


@pytest.fixture(scope="session")
def axe(tmp_path_factory: pytest.TempPathFactory) -> str | None:
    """What finds barriers; None where it cannot be fetched."""
    npm = packages(tmp_path_factory)
    return None if npm is None else (npm / "axe-core" / "axe.min.js").read_text(encoding="utf-8")


@pytest.fixture
def open_report(browser: Any, report: Path) -> Iterator[Open]:
    """Opens the file at a place in it; nobody who did may have met a defect, nor have asked for more."""
    with ExitStack() as stack:
        visitors: list[Visitor] = []

        def opened(place: str = "", **options: Any) -> Visitor:
            context = browser.new_context(**{"viewport": {"width": 1440, "height": 900}} | options)
            stack.callback(context.close)
            visitor = Visitor(context.new_page(), report.as_uri())
            visitors.append(visitor)
            visitor.page.goto(f"{report.as_uri()}{place}")
            return visitor

        yield opened
        for visitor in visitors:
            assert visitor.defects == []
            assert visitor.foreign == []
            assert visitor.page.evaluate("window.violations ?? []") == []


def test_it_is_small_and_painted_at_once(report: Path, open_report: Open) -> None:
    assert report.stat().st_size <= MOST_BYTES
    painted = list[float]()
    while len(painted) < TRIES and min(painted, default=np.inf) > SOON_MS:
        visitor = open_report()
        visitor.page.wait_for_selector("nav.tabs")
        painted += visitor.page.evaluate(PAINTED)
    assert min(painted) <= SOON_MS


@pytest.mark.parametrize("place", ["space", "angles?over=gait_1", "files", "everything"])
def test_nobody_meets_a_barrier(open_report: Open, headline: str, axe: str | None, place: str) -> None:
    """On one page stand all parts that are to be read; the others are there to be handled."""
    visitor = open_report(f"#/jobs/report/{place}")
    visitor.page.wait_for_selector("nav.tabs [aria-current]")
    if place == "everything":
        visitor.sees(headline)
        visitor.page.wait_for_selector(".picture canvas")
        assert set(READ) <= set(visitor.page.locator("main > section > h2").all_inner_texts())
    if place == "space":
        visitor.page.wait_for_selector(".playback canvas")
        visitor.page.wait_for_selector(".main-svg")
    if "over" in place:
        visitor.page.get_by_text("Farthest now: ").wait_for()
    if axe is not None:
        assert visitor.barriers(axe) == []


def test_every_part_is_shown(open_report: Open, headline: str) -> None:
    visitor = open_report()
    visitor.sees(headline)
    visitor.page.wait_for_selector(".picture canvas")
    for title in READ:
        visitor.follow(title)
        visitor.page.locator("nav.tabs [aria-current]", has_text=title).wait_for()
        visitor.page.locator("main :is(table, figure)").first.wait_for()


def test_parts_are_reached_by_their_names_and_back(open_report: Open, headline: str) -> None:
    visitor = open_report()
    visitor.sees(headline)
    visitor.follow("Sizes")
    visitor.sees("Segment lengths, mm")
    visitor.page.go_back()
    visitor.sees(headline)


def test_the_farthest_marker_is_lit_at_the_time_that_a_curve_is_pointed_at(
    open_report: Open, report: Path
) -> None:
    visitor = open_report("#/jobs/report/angles?over=gait_1")
    companion = visitor.page.locator(".companion")
    plot = visitor.page.locator("figure:not(.companion) .plot").first
    plot.locator(".main-svg").first.wait_for()
    companion.get_by_text("Farthest now: ").wait_for()
    box = plot.bounding_box()
    frames = set[int]()
    for share in (0.4, 0.8):
        visitor.page.mouse.move(box["x"] + share * box["width"], box["y"] + box["height"] / 2)
        plot.locator(".hoverlayer").get_by_text("time, s: ").wait_for()
        visitor.page.wait_for_timeout(300)  # the second time, another moment is still shown
        frame = int(companion.get_by_role("slider", name="Frame").input_value())
        labels, errors = read_errors(report, "gait_1", "MAP")
        farthest = int(np.nanargmax(errors[frame]))
        said = f"Farthest now: {labels[farthest]}, {errors[frame, farthest]:.1f} mm from MAP"
        assert companion.locator(".status").inner_text() == said
        lit = companion.locator(".names span:not([hidden])")
        assert lit.all_text_contents() == [labels[farthest]]
        frames.add(frame)
    assert len(frames) == 2


def read_errors(report: Path, trial: str, method: str) -> tuple[list[str], Any]:
    """Markers of a recording and their distance from a method's model, (n_frames, n_markers), mm."""
    text = report.read_text(encoding="utf-8")
    (held,) = re.findall(r'<script type="application/json" id="held">(.*?)</script>', text, re.DOTALL)
    files = json.loads(held)["files"]
    content = {name: gzip.decompress(base64.b64decode(packed)) for name, packed in files.items()}
    scenes = (json.loads(text) for name, text in content.items() if name.endswith("scene.json"))
    (found,) = (one for scene in scenes for one in scene["trials"] if one["name"] == trial)
    stored = found["motions"][method]["errors"]
    (values,) = (text for name, text in content.items() if name.endswith(stored["file"]))
    return found["labels"], np.frombuffer(values, "<f4").reshape(stored["shape"])


def test_notes_are_those_of_the_document_word_for_word(
    open_report: Open, report: Path, demo_program: Path
) -> None:
    document = json.loads(report.with_name("comparison.json").read_text(encoding="utf-8"))
    notes = [*document["warnings"], *(w for m in document["methods"].values() for w in m["warnings"])]
    assert any("the right knee's axis (x, y)" in note for note in notes)
    visitor = open_report()
    visitor.page.locator("details summary", has_text="note").first.click()
    shown = visitor.page.locator("main").inner_text()
    screen = " ".join((demo_program / "screen.txt").read_text(encoding="utf-8").split())
    summary = open_report(java_script_enabled=False).page.locator("main").inner_text()
    for note in notes:
        assert note in shown
        assert note in screen
        assert note in summary


def test_it_fits_a_phone(open_report: Open) -> None:
    visitor = open_report(viewport={"width": 390, "height": 844})
    for title in (READ[0], "In space", *READ[1:]):
        visitor.follow(title)
        visitor.page.locator("nav.tabs [aria-current]", has_text=title).wait_for()
        visitor.page.locator("main :is(table, figure, .playback)").first.wait_for()
        assert visitor.page.evaluate(TOO_WIDE) <= 0, title
        if title == READ[0]:
            assert visitor.page.locator(".table").first.evaluate("it => it.scrollWidth - it.clientWidth") <= 0


def test_models_are_printed_on_light_paper(open_report: Open) -> None:
    visitor = open_report(color_scheme="dark")
    visitor.page.locator(".picture .apart").wait_for()  # both models are there
    printed = visitor.page.pdf(format="A4")
    (found,) = IMAGE.finditer(printed)
    width, height, size = map(int, found.groups())
    content = zlib.decompress(printed[found.end() : found.end() + size])
    pixels = np.frombuffer(content, np.uint8).reshape(height, width, 3)
    assert tuple(pixels[0, 0]) == PAPER
    assert np.mean(np.any(pixels != pixels[0, 0], axis=2)) > DRAWN


def test_heads_of_tables_are_repeated_on_further_pages(open_report: Open) -> None:
    """Chromium repeats what is written in a head, and no box within it, as a button is."""
    visitor = open_report("#/jobs/report/everything")
    visitor.page.locator("thead button.head").first.wait_for()
    visitor.page.emulate_media(media="print")
    shown = "heads => new Set(heads.map((head) => getComputedStyle(head).display)).values().toArray()"
    assert visitor.page.locator("thead button.head").evaluate_all(shown) == ["contents"]


def test_without_javascript_the_summary_is_read(open_report: Open, headline: str) -> None:
    visitor = open_report(java_script_enabled=False)
    text = visitor.page.locator("main").inner_text()
    for said in (
        headline,
        "What to beware of",
        "How far to trust",
        "Kinematic error, mm",
        "With JavaScript this file",
    ):
        assert said in text


def test_the_result_is_saved_as_it_is(open_report: Open, report: Path) -> None:
    visitor = open_report("#/jobs/report/files")
    with visitor.page.expect_download() as saved:
        visitor.press("The result as JSON")
    content = json.loads(Path(saved.value.path()).read_text(encoding="utf-8"))
    assert content == json.loads(report.with_name("comparison.json").read_text(encoding="utf-8"))


def test_a_view_that_fails_leaves_the_summary(browser: Any, report: Path, headline: str) -> None:
    broken = report.with_name("broken.html")
    text = report.read_text(encoding="utf-8")
    broken.write_text(text.replace('"methods":{"', '"nothing":{"', 1), encoding="utf-8")
    page = browser.new_page()
    page.goto(broken.as_uri())
    page.get_by_text("The page has a defect").wait_for()
    assert headline in page.locator("main").inner_text()
    page.close()
