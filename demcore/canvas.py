"""Orthographic views drawn by Pillow: outlines of triangles, lit spheres, lines and words in metres.

Pillow, because it is here for the pile's picture already; matplotlib would bring 40 MB for a few lines and words,
and draws no overlapping spheres right.

Notation: a view looks against its `toward`; `right` and `up` span the paper. Points (N, 3) m become pixels.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from demcore.picture import LIGHT, draw_sphere, shades

Floats = NDArray[np.float64]
Colour = tuple[int, int, int]

PAPER: Colour = (255, 255, 255)
INK: Colour = (40, 44, 52)
GREY: Colour = (140, 146, 156)
# Edges between faces that turn by more than this are drawn.
CREASE = math.cos(math.radians(20.0))
MARGIN = 14
# Of a colour scale: steps, and pixels of one.
SCALE_STEPS, STEP_WIDTH = 60, 5


class View(NamedTuple):
    """A direction to look from: three unit vectors, and its name."""

    right: tuple[float, float, float]
    up: tuple[float, float, float]
    toward: tuple[float, float, float]
    name: str


FRONT = View((1.0, 0.0, 0.0), (0.0, 0.0, 1.0), (0.0, -1.0, 0.0), "from the front: x, z")
SIDE = View((0.0, 1.0, 0.0), (0.0, 0.0, 1.0), (1.0, 0.0, 0.0), "from the far side: y, z")
TOP = View((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0), "from above: x, y")


@dataclass(frozen=True)
class Frame:
    """A rectangle of the paper, pixels, that shows the world from (left, bottom), m, at `pixels_per_m`."""

    view: View
    x: int
    y: int
    width: int
    height: int
    left: float
    bottom: float
    pixels_per_m: float

    def project(self, points: Floats) -> Floats:
        """(N, 3) pixels across, pixels down, and pixels towards the eye, inside the frame."""
        across = points @ np.array(self.view.right)
        up = points @ np.array(self.view.up)
        toward = points @ np.array(self.view.toward)
        scale = self.pixels_per_m
        down = self.height - (up - self.bottom) * scale
        return np.column_stack([(across - self.left) * scale, down, toward * scale])


def fit_frame(view: View, place: tuple[int, int, int, int], lower: Floats, upper: Floats) -> Frame:
    """The frame in `place` (x, y, width, height; pixels) that just holds the box from lower to upper (3,), m."""
    corners = np.array([lower, upper])
    across, up = corners @ np.array(view.right), corners @ np.array(view.up)
    wide, high = float(np.ptp(across)), float(np.ptp(up))
    x, y, width, height = place
    scale = min((width - 2 * MARGIN) / wide, (height - 2 * MARGIN) / high)
    left = 0.5 * float(across.sum()) - 0.5 * width / scale
    bottom = 0.5 * float(up.sum()) - 0.5 * height / scale
    return Frame(view, x, y, width, height, left, bottom, scale)


class Canvas:
    """A page of so many pixels; what is drawn in a frame is cut off at its edge."""

    def __init__(self, width: int, height: int) -> None:
        self.image = Image.new("RGB", (width, height), PAPER)
        self._draw = ImageDraw.Draw(self.image)

    def spheres(self, frame: Frame, centres: Floats, radii: Floats, colours: Floats) -> None:
        """Lit spheres: centres (N, 3) m, radii (N,) m, colours (N, 3)."""
        colour = np.empty((frame.height, frame.width, 3))
        colour[:] = PAPER
        depth = np.full((frame.height, frame.width), -np.inf)
        light = LIGHT / np.sqrt((LIGHT**2).sum())
        for place, r, paint in zip(frame.project(centres), radii * frame.pixels_per_m, colours, strict=True):
            draw_sphere(colour, depth, (place[0], place[1], place[2]), float(r), paint, light)
        picture = Image.fromarray(np.clip(colour, 0, 255).astype(np.uint8))
        drawn = Image.fromarray(np.isfinite(depth).astype(np.uint8) * 255)
        self.image.paste(picture, (frame.x, frame.y), drawn)

    def outlines(self, frame: Frame, points: Floats, triangles: NDArray[np.int64], colour: Colour) -> None:
        """The edges of a surface that an eye sees: borders, creases, and where it turns away."""
        for a, b in seen_edges(points, triangles, np.array(frame.view.toward)):
            self.line(frame, np.array([points[a], points[b]]), colour)

    def line(self, frame: Frame, points: Floats, colour: Colour, width: int = 1) -> None:
        """A line through points (N, 3), m, cut off at the frame."""
        flat = frame.project(points)[:, :2]
        for start, end in pairwise(flat):
            cut = clip_segment(start, end, (float(frame.width), float(frame.height)))
            if cut is not None:
                (ax, ay), (bx, by) = cut
                ends = [(frame.x + ax, frame.y + ay), (frame.x + bx, frame.y + by)]
                self._draw.line(ends, fill=colour, width=width)

    def words(self, x: float, y: float, text: str, size: int = 13, colour: Colour = INK) -> None:
        """Text whose upper left corner is at pixel (x, y)."""
        self._draw.text((x, y), text, fill=colour, font=ImageFont.load_default(size))

    def label(self, frame: Frame, point: Floats, text: str, colour: Colour = INK) -> None:
        """Text beside a point of the world."""
        x, y, _ = frame.project(np.array([point], float))[0]
        self.words(frame.x + x + 4, frame.y + y - 6, text, 12, colour)

    def box(self, x: float, y: float, width: float, height: float, fill: Colour) -> None:
        """A filled rectangle, pixels."""
        self._draw.rectangle([x, y, x + width, y + height], fill=fill)

    def strip(self, points: list[tuple[float, float]], colour: Colour, width: int = 2) -> None:
        """A line through pixels."""
        self._draw.line(points, fill=colour, width=width)

    def colour_scale(self, x: int, y: int, name: str, low: float, high: float) -> None:
        """The scale of `shades` with its ends, from pixel (x, y)."""
        for k, colour in enumerate(shades(np.linspace(0.0, 1.0, SCALE_STEPS))):
            red, green, blue = (int(c) for c in colour)
            self.box(x + STEP_WIDTH * k, y, STEP_WIDTH, 14, (red, green, blue))
        end = x + STEP_WIDTH * SCALE_STEPS
        self.words(x, y + 18, f"{low:.3g}", 12)
        self.words(end - 30, y + 18, f"{high:.3g}", 12)
        self.words(end + 12, y - 1, name, 13)

    def caption(self, frame: Frame, text: str) -> None:
        """The name of a frame and its scale, a metre long."""
        self.words(frame.x + 6, frame.y + 4, text, 14)
        end, low = frame.x + frame.width - 10, frame.y + frame.height - 8
        self._draw.line([(end - frame.pixels_per_m, low), (end, low)], fill=INK, width=2)
        self.words(end - frame.pixels_per_m, low - 18, "1 m", 12)
        corner = (frame.x + frame.width - 1, frame.y + frame.height - 1)
        self._draw.rectangle([(frame.x, frame.y), corner], outline=(225, 228, 232))


def seen_edges(points: Floats, triangles: NDArray[np.int64], toward: Floats) -> NDArray[np.int64]:
    """(E, 2) rows of points: edges with one face, or two that turn by more than CREASE, or one seen from the front
    and one from behind. Points that coincide count as one."""
    merged, row = np.unique(np.round(points, 6), axis=0, return_inverse=True)
    faces = row.ravel()[triangles]
    first = np.full(len(merged), -1, np.int64)
    first[row.ravel()[::-1]] = np.arange(len(points))[::-1]
    normal = np.cross(merged[faces[:, 1]] - merged[faces[:, 0]], merged[faces[:, 2]] - merged[faces[:, 0]])
    normal /= np.maximum(np.sqrt((normal**2).sum(axis=1)), 1e-300)[:, None]
    sides = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
    of = np.tile(np.arange(len(faces)), 3)
    order = np.lexsort((sides[:, 1], sides[:, 0]))
    sides, of = sides[order], of[order]
    edges, begin, count = np.unique(sides, axis=0, return_index=True, return_counts=True)
    a, b = normal[of[begin]], normal[of[np.minimum(begin + 1, len(of) - 1)]]
    crease = np.abs((a * b).sum(axis=1)) < CREASE
    turned = (a @ toward) * (b @ toward) * np.sign((a * b).sum(axis=1)) < 0.0
    chosen = (count != 2) | crease | turned
    return np.asarray(first[edges[chosen]], np.int64)


def clip_segment(
    start: Floats, end: Floats, size: tuple[float, float]
) -> tuple[tuple[float, float], tuple[float, float]] | None:
    """The part of a segment inside the rectangle from (0, 0) to `size`; None outside (Liang and Barsky 1984)."""
    low, high = 0.0, 1.0
    for c in (0, 1):
        way = end[c] - start[c]
        for direction, gap in ((-way, start[c]), (way, size[c] - start[c])):
            if direction == 0.0:
                if gap < 0.0:
                    return None
            elif direction < 0.0:
                low = max(low, gap / direction)
            else:
                high = min(high, gap / direction)
    if low > high:
        return None
    a, b = start + low * (end - start), start + high * (end - start)
    return (float(a[0]), float(a[1])), (float(b[0]), float(b[1]))
