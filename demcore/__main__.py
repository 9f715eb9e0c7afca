"""python -m demcore verify | bench | pile | charge | findings | compare | table7 | mix | mesh.

Bad input ends with one line and exit status 2; a failed verification or simulation with status 1.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence

from demcore.commands import bench, charge, compare, findings, mesh, mix, pile, table7, verify
from demcore.commands.arguments import Parser, UsageError
from demcore.commands.warning_lines import checkpoint_warnings_as_lines
from demcore.errors import Cancelled, InputError, SimulationError

FAILED, BAD_INPUT = 1, 2
# The shell's own status for a program that Ctrl-C ended: 128 + SIGINT.
INTERRUPTED = 130


def parser() -> Parser:
    """The command line."""
    top = Parser(prog="python -m demcore", description=__doc__)
    commands = top.add_subparsers(dest="command", required=True)
    for command in (verify, bench, pile, charge, findings, compare, table7, mix, mesh):
        command.add_parser(commands)
    return top


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command; the exit status."""
    try:
        parsed = parser().parse_args(arguments)
        with checkpoint_warnings_as_lines():
            return int(parsed.run(parsed))
    except (InputError, UsageError) as error:
        print("error: " + " ".join(str(error).split()), file=sys.stderr)
        return BAD_INPUT
    except Cancelled as error:
        print(f"error: {error}", file=sys.stderr)
        return INTERRUPTED
    except SimulationError as error:
        print(f"error: {error.kind}: {error}", file=sys.stderr)
        return FAILED
    except KeyboardInterrupt:
        print("error: interrupted", file=sys.stderr)
        return INTERRUPTED


if __name__ == "__main__":
    sys.exit(main())
