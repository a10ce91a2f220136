"""The whole tour from an empty installation to a downloaded zip, on the example."""

from __future__ import annotations

import csv
import json
import re
import subprocess
import sys
import zipfile
from collections.abc import Callable
from io import BytesIO
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from PIL import Image

from tests.cli.serving import ENVIRONMENT, served
from tests.service.page.conftest import Visit
from tests.service.page.visitor import Visitor

Look = Callable[[], None]


@pytest.mark.costly
def test_tour(visit: Visit, npm: Path | None, tmp_path: Path) -> None:
    with served(tmp_path / "data") as url:
        tour(visit(url), npm, tmp_path)


def tour(visitor: Visitor, npm: Path | None, folder: Path) -> None:
    axe = None if npm is None else (npm / "axe-core" / "axe.min.js").read_text(encoding="utf-8")

    def look() -> None:
        if axe is not None:
            assert visitor.barriers(axe, every_pair=True) == [], visitor.page.url

    visitor.go()
    look()
    visitor.press("Load the example")
    imports(visitor, look)
    compares(visitor)
    plays(visitor)
    look()
    reads(visitor, look)
    takes_away(visitor, folder)
    discovers(visitor, look)
    visitor.follow("Jobs")
    visitor.page.get_by_role("link", name="Search for the missing effect").wait_for()
    look()
    visitor.met_no_defect()


def test_accessibility_was_looked_at(npm: Path | None) -> None:
    if npm is None:
        pytest.skip("axe cannot be fetched from the npm registry: the tour ran without it")
    assert (npm / "axe-core" / "axe.min.js").is_file()


def imports(visitor: Visitor, look: Look) -> None:
    visitor.sees("7 recordings in 13 files can be read")
    look()
    visitor.press("2 Markers")
    look()
    visitor.press("3 Laboratory")
    visitor.sees("up is +z, forward is +x of the laboratory")
    visitor.sees("1 of 14 labels have gaps")
    assert visitor.page.locator(".timeline .gap").count() == 1
    look()


def compares(visitor: Visitor) -> None:
    visitor.follow("On to the analyses")
    visitor.sees("Scale by several methods and compare them")
    visitor.press("Start: Find the missing effect")  # goes on beside the rest
    visitor.page.get_by_role("link", name="Search for the missing effect").wait_for()
    visitor.press("Compare")
    visitor.sees("How far to trust")
    assert visitor.page.title() == "Comparison of methods: example · scaling-service"
    assert visitor.page.get_by_text("This person is virtual").count() == 0  # its truth is not in its files


def plays(visitor: Visitor) -> None:
    """The stage shows something, plays, steps, and goes where the map of the error is clicked."""
    page = visitor.page
    visitor.follow("In space")
    page.locator(".cursor").wait_for(state="attached")
    page.wait_for_function("() => document.querySelector('.stage canvas').width > 0")
    assert colours(visitor) > 50  # bones in the light; an empty stage has a dozen
    visitor.press("One frame on")
    visitor.sees("0.01 s · 2 / 278")
    visitor.press("Play")
    page.wait_for_function("() => Number(document.querySelector('input[type=range]').value) > 20")
    visitor.press("Pause")
    page.locator("figure .plot").scroll_into_view_if_needed()
    box = page.locator("figure .plot").bounding_box()
    page.mouse.click(box["x"] + 84 + 0.75 * (box["width"] - 150), box["y"] + 30)
    visitor.sees("mm from")
    assert int(page.get_by_label("Frame", exact=True).input_value()) == pytest.approx(208, abs=3)
    frame = int(page.get_by_label("Frame", exact=True).input_value())
    page.wait_for_url(f"**/space?trial=gait_1&frame={frame}")
    page.reload()  # the address leads to the same picture
    page.locator(".cursor").wait_for(state="attached")
    visitor.sees(f"{frame + 1} / 278")
    page.locator(".stage canvas").focus()
    before = page.locator(".stage canvas").screenshot()
    page.keyboard.press("ArrowLeft")
    page.wait_for_timeout(200)
    assert page.locator(".stage canvas").screenshot() != before


