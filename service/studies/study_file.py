"""The file that a study travels in, from one installation to another: one JSON, checked whole when it is read.

    {"format": "talus-study", "version": 1, "content_sha256": ..., "exported_at": ..., "study": {...}}

The hash is over `study` alone, as canonical JSON: the same study is the same file wherever it comes from. Times
are seconds since 1970 (UTC); everything else is named as in the API. No ids: they mean nothing elsewhere.
"""

from __future__ import annotations

import hashlib
import json
import math
from typing import Annotated, Any, Literal, Self

from pydantic import (
    AfterValidator,
    BaseModel,
    ConfigDict,
    Field,
    ModelWrapValidatorHandler,
    model_validator,
)

from service.domain.errors import InvalidValue
from service.domain.plain_text import clean_text
from service.domain.states import DesignState, StudyState, Verdict
from service.studies.shown_parts import recommendation_part, report_part

FORMAT = "talus-study"
VERSION = 1
MOST_DESIGNS = 5_000
DEEPEST = 30
LARGEST_INTEGER = 2**63 - 1

_STRICT = ConfigDict(extra="forbid", allow_inf_nan=False)


def content_hash(study: dict[str, Any]) -> str:
    """sha256 of the study as canonical JSON: sorted names, no spaces, shortest numbers."""
    text = json.dumps(study, sort_keys=True, separators=(",", ":"), allow_nan=False)
    return hashlib.sha256(text.encode()).hexdigest()


def _plain_json(value: Any, depth: int = 0) -> Any:
    """Refuses what JSON columns cannot keep: numbers that are none, absurdly large ones, endless nesting."""
    if depth > DEEPEST:
        raise ValueError(f"at most {DEEPEST} levels of nesting are allowed")
    if isinstance(value, dict):
        for key, item in value.items():
            clean_text(key)
            _plain_json(item, depth + 1)
    elif isinstance(value, list):
        for item in value:
            _plain_json(item, depth + 1)
    elif isinstance(value, str):
        clean_text(value)
    elif isinstance(value, float) and not math.isfinite(value):
        raise ValueError("finite numbers are needed")
    elif isinstance(value, int) and abs(value) > LARGEST_INTEGER:
        raise ValueError(f"whole numbers up to {LARGEST_INTEGER} are allowed")
    return value


Plain = Annotated[dict[str, Any], AfterValidator(_plain_json)]
Text = Annotated[str, Field(max_length=20_000), AfterValidator(clean_text)]
Word = Annotated[str, Field(max_length=32), AfterValidator(clean_text)]
Hash = Annotated[str, Field(pattern="^[0-9a-f]{64}$")]
Count = Annotated[int, Field(ge=0, le=LARGEST_INTEGER, strict=True)]
Number = Annotated[float, Field(strict=True)]
# Seconds since 1970, up to the last year that a date can have.
Moment = Annotated[float, Field(strict=True, ge=0.0, lt=253_402_300_800.0)]


class RunRecord(BaseModel):
    """One attempt at a design and what it cost."""

    model_config = _STRICT

    attempt: Count
    exit_class: Word | None
    exit_text: Text | None
    time_step_factor: Number
    code_version: Annotated[str, Field(max_length=64), AfterValidator(clean_text)] | None
    time_step_s: Number | None
    steps: Count | None
    wall_s: Number | None
    cpu_s: Number | None
    memory_mb: Number | None
    started_at: Moment
    ended_at: Moment | None


class DesignRecord(BaseModel):
    """One design: why it was proposed, what was predicted, what came out."""

    model_config = _STRICT

    number: Annotated[int, Field(ge=1, le=LARGEST_INTEGER, strict=True)]
    x: dict[str, Number]
    scale: Number
    seed: Annotated[int, Field(ge=0, le=2**31 - 1, strict=True)]
    origin: Annotated[str, Field(max_length=16), AfterValidator(clean_text)]
    reason: Text
    prediction: Plain | None
    acquisition: Number | None
    training_hash: Hash | None
    hyperparameters: Plain | None
    state: DesignState
    verdict: Verdict | None
    angle_deg: Number | None
    angle_sd_deg: Number | None
    literal_angle_deg: Number | None
    responses: dict[str, Number] | None
    results: Plain | None
    failure_class: Word | None
    failure_text: Text | None
    supersedes: Count | None
    created_at: Moment
    started_at: Moment | None
    ended_at: Moment | None
    runs: Annotated[list[RunRecord], Field(max_length=1_000)]


class StopRecord(BaseModel):
    """Why a study proposed nothing more, or paused."""

    model_config = _STRICT

    reason: Word
    text: Text | None
    numbers: Plain | None


class BudgetChange(BaseModel):
    """`number`: the first design that was proposed under the new budget."""

    model_config = _STRICT

    number: Count
    before: Count
    after: Count


class StudyRecord(BaseModel):
    """A study with all its designs. `warm_start` of the spec names studies of the installation it comes from."""

    model_config = _STRICT

    spec: Plain
    state: StudyState
    stop: StopRecord | None
    recommendation: Annotated[Plain, AfterValidator(recommendation_part)] | None
    report: Annotated[Plain, AfterValidator(report_part)] | None
    failures_forgiven: Count
    budget_changes: Annotated[list[BudgetChange], Field(max_length=1_000)]
    created_at: Moment
    ended_at: Moment | None
    designs: Annotated[list[DesignRecord], Field(max_length=MOST_DESIGNS)]


class StudyFile(BaseModel):
    """A study as one file."""

    model_config = _STRICT

    format: Literal["talus-study"] = Field(description="always talus-study")
    version: Literal[1] = Field(description="of this format; another one is refused")
    content_sha256: Hash = Field(description="of `study` as canonical JSON")
    exported_at: Moment = Field(description="seconds since 1970 (UTC)")
    talus_version: Annotated[str, Field(max_length=64), AfterValidator(clean_text)]
    study: StudyRecord

    @model_validator(mode="wrap")
    @classmethod
    def _of_this_version_and_whole(cls, data: Any, handler: ModelWrapValidatorHandler[Self]) -> Self:
        """Another version is named before its other fields; a changed content, once all else is right."""
        if isinstance(data, dict):
            for field, known in (("format", FORMAT), ("version", VERSION)):
                if field in data and data[field] != known:
                    raise InvalidValue(field, data[field], f"{known}, which this installation reads")
        file = handler(data)
        if isinstance(data, dict) and file.content_sha256 != content_hash(data["study"]):
            allowed = "the sha256 of `study`: the file was changed or damaged"
            raise InvalidValue("content_sha256", file.content_sha256, allowed)
        return file
