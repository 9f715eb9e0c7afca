"""What routes get from the application, and the parameters that several of them share."""

from __future__ import annotations

from typing import Annotated

from fastapi import Depends, Path, Query, Request

from service.db.session import Database
from service.domain.access import Principal
from service.file_store import FileStore, artifact_store, geometry_store
from service.settings import Settings

# What both databases can store as a row's id.
LARGEST_ID = 2**63 - 1


def get_database(request: Request) -> Database:
    """The application's database, as whoever asks may see it."""
    database = request.app.state.database
    assert isinstance(database, Database)
    principal = request.state.principal
    assert isinstance(principal, Principal)
    return database.within(principal.project)


def get_settings_of_app(request: Request) -> Settings:
    """The settings that the application was made with."""
    settings = request.app.state.settings
    assert isinstance(settings, Settings)
    return settings


def get_artifacts(request: Request) -> FileStore:
    """Where the application's artifacts lie."""
    return artifact_store(get_settings_of_app(request))


def get_geometries(request: Request) -> FileStore:
    """Where the application's uploaded meshes lie."""
    return geometry_store(get_settings_of_app(request))


DatabaseDep = Annotated[Database, Depends(get_database)]
SettingsDep = Annotated[Settings, Depends(get_settings_of_app)]
ArtifactsDep = Annotated[FileStore, Depends(get_artifacts)]
GeometriesDep = Annotated[FileStore, Depends(get_geometries)]
RowId = Annotated[int, Path(ge=1, le=LARGEST_ID)]
Limit = Annotated[int, Query(ge=1, le=200, description="rows a page")]
IdCursor = Annotated[int | None, Query(ge=0, le=LARGEST_ID, description="`next_cursor` of the page before")]
