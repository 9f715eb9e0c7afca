"""Work is started from forms: the cost is told, refusals stand at their fields, a double click makes one job."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from sqlalchemy import select

from service.db.models import ChargeRow, DataSetRow, DiagnosisRow, StudyRow
from service.db.session import Database
from service.domain.search_space import PAPER_PARAMETERS
from tests.browser.axe import serious_faults
from tests.browser.chromium import PHONE, wait_until
from tests.builders.diagnoses import CONDITIONS, OBSERVATIONS, a_data_set, tables
from tests.builders.studies import a_finished_study
from tests.service.test_model_versions import a_version

if TYPE_CHECKING:
    from playwright.sync_api import Page

    from tests.browser.conftest import Faults

pytestmark = pytest.mark.browser


def wait_for_cost(page: Page, words: str) -> None:
    page.wait_for_selector(f"#cost:has-text({json.dumps(words)})")


def stored(
    database: Database, kind: type[StudyRow | ChargeRow | DiagnosisRow | DataSetRow]
) -> list[dict[str, object]]:
    with database.reading() as session:
        return [dict(vars(row)) for row in session.scalars(select(kind))]


def test_a_study_starts_once_however_often_the_button_is_pressed(
    page: Page, sqlite_database: Database
) -> None:
    page.goto("/")
    page.get_by_role("link", name="New study").click()
    page.get_by_label("Material").select_option("coke")
    page.get_by_label("Budget").fill("14")
    wait_for_cost(page, "At most 14 simulations")
    page.locator("summary", has_text="What to search").click()
    page.get_by_label("rolling resistance, to").fill("0.5")
    sent = {
        "material": "coke",
        "budget": 14,
        "strategy": "auto",
        "time_step": "fast",
        "variables": {
            "particle_particle_static_friction": {},
            "particle_wall_static_friction": {},
            "particle_particle_restitution": {},
            "rolling_resistance": {"upper": 0.5},
        },
    }
    told = re.search(r"-d '(.*)'", page.locator("#curl").inner_text())
    assert told is not None and json.loads(told[1]) == sent
    code = page.locator("#python").inner_text()
    # What is printed is run as it stands: the same request, a study of its own.
    exec(code, {})
    (printed,) = stored(sqlite_database, StudyRow)
    assert printed["material"] == "coke" and printed["budget"] == 14
    page.locator("#go").dblclick()
    page.wait_for_url("**/studies/2")
    _, study = stored(sqlite_database, StudyRow)
    assert study["spec"] == printed["spec"]
    assert study["budget"] == 14 and study["material"] == "coke"
    assert study["spec"]["variables"]["rolling_resistance"]["upper"] == 0.5  # type: ignore[index]
    assert study["idempotency_key"]


def test_what_is_known_already_goes_into_a_study(
    page: Page, faults: Faults, sqlite_database: Database, tmp_path: Path
) -> None:
    version = a_version(sqlite_database, {"density": 0.1})
    a_version(sqlite_database, {"size_shift": 0.1}, withdrawn=True)
    earlier = a_finished_study(sqlite_database)
    table = tmp_path / "designs.csv"
    names = list(PAPER_PARAMETERS)
    table.write_text(",".join(names) + "\n0.5,0.5,0.3,0.2\n")
    page.goto("/new/study")
    page.locator("summary", has_text="What is known already").click()
    choices = page.get_by_label("Model version").locator("option").all_inner_texts()
    assert choices == ["baseline", version]
    page.get_by_label("Table of designs").set_input_files(table)
    page.get_by_label("Start from studies").fill(f"{earlier}")
    wait_until(page, "document.getElementById('python').textContent.includes('table_csv=')")
    assert f"warm_start=[{earlier}]" in page.locator("#python").inner_text()
    table.write_text(",".join(names) + "\n0.5,0.5,0.3\n")
    page.get_by_label("Table of designs").set_input_files(table)
    page.locator('[data-path="table_csv"] .refused').wait_for()
    assert all("422" in fault for fault in faults.found)
    faults.found.clear()


def test_a_refusal_stands_at_its_field_and_goes_when_it_is_mended(
    page: Page, faults: Faults, sqlite_database: Database
) -> None:
    page.goto("/new/study")
    wait_for_cost(page, "At most 30 simulations")
    page.get_by_label("Window from").fill("27")
    # Half a window is none: the other end is asked for.
    place = page.locator('[data-path="objective.window_deg.1"] .refused')
    place.wait_for()
    page.get_by_label("Window from").fill("24")
    page.get_by_label("Window to").fill("27")
    page.get_by_label("Target angle").fill("95")
    refused = page.locator('[data-path="objective.target_deg"] .refused')
    refused.wait_for()
    assert "5 to 60 deg" in refused.inner_text() and place.is_hidden()
    field = page.get_by_label("Target angle")
    assert field.get_attribute("aria-invalid") == "true"
    page.locator("#go").click()
    wait_until(page, "document.activeElement.id === 'f-objective.target_deg'")
    assert stored(sqlite_database, StudyRow) == []
    field.fill("25,5")
    wait_for_cost(page, "At most 30 simulations")
    assert refused.is_hidden() and field.get_attribute("aria-invalid") is None
    # A refusal is an answer of 422, which the browser writes to its console.
    assert all("422" in fault for fault in faults.found)
    faults.found.clear()


def test_charges_tell_their_cost_and_start_with_the_keyboard(page: Page, sqlite_database: Database) -> None:
    page.goto("/new/charge")
    page.get_by_label("Coarse-graining").fill("10")
    page.get_by_label("Random seeds").fill("4, 5")
    wait_for_cost(page, "2 charges, each: ")
    page.locator("#go").focus()
    page.keyboard.press("Enter")
    page.wait_for_url("**/charges/1")
    assert [(row["seed"], row["scale"]) for row in stored(sqlite_database, ChargeRow)] == [
        (4, 10.0),
        (5, 10.0),
    ]


def test_measurements_are_uploaded_and_diagnosed(
    page: Page, sqlite_database: Database, tmp_path: Path
) -> None:
    found = tables()
    page.goto("/new/measurement")
    page.get_by_label("Name").fill("piles of May")
    for name in (CONDITIONS, OBSERVATIONS):
        (tmp_path / name).write_text(found[name])
        page.get_by_label(name).set_input_files(tmp_path / name)
    wait_until(page, "document.getElementById('python').textContent.includes('observations.csv')")
    page.locator("#go").click()
    page.wait_for_url("**/new/diagnosis?data_set=1")
    assert [row["name"] for row in stored(sqlite_database, DataSetRow)] == ["piles of May"]
    page.get_by_label("Grains of a pile").fill("300")
    wait_for_cost(page, "pile tests")
    page.locator("#go").click()
    page.wait_for_url("**/diagnoses/1")
    (diagnosis,) = stored(sqlite_database, DiagnosisRow)
    assert diagnosis["spec"]["grains"] == 300  # type: ignore[index]


def test_a_bad_cell_is_named_at_its_table(
    page: Page, faults: Faults, sqlite_database: Database, tmp_path: Path
) -> None:
    found = tables()
    page.goto("/new/measurement")
    page.get_by_label("Name").fill("piles")
    for name, text in (
        (CONDITIONS, found[CONDITIONS].replace("20", "heavy")),
        (OBSERVATIONS, found[OBSERVATIONS]),
    ):
        (tmp_path / name).write_text(text)
        page.get_by_label(name).set_input_files(tmp_path / name)
    page.locator("#go").click()
    refused = page.locator('[data-path="tables.conditions.csv"] .refused')
    refused.wait_for()
    assert "mass_kg" in refused.inner_text() and '"heavy"' in refused.inner_text()
    assert all("422" in fault for fault in faults.found)
    faults.found.clear()


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_the_forms_are_accessible_and_fit_a_phone(page: Page, sqlite_database: Database, scheme: str) -> None:
    a_data_set(sqlite_database)
    page.emulate_media(color_scheme=scheme)  # type: ignore[arg-type]
    page.set_viewport_size({"width": PHONE[0], "height": PHONE[1]})
    for name in ("study", "charge", "measurement", "diagnosis"):
        page.goto(f"/new/{name}")
        wait_until(page, "document.getElementById('cost').textContent !== '…'")
        assert page.evaluate("document.documentElement.scrollWidth - window.innerWidth") <= 0, name
        assert serious_faults(page) == [], name
