"""Every command line that the documentation prints is done against a real service, or, where it simulates, read by
the program that it names.

The service runs here over a database that has what the pages talk of: a study with piles, charges, a mesh.
"""

from __future__ import annotations

import importlib
import re
from collections.abc import Callable
from pathlib import Path
from urllib.parse import urlsplit

import click
import httpx
import pytest

from service.cli import cli, main
from service.db.session import Database
from service.domain.search_space import default_values
from service.settings import Settings, get_settings
from tests.builders.charges import charges, finish_charge
from tests.builders.everything import one_of_everything
from tests.builders.mesh_files import binary_stl
from tests.builders.server import Server
from tests.builders.studies import a_study
from tests.documentation.command_lines import ROOT, Documented, documented

COMMANDS = documented()
# They simulate, or stay: read by the program, not run.
LONG = {"calibrate", "charge", "diagnose", "plan", "demo", "serve", "worker"}


def of(program: str, long: bool | None = None) -> list[Documented]:
    """The commands of one program; of talus those that simulate, or the others."""
    return [c for c in COMMANDS if c.words[0] == program and (long is None or (c.words[1] in LONG) is long)]


@pytest.fixture(autouse=True)
def a_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """With the files that the pages name."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "docs").symlink_to(ROOT / "docs")
    (tmp_path / "mine.toml").write_text("[belt]\nspeed_m_s = 1.7\n", encoding="utf-8")
    (tmp_path / "mine.stl").write_bytes(binary_stl())


@pytest.fixture
def installation(
    tmp_path: Path, migrated_sqlite: Path, monkeypatch: pytest.MonkeyPatch
) -> Callable[..., Settings]:
    """Makes a data folder and a service on it, to which the commands of this process talk."""
    started: list[Server] = []

    def make(name: str, fill: Callable[[Database, Settings], None] | None) -> Settings:
        folder = tmp_path / name
        folder.mkdir()
        settings = Settings(data_dir=folder)
        if fill is not None:
            (folder / "talus.db").write_bytes(migrated_sqlite.read_bytes())
            database = Database(settings.resolved_database_url)
            fill(database, settings)
            database.dispose()
            server = Server(settings)
            server.start()
            started.append(server)
            monkeypatch.setenv("TALUS_PORT", str(server.port))
        monkeypatch.setenv("TALUS_DATA_DIR", str(folder))
        get_settings.cache_clear()
        return get_settings()

    yield make  # type: ignore[misc]
    for server in started:
        server.stop()
    get_settings.cache_clear()


def fill(database: Database, settings: Settings) -> None:
    """Study 1 at its end, six charges, a file, a mesh."""
    one_of_everything(database, settings)
    for _ in range(5):
        charges(database)
    for number in range(1, 7):
        finish_charge(database, number, settings)


def running_study(database: Database, settings: Settings) -> None:
    a_study(database)


def test_there_are_commands_of_every_kind() -> None:
    assert len(COMMANDS) > 30
    assert all((of("talus", True), of("talus", False), of("curl"), of("make"), of("python")))


# What `...` stands for, and what has to be there before.
COMPLETED = {"add": [f"{k}={v:g}" for k, v in default_values().items() if k != "rolling_resistance"]}
BEFORE = {"import": ["export", "1", "--out", "folder"], "resume": ["pause", "1"]}
OF_A_RUNNING_STUDY = {"pause", "resume", "cancel", "add", "extend"}


@pytest.mark.parametrize("command", of("talus", long=False), ids=str)
def test_a_talus_command_is_done(
    command: Documented, installation: Callable[..., Settings], capsys: pytest.CaptureFixture[str]
) -> None:
    name = command.words[1]
    settings = installation("data", running_study if name in OF_A_RUNNING_STUDY else fill)
    if name == "restore":
        assert main(["backup", command.words[2]]) == 0
        installation("empty", None)
    if name in BEFORE:
        assert main(BEFORE[name]) == 0
    status = main([*command.words[1:], *COMPLETED.get(name, [])])
    told = capsys.readouterr()
    assert status == 0, told.err
    assert told.out and "Traceback" not in told.err
    assert settings.data_dir.exists()


@pytest.mark.parametrize("command", of("talus", long=True), ids=str)
def test_a_talus_command_that_simulates_is_understood(command: Documented) -> None:
    """By the command's own parser, which raises for names, values and files that it does not know."""
    found = cli.commands[command.words[1]]
    context = found.make_context(command.words[1], list(command.words[2:]))
    assert context.args == [] and all(value is not None for value in given(context).values())


def given(context: click.Context) -> dict[str, object]:
    """The parameters that were written on the command line."""
    written = click.core.ParameterSource.COMMANDLINE
    return {k: v for k, v in context.params.items() if context.get_parameter_source(k) is written}


@pytest.mark.parametrize("command", [c for c in of("curl") if c.words[1] != "-H"], ids=str)
def test_a_request_is_answered_as_the_page_says(
    command: Documented, installation: Callable[..., Settings]
) -> None:
    """A problem where the page shows one, else what was asked for."""
    installation("data", fill)
    response = as_curl(command.words, get_settings().base_url)
    shown = re.search(r'"status":(\d+)', command.answer)
    expected = (
        {int(shown[1])} if shown else {415, 422} if '"Invalid request"' in command.answer else {200, 201}
    )
    assert response.status_code in expected, response.text[:500]
    for key in re.findall(r'[{,]"(\w+)":', command.answer):
        assert f'"{key}"' in response.text


def as_curl(words: tuple[str, ...], base_url: str) -> httpx.Response:
    """The request of a curl command; of an endless answer the first piece."""
    headers, content, address = {}, None, ""
    rest = iter(words[1:])
    for word in rest:
        if word == "-H":
            key, _, value = next(rest).partition(":")
            headers[key] = value.strip()
        elif word in ("-d", "--data-binary"):
            given = next(rest)
            content = Path(given[1:]).read_bytes() if given.startswith("@") else given.encode()
        elif not word.startswith("-"):
            address = word
        else:
            assert word in ("-s", "-sN", "-sOJ"), word
    parts = urlsplit(f"http://{address}")
    assert parts.port == Settings.model_fields["port"].default
    url = f"{base_url}{parts.path}" + (f"?{parts.query}" if parts.query else "")
    with httpx.Client() as client:
        request = client.build_request(
            "POST" if content is not None else "GET", url, headers=headers, content=content
        )
        response = client.send(request, stream=True)
        if response.headers["content-type"].startswith("text/event-stream"):
            assert next(response.iter_text())
            response.close()
        else:
            response.read()
    return response


@pytest.mark.parametrize("command", of("make"), ids=str)
def test_a_make_target_is_there_and_takes_its_variables(command: Documented) -> None:
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    assert re.search(rf"^[a-z -]*\b{command.words[1]}\b[a-z -]*:", makefile, flags=re.M)
    for assignment in command.words[2:]:
        assert f"$({assignment.partition('=')[0]})" in makefile


@pytest.mark.parametrize("command", of("python"), ids=str)
def test_a_module_understands_its_words(command: Documented) -> None:
    """Letters that stand for numbers become one."""
    module, words = command.words[2], [re.sub(r"^(\$?[A-Za-z])$", "4", word) for word in command.words[3:]]
    words = [
        "coke" if before == "charge" else word for before, word in zip(["", *words], words, strict=False)
    ]
    program = importlib.import_module(module)
    if hasattr(program, "__path__"):
        program = importlib.import_module(f"{module}.__main__")
    assert program.parser().parse_args(words)
