"""The overview and a design's page in a real browser, and every page on a phone and in the dark."""

from __future__ import annotations

import csv
from io import BytesIO
from typing import TYPE_CHECKING

import pytest
from pypdf import PdfReader

from service.db.session import Database
from service.settings import Settings
from tests.browser.chromium import PHONE, wait_until
from tests.builders import piles
from tests.builders.charges import charges, finish_charge
from tests.builders.studies import a_finished_study, a_study, designs

if TYPE_CHECKING:
    from playwright.sync_api import Page

pytestmark = pytest.mark.browser

# The least contrast of text against its background, by WCAG's formula, with the text and both colours.
LEAST_CONTRAST = """() => {
  const probe = document.createElement("canvas").getContext("2d", { willReadFrequently: true });
  const parse = (text) => {
    probe.clearRect(0, 0, 1, 1); probe.fillStyle = text; probe.fillRect(0, 0, 1, 1);
    const [r, g, b, a] = probe.getImageData(0, 0, 1, 1).data; return [r, g, b, a / 255];
  };
  const light = ([r, g, b]) => [r, g, b].map((v) => v / 255)
    .map((v) => (v <= 0.04045 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4))
    .reduce((sum, v, k) => sum + v * [0.2126, 0.7152, 0.0722][k], 0);
  const behind = (element) => {
    for (let at = element; at; at = at.parentElement) {
      const colour = parse(getComputedStyle(at).backgroundColor);
      if (colour[3] > 0.99) return colour;
    }
    return [255, 255, 255, 1];
  };
  let least = [99, "", "", ""];
  const walk = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
  while (walk.nextNode()) {
    const element = walk.currentNode.parentElement;
    const text = walk.currentNode.textContent.trim();
    if (!text || element.closest("svg, script, .sr, .skip") || !element.checkVisibility()) continue;
    const [front, back] = [parse(getComputedStyle(element).color), behind(element)];
    const [a, b] = [light(front), light(back)].sort((x, y) => y - x);
    const ratio = (a + 0.05) / (b + 0.05);
    if (ratio < least[0]) least = [ratio, text.slice(0, 40), front.join(), back.join()];
  }
  return least;
}"""


def test_a_study_that_starts_appears_on_the_overview(page: Page, sqlite_database: Database) -> None:
    page.goto("/")
    assert "make demo" in page.locator("#part-studies").inner_text()
    study_id = a_study(sqlite_database)
    page.wait_for_selector(f'a[href="/studies/{study_id}"]')
    page.locator(f'a[href="/studies/{study_id}"]').click()
    page.wait_for_url(f"**/studies/{study_id}")


def test_a_design_shows_profile_and_sectors(
    page: Page, sqlite_database: Database, settings: Settings
) -> None:
    study_id = piles.a_finished_study(sqlite_database, certified=True, settings=settings)
    design = designs(sqlite_database, study_id)[1]
    page.goto(f"/designs/{design.id}")
    page.wait_for_selector('[data-chart="sectors"] .main-svg')
    page.wait_for_selector('[data-chart="profile"] .main-svg')
    sectors = page.evaluate("document.querySelector('[data-chart=\"sectors\"]').data[0].y")
    assert len(sectors) == 24 and sectors[23] is None
    fitted = page.evaluate("document.querySelector('[data-chart=\"profile\"]').data[2]")
    assert fitted["x"] == pytest.approx([0.045, 0.27])
    # The drawn line falls by the tangent of the angle.
    fall = (fitted["y"][0] - fitted["y"][1]) / (fitted["x"][1] - fitted["x"][0])
    assert fall == pytest.approx(0.4748, abs=1e-3)


def test_every_chart_of_a_design_a_study_and_a_charge_comes_as_png_and_csv(
    page: Page, sqlite_database: Database, settings: Settings
) -> None:
    study_id = piles.a_finished_study(sqlite_database, certified=True, settings=settings)
    design = designs(sqlite_database, study_id)[1]
    (charge_id,) = charges(sqlite_database)
    finish_charge(sqlite_database, charge_id, settings)
    of_charge = {
        "burden": "height above the seat, m",
        "belt": "share of the mass",
        "account": "in the hopper, kg",
    }
    for address, charts in (
        (f"/charges/{charge_id}", of_charge),
        (f"/designs/{design.id}", {"profile": "mean height, m", "sectors": "slope of the sector, °"}),
        (f"/studies/{study_id}", {"angle": "standard error, °", "profile": "distance from the axis, m"}),
    ):
        page.goto(address)
        for name, column in charts.items():
            page.wait_for_selector(f'[data-chart="{name}"] .main-svg')
            button = page.locator(f'[data-save="csv"][data-of="{name}"]')
            with page.expect_download() as coming:
                button.focus()
                page.keyboard.press("Enter")
            rows = list(csv.reader(coming.value.path().read_text().splitlines()))
            assert column in rows[0] and len(rows) > 2 and len({len(row) for row in rows}) == 1, name
            assert coming.value.suggested_filename.endswith(f"-{name}.csv")
            with page.expect_download() as coming:
                page.locator(f'[data-save="png"][data-of="{name}"]').click()
            assert coming.value.path().read_bytes().startswith(b"\x89PNG"), name


def test_a_design_under_way_fills_in_when_it_ends(page: Page, sqlite_database: Database) -> None:
    study_id = piles.a_searching_study(sqlite_database)
    design = designs(sqlite_database, study_id)[4]
    page.goto(f"/designs/{design.id}")
    page.wait_for_selector("#live[data-state=live]")
    assert "The pile appears here" in page.locator("#part-design_pile").inner_text()
    piles.finish_running(sqlite_database, study_id, 25.1)
    page.wait_for_selector("#part-design_outcome:has-text('25.10°')")
    page.wait_for_selector('[data-chart="profile"] .main-svg')


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_text_is_readable_and_nothing_runs_off_a_phone(
    page: Page, sqlite_database: Database, settings: Settings, scheme: str
) -> None:
    searching = piles.a_searching_study(sqlite_database, settings)
    certified = piles.a_finished_study(sqlite_database, certified=True, settings=settings)
    page.emulate_media(color_scheme=scheme)  # type: ignore[arg-type]
    page.set_viewport_size({"width": PHONE[0], "height": PHONE[1]})
    for address in ("/", f"/studies/{searching}", f"/studies/{certified}", "/designs/1"):
        page.goto(address)
        page.wait_for_load_state("load")
        over = page.evaluate("document.documentElement.scrollWidth - window.innerWidth")
        assert over <= 0, address
        contrast = page.evaluate(LEAST_CONTRAST)
        assert contrast[0] >= 4.5, (address, contrast)


def test_a_printed_study_holds_its_charts_and_its_table(page: Page, sqlite_database: Database) -> None:
    """On A4: a chart's axis is on the sheet of its title, the table is whole, the screen's tools are gone."""
    page.goto(f"/studies/{a_finished_study(sqlite_database)}")
    wait_until(page, "document.querySelectorAll('[data-chart][data-drawn]').length > 0")
    printed = PdfReader(BytesIO(page.pdf(format="A4", print_background=True)))
    texts = [sheet.extract_text() for sheet in printed.pages]
    (chart,) = [text for text in texts if "Repose angle of each simulation" in text]
    assert "simulation number" in chart and "repose angle, degrees" in chart
    # The tabs stay on the screen; the table's last column does not.
    assert not any("Compare" in text for text in texts)
    assert any("Literal" in text and "this" in text for text in texts), texts
