"""`talus demo`: one calibration from the outside, over HTTP alone, shown live and set beside the paper.

It uses the service that runs on the data folder, or starts one for as long as the study takes.
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.live import Live

from service.child_process import last_line
from service.client.rest import Client, ServiceAwayError
from service.client.study_view import StudyView
from service.client.tables import LiveTable, closing_table, plain_line
from service.installation_lock import find_running
from service.settings import Settings, StartupError

START_SECONDS = 120.0
STOP_SECONDS = 12.0
NEEDED_CHECKS = ("database", "schema", "dispatcher", "workers")


@dataclass(frozen=True)
class DemoOptions:
    """What to calibrate. None: the service's default. `extra` goes into the study's request as it is."""

    material: str = "pellet"
    scale: float | None = None
    budget: int | None = None
    seed: int | None = None
    keep_serving: bool = False

    def body(self) -> dict[str, Any]:
        """The request for POST /v1/studies."""
        asked = {"scale": self.scale, "budget": self.budget, "seed": self.seed}
        return {
            "material": self.material,
            **{name: value for name, value in asked.items() if value is not None},
        }


def run_demo(settings: Settings, options: DemoOptions, console: Console) -> int:
    """The exit status. Raises StartupError, RefusedError or ServiceAwayError with a sentence for the user."""
    with running_service(settings, console) as url, Client(url) as client:
        started = time.monotonic()
        study = client.create_study(options.body())
        page = f"{url}/studies/{study['id']}"
        console.print(f"Study {study['id']} is at {page}", highlight=False)
        try:
            follow(client, study, console)
        except KeyboardInterrupt:
            client.cancel_study(study["id"])
            console.print("The study is cancelled.")
            raise
        study = client.study(study["id"])
        outcome = summarise(study, (time.monotonic() - started) / 60.0)
        file = settings.data_dir / "demo.json"
        file.write_text(json.dumps(outcome, indent=2) + "\n", encoding="utf-8")
        tell(outcome, study, console)
        console.print(
            f"Page:  {page} (while the service runs: `make serve`)", highlight=False, soft_wrap=True
        )
        console.print(f"Files: {settings.artifacts_dir}, summary {file}", highlight=False, soft_wrap=True)
        if options.keep_serving:
            console.print("The service goes on; Ctrl-C ends it.")
            wait_for_interrupt()
    return 0 if study["state"] in ("completed", "cancelled") else 1


def follow(client: Client, study: Mapping[str, Any], console: Console) -> None:
    """Shows the study until it is over: a live table in a terminal, a line per finished design elsewhere."""
    view = StudyView.of(study, time.monotonic())
    spec = study["spec"]
    lower, upper = spec["objective"]["window_deg"]
    title = (
        f"{spec['material']} at scale {spec['scale']:g}, repose angle {view.target_deg:g}° "
        f"({lower:g} to {upper:g}), seed {spec['seed']}"
    )
    if not console.is_terminal:
        console.print(title, highlight=False)
        for event in client.events(study["id"]):
            line = view.fold(event)
            if line is not None and line.is_over and event.kind != "progress":
                console.print(plain_line(view, line, time.monotonic()), highlight=False, soft_wrap=True)
        return
    with Live(LiveTable(view, title), console=console, refresh_per_second=2, vertical_overflow="crop"):
        for event in client.events(study["id"]):
            view.fold(event)


def summarise(study: Mapping[str, Any], minutes: float) -> dict[str, Any]:
    """What demo.json holds."""
    spec, found, stop = study["spec"], study["recommendation"] or {}, study["stop"] or {}
    return {
        "material": spec["material"],
        "scale": spec["scale"],
        "target_deg": spec["objective"]["target_deg"],
        "window_deg": spec["objective"]["window_deg"],
        "optimum": found.get("x", {}),
        "angle_deg": found.get("mean_deg"),
        "repeats_deg": list(found.get("replicates_deg", [])),
        "certified": bool(found.get("certified", False)),
        "stop_reason": stop.get("reason"),
        "simulations": dict(study["counters"]),
        "minutes": round(minutes, 2),
    }


def tell(outcome: Mapping[str, Any], study: Mapping[str, Any], console: Console) -> None:
    """The end of the study in words and figures."""
    console.print()
    if outcome["optimum"]:
        console.print(closing_table(outcome["material"], outcome))
        certified = "certified" if outcome["certified"] else "not certified"
        console.print(f"Repose angle {outcome['angle_deg']:.2f}°, {certified}.", highlight=False)
    else:
        console.print("No simulation gave a repose angle, so there is no optimum.")
    reason = (study["stop"] or {}).get("text") or outcome["stop_reason"] or study["state"]
    console.print(f"Ended after {outcome['minutes']:.1f} minutes: {reason}", highlight=False, soft_wrap=True)


@contextmanager
def running_service(settings: Settings, console: Console) -> Iterator[str]:
    """The URL of a service on the data folder: the one that runs, or one that ends with this block."""
    found = find_running(settings)
    if found is not None:
        wait_until_ready(found.url, None, None)
        yield found.url
        return
    settings.logs_dir.mkdir(parents=True, exist_ok=True)
    log = settings.logs_dir / "supervisor.log"
    console.print(f"Starting the service at {settings.base_url} ...", highlight=False)
    environment = {**os.environ, "TALUS_DATA_DIR": str(settings.data_dir)}
    with log.open("ab") as output:
        # A session of its own: Ctrl-C is for this process, which then ends the service in order.
        process = subprocess.Popen(
            [sys.executable, "-m", "service.cli", "serve"],
            env=environment,
            stdin=subprocess.DEVNULL,
            stdout=output,
            stderr=subprocess.STDOUT,
            start_new_session=True,
        )
    try:
        wait_until_ready(settings.base_url, process, log)
        yield settings.base_url
    finally:
        stop(process)


def wait_until_ready(url: str, process: subprocess.Popen[bytes] | None, log: Path | None) -> None:
    """Until jobs can run there. StartupError with the reason where that does not come."""
    deadline = time.monotonic() + START_SECONDS
    reason = "it does not answer"
    with Client(url) as client:
        while time.monotonic() < deadline:
            if process is not None and log is not None and process.poll() is not None:
                raise StartupError(last_line(log).removeprefix("talus: "))
            try:
                checks = client.readiness()["checks"]
                missing = [
                    checks[name]["reason"]
                    for name in NEEDED_CHECKS
                    if name in checks and not checks[name]["ok"]
                ]
                if not missing:
                    return
                reason = "; ".join(missing)
            except ServiceAwayError:
                pass  # it is still starting
            time.sleep(0.2)
    raise StartupError(f"the service at {url} was not ready within {START_SECONDS:g} s: {reason}")


def stop(process: subprocess.Popen[bytes]) -> None:
    """Ends the supervisor, which ends everything else."""
    if process.poll() is None:
        process.terminate()
        try:
            process.wait(STOP_SECONDS)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()


def wait_for_interrupt() -> None:
    """Returns at Ctrl-C or SIGTERM."""
    try:
        signal.pause()
    except KeyboardInterrupt:
        return
