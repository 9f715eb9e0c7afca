"""The pages with rows of every state: they render, say what is so, and ask for nothing outside."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from html.parser import HTMLParser
from pathlib import Path

import pytest
from fastapi.testclient import TestClient

from service.db.presence import report_presence
from service.db.session import Database
from service.settings import Settings
from service.studies.cancel_study import cancel_study
from tests.builders import piles
from tests.builders.studies import a_study, add_finished_designs, designs, write_report

Course = Callable[[Database], int]

DASHBOARD = Path(__file__).resolve().parents[3] / "service" / "dashboard"


def a_cancelled_study(database: Database) -> int:
    study_id = a_study(database, parallel=1)
    with database.writing() as session:
        cancel_study(session, study_id)
    return study_id


STUDIES: dict[str, tuple[Course, tuple[str, ...]]] = {
    "empty": (a_study, ("no angle yet", "Not certified yet", "The first simulation is being chosen")),
    "searching": (
        piles.a_searching_study,
        ("25.40°", "Nearest to the target so far", "discharge over the rim", "about 1", "repeat"),
    ),
    "certified": (
        lambda database: piles.a_finished_study(database, certified=True),
        ("25.43°", "0.39°", "Certified", "all demands hold", "±0.4° (90\u202f%)"),
    ),
    "not certified": (
        lambda database: piles.a_finished_study(database, certified=False),
        ("Not certified", "All demands must hold", "does not hold", "To go on", 'href="/new/study"'),
    ),
    "unreachable": (
        lambda database: piles.a_finished_study(database, certified=False, reason="target_unreachable"),
        ("Not certified", "No parameters in the search space reach the target"),
    ),
    "errors alone": (
        piles.a_study_without_piles,
        ("no angle yet", "ecame unstable", "Paused", "1 of 1 ended in error"),
    ),
    "failed": (piles.a_failed_study, ("Failed", "singular matrix")),
    "cancelled": (a_cancelled_study, ("stopped", "Cancelled by the user")),
}


class Addresses(HTMLParser):
    """Every address that a page would have a browser fetch or offer."""

    def __init__(self, html: str) -> None:
        super().__init__()
        self.found: list[str] = []
        self.inline: list[str] = []
        self.feed(html)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        for name, value in attrs:
            if name in ("src", "href", "action", "data-parts", "data-events", "data-plotly", "srcset"):
                self.found.append(value or "")
            if name == "style" or name.startswith("on"):
                self.inline.append(f"{tag} {name}")
        if tag in ("style", "iframe", "object", "embed", "form"):
            self.inline.append(tag)
        if tag == "script" and dict(attrs).get("type") not in ("module", "application/json"):
            self.inline.append("script")


def check_page(text: str) -> None:
    page = Addresses(text)
    assert page.found
    assert [address for address in page.found if not re.match(r"/(?!/)|#", address)] == []
    assert page.inline == []
    assert piles.SCRIPT not in text
    assert "None" not in re.sub(r"<script.*?</script>", "", text, flags=re.S)
    assert "Undefined" not in text


@pytest.mark.parametrize("name", STUDIES)
def test_a_study_page_says_how_the_study_stands(
    name: str, client: TestClient, sqlite_database: Database
) -> None:
    course, words = STUDIES[name]
    study_id = course(sqlite_database)
    response = client.get(f"/studies/{study_id}")
    assert response.status_code == 200
    check_page(response.text)
    for word in words:
        assert word in response.text, word
    assert ("data-over" in response.text) == (name not in ("empty", "searching", "errors alone"))
    overview = client.get("/")
    check_page(overview.text)
    assert f'href="/studies/{study_id}"' in overview.text
    for design in designs(sqlite_database, study_id):
        assert f'id="design-{design.number}"' in response.text
        page = client.get(f"/designs/{design.id}")
        assert page.status_code == 200
        check_page(page.text)


def test_the_reason_of_a_stop_is_told_even_without_its_text() -> None:
    from service.dashboard import words

    assert words.look_up(words.STOPS, "budget").meaning == "The budget of simulations is spent."
    assert words.look_up(words.STOPS, "something_new").text == "something new"


def test_the_empty_overview_says_how_to_start(client: TestClient) -> None:
    text = client.get("/").text
    check_page(text)
    assert "make demo" in text and "curl -X POST" in text
    assert "none reports" in text


def test_the_health_strip_knows_who_reported(client: TestClient, sqlite_database: Database) -> None:
    with sqlite_database.writing() as session:
        report_presence(session, "w", "worker", "here", 1)
        report_presence(session, "d", "dispatcher", "here", 2, problem="no broker at /run/x")
    text = client.get("/").text
    assert "1 at work" in text and "no broker at /run/x" in text
    study_id = a_study(sqlite_database)
    page = client.get(f"/studies/{study_id}").text
    assert "no broker at /run/x" in page and "No worker reports" not in page


def test_older_studies_are_a_page_away(client: TestClient, sqlite_database: Database) -> None:
    ids = [a_study(sqlite_database) for _ in range(27)]
    first = client.get("/").text
    assert f'href="/studies/{ids[-1]}"' in first and f'href="/studies/{ids[0]}"' not in first
    address = re.search(r'href="(/\?before=\d+)"', first)
    assert address is not None
    second = client.get(address[1]).text
    assert f'href="/studies/{ids[0]}"' in second and f'href="/studies/{ids[-1]}"' not in second
    check_page(second)
    assert "no older studies" in client.get("/?before=1").text


def test_charts_hold_every_finished_design(client: TestClient, sqlite_database: Database) -> None:
    study_id = piles.a_searching_study(sqlite_database)
    text = client.get(f"/studies/{study_id}").text
    embedded = re.search(r'<script type="application/json" id="charts">(.*?)</script>', text, re.S)
    assert embedded is not None
    charts = json.loads(embedded[1])
    points = charts["angle"]["points"]
    assert [point["verdict"] for point in points] == ["unfeasible", "feasible", "error", "feasible"]
    assert [point["chosen"] for point in points] == [False, True, False, False]
    assert points[2]["angle"] is None and points[2]["failure"] == "the simulation became unstable"
    assert points[3]["predicted"] == piles.PREDICTION["mean_deg"]
    assert len(charts["profile"]["r"]) == piles.RINGS


def test_the_design_page_shows_every_number_with_its_unit(
    client: TestClient, sqlite_database: Database, settings: Settings
) -> None:
    study_id = piles.a_searching_study(sqlite_database, settings)
    rows = designs(sqlite_database, study_id)
    text = client.get(f"/designs/{rows[3].id}").text
    for number in (
        "25.90°",
        "50.8\u202fkg",
        "160\u202fmm",
        "2\u202f100",
        "0.900\u202fs",
        "3.50 · 10⁻⁵\u202fs",
        "600\u202fmm",
    ):
        assert number in text, number
    assert "+0.6 sd" in text and "93\u202f%" in text
    picture = re.search(r'<img src="(/v1/artifacts/\d+)"', text)
    assert picture is not None
    assert client.get(picture[1]).headers["content-type"] == "image/png"
    assert f'href="/designs/{rows[2].id}"' in text and f'href="/designs/{rows[4].id}"' in text


def test_parts_since_an_event_hold_only_the_rows_concerned(
    client: TestClient, sqlite_database: Database
) -> None:
    study_id = piles.a_searching_study(sqlite_database)
    whole = client.get(f"/studies/{study_id}/parts").json()
    assert list(whole["rows"]) == [f"design-{n}" for n in range(1, 6)]
    assert client.get(f"/studies/{study_id}/parts?after={whole['cursor']}").json()["rows"] == {}
    with sqlite_database.writing() as session:
        cancel_study(session, study_id)
    later = client.get(f"/studies/{study_id}/parts?after={whole['cursor']}").json()
    assert later["cursor"] > whole["cursor"]
    assert later["rows"] == {}
    assert "stopping" in later["html"]["used"]
    assert whole["counts"] == {"all": 5, "feasible": 2, "unfeasible": 1, "error": 1, "open": 1}
    assert whole["chosen"] == [2]


def test_parts_are_what_the_page_shows(client: TestClient, sqlite_database: Database) -> None:
    study_id = piles.a_finished_study(sqlite_database, certified=True)
    for address in ("/", f"/studies/{study_id}", "/designs/1"):
        page = client.get(address).text
        parts = client.get(address.rstrip("/") + "/parts").json()
        for name in parts["html"]:
            assert f'id="part-{name}"' in page or name == "jobs", name


@pytest.mark.parametrize(
    "address",
    ["/studies/99", "/studies/abc", "/studies/0", "/studies/" + "9" * 40, "/designs/7", "/designs/-1"],
)
def test_unknown_ids_are_a_page_that_leads_back(address: str, client: TestClient) -> None:
    response = client.get(address)
    assert response.status_code == 404
    assert response.headers["content-type"].startswith("text/html")
    check_page(response.text)
    assert "All studies" in response.text


BROWSER = {"accept": "text/html,application/xhtml+xml,application/xml;q=0.9,*/*;q=0.8"}


@pytest.mark.parametrize("address", ["/studys", "/studies/1/nowhere", "/<b>hi</b>"])
def test_an_unknown_address_is_a_page_for_a_browser(address: str, client: TestClient) -> None:
    response = client.get(address, headers=BROWSER)
    assert response.status_code == 404
    check_page(response.text)
    assert "There is no page" in response.text and "<b>hi</b>" not in response.text
    assert "default-src 'none'" in response.headers["content-security-policy"]


@pytest.mark.parametrize(
    ("method", "address", "accept"),
    [
        ("GET", "/studys", "*/*"),
        ("GET", "/v1/studys", BROWSER["accept"]),
        ("POST", "/studys", BROWSER["accept"]),
    ],
)
def test_an_unknown_address_is_a_problem_for_a_program(
    method: str, address: str, accept: str, client: TestClient
) -> None:
    response = client.request(method, address, headers={"accept": accept})
    assert response.status_code == 404
    assert response.headers["content-type"] == "application/problem+json"
    assert response.json()["status"] == 404


def test_hostile_ids_are_escaped(client: TestClient) -> None:
    response = client.get("/studies/%3Cscript%3Ealert(1)")
    assert response.status_code == 404 and "<script>alert" not in response.text


@pytest.mark.parametrize(
    "address", ["/", "/studies/1", "/designs/1", "/studies/99", "/parts", "/studies/1/parts"]
)
def test_security_headers(address: str, client: TestClient, sqlite_database: Database) -> None:
    piles.a_finished_study(sqlite_database, certified=True)
    headers = client.get(address).headers
    policy = dict(part.strip().split(" ", 1) for part in headers["content-security-policy"].split(";"))
    assert policy["default-src"] == "'none'"
    assert policy["script-src"] == policy["style-src"] == policy["connect-src"] == "'self'"
    assert headers["x-content-type-options"] == "nosniff"
    assert headers["x-frame-options"] == "DENY"
    assert headers["cache-control"] == "no-store"


def test_a_database_that_is_away_is_a_page_too(tmp_path: Path) -> None:
    from service.app import create_app

    url = "postgresql+psycopg://nobody@/none?host=/nowhere"
    app = create_app(Settings(data_dir=tmp_path, database_url=url))
    with TestClient(app, raise_server_exceptions=False) as client:
        response = client.get("/")
    assert response.status_code == 503 and response.headers["retry-after"]
    assert "The database does not answer" in response.text


def test_the_document_of_the_api_does_not_list_pages(client: TestClient) -> None:
    """Its metrics have the path that Prometheus asks for by itself."""
    paths = client.get("/openapi.json").json()["paths"]
    assert [path for path in paths if not path.startswith("/v1")] == ["/metrics"]


def test_a_study_of_500_designs_is_a_light_page(client: TestClient, sqlite_database: Database) -> None:
    study_id = a_study(sqlite_database, budget=600)
    add_finished_designs(sqlite_database, study_id, 500)
    response = client.get(f"/studies/{study_id}", headers={"Accept-Encoding": "gzip"})
    assert response.status_code == 200
    assert len(response.content) < 1_200_000
    assert response.headers["content-encoding"] == "gzip"
    assert int(response.headers["content-length"]) < 100_000


def test_pages_go_out_by_gzip_and_the_api_as_it_is(client: TestClient, sqlite_database: Database) -> None:
    study_id = a_study(sqlite_database)
    for path, encoding in (
        (f"/studies/{study_id}", "gzip"),
        (f"/v1/studies/{study_id}", None),
        ("/openapi.json", "gzip"),
        ("/metrics", None),
    ):
        response = client.get(path, headers={"Accept-Encoding": "gzip"})
        assert response.status_code == 200
        assert response.headers.get("content-encoding") == encoding, path
    plain = client.get(f"/studies/{study_id}", headers={"Accept-Encoding": "identity"})
    assert "content-encoding" not in plain.headers and "Accept-Encoding" in plain.headers["vary"]


def test_sources_name_no_outside_address() -> None:
    allowed = ("http://www.w3.org/2000/svg",)
    for path in [
        *DASHBOARD.rglob("*.html"),
        *DASHBOARD.rglob("*.css"),
        *DASHBOARD.rglob("*.js"),
        *DASHBOARD.rglob("*.svg"),
    ]:
        text = path.read_text()
        assert [
            found
            for found in re.findall(r"(?:https?:)?//[\w.-]+\.\w+[^\s\"']*", text)
            if found not in allowed
        ] == []
        assert "url(" not in text and "@import" not in text, path
        assert text.count("\n") <= 400, path


def test_a_study_page_says_what_is_identified_in_words(client: TestClient, sqlite_database: Database) -> None:
    study_id = piles.a_finished_study(sqlite_database, certified=True)
    text = client.get(f"/studies/{study_id}").text
    for words in (
        "not identified",
        "any value in its range does as well",
        "Identified only as a combination",
        "Test next: Mass on the base",
    ):
        assert words in text, words
    assert "Report on what is known now" not in text, "nothing has changed since"
    assert "/pause" not in text


def test_a_running_study_has_its_controls_and_a_report_on_demand(
    client: TestClient, sqlite_database: Database
) -> None:
    study_id = piles.a_searching_study(sqlite_database)
    text = client.get(f"/studies/{study_id}").text
    for path in ("pause", "cancel", "budget", "designs", "report"):
        assert f'data-post="/v1/studies/{study_id}/{path}"' in text
    client.post(f"/v1/studies/{study_id}/report")
    assert "disabled" in client.get(f"/studies/{study_id}").text
    write_report(sqlite_database, study_id, {"enough": False, "text": "At least three designs are needed."})
    assert "At least three designs are needed." in client.get(f"/studies/{study_id}").text
    client.post(f"/v1/studies/{study_id}/pause")
    assert f'data-post="/v1/studies/{study_id}/resume"' in client.get(f"/studies/{study_id}").text


def test_a_design_page_says_whether_it_was_a_surprise(client: TestClient, sqlite_database: Database) -> None:
    study_id = piles.a_searching_study(sqlite_database)
    piles.finish_running(sqlite_database, study_id, 25.4)
    pages = [client.get(f"/designs/{design.id}").text for design in designs(sqlite_database, study_id)]
    assert any("the 90 % interval" in page for page in pages)
