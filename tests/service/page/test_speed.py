"""How fast the page is: the first view, playback, and a long recording. Without a graphics card here."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import requests

from scaling_service.client import Client
from scaling_service.files.trc import read_trc, write_trc
from scaling_service.model.trial import Trial
from tests.service.page.conftest import Visit
from tests.service.page.visitor import Visitor

pytestmark = pytest.mark.benchmark

MARKERS = 60
FRAMES = 100_000


def test_first_view(visit: Visit, url: str) -> None:
    visitor = visit(url)
    visitor.go()
    visitor.sees("Load the example")
    shown = "() => performance.getEntriesByName('first-contentful-paint')[0].startTime"
    fetched = "() => performance.getEntriesByType('resource').reduce((sum, one) => sum + one.transferSize, 0)"
    seconds, megabytes = visitor.page.evaluate(shown) / 1e3, visitor.page.evaluate(fetched) / 1e6
    print(f"\nfirst view: {seconds:.2f} s, {megabytes:.3f} MB compressed")  # noqa: T201
    assert seconds < 1.0
    assert megabytes < 1.5


def test_playback(visit: Visit, url: str) -> None:
    """Two legs of bones and 60 markers."""
    requests.post(f"{url}/v1/examples", timeout=30).raise_for_status()
    with Client(url) as client:
        job = client.wait(client.ask("comparisons", subject="example", methods=["MB", "EB"]))
    visitor = visit(url)
    visitor.page.route("**/files/scene/scene.json", crowded_scene)
    visitor.page.route("**/files/scene/*.measured.f32", crowded_markers)
    visitor.go(f"jobs/{job.id}/space")
    visitor.page.locator(".cursor").wait_for(state="attached")
    visitor.page.get_by_role("checkbox", name="MB", exact=True).uncheck()
    visitor.press("Play")
    visitor.page.wait_for_timeout(6_000)
    reported = [
        visitor.page.locator(".pace").inner_text()
        for _ in range(3)
        if not visitor.page.wait_for_timeout(1100)
    ]
    print(f"\nplayback with {MARKERS} markers: {reported}")  # noqa: T201
    assert min(int(text.split()[0]) for text in reported) >= 30


def crowded_scene(route: Any) -> None:
    """The scene with as many markers as a whole body has: those that are there, again and again."""
    scene = route.fetch().json()
    for body in scene["bodies"]:
        body["markers"] = [repeated(body["markers"][k % len(body["markers"])], k) for k in range(MARKERS)]
    for trial in scene["trials"]:
        labels = trial["labels"]
        trial["labels"] = [f"{labels[k % len(labels)]}_{k}" for k in range(MARKERS)]
        trial["measured"]["shape"][1] = MARKERS
    route.fulfill(body=json.dumps(scene), content_type="application/json")


def repeated(marker: dict[str, Any], k: int) -> dict[str, Any]:
    return marker | {"name": f"{marker['name']}_{k}"}


def crowded_markers(route: Any) -> None:
    few = np.frombuffer(route.fetch().body(), "<f4").reshape(-1, 14, 3)
    route.fulfill(body=few[:, np.arange(MARKERS) % 14].tobytes())


def test_long_recording(visit: Visit, url: str, tmp_path: Path) -> None:
    requests.post(f"{url}/v1/examples", timeout=30).raise_for_status()
    with Client(url) as client:
        job = client.wait(client.ask("comparisons", subject=long_subject(client, tmp_path), methods=["MB"]))
    visitor = visit(url)
    visitor.go()
    visitor.sees("Load the example")
    seconds = visitor.page.evaluate(
        """async (place) => {
          const start = performance.now();
          location.hash = place;
          while (document.querySelector('.cursor') === null) await new Promise(requestAnimationFrame);
          return (performance.now() - start) / 1000;
        }""",
        f"#/jobs/{job.id}/space?trial=long",
    )
    visitor.sees(f"0.00 s · 1 / {FRAMES}")
    middle, worst = stalls(
        visitor,
        f"""const slider = document.querySelector('input[aria-label="Frame"]');
          slider.value = String((k * 7919 * 13) % {FRAMES});
          slider.dispatchEvent(new Event('input'));""",
    )
    hover, longest = stalls(
        visitor,
        """const plot = document.querySelector('figure .plot .nsewdrag');
          const box = plot.getBoundingClientRect();
          const at = {clientX: box.left + 90 + 4 * k, clientY: box.top + 20 + k, bubbles: true};
          plot.dispatchEvent(new MouseEvent('mousemove', at));""",
    )
    figures = (
        f"open in {seconds:.2f} s; scrubbing {middle:.0f} ms, worst {worst:.0f} ms; "
        f"over the chart {hover:.0f} ms, worst {longest:.0f} ms"
    )
    print(f"\n{figures}")  # noqa: T201
    assert seconds < 3.0, figures
    assert max(middle, hover) < 100, figures
    assert max(worst, longest) < 500, figures


def stalls(visitor: Visitor, act: str) -> tuple[float, float]:
    """Median and largest time, ms, from something done, number ``k`` of 120, to the next picture."""
    script = f"""async () => {{
        const long = [];
        for (let k = 0; k < 120; k += 1) {{
          const before = performance.now();
          {act}
          await new Promise(requestAnimationFrame);
          long.push(performance.now() - before);
        }}
        return long.sort((a, b) => a - b);
      }}"""
    found = visitor.page.evaluate(script)
    return found[len(found) // 2], found[-1]


def long_subject(client: Client, folder: Path) -> str:
    """The example's person walking to and fro for a quarter of an hour."""
    document = client.subject("example").document
    for name in ("static.trc", "gait_1.trc"):
        content = requests.get(f"{client._url}/v1/subjects/example/files/{name}", timeout=30).content
        (folder / name).write_bytes(content)
    walk = read_trc(folder / "gait_1.trc")
    there = walk.markers - np.nanmean(walk.markers, axis=(0, 1)) * [1, 1, 0]
    turns = -(-FRAMES // (2 * len(there)))
    markers = np.tile(np.concatenate([there, there[::-1]]), (turns, 1, 1))[:FRAMES]
    long = Trial(
        name="long",
        times=np.arange(FRAMES) / walk.rate_hz,
        labels=walk.labels,
        markers=markers,
        rate_hz=walk.rate_hz,
    )
    write_trc(folder / "long.trc", long)
    trials = {"static": "static.trc", "evaluation": ["long.trc"]}
    person = document["subject"] | {"id": "long"}
    client.put_subject({"subject": person, "model": document["model"], "trials": trials})
    client.upload("long", folder / "static.trc")
    client.upload("long", folder / "long.trc")
    return "long"
