"""Talus from a notebook or a script: start studies, charges and diagnoses, wait for them, read what they found.

    from service.client.notebook import Talus

    talus = Talus()                                   # the service of this machine, or Talus("http://host:8642")
    study = talus.calibrate("pellet", budget=16)      # the fields of POST /v1/studies
    study.wait()
    study.found                                       # angle, its 90 % interval, certified or not, parameters

Every object holds its last answer in `.answer` (the JSON of the API, in SI units as its names say) and asks again
with `.refresh()`. A refusal raises RefusedError with the service's own sentence, a service that does not answer
ServiceAwayError.
"""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from html import escape
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from service.client.charge import OVER as OVER_TASKS
from service.client.commands import FILES
from service.client.diagnose import lines, read_tables
from service.client.rest import Client
from service.client.tables import short
from service.domain.verdict_words import VERDICTS
from service.settings import get_settings

POLL_SECONDS = 1.0
OVER_STUDIES = ("completed", "cancelled", "failed")


class NotOverError(Exception):
    """What was asked for has not come in the time that was given for it."""


@dataclass(frozen=True)
class Found:
    """What a study found: the mean of the response (its unit in `unit`), half of the 90 % interval, and whether
    that is certified; the parameters by name; how many seeds of them were simulated."""

    response: str
    unit: str
    mean: float
    half_width_90: float
    certified: bool
    parameters: Mapping[str, float]
    seeds: int

    def __str__(self) -> str:
        sure = "certified" if self.certified else "not certified"
        values = ", ".join(f"{short(name)} {value:.3g}" for name, value in self.parameters.items())
        return (
            f"{self.response} {self.mean:.2f} +- {self.half_width_90:.2f} {self.unit} (90 %), {sure} by "
            f"{self.seeds} seeds: {values}"
        )


class Task(ABC):
    """Something that the service works on."""

    path = ""
    over: tuple[str, ...] = ()

    def __init__(self, client: Client, answer: Mapping[str, Any]) -> None:
        self.client = client
        self.answer = dict(answer)

    @property
    def id(self) -> int:
        return int(self.answer["id"])

    @property
    def state(self) -> str:
        """As of the last answer."""
        return str(self.answer["state"])

    @property
    def is_over(self) -> bool:
        return self.state in self.over

    @property
    def url(self) -> str:
        """Of its page."""
        return f"{self.client.base_url}/{self.path}/{self.id}"

    @abstractmethod
    def _ask(self) -> dict[str, Any]:
        """The API's present answer."""

    @abstractmethod
    def rows(self) -> list[tuple[str, str]]:
        """What a person reads of it: name and value."""

    def refresh(self) -> Self:
        """Ask again."""
        self.answer = self._ask()
        return self

    def wait(self, seconds: float | None = None, tell: Callable[[Self], None] | None = None) -> Self:
        """Until it is over; `tell` is called after each look. Raises NotOverError after so many `seconds`."""
        started = time.monotonic()
        while not self.refresh().is_over:
            if tell is not None:
                tell(self)
            if seconds is not None and time.monotonic() - started > seconds:
                raise NotOverError(f"{self.url} is {self.state} after {seconds:g} s")
            time.sleep(POLL_SECONDS)
        return self

    def __repr__(self) -> str:
        return f"<{type(self).__name__} {self.id} {self.state}, {self.url}>"

    def _repr_html_(self) -> str:
        """The notebook's view of it."""
        cells = "".join(f"<tr><th>{escape(a)}</th><td>{escape(b)}</td></tr>" for a, b in self.rows())
        return f'<table>{cells}</table><p><a href="{escape(self.url)}">its page</a></p>'


