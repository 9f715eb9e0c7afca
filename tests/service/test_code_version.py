"""The code's hash: any edit of demcore changes it, nothing else does."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from demcore.source_hash import hash_sources
from service.code_version import demcore_hash

DEMCORE = Path(__file__).resolve().parents[2] / "demcore"


@pytest.fixture
def copy(tmp_path: Path) -> Path:
    return Path(shutil.copytree(DEMCORE, tmp_path / "demcore", ignore=shutil.ignore_patterns("__pycache__")))


def test_a_copy_has_the_same_hash(copy: Path) -> None:
    assert hash_sources(copy) == hash_sources(DEMCORE) == demcore_hash()


def edit_a_law(package: Path) -> None:
    law = package / "contact" / "coulomb_spring.py"
    law.write_text(law.read_text().replace("+", "-", 1))


def edit_data(package: Path) -> None:
    with (package / "data" / "materials.toml").open("a") as file:
        file.write("# a note\n")


def rename_a_module(package: Path) -> None:
    (package / "forces.py").rename(package / "forces2.py")


def add_a_module(package: Path) -> None:
    (package / "geometry" / "empty.py").touch()


@pytest.mark.parametrize("edit", [edit_a_law, edit_data, rename_a_module, add_a_module])
def test_an_edit_changes_it(copy: Path, edit: Callable[[Path], None]) -> None:
    edit(copy)
    assert hash_sources(copy) != demcore_hash()


def test_bytecode_and_caches_do_not_count(copy: Path) -> None:
    (copy / "__pycache__").mkdir()
    (copy / "__pycache__" / "forces.cpython-311.pyc").write_bytes(b"x")
    assert hash_sources(copy) == demcore_hash()
