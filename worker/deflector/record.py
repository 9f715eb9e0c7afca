"""The record of a search: a file of JSON lines, one a charge; what was stopped goes on after its last line."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any


class Record:
    """The rows of a file, in the order of the work; a last line that a kill cut off is dropped from it."""

    def __init__(self, path: Path) -> None:
        self._path = path
        text = path.read_text(encoding="utf-8") if path.exists() else ""
        whole = text[: text.rfind("\n") + 1]
        if whole != text:
            path.write_text(whole, encoding="utf-8")
        self.rows: list[dict[str, Any]] = [json.loads(line) for line in whole.splitlines()]

    def find(self, key: Mapping[str, Any]) -> dict[str, Any] | None:
        """The first row with all of these; None where there is none."""
        return next((row for row in self.rows if all(row[name] == key[name] for name in key)), None)

    def add(self, row: dict[str, Any]) -> dict[str, Any]:
        """Written before it is known, so that what a caller goes on from is there after a kill."""
        with self._path.open("a", encoding="utf-8") as file:
            file.write(json.dumps(row) + "\n")
        self.rows.append(row)
        return row
