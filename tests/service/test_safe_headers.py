"""Every answer of every route, asked of the application itself: no page can be forgotten, nor an error."""

from __future__ import annotations

import re
from collections.abc import Mapping

import pytest
from fastapi import FastAPI
from fastapi.testclient import TestClient

from service.app import create_app
from service.dashboard.rendering import POLICY
from service.db.session import Database
from service.domain.access import Scope
from service.settings import Settings
from service.studies.log_in import COOKIE
from service.studies.manage_keys import create_key
from tests.builders.everything import one_of_everything, paths_of

# It ends with the study's last report, which these tests ask for anew; its refusals are tried.
STREAM = "/v1/studies/{study_id}/events"
NEVER = ("unsafe-eval", "*", "http:", "https:", "ws:")


def policy_of(headers: Mapping[str, str]) -> dict[str, str]:
    parts = (part.strip().partition(" ") for part in headers["content-security-policy"].split(";"))
    return {name: value for name, _, value in parts}


def check(address: str, headers: Mapping[str, str]) -> None:
    """What no answer may lack, and what a page may do at most."""
    policy = policy_of(headers)
    assert policy["default-src"] == "'none'", address
    scripts = policy.get("script-src", "'none'")
    assert scripts in ("'self'", "'none'"), address
    assert not [word for value in policy.values() for word in value.split() if word in NEVER], address
    if headers["content-type"].startswith("text/html") and "sandbox" not in policy:
        assert scripts == "'self'" and policy["frame-ancestors"] == policy["base-uri"] == "'none'", address
        assert "unsafe-inline" not in headers["content-security-policy"], address
        assert "camera=()" in headers["permissions-policy"], address
    assert headers["x-content-type-options"] == "nosniff", address
    assert headers["x-frame-options"] == "DENY", address
    assert headers["referrer-policy"] == "same-origin", address
    assert headers["cross-origin-opener-policy"] == "same-origin", address
    assert "server" not in headers and "x-powered-by" not in headers, address
    if not address.startswith("/static/"):
        assert headers["cache-control"] == "no-store", address
    if headers["content-type"].startswith("application/problem+json"):
        assert policy.get("script-src") is None, address


def test_every_answer_of_every_route_has_them(
    client: TestClient, sqlite_database: Database, settings: Settings
) -> None:
    rows = one_of_everything(sqlite_database, settings)
    assert isinstance(client.app, FastAPI)
    paths, pages = paths_of(client.app), 0
    for path, methods in paths.items():
        found = re.sub(r"\{(\w+)\}", lambda name: rows.get(name[1], "1"), path)
        missing = re.sub(r"\{(\w+)\}", "999999", path)
        addresses = {missing} if path == STREAM else {found, missing}
        for address, method in ((a, m) for a in sorted(addresses) for m in sorted({*methods, "PUT"})):
            answer = client.request(method, address, follow_redirects=False)
            if answer.status_code != 204:
                check(f"{method} {address} ({answer.status_code})", {"content-type": "", **answer.headers})
            pages += answer.headers.get("content-type", "").startswith("text/html")
    assert len(paths) > 60
    assert pages >= 20


def test_refusals_and_errors_have_them(settings: Settings, sqlite_database: Database) -> None:
    app = create_app(settings.model_copy(update={"auth": "on"}))

    @app.get("/breaks")
    def breaks() -> None:
        raise RuntimeError("a mistake of ours")

    with sqlite_database.writing() as session:
        key = create_key(session, "me", Scope.ADMIN, "default")[1].text
    admin = {"Authorization": f"Bearer {key}"}
    with TestClient(app, raise_server_exceptions=False, follow_redirects=False) as client:
        for status, headers, address in (
            (303, {}, "/studies/1"),
            (401, {}, "/v1/studies"),
            (403, {"Origin": "https://evil.example"}, "/v1/studies"),
            (404, admin, "/nowhere"),
            (500, admin, "/breaks"),
        ):
            method = "POST" if status == 403 else "GET"
            answer = client.request(method, address, headers=headers)
            assert answer.status_code == status, address
            check(address, {"content-type": "", **answer.headers})


def test_the_pages_policy_lets_nothing_from_outside_in() -> None:
    policy = policy_of({"content-security-policy": POLICY})
    assert set(policy.values()) <= {"'none'", "'self'", "'self' data: blob:"}
    assert policy["img-src"] == "'self' data: blob:"


@pytest.mark.parametrize("scheme", ["http", "https"])
def test_the_one_cookie_has_its_flags_and_goes_with_them(
    settings: Settings, sqlite_database: Database, scheme: str
) -> None:
    with sqlite_database.writing() as session:
        key = create_key(session, "me", Scope.READ, "default")[1].text
    app = create_app(settings.model_copy(update={"auth": "on"}))
    with TestClient(app, base_url=f"{scheme}://talus.example", follow_redirects=False) as client:
        opened = client.post("/login", data={"key": key}).headers.get_list("set-cookie")
        closed = client.post("/logout").headers.get_list("set-cookie")
    for cookie in (*opened, *closed):
        flags = {part.strip().lower() for part in cookie.split(";")[1:]}
        assert cookie.startswith(COOKIE + "=")
        assert {"httponly", "samesite=strict", "path=/"} <= flags
        assert not any(flag.startswith("domain=") for flag in flags)
    assert (len(opened), len(closed)) == (1, 1)
    assert ("secure" in opened[0].lower()) == (scheme == "https")
    assert "max-age=0" in closed[0].lower()
