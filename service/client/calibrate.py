"""`talus calibrate`: a study from a file, from its start to the files that it leaves.

It uses the service that runs on the data folder, or starts one for as long as the study takes.
"""

from __future__ import annotations

import json
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from rich.console import Console

from service.client.commands import write_files
from service.client.demo import conduct, summarise, tell
from service.client.local_service import running_service
from service.client.rest import Client
from service.settings import Settings

# A report takes seconds; a worker that died over it is replaced within its lease.
REPORT_SECONDS = 60.0
POLL_SECONDS = 0.5


class NotARequestError(Exception):
    """The file holds no request for a study; the text says what is wrong."""


def read_request(file: Path) -> dict[str, Any]:
    """The body of POST /v1/studies; what it asks for is judged by the service. Raises NotARequestError."""
    try:
        body = json.loads(file.read_text(encoding="utf-8"))
    except OSError as error:
        raise NotARequestError(f"{file}: {error.strerror}") from error
    except ValueError as error:
        raise NotARequestError(f"{file} is no JSON: {error}") from error
    if not isinstance(body, dict):
        raise NotARequestError(f"{file} holds {type(body).__name__}, not an object with the study's fields")
    return body


def calibrate(settings: Settings, body: Mapping[str, Any], out: Path | None, console: Console) -> int:
    """The exit status: 0 when the study ended by itself or was cancelled. `out`: a folder for its files."""
    with running_service(settings) as service, Client(service.url) as client:
        study, minutes = conduct(service, client, body, console)
        tell(summarise(study, minutes), study, console)
        if out is not None:
            if not wait_for_report(client, study["id"]):
                console.print("The report is not written yet: the files come without it.", highlight=False)
            for file in write_files(client, study["id"], out):
                console.print(f"Written: {file}", highlight=False, soft_wrap=True)
    return 0 if study["state"] in ("completed", "cancelled") else 1


def wait_for_report(client: Client, study_id: int) -> bool:
    """Whether the report on a study that is over came in time; the export holds it then."""
    deadline = time.monotonic() + REPORT_SECONDS
    while time.monotonic() < deadline:
        found = client.report(study_id)
        if found is not None and found["is_current"]:
            return True
        time.sleep(POLL_SECONDS)
    return False
