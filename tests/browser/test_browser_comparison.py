"""Methods side by side in a real browser: chosen with the mouse, and the films move with table and curves."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from tests.browser.lab import Lab

if TYPE_CHECKING:
    from playwright.sync_api import Locator

PREPARE = """
import acp_lab.prepared_part as prepared_part
from tests.prepared_sample import sample_model
model = sample_model()
prepared_part.PreparedPart.load = classmethod(lambda *_: model)
"""
SHOW = """
from acp_lab.course.side_by_side import workbench
from acp_lab.display.widgets import RunComparison
shown = RunComparison(workbench(), ["acp-edges", "region", "slet"])
shown
"""

pytestmark = pytest.mark.usefixtures("closes")


SLOW = """
import time
from acp_lab.display.widgets import run_comparison
show_frame = run_comparison.RunComparison._show_frame
run_comparison.RunComparison._show_frame = lambda self: (time.sleep(0.1), show_frame(self))
"""
WATCH = """(readout) => {
    window.seen = [];
    new MutationObserver(() => window.seen.push(Number(readout.innerText))).observe(
        readout, { childList: true, characterData: true, subtree: true });
}"""


def check_that_the_film_never_goes_back(lab: Lab, panel: Locator) -> None:
    """While it plays and the kernel needs longer for a picture than one is shown."""
    lab.kernel(SLOW)
    panel.locator(".widget-readout").first.evaluate(WATCH)
    panel.locator(".widget-play button").first.click()
    lab.until("shown.frame == shown.slider.max", "shown.frame")
    lab.page.wait_for_function("(last) => window.seen.at(-1) === last", arg=lab.value("shown.slider.max"))
    seen = lab.page.evaluate("() => window.seen")
    assert seen == sorted(seen)
    lab.kernel("run_comparison.RunComparison._show_frame, shown.frame = show_frame, 0")


def test_methods_are_chosen_with_the_mouse_and_films_stand_side_by_side(lab: Lab) -> None:
    panel = lab.open("comparison", PREPARE, SHOW)
    canvases = panel.locator(".acp-canvas")
    canvases.nth(1).locator("image[href]").wait_for(state="attached")
    assert canvases.count() == 2
    check_that_the_film_never_goes_back(lab, panel)
    lists = panel.locator("select[multiple]")
    lists.nth(0).locator("option", has_text="slet").click(modifiers=["ControlOrMeta"])
    lists.nth(0).locator("option", has_text="acp-edges").click(modifiers=["ControlOrMeta"])
    lists.nth(1).locator("option", has_text="backwards").click(modifiers=["ControlOrMeta"])
    panel.get_by_text("every frame", exact=True).locator("xpath=..").select_option("every 4th")
    panel.get_by_role("button", name="compare").click()
    lab.until("shown.report.methods == ['region', 'slet'] and len(shown.film.options) == 2", "shown.told.value")
    panel.locator("table").first.locator("xpath=..").filter(has_text="backwards").wait_for()
    titles = canvases.locator(".acp-title")
    titles.nth(1).get_by_text("slet, image").wait_for()
    before = titles.nth(0).inner_text()
    slider = panel.get_by_role("slider").first
    slider.focus()
    lab.page.keyboard.press("ArrowRight")
    lab.until("shown.frame == 1 and shown.errors.cursor == 1", "shown.frame")
    lab.page.wait_for_function("([el, was]) => el.innerText !== was", arg=[titles.nth(0).element_handle(), before])
    lab.shot("comparison", panel)
    canvases.nth(1).scroll_into_view_if_needed()
    lab.shot("comparison_films", panel)
