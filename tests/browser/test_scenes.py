"""Grains in 3D, in a browser that draws WebGL2 in software, and in one that says it has none."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from PIL import Image
from sqlalchemy import select

from service.db.models import ArtifactRow
from service.db.queries import Lease
from service.db.session import Database
from service.settings import Settings
from service.studies.cancel_job import cancel_job
from service.studies.record_cancellation import record_cancellation
from tests.browser.axe import serious_faults
from tests.browser.chromium import PHONE, wait_until
from tests.builders.scenes import (
    GRAINS,
    a_charge_under_way,
    a_charge_with_grains,
    a_design_with_grains,
    block_of_grains,
    leave_files,
    write_running_frames,
)
from worker.evaluate import forget_checkpoint

if TYPE_CHECKING:
    from playwright.sync_api import Page

    from tests.browser.conftest import Faults

pytestmark = pytest.mark.browser

DRAWN = "document.querySelector('[data-scene]').dataset.drawn"
# Pixels of the canvas that are not see-through, and the mean of each channel over them, right after a drawing.
NO_WEBGL2 = """(() => {
  const open = HTMLCanvasElement.prototype.getContext;
  HTMLCanvasElement.prototype.getContext = function (kind, ...more) {
    return kind === "webgl2" ? null : open.call(this, kind, ...more);
  };
})()"""
PIXELS = """() => {
  const source = document.querySelector('[data-part="canvas"]');
  const copy = Object.assign(document.createElement("canvas"), { width: 200, height: 120 });
  const context = copy.getContext("2d", { willReadFrequently: true });
  return new Promise((resolve) => {
    document.querySelector('[data-part="walls"]').dispatchEvent(new Event("change"));
    requestAnimationFrame(() => {
      context.drawImage(source, 0, 0, 200, 120);
      const data = context.getImageData(0, 0, 200, 120).data;
      const sum = [0, 0, 0, 0];
      for (let k = 0; k < data.length; k += 4) {
        if (data[k + 3] > 250) { sum[0] += 1; for (const c of [0, 1, 2]) sum[c + 1] += data[k + c]; }
      }
      resolve([sum[0], ...sum.slice(1).map((value) => Math.round(value / Math.max(1, sum[0])))]);
    });
  });
}"""


def wait_for_drawing(page: Page, frame: int) -> None:
    wait_until(page, f"{DRAWN} === '{frame}'", 90.0)


def part(name: str) -> str:
    return f'[data-part="{name}"]'


def test_a_pile_is_drawn_coloured_cut_and_picked(
    page: Page, sqlite_database: Database, settings: Settings, tmp_path: Path
) -> None:
    page.goto(f"/designs/{a_design_with_grains(sqlite_database, settings)}")
    wait_for_drawing(page, 0)
    assert page.locator(".still").is_hidden(), "the picture goes when the grains are there"
    by_height = page.evaluate(PIXELS)
    assert by_height[0] > 800
    assert f"{GRAINS} grains" in page.locator(part("words")).inner_text()
    assert "Not stored: time of arrival, time-lapse" in page.locator(part("notes")).inner_text()

    # Without walls only grains are left; their colours follow the choice.
    page.locator(part("walls")).uncheck()
    assert page.evaluate(PIXELS)[0] < by_height[0]
    heights = page.evaluate(PIXELS)
    page.locator(part("colour")).select_option(label="speed, m/s")
    page.wait_for_selector(f"{part('words')}:has-text('from 0 (dark violet) to 0.059 m/s')")
    assert page.evaluate(PIXELS)[1:] != heights[1:]

    # Half of the block lies beyond its middle.
    page.locator(part("axis")).select_option("x")
    assert page.locator(part("cut-at")).inner_text().startswith("x ≤")
    half = page.evaluate(PIXELS)[0]
    assert 0.25 * heights[0] < half < 0.85 * heights[0]
    page.get_by_role("slider", name="Place of the cut").fill("100")
    page.get_by_label("other side").check()
    # One layer of the block is left, the one whose centres lie on the plane.
    assert 0 < page.evaluate(PIXELS)[0] < 0.8 * half
    page.locator(part("axis")).select_option("")

    # The grain in the middle, by the keyboard alone.
    canvas = page.locator(part("canvas"))
    canvas.focus()
    page.keyboard.press("Enter")
    page.wait_for_selector(f"{part('picked-told')}:has-text('mm')")
    told = page.locator(part("picked-told")).inner_text()
    row = int(told.split("(row")[0].split()[-1])
    position, radius = block_of_grains(GRAINS)[0][row], block_of_grains(GRAINS)[1][row]
    place = ", ".join(f"{value:.4f}" for value in position).replace("-", "−")
    assert place in told and f"{2000 * radius:.4g} mm" in told.replace("\u202f", " ")
    assert "pellet" in told and "m/s" in told
    page.keyboard.press("Escape")
    assert page.locator(part("picked")).is_hidden()

    # A click far beside the heap picks nothing; the keys turn and zoom the view.
    canvas.click(position={"x": 4, "y": 4})
    assert page.locator(part("picked")).is_hidden()
    before = page.evaluate(PIXELS)
    for key in ("ArrowLeft", "ArrowUp", "+", "+"):
        page.keyboard.press(key)
    page.wait_for_timeout(400)
    assert page.evaluate(PIXELS)[0] > 1.2 * before[0]
    page.get_by_role("button", name="Reset view").click()
    page.wait_for_timeout(400)
    assert page.evaluate(PIXELS) == pytest.approx(before, abs=2)

    with page.expect_download() as coming:
        page.get_by_role("button", name="PNG").first.click()
    coming.value.save_as(tmp_path / "pile.png")
    with Image.open(tmp_path / "pile.png") as picture:
        colours = len(picture.convert("RGB").getcolors(10**6) or ())
    assert colours > 200 and coming.value.suggested_filename.startswith("talus-study-1-design-1")
    with page.expect_download() as coming:
        page.get_by_role("link", name="CSV", exact=True).first.click()
    coming.value.save_as(tmp_path / "pile.csv")
    assert len((tmp_path / "pile.csv").read_text().splitlines()) == GRAINS + 1


def test_a_charge_is_played_through_time(page: Page, sqlite_database: Database, settings: Settings) -> None:
    page.goto(f"/charges/{a_charge_with_grains(sqlite_database, settings)}")
    wait_for_drawing(page, 3)
    time = page.get_by_role("slider", name="Time")
    time.fill("1")
    wait_for_drawing(page, 1)
    assert page.locator(part("when")).inner_text().replace("\u202f", " ") == "2 s, 6 grains"
    assert time.get_attribute("aria-valuetext") == page.locator(part("when")).inner_text()
    page.get_by_role("button", name="Play").click()
    wait_for_drawing(page, 3)
    page.get_by_role("button", name="Play").wait_for()
    page.locator(part("colour")).select_option(label="time of arrival, s")
    page.wait_for_selector(f"{part('words')}:has-text('below the rim; frames are 2 s apart')")
    assert "from 4 (dark violet) to 6 s" in page.locator(part("words")).inner_text()
    page.locator(part("colour")).select_option(label="material")
    page.wait_for_selector(f"{part('words')}:has-text('kind 1')")
    page.get_by_text("As a table, and how to move").click()
    grains = page.locator(f"{part('layers')} td:nth-child(2)").all_inner_texts()
    assert len(grains) == 8 and sum(map(int, grains)) == 12


def test_a_charge_under_way_shows_each_frame_as_it_is_written(
    page: Page, sqlite_database: Database, settings: Settings
) -> None:
    """From no grain at all to the files that the run leaves; who looks back at a frame is left there."""
    charge, job = a_charge_under_way(sqlite_database, settings, frames=1)
    page.goto(f"/charges/{charge}")
    wait_for_drawing(page, 0)
    page.wait_for_selector(f"{part('state')}:has-text('under way')")
    assert "0 grains" in page.locator(part("words")).inner_text().replace("\u202f", " ")
    assert page.locator(part("timeline")).is_hidden()
    write_running_frames(job, settings, frames=3, first=1)
    wait_for_drawing(page, 2)
    page.wait_for_selector(f"{part('state')}:has-text('at 4 s of simulated time')")
    assert page.locator(part("when")).inner_text().replace("\u202f", " ") == "4 s, 6 grains"
    assert serious_faults(page) == []
    page.locator(part("colour")).select_option(label="speed, m/s")
    time = page.get_by_role("slider", name="Time")
    time.fill("1")
    wait_for_drawing(page, 1)
    write_running_frames(job, settings, frames=4, first=3)
    page.wait_for_selector(f"{part('state')}:has-text('at 6 s of simulated time')")
    assert page.evaluate(DRAWN) == "1" and time.get_attribute("max") == "3"
    # What it leaves replaces what was seen of it, without a reload.
    leave_files(sqlite_database, settings, charge)
    wait_for_drawing(page, 3)
    wait_until(page, f"document.querySelector('{part('state')}').hidden")
    assert page.locator(f"{part('colour')} option:checked").inner_text() == "speed, m/s"
    assert "under way" not in page.locator(part("words")).inner_text()


def test_a_charge_that_is_stopped_leaves_no_frames_to_look_at(
    page: Page, sqlite_database: Database, settings: Settings
) -> None:
    charge, job = a_charge_under_way(sqlite_database, settings)
    page.goto(f"/charges/{charge}")
    wait_for_drawing(page, 2)
    with sqlite_database.writing() as session:
        cancel_job(session, job)
    with sqlite_database.writing() as session:
        assert record_cancellation(session, Lease(job, 1))
    forget_checkpoint(job, settings)
    page.wait_for_selector(f"{part('state')}:has-text('left no grains')")
    assert page.locator(part("canvas")).is_hidden()


def test_a_frame_that_does_not_come_is_said_and_asked_for_again(
    page: Page, faults: Faults, sqlite_database: Database, settings: Settings
) -> None:
    charge = a_charge_with_grains(sqlite_database, settings)
    with sqlite_database.reading() as session:
        file = session.scalars(select(ArtifactRow).where(ArtifactRow.kind == "spheres")).one()
    path = settings.artifacts_dir / file.path
    page.goto(f"/charges/{charge}")
    wait_for_drawing(page, 3)
    aside = path.rename(path.with_name("aside"))
    page.get_by_role("slider", name="Time").fill("0")
    page.wait_for_selector(f"{part('state')}:has-text('no longer stored')")
    assert page.evaluate(DRAWN) == "3", "the earlier frame stays"
    aside.rename(path)
    page.get_by_role("button", name="Try again").click()
    wait_until(page, f"document.querySelector('{part('state')}').hidden")
    assert all("404" in fault for fault in faults.found)
    faults.found.clear()


def test_without_webgl_the_picture_and_the_table_serve(
    page: Page, sqlite_database: Database, settings: Settings
) -> None:
    page.add_init_script(NO_WEBGL2)
    page.goto(f"/designs/{a_design_with_grains(sqlite_database, settings)}")
    page.wait_for_selector(f"{part('no-gl')}:has-text('no WebGL2')")
    assert page.locator(".still").is_visible()
    page.get_by_text("As a table, and how to move").click()
    grains = page.locator(f"{part('layers')} td:nth-child(2)").all_inner_texts()
    assert sum(map(int, grains)) == GRAINS


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_the_3d_view_is_accessible_and_fits_a_phone(
    page: Page, sqlite_database: Database, settings: Settings, scheme: str
) -> None:
    page.emulate_media(color_scheme=scheme)  # type: ignore[arg-type]
    page.set_viewport_size({"width": PHONE[0], "height": PHONE[1]})
    page.goto(f"/charges/{a_charge_with_grains(sqlite_database, settings)}")
    wait_for_drawing(page, 3)
    assert page.evaluate("document.documentElement.scrollWidth - window.innerWidth") <= 0
    assert serious_faults(page) == []
