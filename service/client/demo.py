"""`talus demo`: one calibration from the outside, over HTTP alone, shown live and set beside the paper.

It uses the service that runs on the data folder, or starts one for as long as the study takes.
"""

from __future__ import annotations

import json
import signal
import time
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from rich.console import Console
from rich.live import Live

from service.client.local_service import LocalService, running_service
from service.client.rest import Client
from service.client.study_view import StudyView
from service.client.tables import LiveTable, closing_table, found_lines, noise_lines, plain_line
from service.settings import Settings


@dataclass(frozen=True)
class DemoOptions:
    """What to calibrate. None: the service's default."""

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
    console.print(f"The service's data is in {settings.data_dir}; starting.", highlight=False, soft_wrap=True)
    with running_service(settings) as service, Client(service.url) as client:
        study, minutes = conduct(service, client, options.body(), console)
        outcome = summarise(study, minutes)
        file = settings.data_dir / "demo.json"
        file.write_text(json.dumps(outcome, indent=2) + "\n", encoding="utf-8")
        tell(outcome, study, console)
        page = f"{service.url}/studies/{study['id']}"
        console.print(
            f"Page:  {page} (while the service runs: `make serve`)", highlight=False, soft_wrap=True
        )
        console.print(f"Files: {settings.artifacts_dir}, summary {file}", highlight=False, soft_wrap=True)
        if options.keep_serving:
            console.print("The service goes on; Ctrl-C ends it.")
            wait_for_interrupt()
    return 0 if study["state"] in ("completed", "cancelled") else 1


def conduct(
    service: LocalService, client: Client, body: Mapping[str, Any], console: Console
) -> tuple[dict[str, Any], float]:
    """Ask for a study and show it until it is over; its last state, and the minutes that it took.

    Ctrl-C cancels the study. Raises RefusedError or ServiceAwayError with a sentence for the user.
    """
    started = time.monotonic()
    study = client.create_study(dict(body))
    console.print(f"Study {study['id']} is at {service.url}/studies/{study['id']}", highlight=False)
    try:
        with console.status(
            "waiting for the workers: at their first start they compile the simulation, a minute or two"
        ):
            service.wait_for("dispatcher", "workers")
        follow(client, study, console)
        give_up_if_paused(client, study["id"], console)
    except KeyboardInterrupt:
        client.cancel_study(study["id"])
        console.print("The study is cancelled.")
        raise
    return client.study(study["id"]), (time.monotonic() - started) / 60.0


def give_up_if_paused(client: Client, study_id: int, console: Console) -> None:
    """Nobody sits by the demo to look at failures and resume: the study ends with what it has measured."""
    study = client.study(study_id)
    if not waits_for_nobody(study):
        return
    console.print(f"Paused: {study['pause']['text']}", highlight=False, soft_wrap=True)
    client.cancel_study(study_id)
    for _event in client.events(study_id):
        pass


def waits_for_nobody(study: Mapping[str, Any]) -> bool:
    """Paused, and not by a user: who paused it is there to resume it."""
    return bool(study["state"] == "paused" and study["pause"]["reason"] != "user")


def follow(client: Client, study: Mapping[str, Any], console: Console) -> None:
    """Shows the study until it is over, or paused for its failures: a live table in a terminal, elsewhere a line
    per design."""
    view = StudyView.of(study, time.monotonic())
    spec = study["spec"]
    lower, upper = spec["responses"][0]["window"]
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
            if view.state == "paused" and waits_for_nobody(client.study(study["id"])):
                return
        return
    with Live(LiveTable(view, title), console=console, refresh_per_second=2, vertical_overflow="crop"):
        for event in client.events(study["id"]):
            view.fold(event)
            if view.state == "paused" and waits_for_nobody(client.study(study["id"])):
                return


def summarise(study: Mapping[str, Any], minutes: float) -> dict[str, Any]:
    """What demo.json holds."""
    spec, found, stop = study["spec"], study["recommendation"] or {}, study["stop"] or {}
    return {
        "material": spec["material"],
        "scale": spec["scale"],
        "target_deg": spec["responses"][0]["target"],
        "window_deg": spec["responses"][0]["window"],
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
        for line in found_lines(study["recommendation"]):
            console.print(line, highlight=False, soft_wrap=True)
    else:
        console.print("No simulation gave a repose angle, so there is no optimum.")
    for line in noise_lines(study):
        console.print(f"{line}.", highlight=False, soft_wrap=True)
    reason = (study["stop"] or {}).get("text") or outcome["stop_reason"] or study["state"]
    console.print(f"Ended after {outcome['minutes']:.1f} minutes: {reason}", highlight=False, soft_wrap=True)
    if outcome["stop_reason"] == "budget":
        again = f'"warm_start": [{study["id"]}]'
        console.print(f"To go on: a larger budget, and {again} to start from this study.", highlight=False)


def wait_for_interrupt() -> None:
    """Returns at Ctrl-C or SIGTERM."""
    try:
        signal.pause()
    except KeyboardInterrupt:
        return