def colours(visitor: Visitor) -> int:
    """How many colours the stage shows."""
    visitor.page.wait_for_timeout(500)
    picture = Image.open(BytesIO(visitor.page.locator(".stage canvas").screenshot())).convert("RGB")
    return len(picture.resize((200, 100)).getcolors(20_000) or ())


def reads(visitor: Visitor, look: Look) -> None:
    visitor.follow("Sizes")
    visitor.sees("Segment lengths, mm")
    table = visitor.downloads("Save as CSV: Segment lengths, mm")
    rows = list(csv.reader(table.read_text(encoding="utf-8").splitlines()))
    assert rows[0] == ["segment", "MB", "MB_lam", "MB_am", "EB", "EB_am", "MAP"]
    assert 380 < float(rows[2][1]) < 460  # a thigh, mm
    assert " ± " in visitor.page.locator("table").filter(has_text="hip, right, x").inner_text()
    look()
    visitor.follow("Errors")
    visitor.sees("Kinematic error, mm (mean ± SD over frames)")
    look()
    visitor.follow("Angles")
    title = visitor.page.get_by_text(re.compile(r"^hip flexion, right \(\d+ cycles, p < 0\.001\)$")).first
    title.wait_for()
    name = title.inner_text()
    drawing = visitor.saves("SVG", name)
    assert ElementTree.parse(drawing).getroot().tag == "{http://www.w3.org/2000/svg}svg"
    assert visitor.saves("PNG", name).read_bytes().startswith(b"\x89PNG")
    look()
    visitor.page.get_by_label("Over", exact=True).select_option("as a clinic reads them")
    visitor.sees("of 83 typically developing children")
    knee = visitor.saves("CSV", "knee flexion, deg: flexion +, extension −")
    rows = list(csv.reader(knee.read_text(encoding="utf-8").splitlines()))
    columns = dict(zip(rows[0], np.array(rows[1:], dtype=float).T, strict=True))
    assert columns["percent"][-1] == 100.0
    assert 45.0 < columns["usual_mean_deg"].max() < 70.0  # a swinging knee, of children and of the example
    assert 45.0 < columns["right_mean_deg"].max() < 80.0
    look()
    visitor.follow("Forces")
    visitor.sees("The forces of this subject were not checked yet")


def takes_away(visitor: Visitor, folder: Path) -> None:
    """The zip is whole, and the lines that are shown give the same result again."""
    visitor.follow("Take away")
    button = visitor.page.get_by_role("button", name="Everything as one zip")
    with visitor.page.expect_download() as coming:
        button.click()
    with zipfile.ZipFile(coming.value.path()) as archive:
        assert archive.testzip() is None
        reported = json.loads(archive.read("comparison.json"))
        assert {"report.html", "EB/model.json", "scene/scene.json"} <= set(archive.namelist())
    shell, python = visitor.page.locator("pre").all_inner_texts()
    run(["bash", "-euo", "pipefail", "-c", shell], folder)
    assert json.loads((folder / "result.json").read_text(encoding="utf-8")) == reported
    run([sys.executable, "-c", python + "\nassert result['verdict']"], folder)
    assert (folder / "results" / "report.html").is_file()


def run(command: list[str], folder: Path) -> None:
    done = subprocess.run(command, cwd=folder, env=ENVIRONMENT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def discovers(visitor: Visitor, look: Look) -> None:
    visitor.follow("example")
    visitor.page.get_by_role("link", name="Search for the missing effect").click()
    visitor.sees("2 missing effects were found")
    visitor.sees("Markers: what is left over, and what is ordinary")
    look()
    visitor.page.get_by_text("What had been hidden in this virtual person").click()
    visitor.sees("LLM, LMM: two labels are exchanged for a while, in knee_l only: start 2 s, end 2.6 s")
    visitor.follow("2. What")
    visitor.sees("1. marker swap at LLM, LMM in knee_l")
    visitor.follow("3. With and without")
    visitor.page.locator(".cursor").first.wait_for(state="attached")
    assert visitor.page.get_by_role("checkbox", name="as given").is_checked()
    visitor.follow("4. On unseen data")
    visitor.sees("Held out: markers, mm")
    visitor.press("Show the page dark")
    look()
    visitor.press("Show the page light")
