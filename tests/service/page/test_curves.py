"""Angles over time: where a joint stands at its stop, and one pointer for all that is seen."""

from __future__ import annotations

from pathlib import Path

import pytest

from scaling_service.client import Client
from tests.service.page.conftest import Visit
from tests.service.page.visitor import LONG_MS


@pytest.mark.costly  # follows a whole body first; that a stop is told is asked in tests/capabilities
def test_a_stop_is_drawn_and_what_is_pointed_at_is_shown_by_all(
    visit: Visit, url: str, shared_data: Path
) -> None:
    files = [shared_data / "opencap_squat" / name for name in ("manually_scaled.osim", "squats1.trc")]
    with Client(url) as client:
        client.put_subject(
            {"subject": {"id": "squats"}, "model": files[0].name, "trials": {"evaluation": [files[1].name]}}
        )
        for file in files:
            client.upload("squats", file)
        job = client.wait(client.ask("motions", subject="squats", model=files[0].name))
    said = [text for text in client.result(job)["warnings"] if "stands at its stop" in text]
    assert [text.split(":")[1].split(",")[0] for text in said] == [
        " right forearm rotation stands at its stop",
        " left forearm rotation stands at its stop",
    ]
    visitor = visit(url)
    visitor.go(f"jobs/{job.id}/errors")
    visitor.sees(said[0], LONG_MS)
    visitor.follow("Angles and their bands")
    figures = visitor.page.locator("figure")
    stopped, free = (
        figures.filter(has_text=f"{name}, left") for name in ("forearm rotation", "elbow flexion")
    )
    stopped.scroll_into_view_if_needed()
    stopped.locator(".annotation-text", has_text="stop").wait_for()
    assert stopped.locator(".shapelayer path").count() >= 1
    free.locator(".main-svg").first.wait_for()
    assert free.locator(".annotation-text", has_text="stop").count() == 0
    level = figures.filter(has_text="forearm rotation, right")  # at its stop in all frames
    ticks = [float(text.replace("−", "-")) for text in level.locator(".ytick text").all_text_contents()]
    assert max(ticks) - min(ticks) > 1.0
    box = stopped.locator(".plot").bounding_box()
    visitor.page.mouse.move(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
    shown = free.locator(".hoverlayer")
    shown.get_by_text("time, s: ").wait_for()
    visitor.page.mouse.move(1.0, 1.0)
    shown.get_by_text("time, s: ").wait_for(state="hidden")
