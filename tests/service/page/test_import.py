"""What is typed and corrected on Import: it is kept whatever is pressed next, and written down."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import requests

from scaling_service.client import Client
from scaling_service.files.trc import read_trc, write_trc
from tests.service.page.conftest import Visit
from tests.service.page.visitor import Visitor
from tests.service.page.walker import put_walker

CHECKED = "can be read"
DRAWN = "() => [...document.querySelectorAll('.plot')].every((plot) => plot.querySelector('.main-svg'))"


def imported(visit: Visit, url: str, subject: str) -> Visitor:
    visitor = visit(url)
    visitor.go(f"subjects/{subject}/import")
    visitor.sees(CHECKED)
    return visitor


def document(url: str, subject: str) -> dict[str, Any]:
    found: dict[str, Any] = requests.get(f"{url}/v1/subjects/{subject}", timeout=10).json()["document"]
    return found


def test_what_is_typed_is_kept_by_the_next_click(
    visit: Visit, url: str, example: Path, tmp_path: Path
) -> None:
    with Client(url) as client:
        put_walker(client, "typed", example / "lab", tmp_path)
    for height, way in ((1.61, "On to the analyses"), (1.62, "2. Analyses")):
        visitor = imported(visit, url, "typed")
        visitor.page.get_by_label("height, m").fill(str(height))
        visitor.follow(way)
        visitor.page.get_by_role("button", name="Compare", exact=True).wait_for()
        assert document(url, "typed")["subject"]["height_m"] == height, way


@pytest.mark.costly  # what is offered, and puts it right, is asked in tests/jobs/test_proof_corrected.py
def test_exchanged_labels_are_put_right_by_one_click(
    visit: Visit, url: str, example: Path, tmp_path: Path
) -> None:
    with Client(url) as client:
        put_walker(client, "exchanged", example / "lab", tmp_path)
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


def test_a_marker_is_left_out_where_it_is_clicked(
    visit: Visit, url: str, example: Path, tmp_path: Path
) -> None:
    """In the result: the document has it by the file's own label and clock; the same is asked for again."""
    with Client(url) as client:
        subject = put_walker(client, "clicked", example / "lab", tmp_path)
        job = client.wait(client.ask("comparisons", subject=subject, methods=["MB"]))
    visitor = visit(url)
    visitor.go(f"jobs/{job.id}/space?trial=gait_1")
    name = visitor.page.get_by_role("button", name="RLFE", exact=True)
    name.click()
    visitor.page.locator("tr.lit", has=name).wait_for()
    form = visitor.page.get_by_role("form", name="Put V:RKNE right")
    form.get_by_label("from, s").fill("0.5")
    form.get_by_label("to, s").fill("0.9")
    form.get_by_role("button", name="Put it right and run again").click()
    visitor.page.wait_for_url(lambda address: "/jobs/" in address and job.id not in address)
    visitor.sees("Kinematic error and what was fitted")
    (item,) = document(url, "clicked")["corrections"]["gait_1.trc"]
    assert item == {"labels": {"V:RKNE": None}, "from_s": 0.5, "to_s": 0.9}
    with Client(url) as client:
        again = client.result(visitor.page.url.rsplit("/", 1)[-1])
    said = [note["detail"] for note in again["repairs"]["gait_1"] if note["what"] == "labels_changed"]
    assert said == ["V:RKNE left out from 0.50 to 0.90 s, as the subject file says"]


@pytest.mark.costly
def test_one_hover_joins_map_picture_and_table(visit: Visit, url: str, walked: str) -> None:
    """Pointing at the map shows its time and lights its marker in picture and table."""
    visitor = visit(url)
    visitor.go(f"jobs/{walked}/space?trial=gait_1")
    visitor.sees("Worst:")
    plot = visitor.page.locator("figure .plot")
    plot.scroll_into_view_if_needed()
    box = plot.bounding_box()
    assert box is not None
    visitor.page.mouse.move(box["x"] + box["width"] / 2, box["y"] + 40)
    visitor.page.mouse.move(box["x"] + box["width"] / 2 + 2, box["y"] + 40)
    visitor.sees("Pointed at: ")
    visitor.page.wait_for_timeout(300)  # the table follows ten times a second
    said = visitor.page.locator(".status", has_text="Pointed at: ").inner_text()
    marker, value = said.removeprefix("Pointed at: ").split(" mm")[0].split(", ")
    assert int(visitor.page.get_by_label("Frame", exact=True).input_value()) > 0
    lit = visitor.page.locator("tr.lit")
    assert lit.inner_text().split()[0] == marker
    assert lit.inner_text().split()[-1] == value
    assert visitor.page.locator(".names span:not([hidden])").all_inner_texts() == [marker]


def test_a_person_has_one_report(visit: Visit, url: str, walked: str, example: Path, tmp_path: Path) -> None:
    """What ran is in it with its own words, what did not is named; two sessions stand beside each other."""
    with Client(url) as client:
        subject = put_walker(client, "after", example / "lab", tmp_path)
        result = client.result(client.wait(client.ask("comparisons", subject=subject, methods=["MB"])))
    visitor = visit(url)
    visitor.go("subjects/after/report")
    visitor.sees(result["verdict"]["headline"].split(":")[0])
    visitor.sees("The forces were not checked yet.")
    visitor.sees("No missing effect was looked for yet.")
    length = result["methods"]["MB"]["segment_lengths_mm"]["femur_r"]
    row = visitor.page.get_by_role("row", name="femur, right").first
    assert f"{length:.1f}" in row.inner_text()
    visitor.page.get_by_label("beside another session").select_option("walked")
    visitor.sees("after beside walked")
    both = visitor.page.get_by_role("row", name="femur, right").last.inner_text().split()
    assert both[2:5] == [f"{length:.1f}", f"{length:.1f}", "±0.0"]


