"""A study's page in a real browser: drawn whole, then kept up to date by events, without a reload."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Any

import pytest

from service.db import queries
from service.db.models import JobRow
from service.db.session import Database
from service.domain.history import StudyStop
from service.settings import Settings
from tests.browser.chromium import wait_until
from tests.builders import piles
from tests.builders.studies import a_study, propose_next

if TYPE_CHECKING:
    from playwright.sync_api import Page

    from tests.browser.conftest import Faults, Server

pytestmark = pytest.mark.browser

# Points of the traces that hold finished simulations (not the rings around the best, not the predictions).
COUNT_POINTS = """() => {
  const drawn = document.querySelector('[data-chart="angle"]').data ?? [];
  const measured = drawn.filter((trace) => /^(in window|outside|error)/.test(trace.name));
  return measured.reduce((sum, trace) => sum + trace.x.length, 0);
}"""


def wait_for_points(page: Page, count: int) -> None:
    wait_until(page, f"({COUNT_POINTS})() === {count}")


def beat(database: Database, job_id: str, progress: dict[str, Any]) -> None:
    with database.writing() as session:
        attempt = session.get_one(JobRow, job_id).attempt
        assert queries.beat(session, queries.Lease(job_id, attempt), 600.0, progress) is False


def test_the_chart_holds_every_finished_simulation(
    page: Page, sqlite_database: Database, settings: Settings
) -> None:
    study_id = piles.a_searching_study(sqlite_database, settings)
    page.goto(f"/studies/{study_id}")
    wait_for_points(page, 4)
    names = page.evaluate("document.querySelector('[data-chart=\"angle\"]').data.map((trace) => trace.name)")
    assert {"in window", "in window, repeat", "outside", "error (no angle)", "best so far"} <= set(names)
    shapes = page.evaluate("document.querySelector('[data-chart=\"angle\"]').layout.shapes")
    assert [shapes[0]["y0"], shapes[0]["y1"], shapes[1]["y0"]] == [25.0, 26.0, 25.5]
    page.wait_for_selector('[data-chart="profile"] .main-svg')
    picture = page.locator(".picture img")
    picture.scroll_into_view_if_needed()
    wait_until(page, "document.querySelector('.picture img').naturalWidth === 90")


def test_what_happens_appears_without_a_reload(page: Page, sqlite_database: Database) -> None:
    study_id = a_study(sqlite_database, parallel=1)
    page.goto(f"/studies/{study_id}")
    page.evaluate("window.isStillTheSamePage = true")
    page.wait_for_selector("#live[data-state=live]")
    assert page.locator("#rows > tr").count() == 0

    job_id = piles.start_next(sqlite_database, study_id)
    page.wait_for_selector("#design-1:has-text('simulating')")
    beat(sqlite_database, job_id, {"phase": "discharge", "fraction": 0.9, "seconds_left": 3.0})
    wait_until(page, "document.querySelector('[data-job] progress')?.value === 0.9")
    assert page.locator("[data-left]").inner_text() == "about 3 s left"

    piles.finish_running(sqlite_database, study_id, 25.4)
    page.wait_for_selector("#design-1:has-text('25.40°')")
    wait_for_points(page, 1)
    piles.add_failure(sqlite_database, study_id)
    page.wait_for_selector("#design-2[data-verdict=error]")
    wait_for_points(page, 2)
    page.wait_for_selector("[data-count=all]:text-is('2')")

    propose_next(sqlite_database, study_id, StudyStop("budget", "All 2 simulations are spent.", {}))
    piles.finish(sqlite_database, study_id, None)
    page.wait_for_selector("#live[data-state=over]")
    assert "All 2 simulations are spent." in page.locator("#part-headline").inner_text()
    assert page.evaluate("window.isStillTheSamePage") is True


def test_an_opened_reason_stays_open_when_its_row_changes(page: Page, sqlite_database: Database) -> None:
    study_id = a_study(sqlite_database, parallel=1)
    piles.start_next(sqlite_database, study_id)
    page.goto(f"/studies/{study_id}")
    page.locator("#design-1 summary").click()
    piles.finish_running(sqlite_database, study_id, 25.4)
    page.wait_for_selector("#design-1:has-text('25.40°')")
    assert page.locator("#design-1 details").evaluate("(box) => box.open") is True
    assert page.locator("#design-1 details p").first.is_visible()


def test_the_table_is_filtered_by_verdict_with_the_keyboard(page: Page, sqlite_database: Database) -> None:
    study_id = piles.a_searching_study(sqlite_database)
    page.goto(f"/studies/{study_id}")
    page.locator("#show-all").focus()
    shown = {}
    for key in ("feasible", "unfeasible", "error", "open"):
        page.keyboard.press("ArrowRight")
        shown[key] = page.locator("#rows > tr:visible").count()
    assert shown == {"feasible": 2, "unfeasible": 1, "error": 1, "open": 1}


def test_a_lost_connection_is_said_and_mends_itself(
    page: Page, server: Server, faults: Faults, sqlite_database: Database
) -> None:
    study_id = piles.a_searching_study(sqlite_database)
    page.goto(f"/studies/{study_id}")
    page.wait_for_selector("#live[data-state=live]")
    wait_for_points(page, 4)
    faults.is_server_away = True
    server.stop()
    page.wait_for_selector("#banner:has-text('connection to Talus is lost')")
    told = page.locator("#banner").inner_text()
    assert re.search(r"stale, from \d{1,2}:\d\d:\d\d", told), told
    assert page.locator("#live-text").inner_text() == "stale: connection lost"
    assert page.locator("body.stale").count() == 1
    piles.finish_running(sqlite_database, study_id, 25.1)
    server.start()
    page.wait_for_selector("#live[data-state=live]", timeout=30_000)
    page.wait_for_selector("#design-5:has-text('25.10°')")
    assert page.locator("#banner").is_hidden() and page.locator("body.stale").count() == 0
    wait_for_points(page, 5)


def test_a_list_that_gets_no_answer_is_marked_stale(
    page: Page, server: Server, faults: Faults, sqlite_database: Database
) -> None:
    page.goto("/charges")
    page.wait_for_selector("#live[data-state=live]")
    faults.is_server_away = True
    server.stop()
    page.wait_for_selector("body.stale")
    assert "stale, from" in page.locator("#banner").inner_text()
    server.start()
    page.wait_for_selector("body:not(.stale)")
