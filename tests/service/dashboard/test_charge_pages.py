"""The pages of charges with rows of every state: they render, say what is so, and ask for nothing outside."""

from __future__ import annotations

import json
import re

import pytest
from fastapi.testclient import TestClient

from service.dashboard.charge_page import tell
from service.dashboard.sector_rose import draw_rose
from service.db.session import Database
from service.domain.outcome import Failure, FailureClass
from service.domain.states import JobState
from service.settings import Settings
from service.studies.record_failure import record_failure
from tests.builders.charges import (
    a_summary,
    beat_charge,
    charges,
    claimed_charge,
    finish_charge,
    job_of_charge,
)
from tests.service.dashboard.test_pages import check_page


def page(client: TestClient, address: str) -> str:
    response = client.get(address)
    assert response.status_code == 200
    check_page(response.text)
    return response.text


def test_the_list_says_how_each_charge_stands(
    client: TestClient, sqlite_database: Database, settings: Settings
) -> None:
    done, running, waiting, failed = (charges(sqlite_database, scale=s)[0] for s in (8.0, 9.0, 10.0, 11.0))
    finish_charge(sqlite_database, done, settings)
    beat_charge(sqlite_database, claimed_charge(sqlite_database, running), 0.42)
    lease = claimed_charge(sqlite_database, failed).lease
    with sqlite_database.writing() as session:
        record_failure(session, lease, Failure(FailureClass.NO_RESULT, "nothing lies in the hopper"))
    text = page(client, "/charges")
    for number in (done, running, waiting, failed):
        assert f'href="/charges/{number}"' in text
    for words in ("1.50\u202fm", "of 140\u202fmm", "behind the rod and under the deflector", "42\u202f%"):
        assert words in text, words
    states = re.findall(r'class="tag ([a-z]*)" title="[^"]*">([a-z]+)<', text)
    assert states == [("bad", "error"), ("", "waiting"), ("busy", "simulating"), ("good", "done")]


def test_the_charts_of_a_charge_hold_its_numbers_in_the_units_of_their_axes(
    client: TestClient, sqlite_database: Database, settings: Settings
) -> None:
    (number,) = charges(sqlite_database)
    empty = json.loads(re.search(r'id="charts">(.*?)</script>', page(client, f"/charges/{number}"))[1])  # type: ignore[index]
    assert empty == {"burden": None, "account": None, "belt": None}
    finish_charge(sqlite_database, number, settings)
    charts = client.get(f"/charges/{number}/parts").json()["charts"]
    seat = a_summary()["inputs"]["plant"]["hopper"]["seat_depth"]
    assert charts["burden"]["height"] == pytest.approx([z + seat for z in (1.0, 2.0, 3.0, 4.0)])
    assert charts["burden"]["piles"] == [200.0]
    assert charts["belt"] == {
        "height": pytest.approx([10.0, 30.0]),
        "share": [0.6, 0.4],
        "size": [pytest.approx(80.0), None],
    }
    assert charts["account"]["in_hopper"] == [0.0, 19.5]


def test_a_finished_charge_shows_findings_numbers_pictures_and_files(
    client: TestClient, sqlite_database: Database, settings: Settings
) -> None:
    (number,) = charges(sqlite_database, plant={"deflector": {"ridge_across_mm": -120.0}})
    finish_charge(sqlite_database, number, settings)
    text = page(client, f"/charges/{number}")
    assert text.count(">agrees<") == 4 and "the far pile is much higher" in text
    for words in ("100\u202fmm", "30\u202f%", "34.2°", "deflector ridge across mm", "-120"):
        assert words in text, words
    picture = re.search(r'<img src="(/v1/artifacts/\d+)"', text)
    assert picture is not None
    assert client.get(picture[1]).headers["content-type"] == "image/png"
    assert "Report, one page to keep (HTML)" in text
    assert "data-over" in text and "data-post" not in text
    assert "was asked for alone" in text


def test_a_series_stands_beside_each_other_with_its_scatter(
    client: TestClient, sqlite_database: Database, settings: Settings
) -> None:
    """Far piles of 1.4, 1.5 and 1.6 m: mean 1.5 m, standard deviation .1 m."""
    numbers = charges(sqlite_database, seeds=(1, 2, 3))
    for number, height in zip(numbers[:2], (1.4, 1.5), strict=True):
        finish_charge(sqlite_database, number, settings, far_height_m=height)
    text = page(client, f"/charges/{numbers[2]}")
    assert 'id="series-table"' in text and "data-over" not in text
    finish_charge(sqlite_database, numbers[2], settings, far_height_m=1.6)
    text = page(client, f"/charges/{numbers[0]}")
    row = re.search(r"Far pile</abbr></th>(.*?)</tr>", text, re.S)
    assert row is not None
    cells = re.findall(r">([^<>]+)</td>", row[1])
    assert cells == ["1.40\u202fm", "1.50\u202fm", "1.60\u202fm", "1.50\u202fm", "0.100\u202fm"]
    assert "data-over" in text


