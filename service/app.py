"""The web application: routers, error answers and limits around one database."""

from __future__ import annotations

import gc
import json
import sys
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import Any

from fastapi import FastAPI, Request, Response
from fastapi.openapi.utils import get_openapi

from service.api import (
    charge_comparison,
    charges,
    controls,
    designs,
    diagnoses,
    effects,
    estimates,
    events,
    exports,
    geometries,
    health,
    jobs,
    keys,
    materials,
    metrics,
    reports,
    studies,
)
from service.api.allowed_methods import AllowedMethods
from service.api.authentication import Gate
from service.api.body_limit import BodyLimit
from service.api.problems import ProblemBody, http_error, install_handlers
from service.api.safe_headers import SafeHeaders
from service.dashboard import (
    analysis_page,
    assets,
    compare_page,
    diagnosis_page,
    geometry_page,
    health_page,
    login,
    pages,
    report_page,
    scene_routes,
    start_page,
)
from service.dashboard.compressed_pages import CompressedPages
from service.dashboard.rendering import is_for_a_person, unknown_address
from service.db.session import Database
from service.logs import configure_logs
from service.settings import Settings, get_settings

VERSION = exports.TALUS_VERSION
# In the order in which their routes are tried and documented.
MODULES = (
    materials,
    exports,
    estimates,
    studies,
    controls,
    reports,
    events,
    designs,
    charge_comparison,
    charges,
    diagnoses,
    effects,
    geometries,
    jobs,
    keys,
    health,
    metrics,
)
DESCRIPTION = """Calibrates the contact parameters of granular materials: asks a DEM pile test for the repose
angle of a parameter set, learns, proposes the next one, and ends with a certified optimum.

Every error is problem+json (RFC 9457). Numbers are SI unless their name says otherwise (`angle_deg`)."""


def create_app(settings: Settings | None = None) -> FastAPI:
    """The application for `settings` (default: the process's). It connects when first asked."""
    settings = settings or get_settings()
    configure_logs(settings.log_level)
    database = Database(settings.resolved_database_url)

    @asynccontextmanager
    async def lifespan(_app: FastAPI) -> AsyncIterator[None]:
        _spare_imports()
        yield
        database.dispose()

    app = FastAPI(
        title="Talus",
        version=VERSION,
        description=DESCRIPTION,
        lifespan=lifespan,
        docs_url=None,
        redoc_url=None,
    )
    app.state.settings = settings
    app.state.database = database
    for module in MODULES:
        app.include_router(module.router)
    app.include_router(login.router)
    app.include_router(pages.router)
    app.include_router(analysis_page.router)
    app.include_router(start_page.router)
    app.include_router(diagnosis_page.router)
    app.include_router(geometry_page.router)
    app.include_router(geometry_page.scene_router)
    app.include_router(health_page.router)
    app.include_router(report_page.router)
    app.include_router(scene_routes.router)
    app.include_router(compare_page.router)
    app.include_router(assets.router)
    install_handlers(app)
    app.add_exception_handler(404, _nowhere)
    large = (exports.IMPORT_PATH, diagnoses.MEASUREMENTS_PATH, geometries.GEOMETRIES_PATH)
    by_path = dict.fromkeys(large, settings.max_import_bytes)
    app.add_middleware(AllowedMethods, document=lambda: _document(app))
    app.add_middleware(CompressedPages)
    app.add_middleware(BodyLimit, max_bytes=settings.max_body_bytes, by_path=by_path)
    # The last one added is the outermost: a body is read of nobody who may not send it, and refusals have the
    # same headers as answers.
    app.add_middleware(Gate, database=database, asks_for_keys=settings.asks_for_keys)
    app.add_middleware(SafeHeaders)
    app.openapi = lambda: _document(app)  # type: ignore[method-assign]
    return app


def _nowhere(request: Request, error: Exception) -> Response:
    """An address without a route: a page for a person, a problem for a program."""
    return unknown_address(request) if is_for_a_person(request) else http_error(request, error)


def _spare_imports() -> None:
    """What the imports left lives as long as the process: looking through it for garbage holds every request up, a
    hundredth of them by 100 ms."""
    if not gc.get_freeze_count():
        gc.collect()
        gc.freeze()


def _document(app: FastAPI) -> dict[str, Any]:
    """OpenAPI with the one error schema, which the routes only refer to."""
    if app.openapi_schema is None:
        document = get_openapi(
            title=app.title, version=app.version, description=app.description, routes=app.routes
        )
        schema = ProblemBody.model_json_schema(ref_template="#/components/schemas/{model}")
        schemas = document["components"]["schemas"]
        schemas.update(schema.pop("$defs", {}))
        schemas["ProblemBody"] = schema
        document["components"]["securitySchemes"] = {
            "key": {
                "type": "http",
                "scheme": "bearer",
                "description": "a key of the API: `talus keys create`",
            }
        }
        document["security"] = [{"key": []}, {}]
        app.openapi_schema = document
    return app.openapi_schema


def document_text(app: FastAPI) -> str:
    """The OpenAPI document as it is committed."""
    return json.dumps(app.openapi(), indent=1, sort_keys=True, ensure_ascii=False) + "\n"


if __name__ == "__main__":
    # `python -m service.app > docs/openapi.json` renews the committed document.
    sys.stdout.write(document_text(create_app()))
