"""What a page shows, as numbers."""

from __future__ import annotations

import io
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from PIL import Image

if TYPE_CHECKING:
    from playwright.sync_api import Page

Pixels = NDArray[np.int_]
# How often a scene is looked at, and for how long it is left alone in between, ms.
_TRIES, _PAUSE = 60, 300


def pixels(page: Page) -> Pixels:
    """Red, green and blue (h, w, 3) of the 3-D scene on a page, which should stand still."""
    shot = page.screenshot(clip=page.locator("canvas").first.bounding_box())
    picture = Image.open(io.BytesIO(shot)).convert("RGB")
    return np.array(picture).astype(int)


def still(page: Page) -> Pixels:
    """The scene once it stands still and there is something in it."""
    picture = pixels(page)
    for _ in range(_TRIES):
        page.wait_for_timeout(_PAUSE)
        picture, before = pixels(page), picture
        if np.array_equal(picture, before) and np.ptp(picture) > 0:
            return picture
    raise AssertionError("the scene does not come to rest")


def moved_from(page: Page, before: Pixels, share: float) -> Pixels:
    """The scene as soon as more than a share of its pixels differs from an earlier picture."""
    for _ in range(_TRIES):
        picture = pixels(page)
        if differing(before, picture) > share:
            return picture
        page.wait_for_timeout(_PAUSE)
    raise AssertionError("the scene stays as it was")


def count(picture: Pixels, colour: str) -> int:
    """Number of pixels of about a colour, #rrggbb."""
    wanted = list(bytes.fromhex(colour[1:]))
    return int(np.sum(np.abs(picture - wanted).max(axis=-1) < 24))


def differing(first: Pixels, second: Pixels) -> float:
    """Share of pixels that differ visibly."""
    return float(np.mean(np.abs(first - second).max(axis=-1) > 30))
