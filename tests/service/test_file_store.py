"""Files in a folder, in memory and in a store that speaks S3: the same promises from each."""

from __future__ import annotations

import uuid
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import httpx
import pytest
from fastapi.testclient import TestClient
from s3fs import S3FileSystem
from sqlalchemy import select

from service.app import create_app
from service.backup import make_backup, restore_backup
from service.db.models import DesignRow
from service.db.session import Database
from service.file_store import (
    ASIDE,
    FileStore,
    ObjectStore,
    StoreAway,
    _connected,
    artifact_store,
    geometry_store,
)
from service.retention import COPY, Rule, find_removable, remove
from service.settings import Settings, StartupError
from service.studies.keep_files import keep_files
from tests.builders.mesh_files import binary_stl
from tests.builders.object_store import an_s3_server
from tests.builders.studies import a_finished_study
from worker.evaluate import store_file

NAME = "ab/abcdef"
BOX = binary_stl()
MESH = {"Content-Type": "application/octet-stream"}


@contextmanager
def forgotten_clients() -> Iterator[None]:
    """Clients are kept by address of the store; another endpoint needs new ones, and so does what comes after."""
    _connected.cache_clear()
    S3FileSystem.clear_instance_cache()
    try:
        yield
    finally:
        _connected.cache_clear()
        S3FileSystem.clear_instance_cache()


@pytest.fixture(scope="module")
def s3() -> Iterator[str]:
    with an_s3_server() as url:
        yield url
    _connected.cache_clear()


@pytest.fixture(params=["folder", "memory", "s3"])
def settings(request: pytest.FixtureRequest, tmp_path: Path, sqlite_database: Database) -> Settings:
    """An installation of its own; an object store's files lie below a name that no other test has."""
    below = uuid.uuid4().hex
    url = {"folder": None, "memory": f"memory://{below}"}.get(request.param, "s3")
    if url == "s3":
        url = f"{request.getfixturevalue('s3')}/{below}"
    return Settings(data_dir=tmp_path / "here", store_url=url, database_url=sqlite_database.url)


@pytest.fixture
def store(settings: Settings) -> FileStore:
    return artifact_store(settings)


def put(store: FileStore, name: str, content: bytes) -> None:
    with store.incoming() as folder:
        file = folder / "file"
        file.write_bytes(content)
        store.put(file, name)
        assert not file.exists(), "it was moved"


def other_machine(settings: Settings) -> Settings:
    """The same installation, seen from a machine with a disk of its own."""
    return settings.model_copy(update={"data_dir": settings.data_dir.parent / "there"})


def test_what_is_put_is_there_whole_under_its_name(store: FileStore) -> None:
    put(store, NAME, b"12345")
    put(store, NAME, b"12345")
    assert store.size(NAME) == 5
    assert store.local(NAME).read_bytes() == b"12345"
    with store.open(NAME) as stream:
        assert stream.read() == b"12345"
    (file,) = store.files()
    assert (file.name, file.size_bytes) == (NAME, 5)
    assert NAME in store.place(NAME)


def test_an_empty_store_and_a_file_that_is_not_there(store: FileStore) -> None:
    assert list(store.files()) == []
    assert store.size(NAME) is None
    assert not store.local(NAME).exists()
    with pytest.raises(FileNotFoundError):
        store.open(NAME)
    store.remove(NAME)


def test_what_is_removed_is_gone_and_its_copy_with_it(store: FileStore) -> None:
    put(store, NAME, b"12345")
    put(store, "ab/other", b"1")
    copy = store.local(NAME)
    store.remove(NAME)
    assert [file.name for file in store.files()] == ["ab/other"]
    assert not copy.exists() and not store.local(NAME).exists()


def test_what_is_being_written_has_no_name_yet_and_leaves_nothing(store: FileStore) -> None:
    with store.incoming() as folder:
        (folder / "half").write_bytes(b"1")
        assert store.size("half") is None
    assert not folder.exists()
    assert list(store.files()) == []


def test_another_machine_reads_what_this_one_stored(settings: Settings) -> None:
    put(artifact_store(settings), NAME, b"12345")
    there = artifact_store(other_machine(settings))
    if settings.store_url is None:
        assert there.size(NAME) is None, "folders are shared by the file system, not by us"
        return
    assert there.local(NAME).read_bytes() == b"12345"
    assert there.local(NAME).is_relative_to(other_machine(settings).data_dir)
    put(artifact_store(settings), "cd/later", b"1")
    assert [file.name for file in there.files()] == [NAME, "cd/later"], "no listing is kept"


def a_design_with_a_file(database: Database, settings: Settings) -> bytes:
    content = b"particles " * 1000
    study_id = a_finished_study(database)
    store = artifact_store(settings)
    with store.incoming() as folder:
        file = folder / "result.vtkhdf"
        file.write_bytes(content)
        stored = store_file(file, "vtkhdf", "application/x-hdf5", store)
    with database.writing() as session:
        design = session.scalars(select(DesignRow).where(DesignRow.study_id == study_id)).first()
        assert design is not None
        keep_files(session, [stored], design_id=design.id)
    return content


