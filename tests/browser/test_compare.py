"""Two piles side by side in a real browser: picked from lists, turned together, kept as a table."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from service.db.session import Database
from service.settings import Settings
from tests.browser.axe import serious_faults
from tests.browser.chromium import PHONE, wait_until
from tests.builders.scenes import a_design_with_grains

if TYPE_CHECKING:
    from playwright.sync_api import Page

pytestmark = pytest.mark.browser

BOTH_DRAWN = "[...document.querySelectorAll('[data-scene]')].every((box) => box.dataset.drawn === '0')"


def test_two_piles_are_picked_and_turn_together(
    page: Page, sqlite_database: Database, settings: Settings, tmp_path: Path
) -> None:
    first, second = (a_design_with_grains(sqlite_database, settings) for _ in range(2))
    page.goto(f"/compare?kind=design&a={first}&b={second}")
    wait_until(page, BOTH_DRAWN)
    assert page.locator("#compared tbody tr").count() > 5
    canvases = page.locator('[data-part="canvas"]')
    before = canvases.nth(1).screenshot()
    canvases.nth(0).focus()
    for _ in range(4):
        page.keyboard.press("ArrowLeft")
    page.keyboard.press("+")
    page.wait_for_timeout(600)
    assert canvases.nth(1).screenshot() != before, "the second follows the first"
    with page.expect_download() as coming:
        page.locator("#csv").click()
    coming.value.save_as(tmp_path / "compared.csv")
    lines = (tmp_path / "compared.csv").read_text().splitlines()
    assert lines[0].startswith("Number,Simulation 1 of study 1,Simulation 1 of study 2,Difference")
    with page.expect_download() as coming:
        page.get_by_role("button", name="Mean heights, as CSV").click()
    coming.value.save_as(tmp_path / "heights.csv")
    heights = (tmp_path / "heights.csv").read_text().splitlines()
    assert "mean height, m" in heights[0] and len(heights) == 1 + page.locator(".outline-mark").count()
    with page.expect_download() as coming:
        page.get_by_role("button", name="Mean heights, as PNG").click()
    assert coming.value.path().read_bytes().startswith(b"\x89PNG")
    assert "from the axis:" in page.locator(".outline-mark title").first.text_content()
    assert serious_faults(page) == []
    page.set_viewport_size({"width": PHONE[0], "height": PHONE[1]})
    assert page.evaluate("document.documentElement.scrollWidth - window.innerWidth") <= 0


def test_two_studies_are_chosen_from_the_lists(
    page: Page, sqlite_database: Database, settings: Settings
) -> None:
    for _ in range(2):
        a_design_with_grains(sqlite_database, settings)
    page.goto("/")
    page.get_by_role("link", name="Compare").click()
    page.get_by_label("First").select_option("1")
    page.get_by_label("Second").select_option("2")
    page.locator("#compare").click()
    page.wait_for_url("**/compare?kind=study&a=1&b=2")
    assert "Simulations used" in page.locator("#compared").inner_text()
