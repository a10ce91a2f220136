"""What is typed and corrected on Import: it is kept whatever is pressed next, and written down."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import requests

from scaling_service.client import Client
from scaling_service.files.trc import read_trc, write_trc
from tests.service.page.conftest import Visit
from tests.service.page.visitor import Visitor
from tests.service.page.walker import put_walker

CHECKED = "can be read"


def imported(visit: Visit, url: str, subject: str) -> Visitor:
    visitor = visit(url)
    visitor.go(f"subjects/{subject}/import")
    visitor.sees(CHECKED)
    return visitor


def document(url: str, subject: str) -> dict[str, Any]:
    found: dict[str, Any] = requests.get(f"{url}/v1/subjects/{subject}", timeout=10).json()["document"]
    return found


def test_what_is_typed_is_kept_by_the_next_click(visit: Visit, url: str, tmp_path: Path) -> None:
    with Client(url) as client:
        put_walker(client, "typed", tmp_path)
    for height, way in ((1.61, "On to the analyses"), (1.62, "2. Analyses")):
        visitor = imported(visit, url, "typed")
        visitor.page.get_by_label("height, m").fill(str(height))
        visitor.follow(way)
        visitor.page.get_by_role("button", name="Compare", exact=True).wait_for()
        assert document(url, "typed")["subject"]["height_m"] == height, way


def test_exchanged_labels_are_put_right_by_one_click(visit: Visit, url: str, tmp_path: Path) -> None:
    with Client(url) as client:
        put_walker(client, "exchanged", tmp_path)
        walk = read_trc(tmp_path / "gait_1.trc")
        wrong = walk.markers.copy()
        pair = [walk.index("V:RKNE"), walk.index("V:RKNM")]
        wrong[50:150, pair] = walk.markers[50:150, pair[::-1]]
        write_trc(tmp_path / "gait_1.trc", walk.with_markers(wrong))
        client.upload("exchanged", tmp_path / "gait_1.trc")
    visitor = imported(visit, url, "exchanged")
    button = visitor.page.get_by_role("button", name="Exchange V:R").first
    button.click()
    visitor.page.get_by_role("heading", name="Labels put right").wait_for()
    assert visitor.page.get_by_role("button", name="Exchange V:R").count() == 0  # nothing looks exchanged now
    (item,) = document(url, "exchanged")["corrections"]["gait_1.trc"]
    np.testing.assert_allclose([item["from_s"], item["to_s"]], walk.times[[50, 149]], atol=1.5 / walk.rate_hz)
    visitor.press("Undo")
    button.wait_for()
    assert "corrections" not in document(url, "exchanged")


def test_another_model_has_other_markers(visit: Visit, url: str, tmp_path: Path) -> None:
    """What was chosen for the markers of one model is not asked of another; what hinders is told there."""
    with Client(url) as client:
        put_walker(client, "changed", tmp_path)
        document_ = client.subject("changed").document
        nowhere = {"extra_markers": {"V:RKNE": "calcn_r"}}  # a segment of models with feet
        client.put_subject({**document_, **nowhere})
    visitor = visit(url)
    visitor.go("subjects/changed/run")
    visitor.sees("has no segment 'calcn_r'")
    visitor.follow("Back to the recordings")
    visitor.sees(CHECKED)
    visitor.page.get_by_label("model", exact=True).select_option("lower_limb_feet_18dof")
    visitor.press("2 Markers")
    visitor.page.locator("tr", has_text="RHEE").first.wait_for()
    assert "extra_markers" not in document(url, "changed")


def test_what_cannot_run_says_what_it_needs(visit: Visit, url: str, tmp_path: Path) -> None:
    """Without forces the check of forces cannot be started; with a click one is where they are given."""
    with Client(url) as client:
        put_walker(client, "bare", tmp_path)
    visitor = visit(url)
    visitor.go("subjects/bare/run")
    start = visitor.page.get_by_role("button", name="Start: Check the forces")
    start.wait_for()
    assert start.is_disabled()
    visitor.page.get_by_role("button", name="Give: forces").first.click()
    visitor.sees("What each file is for")


def test_an_address_of_no_job_says_so(visit: Visit, url: str) -> None:
    visitor = visit(url)
    visitor.go("jobs/nonsense")
    visitor.sees("There is no such job")


def test_the_worst_moment_is_the_frame_itself(visit: Visit, url: str, tmp_path: Path) -> None:
    """The button under the map leads to the very frame, and the stage says the same number."""
    with Client(url) as client:
        job = client.wait(
            client.ask("comparisons", subject=put_walker(client, "worst", tmp_path), methods=["MB"])
        )
    visitor = visit(url)
    visitor.go(f"jobs/{job.id}/space?trial=gait_1")
    visitor.sees("Worst:")
    for k in range(3):
        button = visitor.page.locator(".actions", has_text="Worst:").get_by_role("button").nth(k)
        marker, value = button.inner_text().split()[:2]
        button.click()
        visitor.sees(f"{marker}: {value} mm from MB")
