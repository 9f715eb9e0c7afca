"""The real thing: `talus serve` on a folder of its own, with its processes, deaths and ends."""

from __future__ import annotations

import json
import os
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import httpx
import pytest

from service import broker
from service.installation_lock import find_running
from service.settings import Settings

ROOT = Path(__file__).resolve().parents[2]
START_SECONDS = 180.0
# The kernels are compiled at a worker's first start, and every core may be busy.
WORKER_SECONDS = 240.0


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def wait_until(is_so: Callable[[], bool], seconds: float, what: str) -> None:
    deadline = time.monotonic() + seconds
    while not is_so():
        assert time.monotonic() < deadline, f"{what} did not come within {seconds:g} s"
        time.sleep(0.05)


class Served:
    """A `talus serve` under test."""

    def __init__(self, settings: Settings) -> None:
        self.settings = settings
        self.process: subprocess.Popen[str] | None = None

    @property
    def url(self) -> str:
        return self.settings.base_url

    def start(self) -> subprocess.Popen[str]:
        shared = {name: value for name, value in os.environ.items() if not name.startswith("TALUS_")}
        own = {
            "TALUS_DATA_DIR": str(self.settings.data_dir),
            "TALUS_PORT": str(self.settings.port),
            "TALUS_WORKERS": str(self.settings.workers),
        }
        return subprocess.Popen(
            [sys.executable, "-m", "service.cli", "serve"],
            cwd=ROOT,
            env={**shared, **own},
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )

    def start_and_wait(self) -> None:
        self.process = self.start()
        wait_until(self.is_live, START_SECONDS, "the API")

    def is_live(self) -> bool:
        assert self.process is not None
        if self.process.poll() is not None:
            pytest.fail(f"talus serve ended: {self.process.stdout.read() if self.process.stdout else ''}")
        try:
            return httpx.get(f"{self.url}/v1/health/live", timeout=2).is_success
        except httpx.TransportError:
            return False

    def check(self, name: str) -> bool:
        checks = httpx.get(f"{self.url}/v1/health/ready", timeout=5).json()["checks"]
        return bool(checks[name]["ok"])

    def children(self) -> dict[int, str]:
        """The direct children: pid and command line."""
        assert self.process is not None
        found = {}
        for stat in Path("/proc").glob("[0-9]*/stat"):
            try:
                fields = stat.read_text().rpartition(")")[2].split()
                words = stat.with_name("cmdline").read_text().split("\0")
            except (FileNotFoundError, ProcessLookupError):
                continue  # it ended between the two looks
            if int(fields[1]) == self.process.pid and fields[0] != "Z":
                found[int(stat.parent.name)] = " ".join(words)
        return found

    def pid_of(self, word: str) -> int | None:
        return next((pid for pid, command in self.children().items() if word in command), None)

    def end(self, number: signal.Signals = signal.SIGTERM) -> tuple[float, str]:
        """Seconds until everything ended, and what was said."""
        assert self.process is not None
        started = time.monotonic()
        self.process.send_signal(number)
        text, _ = self.process.communicate(timeout=30)
        return time.monotonic() - started, text


@pytest.fixture
def served(tmp_path: Path, request: pytest.FixtureRequest) -> Iterator[Served]:
    """Started with as many workers as the test's parameter says (default none), and ended with the test."""
    with running(tmp_path, getattr(request, "param", 0)) as one:
        yield one


