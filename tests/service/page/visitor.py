"""Somebody who uses the page in a browser, and tells of every defect."""

from __future__ import annotations

import itertools
import json
from pathlib import Path
from typing import Any

CHROMIUM = Path("/usr/bin/chromium")
ARGUMENTS = [
    "--no-sandbox",
    "--enable-unsafe-swiftshader",  # WebGL without a graphics card
    "--disable-gpu-rasterization",  # which Debian asks for: a processor draws faster without
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
]
LONG_MS = 120_000
SCHEMES, WIDTHS = ("dark", "light"), (390, 1440)
BOTH_ONCE = tuple(zip(SCHEMES, WIDTHS, strict=True))

_WATCH = """
window.violations = [];
document.addEventListener('securitypolicyviolation', (event) =>
  window.violations.push(`${event.violatedDirective} ${event.blockedURI}`));
"""


class Visitor:
    """A page of the browser at a service.

    Parameters
    ----------
    page : playwright.sync_api.Page
    url : str
        Of the service.
    """

    def __init__(self, page: Any, url: str) -> None:
        self.page, self.url = page, url
        self.defects: list[str] = []
        self.foreign: list[str] = []
        self.open: set[Any] = set()  # requests without an answer yet
        page.set_default_timeout(20_000)
        page.add_init_script(_WATCH)
        page.on("pageerror", lambda error: self.defects.append(str(error)))
        page.on("console", self._heard)
        page.on("request", self._asked)
        page.on("requestfinished", self._ended)
        page.on("requestfailed", self._ended)

    def _heard(self, message: Any) -> None:
        # An answer that is no success is told by the page itself.
        if message.type == "error" and not message.text.startswith("Failed to load resource"):
            self.defects.append(message.text)

    def _ended(self, request: Any) -> None:
        self.open.discard(request)

    def _asked(self, request: Any) -> None:
        self.open.add(request)
        if not request.url.startswith((self.url, "blob:", "data:")):
            self.foreign.append(request.url)

    def go(self, place: str = "") -> None:
        """Open a place, such as ``jobs``."""
        self.page.goto(f"{self.url}/#/{place}")

    def press(self, name: str) -> None:
        self.page.get_by_role("button", name=name, exact=True).click()

    def follow(self, name: str) -> None:
        self.page.get_by_role("link", name=name, exact=True).first.click()

    def sees(self, text: str, timeout_ms: int = LONG_MS) -> None:
        self.page.get_by_text(text).first.wait_for(timeout=timeout_ms)

    def settles(self, quiet_ms: float = 150.0) -> None:
        """Until nothing is asked for; the browser's own word for that takes half a second of quiet."""
        quiet = 0.0
        while quiet < quiet_ms:
            self.page.wait_for_timeout(30.0)
            quiet = 0.0 if self.open else quiet + 30.0

    def downloads(self, name: str) -> Path:
        """The file that comes when a button is pressed."""
        with self.page.expect_download(timeout=LONG_MS) as coming:
            self.press(name)
        return Path(coming.value.path())

    def saves(self, kind: str, title: str) -> Path:
        """A figure as a file, from its menu."""
        self.page.get_by_label(f"Save: {title}", exact=True).click()
        return self.downloads(f"Save as {kind}: {title}")

    def drops(self, *files: Path) -> None:
        """Give files to the first place that takes some."""
        self.page.locator("input[type=file]").first.set_input_files([str(file) for file in files])

    def barriers(self, axe: str, *, every_pair: bool = False) -> list[str]:
        """What axe finds in what is shown, be it only minor: in light and dark, on a phone and on a desk.

        Colours do not depend on the width, so that by default dark is looked at on a phone, light on a desk.
        """
        self.page.locator("h1").first.wait_for(timeout=LONG_MS)
        self.page.evaluate(axe)
        size, told = self.page.viewport_size, list[str]()
        pairs = itertools.product(SCHEMES, WIDTHS) if every_pair else BOTH_ONCE
        for scheme, width in pairs:  # the last is what visits begin with
            self.page.emulate_media(color_scheme=scheme)
            self.page.set_viewport_size({"width": width, "height": size["height"]})
            self.page.wait_for_timeout(300)  # until figures are drawn in other colours
            found = self.page.evaluate("() => axe.run(document, {resultTypes: ['violations']})")
            told += [
                f"{scheme}, {width} px: {one['id']}: "
                f"{json.dumps([node['html'][:200] for node in one['nodes'][:3]])}"
                for one in found["violations"]
            ]
        self.page.set_viewport_size(size)
        return told

    def met_no_defect(self) -> None:
        violations = self.page.evaluate("() => window.violations ?? []")
        met = {"defects": self.defects, "violations": violations, "foreign": self.foreign}
        assert not any(met.values()), f"{self.page.url} met {met}"
