"""The version of the model that a study or a charge simulates with: the effects that a diagnosis named."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any, Self

from service.domain.errors import InvalidValue

FIELD = "model_version"


@dataclass(frozen=True)
class ModelUse:
    """`name` of the version; `moisture_percent` of the burden in the pile; `effects`: amplitudes by effect key as
    a simulation takes them, empty until the version was looked up. Raises InvalidValue."""

    name: str
    moisture_percent: float = 0.0
    effects: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if not self.name or len(self.name) > 100:
            raise InvalidValue(FIELD, self.name, "the name of a model version, 1 to 100 characters")
        if not 0.0 <= self.moisture_percent <= 40.0:
            raise InvalidValue("moisture_percent", self.moisture_percent, "0 to 40 percent")
        object.__setattr__(self, "effects", MappingProxyType(dict(self.effects)))

    @classmethod
    def asked(cls, name: str | None, moisture_percent: float) -> Self | None:
        """What a request names; None for the baseline. Raises InvalidValue."""
        if name is not None:
            return cls(name, moisture_percent)
        if moisture_percent:
            allowed = "0 without a model_version: the baseline knows no water"
            raise InvalidValue("moisture_percent", moisture_percent, allowed)
        return None

    def as_record(self) -> dict[str, Any]:
        """Plain JSON types only."""
        return {
            "name": self.name,
            "moisture_percent": self.moisture_percent,
            "effects": dict(self.effects),
        }
