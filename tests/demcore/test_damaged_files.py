"""Meshes and TOML files, damaged in every way that hypothesis finds: read, or refused by an InputError."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from demcore.errors import InputError
from demcore.geometry.mesh_file import load_mesh
from demcore.material_file import read_material
from demcore.toml_file import number, read_toml
from tests.builders.mesh_files import FILES

MATERIALS = Path("demcore/data/materials.toml")
many = settings(
    max_examples=60,
    deadline=None,
    derandomize=True,
    database=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)


@st.composite
def damaged(draw: st.DrawFn, content: bytes) -> bytes:
    """Cut, overwritten, doubled and filled in at random places."""
    found = bytearray(content)
    for _ in range(draw(st.integers(1, 4))):
        at = draw(st.integers(0, len(found)))
        length = draw(st.integers(0, 40))
        piece = draw(
            st.binary(max_size=12)
            | st.sampled_from(
                [b"\0", b"-1", b"1e999", b"nan", b"9" * 20, b"\xff" * 4, b"\n", b"facet normal "]
            )
            | st.just(bytes(found[at : at + length]) * 2)
        )
        found[at : at + draw(st.sampled_from([0, length, len(piece)]))] = piece
    return bytes(found[: draw(st.integers(0, len(found)))]) if draw(st.booleans()) else bytes(found)


@pytest.mark.parametrize("name", FILES)
def test_a_damaged_mesh_is_read_or_refused(tmp_path: Path, name: str) -> None:
    @many
    @given(content=damaged(FILES[name]))
    def read(content: bytes) -> None:
        path = tmp_path / name
        path.write_bytes(content)
        try:
            mesh, report = load_mesh(path, "mm")
        except InputError:
            return
        assert report.triangles == len(mesh.faces) > 0

    read()


def test_a_damaged_material_file_is_read_or_refused(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"

    @many
    @given(content=damaged(MATERIALS.read_bytes()))
    def read(content: bytes) -> None:
        path.write_bytes(content)
        try:
            material = read_material(path, "pellet")
        except InputError:
            return
        assert material.name == "pellet"

    read()


@pytest.mark.parametrize("text", ["a = " + "[" * 50_000, "a = " + "1" * 5_000], ids=["deep", "5,000 digits"])
def test_absurd_toml_is_refused(tmp_path: Path, text: str) -> None:
    path = tmp_path / "mine.toml"
    path.write_text(text)
    with pytest.raises(InputError):
        read_toml("file", path)


def test_a_whole_number_beyond_all_floats_is_no_number() -> None:
    with pytest.raises(InputError):
        number("radius_m", 10**400)
