"""What is drawn is rounded by no more than a screen can show, in 8 bytes a sphere."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from service.scene.packing import MAGIC, SPHERE, UNKNOWN, pack_column, pack_frame, pack_walls
from service.scene.sphere_file import Spheres, read_spheres, read_surface
from tests.builders.scenes import a_series_file, a_walls_file


def unpack(content: bytes) -> tuple[dict[str, Any], bytes]:
    assert content[:4] == MAGIC
    length = int.from_bytes(content[4:8], "little")
    assert length % 8 == 0, "typed arrays begin at a multiple of their size"
    return json.loads(content[8 : 8 + length]), content[8 + length :]


def random_spheres(count: int) -> Spheres:
    rng = np.random.default_rng(7)
    positions = rng.uniform([-1.9, -1.9, -2.8], [1.9, 1.9, 0.4], (count, 3))
    data = {"Material": rng.integers(0, 3, count).astype(np.int32)}
    return Spheres(1.5, positions, rng.uniform(0.005, 0.05, count), data)


def test_a_frame_is_8_bytes_a_sphere_and_near_the_truth() -> None:
    spheres = random_spheres(500)
    head, body = unpack(pack_frame(spheres))
    assert len(body) == 8 * 500 and head["grains"] == 500 and head["time_s"] == 1.5
    rows = np.frombuffer(body, SPHERE)
    low, high = np.array(head["low"]), np.array(head["high"])
    positions = low + rows["place"] / 65535.0 * (high - low)
    # Half a level: 3.8 m / 65535 / 2 is 29 micrometres.
    assert np.abs(positions - spheres.positions).max() <= 3.8 / 65535 / 2 * 1.001
    radii = head["radius"][0] + rows["radius"] / 255.0 * (head["radius"][1] - head["radius"][0])
    assert np.abs(radii - spheres.radii).max() <= 0.045 / 255 / 2 * 1.001
    assert np.array_equal(rows["material"], spheres.data["Material"])


@pytest.mark.parametrize("count", [0, 1])
def test_a_frame_without_extent_is_packed_too(count: int) -> None:
    spheres = Spheres(0.0, np.full((count, 3), 0.25), np.full(count, 0.01), {})
    head, body = unpack(pack_frame(spheres))
    assert head["grains"] == count and len(body) == 8 * count
    if count:
        assert head["low"] == head["high"] == [0.25] * 3 and head["radius"] == [0.01, 0.01]


def test_a_column_keeps_its_ends_and_says_what_is_not_known() -> None:
    head, body = unpack(pack_column(np.array([2.0, np.nan, 6.0, 4.0])))
    assert head["range"] == [2.0, 6.0]
    assert list(body) == [0, UNKNOWN, 254, 127]
    head, body = unpack(pack_column(np.array([np.nan])))
    assert head["range"] == [0.0, 0.0] and list(body) == [UNKNOWN]


def test_walls_come_with_their_groups(tmp_path: Path) -> None:
    surface = read_surface(a_walls_file(tmp_path), 0)
    head, body = unpack(pack_walls(surface, solid=(1,)))
    assert [(group["wall"], group["solid"]) for group in head["groups"]] == [(0, False), (1, True)]
    assert sum(group["count"] for group in head["groups"]) == head["triangles"]
    points = np.frombuffer(body, "<f4", 3 * head["points"]).reshape(-1, 3)
    corners = np.frombuffer(body, "<u4", offset=12 * head["points"]).reshape(-1, 3)
    assert len(corners) == head["triangles"] and corners.max() < head["points"]
    cone = head["groups"][1]
    reached = points[corners[cone["first"] : cone["first"] + cone["count"]]]
    assert reached[..., 2].min() == pytest.approx(-0.8) and reached[..., 2].max() <= 0.0


def test_a_frame_of_a_series_is_packed_alone(tmp_path: Path) -> None:
    head, _ = unpack(pack_frame(read_spheres(a_series_file(tmp_path), 1)))
    assert head["grains"] == 6 and head["time_s"] == 2.0