class Study(Task):
    """A calibration."""

    path, over = "studies", OVER_STUDIES

    def _ask(self) -> dict[str, Any]:
        return self.client.study(self.id)

    @property
    def found(self) -> Found | None:
        """None before there is a recommendation."""
        told = self.answer["recommendation"]
        if told is None:
            return None
        # Studies of the first release had the angle alone.
        responses = told.get("responses") or {
            "angle_deg": {"unit": "deg", "mean": told["mean_deg"], "half_width_90": told["half_width_90_deg"]}
        }
        name, first = next(iter(responses.items()))
        return Found(
            response=name,
            unit=first["unit"],
            mean=first["mean"],
            half_width_90=first["half_width_90"],
            certified=bool(told["certified"]),
            parameters=dict(told["x"]),
            seeds=len(told["numbers"]),
        )

    def designs(self) -> list[dict[str, Any]]:
        """A flat row for each design, as pandas.DataFrame takes them: number, verdict, parameters, angle_deg."""
        kept = ("number", "state", "verdict", "origin", "scale", "seed", "angle_deg", "angle_sd_deg")
        found = self.client.designs(self.id)
        return [{**{name: row.get(name) for name in kept}, **row["x"]} for row in found]

    def report(self) -> dict[str, Any] | None:
        """Posterior, identifiability, sensitivity, which test next; None before one was written."""
        told = self.client.report(self.id)
        return None if told is None else told["report"]

    def save(self, folder: str | Path) -> list[Path]:
        """Write study.json, designs.csv and designs.parquet."""
        place = Path(folder)
        place.mkdir(parents=True, exist_ok=True)
        for name, file in FILES.items():
            (place / file).write_bytes(self.client.download(self.id, name))
        return [place / file for file in FILES.values()]

    def cancel(self) -> Self:
        """Stop it; what was simulated stays."""
        self.client.cancel_study(self.id)
        return self.refresh()

    def rows(self) -> list[tuple[str, str]]:
        counted, stop = self.answer["counters"], self.answer["stop"]
        told = [
            ("study", f"{self.id}, {self.answer['material']}, {self.state}"),
            ("simulations", ", ".join(f"{number} {name}" for name, number in counted.items())),
        ]
        if self.found is not None:
            told.append(("found", str(self.found)))
        if stop is not None:
            told.append(("ended", str(stop["text"] or stop["reason"])))
        return told


class _WithFiles(Task, ABC):
    """A charge or a diagnosis: it leaves files."""

    over = tuple(OVER_TASKS)

    def files(self) -> dict[str, bytes]:
        """The files that it left, by kind."""
        return {file["kind"]: self.client.artifact(file["id"]) for file in self.answer["artifacts"]}

    def save(self, folder: str | Path) -> list[Path]:
        """Write its files."""
        place = Path(folder)
        place.mkdir(parents=True, exist_ok=True)
        written = []
        for file in self.answer["artifacts"]:
            # A name, never a path: the service is trusted with its bytes, not with where they go.
            target = place / Path(file["file_name"]).name
            target.write_bytes(self.client.artifact(file["id"]))
            written.append(target)
        return written

    def _outcome(self) -> list[tuple[str, str]]:
        told = [("expected", str(self.answer["cost"]["text"]))]
        if self.answer["failure_text"]:
            told.append(("failed", str(self.answer["failure_text"])))
        return told


class Charge(_WithFiles):
    """One charge of the hopper."""

    path = "charges"

    def _ask(self) -> dict[str, Any]:
        return self.client.charge(self.id)

    @property
    def findings(self) -> dict[str, Any] | None:
        """Piles, their heights (m) and grain sizes (m), depressions; None before it is over."""
        found: dict[str, Any] | None = self.answer["findings"]
        return found

    def cancel(self) -> Self:
        """Stop it."""
        self.client.cancel_charge(self.id)
        return self.refresh()

    def rows(self) -> list[tuple[str, str]]:
        told = self.answer
        head = f"{self.id}, {told['charge']}, scale {told['scale']:g}, seed {told['seed']}, {self.state}"
        findings = [(name.replace("_", " "), _text(value)) for name, value in (self.findings or {}).items()]
        return [("charge", head), ("contact numbers", told["parameters_from"]), *self._outcome(), *findings]


