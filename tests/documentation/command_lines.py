"""The command lines that the documentation prints: read out of its blocks, one after the other."""

from __future__ import annotations

import re
import shlex
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
PROGRAMS = ("talus", "curl", "make", "python")


@dataclass(frozen=True)
class Documented:
    """One command: its words, without comment and placeholders, and what the page prints below it."""

    page: str
    words: tuple[str, ...]
    answer: str

    def __str__(self) -> str:
        return f"{self.page}: {' '.join(self.words)[:70]}"


def documented() -> list[Documented]:
    """Of all pages, in order, each once."""
    found = [command for page in PAGES for command in _of_page(page)]
    return list({command.words: command for command in reversed(found)}.values())[::-1]


def _of_page(page: Path) -> Iterator[Documented]:
    for block in re.findall(r"^```\n(.*?)^```", page.read_text(encoding="utf-8"), flags=re.S | re.M):
        lines = block.replace("\\\n", " ").splitlines()
        for k, line in enumerate(lines):
            words = _words(line)
            for one in words:
                below = lines[k + 1] if k + 1 < len(lines) and not _words(lines[k + 1]) else ""
                yield Documented(page.name, one, below)


def _words(line: str) -> list[tuple[str, ...]]:
    """The commands of a line: of a shell's loop or list those inside it; none of what a command printed."""
    text = line.removeprefix("$ ").strip()
    if not text.startswith((*PROGRAMS, "for ", "git clone")):
        return []
    lexer = shlex.shlex(text, posix=True, punctuation_chars=";&|<>")
    lexer.whitespace_split, found = True, [[]]  # type: ignore[var-annotated]
    for word in lexer:
        if word in (";", "&&", "do", "done"):
            found.append([])
        elif word != "...":
            found[-1].append(word.strip("[]"))
    return [tuple(words) for words in found if words and words[0] in PROGRAMS]
