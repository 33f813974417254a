"""What a page shows, as numbers."""

from __future__ import annotations

import io

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from playwright.sync_api import Page

Pixels = NDArray[np.int_]


def pixels(page: Page) -> Pixels:
    """Red, green and blue (h, w, 3) of the 3-D scene on a page, which should stand still."""
    # Without a graphics card, a picture takes long on a machine that is busy.
    shot = page.screenshot(timeout=120_000, clip=page.locator("canvas").first.bounding_box())
    picture = Image.open(io.BytesIO(shot)).convert("RGB")
    return np.array(picture).astype(int)


def count(picture: Pixels, colour: str) -> int:
    """Number of pixels of about a colour, #rrggbb."""
    wanted = list(bytes.fromhex(colour[1:]))
    return int(np.sum(np.abs(picture - wanted).max(axis=-1) < 24))


def differing(first: Pixels, second: Pixels) -> float:
    """Share of pixels that differ visibly."""
    return float(np.mean(np.abs(first - second).max(axis=-1) > 30))