def upload(client: TestClient, content: bytes = BOX) -> httpx.Response:
    return client.post("/v1/geometries", params={"file_name": "box.stl"}, content=content, headers=MESH)


def test_the_api_sends_files_and_ranges_and_takes_meshes(
    settings: Settings, sqlite_database: Database
) -> None:
    content = a_design_with_a_file(sqlite_database, settings)
    with TestClient(create_app(other_machine(settings) if settings.store_url else settings)) as client:
        assert client.get("/v1/artifacts/1").content == content
        part = client.get("/v1/artifacts/1", headers={"Range": "bytes=10-19"})
        assert (part.status_code, part.content) == (206, b"particles ")
        sent = client.post(
            "/v1/geometries", params={"file_name": "box.stl"}, content=binary_stl(), headers=MESH
        )
        assert sent.status_code == 201, sent.text
        assert (
            client.post(
                "/v1/geometries", params={"file_name": "x.stl"}, content=b"no", headers=MESH
            ).status_code
            == 422
        )
    (mesh,) = geometry_store(settings if settings.store_url is None else other_machine(settings)).files()
    assert mesh.name == f"{sent.json()['sha256']}.stl"


def test_a_backup_goes_from_any_store_into_any_other(
    settings: Settings, sqlite_database: Database, tmp_path: Path
) -> None:
    content = a_design_with_a_file(sqlite_database, settings)
    summary = make_backup(settings, tmp_path / "all.tar")
    assert (summary.files, summary.missing) == (1, 0)
    other = None if settings.store_url else f"memory://{uuid.uuid4().hex}"
    new = Settings(data_dir=tmp_path / "new", store_url=other)
    restore_backup(new, tmp_path / "all.tar")
    (file,) = artifact_store(new).files()
    assert artifact_store(new).local(file.name).read_bytes() == content


def test_retention_frees_what_no_row_names_and_copies(
    settings: Settings, sqlite_database: Database, monkeypatch: pytest.MonkeyPatch
) -> None:
    content = a_design_with_a_file(sqlite_database, settings)
    store = artifact_store(settings)
    put(store, NAME, b"12345")
    (kept,) = (file.name for file in store.files() if file.name != NAME)
    store.local(kept)
    assert find_removable(sqlite_database, settings, Rule(90.0)) == [], "all of it is fresh"
    monkeypatch.setattr("service.retention.time.time", lambda: 4e9)
    found = find_removable(sqlite_database, settings, Rule(90.0))
    reasons = {item.place: item.reason for item in found}
    wanted = {store.place(NAME): "no row names it"}
    if isinstance(store, ObjectStore):
        half = store.copies / f"{ASIDE}killed" / "half"
        half.parent.mkdir()
        half.write_bytes(b"1")
        # From before there was a store: it is nowhere else.
        (store.copies / "only-here").write_bytes(b"1")
        wanted[str(store.copies / kept)] = wanted[str(half)] = COPY
        found = find_removable(sqlite_database, settings, Rule(90.0))
        reasons = {item.place: item.reason for item in found}
    assert reasons == wanted
    remove(found)
    assert store.local(kept).read_bytes() == content, "a copy comes again"
    assert store.size(NAME) is None


def test_a_store_that_is_away_is_503_and_says_nothing_was_stored(
    sqlite_database: Database, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, s3: str
) -> None:
    """First the row is there and the store answers; then nobody listens at its address."""
    settings = Settings(data_dir=tmp_path, store_url=f"{s3}/away", database_url=sqlite_database.url)
    a_design_with_a_file(sqlite_database, settings)
    monkeypatch.setenv("AWS_ENDPOINT_URL", "http://127.0.0.1:9")
    monkeypatch.setenv("AWS_MAX_ATTEMPTS", "1")
    monkeypatch.setattr("s3fs.core.S3FileSystem.retries", 1)
    with forgotten_clients():
        with pytest.raises(StoreAway, match="cannot be used"):
            put(artifact_store(settings), NAME, b"1")
        with TestClient(create_app(settings)) as client:
            for answer in (client.get("/v1/artifacts/1"), upload(client)):
                assert answer.status_code == 503, answer.text
                assert answer.headers["Retry-After"] == "5"
                assert "nothing was stored" in answer.json()["detail"]


def test_a_bucket_that_is_not_there_is_a_store_that_is_away(tmp_path: Path, s3: str) -> None:
    store = artifact_store(Settings(data_dir=tmp_path, store_url="s3://no-such-bucket/plant"))
    with pytest.raises(StoreAway, match="no-such-bucket/plant/artifacts/ab/abcdef cannot be put"):
        put(store, NAME, b"1")
    assert not S3FileSystem().exists("no-such-bucket"), "a misspelt bucket is not made"


@pytest.mark.parametrize(
    ("url", "sentence"),
    [("gs://bucket/folder", "a package that is not installed"), ("nonsense://x", "nonsense")],
)
def test_a_store_without_its_package_is_said_at_the_start(tmp_path: Path, url: str, sentence: str) -> None:
    with pytest.raises(StartupError, match=sentence):
        artifact_store(Settings(data_dir=tmp_path, store_url=url))


def test_a_store_is_an_address() -> None:
    with pytest.raises(ValueError, match="store_url"):
        Settings(store_url="bucket/folder")