@pytest.mark.costly  # how it prints
def test_figures_are_drawn_before_anybody_scrolls(visit: Visit, url: str, walked: str) -> None:
    """They are printed, also where a chapter below them comes late."""
    job = requests.get(f"{url}/v1/jobs/{walked}", timeout=10).json() | {"id": "0" * 64}
    search = {"headline": "Nothing stands out", "tone": "good", "repairs": {}, "effects": []}
    visitor = visit(url, viewport={"width": 1440, "height": 200})

    def answer_late(route: Any) -> None:
        time.sleep(1.0)
        route.fulfill(json=search)

    visitor.page.route("**/v1/jobs?*kind=discovery*", lambda route: route.fulfill(json={"items": [job]}))
    visitor.page.route(f"**/v1/jobs/{job['id']}/result", answer_late)
    visitor.go("subjects/walked/report")
    visitor.sees("Nothing stands out")
    visitor.page.wait_for_function(DRAWN)


@pytest.mark.costly  # what a note keeps is asked of HTTP in test_notes.py
def test_notes_are_signed_for_the_results_that_are_shown(
    visit: Visit, url: str, example: Path, tmp_path: Path
) -> None:
    with Client(url) as client:
        subject = put_walker(client, "signed", example / "lab", tmp_path)
        job = client.wait(client.ask("comparisons", subject=subject, methods=["MB"]))
    visitor = visit(url)
    visitor.go("subjects/signed/report")
    visitor.sees("Not signed.")
    visitor.page.get_by_label("Notes").fill("The left knee slipped.")
    visitor.page.get_by_label("name", exact=True).fill("A. Smith")
    visitor.press("Sign notes and results")
    visitor.sees("Signed by A. Smith on")
    with Client(url) as client:
        kept = client._call("GET", "/v1/subjects/signed/note").json()
        assert kept["results"] == [job.id]
        raw = {"processing": {"smoothing": "none"}}
        client.wait(client.ask("comparisons", subject=subject, methods=["MB"], settings=raw))
    visitor.page.reload()
    visitor.sees("before these results: they are newer")
    assert visitor.page.get_by_label("Notes").input_value() == "The left knee slipped."


@pytest.mark.costly  # what marked strikes do is asked in tests/jobs/test_events.py
def test_heel_strikes_are_marked_and_cut_strides(
    visit: Visit, url: str, example: Path, tmp_path: Path
) -> None:
    with Client(url) as client:
        subject = put_walker(client, "struck", example / "lab", tmp_path)
    visitor = imported(visit, url, "struck")
    visitor.press("3 Laboratory")
    visitor.page.get_by_label("Recording").select_option("gait_1.trc")
    for at in (10, 120):
        slider = visitor.page.get_by_label("Frame", exact=True)
        slider.fill(str(at))
        visitor.press("right heel strike")
        visitor.page.get_by_role(
            "button", name=f"right heel strike at {at / 100:.2f} s", exact=True
        ).wait_for()
    given = document(url, "struck")["events"]["gait_1.trc"]
    assert given == [{"side": "r", "kind": "strike", "time_s": at} for at in (0.1, 1.2)]
    with Client(url) as client:
        result = client.result(client.wait(client.ask("comparisons", subject=subject, methods=["MB"])))
    (cycle,) = result["methods"]["MB"]["clinical"]["sides"]["r"]["cycles"]
    assert (cycle["start_s"], cycle["end_s"]) == (0.1, 1.2)
    visitor.press("As they were found")
    visitor.sees("None is in the file, and no plate shows one.")
    assert "events" not in document(url, "struck")


@pytest.mark.costly  # an address that is shared
def test_a_stretch_of_a_curve_stands_in_the_address(visit: Visit, url: str, walked: str) -> None:
    visitor = visit(url)
    visitor.go(f"jobs/{walked}/angles?over=gait_1&zoom=gait_1_knee_angle_r_deg~0.5~1")
    larger = visitor.page.get_by_label("Larger: knee angle, right")
    larger.wait_for()
    assert larger.get_attribute("aria-pressed") == "true"
    plot = visitor.page.locator("figure.large .plot")
    plot.locator(".xtick").first.wait_for()
    shown = plot.evaluate("(place) => place._fullLayout.xaxis.range")
    np.testing.assert_allclose(shown, [0.5, 1.0])
    larger.click()
    visitor.page.wait_for_function("() => !location.hash.includes('zoom')")


def test_another_model_has_other_markers(visit: Visit, url: str, example: Path, tmp_path: Path) -> None:
    """What was chosen for the markers of one model is not asked of another; what hinders is told there."""
    with Client(url) as client:
        put_walker(client, "changed", example / "lab", tmp_path)
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


def test_what_cannot_run_says_what_it_needs(visit: Visit, url: str, example: Path, tmp_path: Path) -> None:
    """Without forces the check of forces cannot be started; with a click one is where they are given."""
    with Client(url) as client:
        put_walker(client, "bare", example / "lab", tmp_path)
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


def test_the_worst_moment_is_the_frame_itself(visit: Visit, url: str, walked: str) -> None:
    """The button under the map leads to the very frame, and the stage says the same number."""
    visitor = visit(url)
    visitor.go(f"jobs/{walked}/space?trial=gait_1")
    visitor.sees("Worst:")
    for k in range(3):
        button = visitor.page.locator(".actions", has_text="Worst:").get_by_role("button").nth(k)
        marker, value = button.inner_text().split()[:2]
        button.click()
        visitor.sees(f"{marker}: {value} mm from MB")