def without_time_run(html: str) -> str:
    """A second may pass between two requests: all but the time that a job has run must be alike."""
    return re.sub(r"(<dt>Running for</dt><dd[^>]*>)[^<]*", r"\1", html)


def test_a_charge_under_way_can_be_stopped_and_its_parts_follow(
    client: TestClient, sqlite_database: Database
) -> None:
    (number,) = charges(sqlite_database)
    beat_charge(sqlite_database, claimed_charge(sqlite_database, number), 0.42)
    text = without_time_run(page(client, f"/charges/{number}"))
    assert f'data-post="/v1/charges/{number}/cancel"' in text and "charging" in text
    parts = client.get(f"/charges/{number}/parts").json()
    assert parts["is_over"] is False
    for name, html in parts["html"].items():
        assert f'id="part-{name}"' in text and without_time_run(html).strip() in text
    assert client.post(f"/v1/charges/{number}/cancel").status_code == 202
    assert job_of_charge(sqlite_database, number).state is JobState.RUNNING
    assert "All data (JSON)" in client.get(f"/charges/{number}/parts").json()["html"]["charge_files"]


def test_a_failed_charge_says_why(client: TestClient, sqlite_database: Database) -> None:
    (number,) = charges(sqlite_database)
    lease = claimed_charge(sqlite_database, number).lease
    with sqlite_database.writing() as session:
        record_failure(session, lease, Failure(FailureClass.NO_RESULT, "nothing <b>lies</b> in the hopper"))
    text = page(client, f"/charges/{number}")
    assert "nothing &lt;b&gt;lies&lt;/b&gt; in the hopper" in text
    assert "left no burden" in text


def test_results_of_another_form_are_shown_as_far_as_they_go(
    client: TestClient, sqlite_database: Database, settings: Settings
) -> None:
    """A summary that a later version has more keys than: no page breaks on it."""
    (number,) = charges(sqlite_database)
    finish_charge(sqlite_database, number, settings, results={"findings": {"piles": 2}, "fed_kg": None})
    assert ">2</dd>" in page(client, f"/charges/{number}")


def test_older_charges_are_a_page_away(client: TestClient, sqlite_database: Database) -> None:
    numbers = charges(sqlite_database, seeds=tuple(range(1, 28)))
    first = page(client, "/charges")
    address = re.search(r'href="(/charges\?before=\d+)"', first)
    assert address is not None and f'href="/charges/{numbers[0]}"' not in first
    assert f'href="/charges/{numbers[0]}"' in page(client, address[1])
    assert "no older charges" in page(client, "/charges?before=1")


def test_no_charge_yet_says_how_to_ask_for_one(client: TestClient) -> None:
    assert "talus charge coke" in page(client, "/charges")


@pytest.mark.parametrize("address", ["/charges/9", "/charges/abc", "/charges/0", "/charges/9/parts"])
def test_an_unknown_charge_is_a_page_that_leads_back(address: str, client: TestClient) -> None:
    response = client.get(address)
    assert response.status_code == 404 and "All studies" in response.text


def test_a_wedge_is_as_long_as_its_sectors_mass() -> None:
    """Four sectors of 1 to 4 kg at 1 to 4 degrees: radii of 25 to 100, the mean at 62.5."""
    rose = draw_rose(a_summary())
    assert rose is not None and rose.mean == 62.5
    assert [float(re.findall(r"A([\d.]+) ", w.path)[0]) for w in rose.wedges] == [25.0, 50.0, 75.0, 100.0]
    assert [w.shade for w in rose.wedges] == [0.25, 0.5, 0.75, 1.0]
    assert draw_rose({"sectors": {"mass": [0.0, 0.0]}}) is None and draw_rose({}) is None


@pytest.mark.parametrize(
    ("name", "value", "text"),
    [
        ("far_height_m", 1.5, "1.50\u202fm"),
        ("far_size_m", 0.1234, "123\u202fmm"),
        ("far_share_of_mass", 0.631, "63\u202f%"),
        ("near_slope_deg", 34.21, "34.2°"),
        ("stratification", 0.5339, "0.534"),
        ("far_height_m", float("nan"), "–"),
        ("piles", None, "–"),
    ],
)
def test_a_number_is_told_in_its_unit(name: str, value: float | None, text: str) -> None:
    assert tell(name, value) == text
