"""The pages' own files: kept for ever under a name that changes with them, small on the way."""

from __future__ import annotations

import gzip
import re

import pytest
from fastapi.testclient import TestClient

from service.dashboard import assets


@pytest.mark.parametrize("name", ["talus.css", "page.js", "talus.svg", "plotly.min.js"])
def test_an_asset_is_kept_for_ever_under_the_present_version(name: str, client: TestClient) -> None:
    response = client.get(assets.url(name))
    assert response.status_code == 200
    assert "immutable" in response.headers["cache-control"]
    assert client.get(f"/static/older/{name}").headers["cache-control"] == "no-cache"


def test_plotly_comes_compressed_from_its_wheel(client: TestClient) -> None:
    with client.stream("GET", assets.url("plotly.min.js"), headers={"Accept-Encoding": "gzip"}) as response:
        body = b"".join(response.iter_raw())
    assert len(body) < 2_000_000
    assert gzip.decompress(body).lstrip().startswith(b"/**\n* plotly.js")
    plain = client.get(assets.url("plotly.min.js"), headers={"Accept-Encoding": "identity"})
    assert "content-encoding" not in plain.headers
    assert plain.content == gzip.decompress(body)


@pytest.mark.parametrize("name", ["nothing.js", "..%2fpages.py", "pages.py", "%2e%2e%2f%2e%2e%2fapp.py"])
def test_other_files_are_not_served(name: str, client: TestClient) -> None:
    assert client.get(f"/static/{assets.version()}/{name}").status_code == 404


def test_pages_carry_the_marks_that_keep_plotly_from_adding_styles(client: TestClient) -> None:
    ids = assets.plotly_style_ids()
    assert ids, "plotly no longer looks for an element before it adds a style: look at base.html"
    text = client.get("/").text
    assert all(f'<meta id="{one}">' in text for one in ids)
    assert '<meta id="plotly.js-style-global" class="no-inline-styles">' in text


def test_every_module_that_a_script_imports_is_there() -> None:
    for name in assets.sources():
        if name.endswith(".js") and name != assets.PLOTLY:
            source = assets.load(name)
            assert source is not None
            for imported in re.findall(r'from "\./([\w.]+)"', source.body.decode()):
                assert assets.load(imported) is not None, (name, imported)
