"""The pages of the installation, of meshes and of diagnoses, and the form of a key: content, axe, sizes, dark."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import httpx
import pytest

from service.db.models import DiagnosisRow
from service.db.presence import report_presence
from service.db.session import Database
from service.domain.states import DesignState
from service.settings import Settings
from service.studies.keep_files import keep_files
from tests.browser.axe import serious_faults
from tests.browser.chromium import LAPTOP, PHONE, wait_until
from tests.builders.charges import charges, finish_charge
from tests.builders.diagnoses import a_data_set, a_diagnosis
from tests.builders.mesh_files import binary_stl
from tests.builders.piles import a_picture
from tests.builders.server import Server
from tests.builders.studies import a_finished_study
from tests.service.dashboard.test_diagnosis_pages import RESULT

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page

    from tests.browser.conftest import Faults

pytestmark = pytest.mark.browser

SIZES = (LAPTOP, PHONE)


def assert_sound(page: Page) -> None:
    """At both sizes: nothing runs off the page, and axe finds nothing serious."""
    for width, height in SIZES:
        page.set_viewport_size({"width": width, "height": height})
        assert page.evaluate("document.documentElement.scrollWidth - window.innerWidth") <= 0, width
        assert serious_faults(page) == [], width


def upload_box(server: Server) -> None:
    httpx.post(
        f"{server.url}/v1/geometries",
        params={"file_name": "box.stl"},
        content=binary_stl(),
        headers={"Content-Type": "application/octet-stream"},
    ).raise_for_status()


def a_finished_diagnosis(database: Database, settings: Settings) -> int:
    number = a_diagnosis(database, a_data_set(database))
    settings.artifacts_dir.mkdir(parents=True, exist_ok=True)
    card = replace(a_picture(settings.artifacts_dir), kind="card", file_name="card.png")
    with database.writing() as session:
        row = session.get_one(DiagnosisRow, number)
        row.state, row.verdict, row.results = DesignState.COMPLETE, "named", RESULT
        keep_files(session, [card], diagnosis_id=number)
    return number


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_the_installation_tells_who_works_and_keeps_itself_up_to_date(
    page: Page, sqlite_database: Database, settings: Settings, scheme: str
) -> None:
    page.emulate_media(color_scheme=scheme)  # type: ignore[arg-type]
    settings.artifacts_dir.mkdir(parents=True, exist_ok=True)
    first, _second = charges(sqlite_database, seeds=(1, 2))
    page.goto("/")
    page.get_by_role("link", name="Installation").click()
    page.wait_for_selector("#part-processes:has-text('No worker')")
    finish_charge(sqlite_database, first, settings)
    with sqlite_database.writing() as session:
        report_presence(session, "w", "worker", "plant-pc", 4711)
    page.wait_for_selector("#part-processes:has-text('plant-pc')")
    page.wait_for_selector("#part-work:has-text('Came to its end')")
    assert_sound(page)


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_a_mesh_is_looked_at_in_3d(page: Page, server: Server, scheme: str) -> None:
    page.emulate_media(color_scheme=scheme)  # type: ignore[arg-type]
    page.goto("/geometries")
    page.wait_for_selector("#part-geometries:has-text('No mesh yet')")
    assert_sound(page)
    upload_box(server)
    page.locator('a[href="/geometries/1"]').click()
    wait_until(page, "document.querySelector('[data-scene]').dataset.drawn === '0'")
    assert "box.stl" in page.locator('[data-part="words"]').inner_text()
    assert "12 triangles" in page.locator('[data-part="words"]').inner_text()
    assert page.locator('[data-part="csv"]').is_hidden() and page.locator('[data-part="colour"]').is_hidden()
    with page.expect_download() as coming:
        page.get_by_role("button", name="PNG").click()
    assert coming.value.suggested_filename.startswith("talus-geometry-1")
    assert_sound(page)


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_diagnoses_and_reports_are_accessible_and_fit_a_phone(
    page: Page, sqlite_database: Database, settings: Settings, scheme: str
) -> None:
    page.emulate_media(color_scheme=scheme)  # type: ignore[arg-type]
    number = a_finished_diagnosis(sqlite_database, settings)
    a_diagnosis(sqlite_database, a_data_set(sqlite_database))
    study = a_finished_study(sqlite_database)
    reports = (f"/diagnoses/{number}/report", f"/studies/{study}/report")
    for address in ("/diagnoses", f"/diagnoses/{number}", *reports):
        page.goto(address)
        page.wait_for_load_state("load")
        assert_sound(page)


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_the_form_of_a_key_is_accessible(
    browser: Browser, faults: Faults, sqlite_database: Database, settings: Settings, scheme: str
) -> None:
    server = Server(settings.model_copy(update={"auth": "on"}))
    server.start()
    context = browser.new_context(base_url=server.url, color_scheme=scheme)  # type: ignore[arg-type]
    page = context.new_page()
    faults.watch(page, server.url)
    page.goto("/")
    page.wait_for_selector("#key")
    assert_sound(page)
    page.get_by_label("A key of this installation").fill("wrong")
    page.keyboard.press("Enter")
    page.wait_for_selector('[role="alert"]:has-text("not known here")')
    assert_sound(page)
    context.close()
    server.stop()
    assert [fault for fault in faults.found if "401" not in fault] == []
