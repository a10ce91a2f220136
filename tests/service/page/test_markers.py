"""Labels of a laboratory: corrected by a click in space, saved, and proposed for the next subject."""

from __future__ import annotations

from io import BytesIO
from pathlib import Path

import numpy as np
import pytest
import requests
from PIL import Image

from scaling_service.files.trc import read_trc, write_trc
from scaling_service.model.trial import Trial
from tests.service.page.conftest import Visit
from tests.service.page.visitor import Visitor


@pytest.mark.costly  # what is saved and proposed is asked of HTTP in test_marker_map.py
def test_corrected_labels_are_kept_for_the_laboratory(
    visit: Visit, url: str, example: Path, tmp_path: Path
) -> None:
    visitor = bring(visit, url, recording(example / "lab", tmp_path), "first")
    page = visitor.page
    row = page.get_by_role("row").filter(has=page.get_by_role("rowheader", name="RASIS", exact=True))
    row.get_by_label("Label of RASIS").select_option("q7")  # as somebody who slipped
    row.get_by_role("button", name="Pick").click()
    visitor.sees("Click the marker that is RASIS")
    click_topmost_marker(visitor)
    page.get_by_text("is taken for RASIS").wait_for()
    taken = page.get_by_label("Label of RASIS").input_value()
    visitor.press("Save these labels for the laboratory")
    visitor.sees("labels are saved for the laboratory")
    assert requests.get(f"{url}/v1/marker-map", timeout=10).json()["labels"][taken] == "RASIS"
    other = bring(visit, url, tmp_path / "standing.trc", "second")
    other.sees("as the laboratory's map says")
    assert other.page.get_by_label("Label of RASIS").input_value() == taken


def recording(lab: Path, folder: Path) -> Path:
    """The example's person standing, with labels that say nothing."""
    trial = read_trc(lab / "static.trc")
    labels = tuple(f"q{k}" for k in range(len(trial.labels)))
    write_trc(
        folder / "standing.trc",
        Trial(
            name="standing", times=trial.times, labels=labels, markers=trial.markers, rate_hz=trial.rate_hz
        ),
    )
    return folder / "standing.trc"


def bring(visit: Visit, url: str, file: Path, name: str) -> Visitor:
    visitor = visit(url)
    visitor.go()
    visitor.drops(file)
    visitor.page.get_by_label("Whose file is this?").fill(name)
    visitor.press("Check them")
    visitor.press("2 Markers")
    return visitor


def click_topmost_marker(visitor: Visitor) -> None:
    canvas = visitor.page.locator(".stage canvas")
    canvas.scroll_into_view_if_needed()
    visitor.page.locator(".views").evaluate("element => { element.hidden = true; }")
    visitor.page.wait_for_timeout(500)
    grey = np.asarray(Image.open(BytesIO(canvas.screenshot())).convert("L"))
    rows, columns = np.nonzero(grey < 60)  # markers are nearly black
    near = rows < rows.min() + 8
    near &= np.abs(columns - columns[rows.argmin()]) < 8
    canvas.click(position={"x": float(columns[near].mean()), "y": float(rows[near].mean())})
