"""`make fuzz [FOR=300] [SEED=1]`: the whole document by schemathesis' own program on a served application, without
keys and with one, all of its checks and phases: examples, coverage, generated requests, chains.

No worker runs: what is accepted is stored and waits.
"""

from __future__ import annotations

import argparse
import random
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Literal

from service.db.migrate import upgrade
from service.db.session import Database
from service.domain.access import Scope
from service.settings import Settings
from service.studies.manage_keys import create_key
from tests.builders.charges import charges
from tests.builders.diagnoses import a_data_set
from tests.builders.server import Server
from tests.builders.studies import a_finished_study

CONFIG = Path(__file__).with_name("schemathesis.toml")


def fuzz(auth: Literal["off", "on"], seconds: int, seed: int) -> int:
    """The program's exit status; what it says goes to the terminal."""
    with tempfile.TemporaryDirectory() as name:
        settings = Settings(data_dir=Path(name), auth=auth)
        upgrade(settings.resolved_database_url)
        database = Database(settings.resolved_database_url)
        a_finished_study(database)
        charges(database)
        a_data_set(database)
        with database.writing() as session:
            key = create_key(session, "fuzz", Scope.ADMIN, "default")[1].text
        server = Server(settings)
        server.start()
        command = [
            *(str(Path(sys.executable).with_name("schemathesis")), "--config-file", str(CONFIG)),
            *("run", f"{server.url}/openapi.json", "--checks", "all", "--continue-on-failure", "--no-color"),
            *("--max-time", str(seconds), "--seed", str(seed)),
            *(("--header", f"Authorization: Bearer {key}") if auth == "on" else ()),
        ]
        try:
            return subprocess.run(command, cwd=name, check=False).returncode
        finally:
            server.stop()
            database.dispose()


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=int, default=300, help="of each of the two runs")
    parser.add_argument("--seed", type=int, default=random.SystemRandom().randrange(10**6))
    wanted = parser.parse_args()
    worst = 0
    for auth in ("off", "on"):
        print(f"=== keys {auth}, seed {wanted.seed}", flush=True)
        worst = max(worst, fuzz(auth, wanted.seconds, wanted.seed))
    return worst


if __name__ == "__main__":
    sys.exit(main())
