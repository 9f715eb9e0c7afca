"""A claim is confirmed and withdrawn with the buttons on the page of its diagnosis."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from service.db.session import Database
from tests.browser.axe import serious_faults
from tests.browser.chromium import PHONE
from tests.service.test_claims import told

if TYPE_CHECKING:
    from playwright.sync_api import Page

pytestmark = pytest.mark.browser


def test_what_a_check_showed_is_recorded_where_the_claim_stands(
    page: Page, sqlite_database: Database
) -> None:
    number = told(sqlite_database)
    page.on("dialog", lambda dialog: dialog.accept())
    page.goto(f"/diagnoses/{number}")
    assert serious_faults(page) == []
    page.get_by_label("lift_speed, checked:").fill("filmed: <twice> as fast")
    page.get_by_role("button", name="Confirm").first.click()
    page.wait_for_selector("#part-diagnosis_claims:has-text('filmed: <twice> as fast')")
    assert "strong claim" in page.locator("#part-diagnosis_claims").inner_text()
    assert page.locator("#control-answer").inner_text() == "Confirmed."
    page.get_by_role("button", name="Withdraw").first.click()
    page.wait_for_selector("#part-diagnosis_claims:has-text('Withdrawn')")
    assert page.get_by_role("button", name="Withdraw").count() == 1  # of the other claim
    assert serious_faults(page) == []
    page.set_viewport_size({"width": PHONE[0], "height": PHONE[1]})
    assert page.evaluate("document.documentElement.scrollWidth <= window.innerWidth")
