"""`make secure`: risky calls in the sources (bandit), secrets in the tree (detect-secrets), known holes in what is
installed (pip-audit, where its database can be reached). Headers and cookies of every page are tests."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
SOURCES = ("service", "worker", "demcore", "migrations")
# What is accepted, with its reason: asserts and subprocesses of fixed commands (B101, B404, B603, B606, B607);
# numbers of the simulation are no cryptography (B311); 0.0.0.0 is only compared with (B104); SQL that is put
# together holds names of our own tables (B608); Markup is made of escaped text, as tests show (B704).
ACCEPTED = "B101,B104,B311,B404,B603,B606,B607,B608,B704"
# Hashes by name, and test data that look like secrets.
NO_SECRETS = r"(.*\.lock|docs/openapi\.json|tests/.*|compose\.yaml)"
# Hashes by name in stored studies and floors: what code ran, and what a file or a surrogate was made of.
HASHES = r'"(content_sha256|training_hash|code_version|code)": "[0-9a-f]+"'
AUDIT_SECONDS = 120


def run(*command: str, seconds: float = 300.0) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", *command],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
        timeout=seconds,
    )


def risky_calls() -> bool:
    done = run("bandit", "--quiet", "--recursive", *SOURCES, "--skip", ACCEPTED, "--format", "json")
    found = json.loads(done.stdout)["results"]
    for item in found:
        print(f"{item['filename']}:{item['line_number']}: {item['test_id']} {item['issue_text']}")
    print(f"bandit: {len(found)} risky calls")
    return not found


def secrets() -> bool:
    tracked = subprocess.run(["git", "ls-files"], cwd=ROOT, capture_output=True, text=True, check=True)
    files = tracked.stdout.split()
    done = run("detect_secrets", "scan", "--exclude-files", NO_SECRETS, "--exclude-lines", HASHES, *files)
    found = json.loads(done.stdout)["results"]
    for name, items in found.items():
        for item in items:
            print(f"{name}:{item['line_number']}: {item['type']}")
    print(f"detect-secrets: {sum(map(len, found.values()))} in {len(files)} files")
    return not found


def known_holes() -> bool:
    try:
        done = run("pip_audit", "--local", "--skip-editable", "--format", "json", seconds=AUDIT_SECONDS)
        packages = json.loads(done.stdout)["dependencies"]
    except (subprocess.TimeoutExpired, json.JSONDecodeError, KeyError):
        print("pip-audit: skipped, its database cannot be reached from here")
        return True
    # A mirror that serves packages and nothing about them makes pip-audit skip every one, and find no hole.
    known = [item for item in packages if "skip_reason" not in item]
    holed = [item for item in known if item["vulns"]]
    for item in holed:
        print(f"{item['name']} {item['version']}: " + ", ".join(hole["id"] for hole in item["vulns"]))
    print(
        f"pip-audit: {len(holed)} packages with known holes, of {len(known)} that its database knows; "
        f"of the {len(packages)} that are installed it could say nothing about {len(packages) - len(known)}"
    )
    return not holed


if __name__ == "__main__":
    sys.exit(0 if all([risky_calls(), secrets(), known_holes()]) else 1)
