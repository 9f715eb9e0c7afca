"""The pages of charges in a real browser: a charge fills in without a reload, can be stopped, fits a phone."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from service.db.session import Database
from service.settings import Settings
from tests.browser.chromium import PHONE, wait_until
from tests.browser.test_other_pages import LEAST_CONTRAST
from tests.builders.charges import beat_charge, charge, charges, claimed_charge, finish_charge

if TYPE_CHECKING:
    from playwright.sync_api import Page

pytestmark = pytest.mark.browser


def test_a_charge_fills_in_when_it_ends_and_stands_beside_its_series(
    page: Page, sqlite_database: Database, settings: Settings
) -> None:
    first, second = charges(sqlite_database, seeds=(1, 2))
    finish_charge(sqlite_database, first, settings)
    beat_charge(sqlite_database, claimed_charge(sqlite_database, second), 0.42)
    page.goto("/")
    page.locator('a[href="/charges"]').click()
    page.locator(f'a[href="/charges/{second}"]').click()
    page.wait_for_url(f"**/charges/{second}")
    page.evaluate("window.isStillTheSamePage = true")
    wait_until(page, "document.querySelector('progress')?.value === 0.42")
    assert "appear here" in page.locator("#part-charge_findings").inner_text()
    finish_charge(sqlite_database, second, settings, far_height_m=1.7)
    page.wait_for_selector("#part-charge_findings:has-text('1.70 m')")
    page.wait_for_selector("#series-table:has-text('1.60')")
    page.wait_for_selector("#live[data-state=over]")
    assert page.locator(".rose-wedge").count() == 4
    with page.expect_download() as coming:
        page.get_by_role("button", name="Mass by sector, as CSV").click()
    rows = coming.value.path().read_text().splitlines()
    assert "mass, kg" in rows[0] and len(rows) == 5
    with page.expect_download() as coming:
        page.get_by_role("button", name="Mass by sector, as PNG").click()
    assert coming.value.path().read_bytes().startswith(b"\x89PNG")
    page.locator(".shot img").first.scroll_into_view_if_needed()
    wait_until(page, "document.querySelector('.shot img').naturalWidth === 90")
    assert page.evaluate("window.isStillTheSamePage") is True


def test_a_waiting_charge_is_stopped_by_its_button(page: Page, sqlite_database: Database) -> None:
    (number,) = charges(sqlite_database)
    page.goto(f"/charges/{number}")
    page.on("dialog", lambda dialog: dialog.accept())
    page.locator("button[data-post]").click()
    page.wait_for_selector("#part-charge_state:has-text('cancelled')")
    assert charge(sqlite_database, number).state.value == "CANCELLED"
    assert page.locator("button[data-post]").count() == 0


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_charges_are_readable_and_nothing_runs_off_a_phone(
    page: Page, sqlite_database: Database, settings: Settings, scheme: str
) -> None:
    numbers = charges(sqlite_database, seeds=(1, 2, 3), plant={"deflector": {"ridge_across_mm": -120.0}})
    for number in numbers[:2]:
        finish_charge(sqlite_database, number, settings)
    page.emulate_media(color_scheme=scheme)  # type: ignore[arg-type]
    page.set_viewport_size({"width": PHONE[0], "height": PHONE[1]})
    for address in ("/charges", *(f"/charges/{number}" for number in numbers)):
        page.goto(address)
        page.wait_for_load_state("load")
        over = page.evaluate("document.documentElement.scrollWidth - window.innerWidth")
        assert over <= 0, address
        contrast = page.evaluate(LEAST_CONTRAST)
        assert contrast[0] >= 4.5, (address, contrast)