@pytest.fixture(scope="module")
def lasting(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    """One for all tests that leave it as they found it, because a start is what they would mostly wait for."""
    with running(tmp_path_factory.mktemp("lasting"), 0) as one:
        yield one


@contextmanager
def running(folder: Path, workers: int) -> Iterator[Served]:
    one = Served(Settings(data_dir=folder / "data", port=free_port(), workers=workers))
    try:
        one.start_and_wait()
        yield one
    finally:
        # Also where it never came: nothing may go on running after its test.
        if one.process is not None and one.process.poll() is None:
            one.end()


def is_gone(pid: int) -> bool:
    stat = Path(f"/proc/{pid}/stat")
    return not stat.exists() or stat.read_text().rpartition(")")[2].split()[0] == "Z"


def study(served: Served) -> int:
    answer = httpx.post(f"{served.url}/v1/studies", json={"material": "pellet", "scale": 4.0, "budget": 2})
    assert answer.status_code == 201, answer.text
    return int(answer.json()["id"])


def test_it_starts_everything_and_ends_it(served: Served) -> None:
    children = served.children()
    assert len(children) == 3
    assert served.pid_of("valkey-server")
    assert served.pid_of("uvicorn")
    assert served.pid_of("service.dispatcher")
    running = find_running(served.settings)
    assert running is not None
    assert served.process is not None
    assert (running.pid, running.url) == (served.process.pid, served.url)
    seconds, text = served.end()
    assert served.process.returncode == 0, text
    assert seconds < 10
    assert f"Talus is ready at {served.url}" in text
    assert [pid for pid in children if not is_gone(pid)] == []
    assert find_running(served.settings) is None


def test_sigterm_with_an_open_event_stream_ends_within_10_s(served: Served) -> None:
    number = study(served)
    first = threading.Event()

    def listen() -> None:
        try:
            with httpx.stream("GET", f"{served.url}/v1/studies/{number}/events", timeout=60) as answer:
                for _ in answer.iter_lines():
                    first.set()
        except httpx.TransportError:
            return

    listener = threading.Thread(target=listen)
    listener.start()
    assert first.wait(10)
    seconds, text = served.end()
    listener.join(5)
    assert not listener.is_alive()
    assert seconds < 10, text
    assert served.process is not None
    assert served.process.returncode == 0


@pytest.mark.parametrize("word", ["valkey-server", "service.dispatcher", "uvicorn"])
def test_what_dies_comes_back(lasting: Served, word: str) -> None:
    before = lasting.pid_of(word)
    assert before is not None
    os.kill(before, signal.SIGKILL)
    wait_until(lambda: lasting.pid_of(word) not in (None, before), 10, f"a new {word}")
    wait_until(lasting.is_live, 30, "the API")
    wait_until(lambda: broker.is_up(lasting.settings.resolved_broker_url), 10, "the broker")


@pytest.mark.parametrize("served", [1], indirect=True)
def test_a_killed_worker_comes_back_and_its_child_ends_with_it(served: Served) -> None:
    wait_until(lambda: served.check("workers"), WORKER_SECONDS, "a worker")
    before = served.pid_of("worker.app")
    assert before is not None
    pool = Path(f"/proc/{before}/task/{before}/children").read_text().split()
    assert pool
    os.kill(before, signal.SIGKILL)
    wait_until(lambda: served.pid_of("worker.app") not in (None, before), 10, "a new worker")
    wait_until(lambda: all(is_gone(int(pid)) for pid in pool), 5, "the end of the old one's child")


def test_a_killed_supervisor_leaves_nothing_behind(served: Served) -> None:
    children = served.children()
    assert served.process is not None
    served.process.kill()
    served.process.wait()
    wait_until(lambda: all(is_gone(pid) for pid in children), 10, "the end of its processes")
    served.start_and_wait()


def test_two_supervisors_do_not_share_a_folder(lasting: Served) -> None:
    other = Served(lasting.settings.model_copy(update={"port": free_port()})).start()
    text, _ = other.communicate(timeout=30)
    assert other.returncode == 2
    assert text.count("\n") == 1
    assert f"is in use by process {lasting.process.pid if lasting.process else None} at {lasting.url}" in text
    assert lasting.is_live()


def test_a_taken_port_is_one_line_and_status_2(tmp_path: Path) -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = int(taken.getsockname()[1])
        one = Served(Settings(data_dir=tmp_path / "data", port=port, workers=0)).start()
        text, _ = one.communicate(timeout=30)
    assert one.returncode == 2
    assert text == f"talus: port {port} on 127.0.0.1 is in use; choose another with TALUS_PORT\n"


def test_what_was_accepted_is_there_after_a_restart(served: Served) -> None:
    number = study(served)
    served.end()
    served.start_and_wait()
    assert httpx.get(f"{served.url}/v1/studies/{number}").json()["state"] == "running"


@pytest.mark.slow
@pytest.mark.parametrize("served", [1], indirect=True)
@pytest.mark.timeout(900)
def test_the_demo_uses_the_running_service_and_writes_its_summary(served: Served) -> None:
    environment = {
        **os.environ,
        "TALUS_DATA_DIR": str(served.settings.data_dir),
        "TALUS_PORT": str(served.settings.port),
    }
    command = [sys.executable, "-m", "service.cli", "demo", "--scale", "4", "--budget", "3"]
    done = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert "Table 5" in done.stdout
    summary = json.loads((served.settings.data_dir / "demo.json").read_text())
    assert sum(summary["simulations"].values()) == 3
    assert summary["stop_reason"] == "budget"
    assert served.is_live()
