"""The picture of a pile: lit spheres drawn with numpy, so that no screen and no graphics library is needed.

A parallel projection, seen from the front and 25 degrees above; each sphere is a shaded disc in a depth buffer.
Matplotlib draws no overlapping spheres right, and a VTK install is a hundred times this page.
"""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

WIDTH, HEIGHT = 900, 520
ELEVATION_DEG = 25.0
BACKGROUND = (244, 245, 247)
STEEL = (176, 182, 190)
# Nine stops of matplotlib's viridis (van der Walt and Smith 2015, public domain): even steps in lightness.
VIRIDIS = np.array(
    [
        (68, 1, 84),
        (72, 40, 120),
        (62, 74, 137),
        (49, 104, 142),
        (38, 130, 142),
        (31, 158, 137),
        (53, 183, 121),
        (110, 206, 88),
        (253, 231, 37),
    ],
    float,
)
LIGHT = np.array([-0.45, 0.55, 0.70])

Floats = NDArray[np.float64]


def draw_pile(position: Floats, radius: Floats, base_radius: float, path: Path) -> None:
    """Write a PNG of spheres on a round base at z = 0, coloured by height; (N, 3) m, (N,) m; whole or not."""
    save_png(Image.fromarray(render_spheres(position, radius, base_radius)), path)


def render_spheres(position: Floats, radius: Floats, base_radius: float) -> NDArray[np.uint8]:
    """(HEIGHT, WIDTH, 3) picture of spheres on a round base at z = 0; positions (N, 3) m, radii (N,) m."""
    up = np.radians(ELEVATION_DEG)
    pixels_per_m = 0.46 * WIDTH / (base_radius + float(radius.max(initial=0.0)))
    colour = np.empty((HEIGHT, WIDTH, 3))
    colour[:] = BACKGROUND
    depth = np.full((HEIGHT, WIDTH), -np.inf)

    def project(p: Floats) -> tuple[Floats, Floats, Floats]:
        x = WIDTH / 2 + p[:, 0] * pixels_per_m
        y = HEIGHT * 0.66 - (p[:, 2] * np.cos(up) + p[:, 1] * np.sin(up)) * pixels_per_m
        toward = (p[:, 2] * np.sin(up) - p[:, 1] * np.cos(up)) * pixels_per_m
        return x, y, toward

    _draw_base(colour, depth, base_radius * pixels_per_m, up)
    top = float((position[:, 2] + radius).max(initial=1e-9))
    palette = shades(position[:, 2] / top)
    light = LIGHT / np.sqrt((LIGHT**2).sum())
    for x, y, near, r, paint in zip(*project(position), radius * pixels_per_m, palette, strict=True):
        draw_sphere(colour, depth, (float(x), float(y), float(near)), float(r), paint, light)
    return np.clip(colour, 0, 255).astype(np.uint8)


def shades(share: Floats) -> Floats:
    """(N, 3) colours for shares (N,) of the scale, 0 to 1."""
    stops = np.linspace(0.0, 1.0, len(VIRIDIS))
    clipped = np.clip(share, 0.0, 1.0)
    return np.column_stack([np.interp(clipped, stops, VIRIDIS[:, c]) for c in range(3)])


def save_png(picture: Image.Image, path: Path) -> None:
    """Write a PNG, whole or not at all."""
    aside = path.with_name(path.name + ".part")
    picture.save(aside, format="PNG", optimize=True)
    os.replace(aside, path)


def _draw_base(colour: Floats, depth: Floats, radius: float, up: float) -> None:
    """The steel disc, as an ellipse; its depth is that of the tilted plane."""
    y, x = np.mgrid[0:HEIGHT, 0:WIDTH]
    across = x + 0.5 - WIDTH / 2
    away = -(y + 0.5 - HEIGHT * 0.66) / np.sin(up)
    on = across**2 + away**2 <= radius**2
    colour[on] = STEEL
    depth[on] = -away[on] * np.cos(up)


def draw_sphere(
    colour: Floats, depth: Floats, centre: tuple[float, float, float], r: float, paint: Floats, light: Floats
) -> None:
    """Shade a sphere into a picture (H, W, 3) with its depth buffer (H, W); all in pixels."""
    x, y, near = centre
    x0, x1 = max(0, int(x - r)), min(depth.shape[1], int(x + r) + 2)
    y0, y1 = max(0, int(y - r)), min(depth.shape[0], int(y + r) + 2)
    if x0 >= x1 or y0 >= y1:
        return
    v, u = np.mgrid[y0:y1, x0:x1]
    u = (u + 0.5 - x) / r
    v = (y - v - 0.5) / r
    square = u * u + v * v
    w = np.sqrt(np.maximum(1.0 - square, 0.0))
    here = depth[y0:y1, x0:x1]
    front = (square <= 1.0) & (near + w * r > here)
    here[front] = (near + w * r)[front]
    shade = 0.35 + 0.65 * np.clip(u * light[0] + v * light[1] + w * light[2], 0.0, 1.0)
    colour[y0:y1, x0:x1][front] = (shade[..., None] * paint)[front]