class Diagnosis(_WithFiles):
    """What a simulation gets wrong of measured data; or, of a plan, what tests could show."""

    path = "diagnoses"

    def _ask(self) -> dict[str, Any]:
        return self.client.diagnosis(self.id)

    @property
    def verdict(self) -> str | None:
        """None before it is over."""
        told: str | None = self.answer["verdict"]
        return told

    @property
    def result(self) -> dict[str, Any] | None:
        """As `talus diagnose --json` prints it, and more."""
        told: dict[str, Any] | None = self.answer["result"]
        return told

    @property
    def sentences(self) -> list[str]:
        """What it says, in words."""
        if self.result is None:
            return []
        return lines(self.result) if self.verdict in VERDICTS else list(self.result["sentences"])

    def cancel(self) -> Self:
        """Stop it; its simulations stay for the next one."""
        self.client.cancel_diagnosis(self.id)
        return self.refresh()

    def rows(self) -> list[tuple[str, str]]:
        head = f"{self.id} of data set {self.answer['data_set']}, {self.state}"
        said = [("", sentence) for sentence in self.sentences]
        return [("diagnosis", head), *self._outcome(), ("verdict", self.verdict or "none yet"), *said]


class Talus:
    """A service. `url`: of the one on this machine where left out; `api_key` as in TALUS_API_KEY."""

    def __init__(self, url: str | None = None, api_key: str | None = None) -> None:
        self.client = Client(url or get_settings().base_url, api_key=api_key)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """End the connection."""
        self.client.close()

    def calibrate(self, material: str, **fields: Any) -> Study:
        """Start a study; `fields` are those of POST /v1/studies."""
        return Study(self.client, self.client.create_study({"material": material, **fields}))

    def study(self, number: int) -> Study:
        """One that is there."""
        return Study(self.client, self.client.study(number))

    def studies(self, limit: int = 20) -> list[Study]:
        """The newest first."""
        return [Study(self.client, answer) for answer in self.client.studies(limit)]

    def import_study(self, file: str | Path) -> Study:
        """The study.json of another installation."""
        return Study(self.client, self.client.import_study(Path(file).read_bytes()))

    def start_charges(self, charge: str, **fields: Any) -> list[Charge]:
        """Start charges (coke or iron), one for each of `seeds`; `fields` are those of POST /v1/charges."""
        answer = self.client.create_charges({"charge": charge, **fields})
        return [Charge(self.client, item) for item in answer["items"]]

    def charge(self, number: int) -> Charge:
        """One that is there."""
        return Charge(self.client, self.client.charge(number))

    def charges(self, limit: int = 20) -> list[Charge]:
        """The newest first."""
        return [Charge(self.client, answer) for answer in self.client.charges(limit)]

    def diagnose(self, folder: str | Path, **fields: Any) -> Diagnosis:
        """Upload the tables of a folder and ask what the simulation gets wrong of them; `fields` are those of
        POST /v1/diagnoses. With `plan={}` the folder may hold conditions.csv alone: what could the tests show?

        Raises NotADataSetError naming every bad cell.
        """
        place, is_plan = Path(folder), fields.get("plan") is not None
        data_set = self.client.create_data_set(
            place.resolve().name[:100], read_tables(place, is_plan), is_plan
        )
        return self.diagnose_stored(data_set["id"], **fields)

    def diagnose_stored(self, data_set: int, **fields: Any) -> Diagnosis:
        """The same of a data set that was uploaded before."""
        asked = {"data_set": data_set, **fields}
        return Diagnosis(self.client, self.client.create_diagnosis(asked))

    def diagnosis(self, number: int) -> Diagnosis:
        """One that is there."""
        return Diagnosis(self.client, self.client.diagnosis(number))

    def diagnoses(self, limit: int = 20) -> list[Diagnosis]:
        """The newest first."""
        return [Diagnosis(self.client, answer) for answer in self.client.diagnoses(limit)]


def _text(value: Any) -> str:
    if isinstance(value, float):
        return f"{value:.3g}"
    return ", ".join(map(str, value)) if isinstance(value, list) else str(value)
