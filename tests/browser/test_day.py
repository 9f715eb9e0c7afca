"""The engineer's day: what ran overnight, a doubtful design, its pile, a new study to its certificate, a charge
with the study's ensemble, a diagnosis' card, a report. One walk by links, buttons and forms, as a person goes."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import pytest
from sqlalchemy import select

from service.db.models import ArtifactRow, ChargeRow, DiagnosisRow
from service.db.session import Database
from service.domain.history import StudyStop
from service.domain.search_space import PAPER_PARAMETERS
from service.domain.states import DesignState
from service.domain.study import Response
from service.settings import Settings
from service.studies.keep_files import keep_files
from tests.browser.axe import serious_faults
from tests.browser.chromium import wait_until
from tests.builders import piles
from tests.builders.diagnoses import a_data_set, a_diagnosis
from tests.builders.scenes import GRAINS, a_pile_file, stored
from tests.builders.studies import A_REPORT, a_proposal, a_study, designs, propose_next, write_report
from tests.service.dashboard.test_diagnosis_pages import RESULT

if TYPE_CHECKING:
    from playwright.sync_api import Page

pytestmark = pytest.mark.browser

NAMES = tuple(PAPER_PARAMETERS)
MEMBERS = [
    {"x": dict(zip(NAMES, (0.5, 0.6, 0.3, roll), strict=True)), "window_probability": 0.9, "weight": 0.5}
    for roll in (0.2, 0.3)
]


def recommended(angle: float, x: tuple[float, ...]) -> dict[str, Any]:
    return {
        "x": dict(zip(NAMES, x, strict=True)),
        "numbers": [2],
        "mean_deg": angle,
        "sd_deg": 0.24,
        "expected_miss_deg": 0.2,
        "window_probability": 0.994,
        "replicates_deg": [angle, angle + 0.2, angle - 0.1],
        "certified": True,
        "half_width_90_deg": 0.39,
    }


def the_night(database: Database, settings: Settings) -> tuple[int, int]:
    """A certified study of coke, whose first pile is stored and outside the window, and a named diagnosis."""
    angle = Response("angle_deg", 36.5, (35.0, 38.0), 0.5)
    study = a_study(database, parallel=1, material="coke", responses=(angle,))
    for degrees in (31.2, 36.4):
        piles.add_pile(database, study, degrees, settings)
    first = designs(database, study)[0]
    file = stored(a_pile_file(settings.artifacts_dir), "vtkhdf", settings)
    with database.writing() as session:
        keep_files(session, [file], design_id=first.id)
    propose_next(database, study, StudyStop("certified", "36.4 deg: certified within +-0.4 deg (90 %).", {}))
    (job_id,) = piles.open_jobs(database, study, piles.JobKind.RECOMMEND)
    with database.writing() as session:
        assert piles.record_recommendation(
            session, piles.claimed(database, job_id).lease, recommended(36.4, designs_x(database, study))
        )
    write_report(database, study, {**A_REPORT, "ensemble": {**A_REPORT["ensemble"], "members": MEMBERS}})
    diagnosis = a_diagnosis(database, a_data_set(database))
    card = replace(piles.a_picture(settings.artifacts_dir), kind="card", file_name="card.png")
    with database.writing() as session:
        row = session.get_one(DiagnosisRow, diagnosis)
        row.state, row.verdict, row.results = DesignState.COMPLETE, "named", RESULT
        keep_files(session, [card], diagnosis_id=diagnosis)
    return study, diagnosis


def designs_x(database: Database, study: int) -> tuple[float, ...]:
    x = designs(database, study)[1].x
    return tuple(x[name] for name in NAMES)


def test_a_day(page: Page, sqlite_database: Database, settings: Settings) -> None:
    study, diagnosis = the_night(sqlite_database, settings)

    # What ran overnight.
    page.goto("/")
    row = page.locator("#part-studies tr", has_text="coke")
    assert "Certified" in row.inner_text() and "36.40° ± 0.39°" in row.inner_text().replace("\u00a0", " ")
    row.get_by_role("link").first.click()
    page.wait_for_url(f"**/studies/{study}")
    assert page.locator("#part-headline").inner_text().count("Certified") >= 1

    # The doubtful one: outside the window. Why was it tried, and what does its pile look like?
    page.locator('label[for="show-unfeasible"]').click()
    doubtful = page.locator("#rows > tr:visible")
    assert doubtful.count() == 1 and "31.20°" in doubtful.inner_text()
    doubtful.get_by_role("link").first.click()
    page.wait_for_url("**/designs/*")
    wait_until(page, "document.querySelector('[data-scene]').dataset.drawn === '0'")
    page.locator('[data-part="axis"]').select_option("y")
    assert f"{GRAINS} grains" in page.locator('[data-part="words"]').inner_text()
    page.locator('[data-part="canvas"]').focus()
    page.keyboard.press("Enter")
    page.wait_for_selector('[data-part="picked-told"]:has-text("coke")')

    # A new study, from the form, followed until it is certified.
    page.goto("/")
    page.get_by_role("link", name="New study").click()
    page.get_by_label("Material").select_option("coke")
    page.locator("summary", has_text="How to search").click()
    page.get_by_label("At a time").fill("1")
    page.wait_for_selector("#cost:has-text('simulations')")
    page.locator("#go").click()
    page.wait_for_url("**/studies/2")
    page.wait_for_selector("#live[data-state=live]")
    piles.start_next(sqlite_database, 2, fraction=0.42)
    wait_until(page, "document.querySelector('[data-job] progress')?.value === 0.42")
    piles.finish_running(sqlite_database, 2, 36.2)
    page.wait_for_selector("#design-1:has-text('36.20°')")
    proposal = a_proposal(2, scale=designs(sqlite_database, 2)[0].scale)
    piles.add_pile(sqlite_database, 2, 36.3, settings, proposal)
    propose_next(sqlite_database, 2, StudyStop("certified", "36.3 deg: certified.", {}))
    piles.finish(sqlite_database, 2, recommended(36.3, designs_x(sqlite_database, 2)))
    page.wait_for_selector("#live[data-state=over]")
    assert "Certified" in page.locator("#part-headline").inner_text()
    assert "99.4" in page.locator(".checks").inner_text()

    # A charge for each member of the night's ensemble.
    page.get_by_role("link", name="Studies").first.click()
    page.get_by_role("link", name="Charges").click()
    page.get_by_role("link", name="New charge").click()
    page.get_by_label("Coarse-graining").fill("10")
    page.get_by_label("Random seeds").fill("1")
    page.locator("summary", has_text="Contact numbers").click()
    page.get_by_label("Of study").fill(str(study))
    page.get_by_label("Sets of its ensemble").fill("2")
    page.wait_for_selector("#cost:has-text('2 charges, each: ')")
    page.locator("#go").click()
    page.wait_for_url("**/charges/1")
    with sqlite_database.reading() as session:
        charges = list(session.scalars(select(ChargeRow)))
    assert [row.spec["parameters_from"].count(f"ensemble of study {study}") for row in charges] == [1, 1]
    assert "appear" in page.locator("#part-charge_findings").inner_text()

    # What the simulation gets wrong: the card and its claim.
    page.goto("/diagnoses")
    page.locator(f'a[href="/diagnoses/{diagnosis}"]').click()
    assert "0.62" in page.locator("main").inner_text()
    with sqlite_database.reading() as session:
        card = session.scalars(select(ArtifactRow.id).where(ArtifactRow.kind == "card")).one()
    wait_until(page, f"document.querySelector('img[src=\"/v1/artifacts/{card}\"]').naturalWidth === 90")
    assert serious_faults(page) == []

    # The report to send.
    page.goto(f"/studies/{study}")
    page.get_by_role("link", name="report, one page to keep or print").click()
    page.wait_for_url(f"**/studies/{study}/report")
    text = page.locator("body").inner_text()
    for words in ("Calibration of coke", "36.40°", "How it was checked", "seed"):
        assert words in text, words
