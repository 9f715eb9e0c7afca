"""The documentation's index is true: what it links is there, what it names can be run."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest

from service.cli import cli
from service.client.notebook import Talus

ROOT = Path(__file__).resolve().parents[2]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
INDEX = ROOT / "docs" / "README.md"


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_every_link_leads_somewhere(page: Path) -> None:
    for target in re.findall(r"\]\(([^)#\s]+)", page.read_text(encoding="utf-8")):
        if "://" not in target:
            assert (page.parent / target).exists(), target


def test_the_index_names_every_page() -> None:
    linked = set(re.findall(r"\]\(([^)#\s]+\.md)", INDEX.read_text(encoding="utf-8")))
    assert {page.name for page in INDEX.parent.glob("*.md") if page != INDEX} <= linked


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_every_command_that_is_named_exists(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    targets = set(re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text(), flags=re.M))
    targets |= set(re.findall(r"^([a-z -]+):", (ROOT / "Makefile").read_text(), flags=re.M))
    named = set(re.findall(r"`make ([a-z-]+)", text)) | set(re.findall(r"^make ([a-z-]+)", text, flags=re.M))
    assert named <= targets
    commands = set(cli.commands)
    assert set(re.findall(r"(?:`|^)talus ([a-z]+)", text, flags=re.M)) <= commands


def test_the_python_of_the_how_to_is_the_clients() -> None:
    text = (ROOT / "docs" / "how-to.md").read_text(encoding="utf-8")
    (code,) = re.findall(r"```python\n(.*?)```", text, flags=re.S)
    called = {
        node.func.attr
        for node in ast.walk(ast.parse(code))
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute)
    }
    assert called and all(callable(getattr(Talus, name)) for name in called)
