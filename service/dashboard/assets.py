"""The pages' own files: style, scripts and plotly, all from this installation.

They stand under a folder named by the hash of all of them, so that a browser may keep them for ever and still
gets new ones after an upgrade. Names are looked up in a table: no path comes from the client.
"""

from __future__ import annotations

import gzip
import hashlib
import re
from dataclasses import dataclass
from functools import lru_cache
from importlib.resources import files
from importlib.resources.abc import Traversable
from importlib.util import find_spec
from pathlib import Path
from typing import Annotated

from fastapi import APIRouter, Header, Response

router = APIRouter(include_in_schema=False)

MEDIA_TYPES = {".css": "text/css", ".js": "text/javascript", ".svg": "image/svg+xml"}
FOR_EVER = "public, max-age=31536000, immutable"
PLOTLY = "plotly.min.js"

# The map half of plotly brings a style element of its own unless one with this id is there (see base.html).
_MAP_STYLE = re.compile(rb'document\.getElementById\("([0-9a-f]{64})"\)')


@dataclass(frozen=True)
class Asset:
    """A file as it is sent."""

    media_type: str
    body: bytes


@lru_cache(maxsize=1)
def sources() -> dict[str, Traversable]:
    """Every file that may be asked for, by name."""
    own = {
        item.name: item for item in files("service.dashboard").joinpath("static").iterdir() if item.is_file()
    }
    # By its path: importing plotly's package would take longer than everything else here together.
    package = find_spec("plotly")
    assert package is not None and package.origin is not None
    return {**own, PLOTLY: Path(package.origin).parent / "package_data" / PLOTLY}


@lru_cache(maxsize=64)
def load(name: str) -> Asset | None:
    """None: there is no such file."""
    source = sources().get(name)
    media_type = MEDIA_TYPES.get("." + name.rpartition(".")[2])
    if source is None or media_type is None:
        return None
    return Asset(media_type + "; charset=utf-8", source.read_bytes())


@lru_cache(maxsize=64)
def compressed(name: str) -> bytes:
    """The file by gzip: plotly shrinks from 4.8 to 1.5 MB."""
    asset = load(name)
    assert asset is not None
    return gzip.compress(asset.body, 6, mtime=0)


@lru_cache(maxsize=1)
def version() -> str:
    """Names the folder; changes when any file does."""
    digest = hashlib.sha256()
    for name in sorted(sources()):
        asset = load(name)
        digest.update(name.encode() + b"\0" + (asset.body if asset else b""))
    return digest.hexdigest()[:12]


@lru_cache(maxsize=1)
def plotly_style_ids() -> tuple[str, ...]:
    """Ids of the style elements that plotly would add although the pages' policy forbids them."""
    asset = load(PLOTLY)
    found = _MAP_STYLE.findall(asset.body) if asset else []
    return tuple(dict.fromkeys(match.decode() for match in found))


def url(name: str) -> str:
    """Where a page finds the file."""
    return f"/static/{version()}/{name}"


@router.get("/static/{folder}/{name}")
def get_asset(folder: str, name: str, accept_encoding: Annotated[str, Header()] = "") -> Response:
    """One file. Under another folder than the present one it is not kept by the browser."""
    asset = load(name)
    if asset is None:
        return Response("There is no such file.\n", 404, media_type="text/plain")
    headers = {
        "Cache-Control": FOR_EVER if folder == version() else "no-cache",
        "Vary": "Accept-Encoding",
        "X-Content-Type-Options": "nosniff",
    }
    if "gzip" in accept_encoding and asset.media_type.startswith("text/"):
        headers["Content-Encoding"] = "gzip"
        return Response(compressed(name), headers=headers, media_type=asset.media_type)
    return Response(asset.body, headers=headers, media_type=asset.media_type)
