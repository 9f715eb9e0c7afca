"""python -m demcore mesh FILE --units mm --up z: what a mesh file holds, as the core reads it."""

from __future__ import annotations

import argparse
import json
from pathlib import Path


def add_parser(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Its arguments."""
    look = commands.add_parser("mesh", help="read an STL, OBJ or PLY file and tell what it holds")
    look.add_argument("file", type=Path)
    look.add_argument("--units", help="m, mm, cm or inch: a mesh file does not say its own")
    look.add_argument("--up", default="z", help="the file's axis that points up: x, y or z (default)")
    look.add_argument("--json", action="store_true", help="print the report as JSON")
    look.set_defaults(run=mesh)


def mesh(arguments: argparse.Namespace) -> int:
    """Print the report of a mesh: size in metres, triangles, whether it is watertight."""
    from demcore.geometry.mesh_file import load_mesh

    _, report = load_mesh(arguments.file, arguments.units, arguments.up)
    print(json.dumps(report.record(), indent=1) if arguments.json else report.line())
    return 0
