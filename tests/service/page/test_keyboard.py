"""From the first view to a model that plays in space, by keyboard alone."""

from __future__ import annotations

import pytest

from tests.service.page.conftest import Visit
from tests.service.page.visitor import Visitor

MOST_STEPS = 300  # Chosen: more than any view has places to stop at

_FOCUSED = """() => {
  const { activeElement: at } = document;
  const label = at.labels?.[0]?.textContent ?? at.getAttribute('aria-label') ?? at.textContent;
  const ring = getComputedStyle(at);
  return { name: label.trim(), seen: ring.outlineStyle !== 'none' && ring.outlineWidth !== '0px' };
}"""


@pytest.mark.costly
def test_a_tour_by_keyboard_alone(visit: Visit, url: str) -> None:
    visitor = visit(url)
    visitor.go()
    visitor.sees("Load the example")
    tab_to(visitor, "To the content")  # what comes first skips what all views share
    tab_to(visitor, "Load the example")
    press(visitor, "Enter")
    visitor.sees("can be read")
    tab_to(visitor, "height, m")
    visitor.page.keyboard.type("1.70")
    visitor.sees("Saved.")
    tab_back_to(visitor, "On to the analyses")
    press(visitor, "Enter")
    visitor.page.get_by_role("button", name="Compare", exact=True).wait_for(timeout=120_000)
    for method in ("MB_lam", "MB_am", "EB", "EB_am", "MAP"):  # one method will do
        tab_to(visitor, f"{method} ")
        press(visitor, "Space")
    tab_to(visitor, "Compare")
    press(visitor, "Enter")
    visitor.sees("How far to trust")
    tab_to(visitor, "MB")
    press(visitor, "Enter")
    visitor.page.locator(".meaning", has_text="segments scaled by distances between markers").wait_for()
    press(visitor, "Escape")
    tab_to(visitor, "Play the models in space")
    press(visitor, "Enter")
    visitor.page.locator(".cursor").wait_for(state="attached")
    tab_to(visitor, "Play")
    press(visitor, "Space")
    visitor.page.wait_for_function("() => Number(document.querySelector('input[type=range]').value) > 20")
    tab_to(visitor, "Save: MB in gait_1")
    press(visitor, "Enter")
    with visitor.page.expect_download():
        tab_to(visitor, "Save as CSV: MB in gait_1")
        press(visitor, "Enter")


def press(visitor: Visitor, key: str) -> None:
    visitor.page.keyboard.press(key)


def tab_to(visitor: Visitor, name: str, key: str = "Tab") -> None:
    """Go on until what begins with a name has the focus, and shows that it has."""
    passed = []
    for _ in range(MOST_STEPS):
        press(visitor, key)
        found = visitor.page.evaluate(_FOCUSED)
        if found["name"].startswith(name):
            assert found["seen"], f"nothing shows that {name} has the focus"
            return
        passed.append(found["name"][:40])
    raise AssertionError(f"{name} is not reached by {key}; passed {passed}")


def tab_back_to(visitor: Visitor, name: str) -> None:
    tab_to(visitor, name, "Shift+Tab")
