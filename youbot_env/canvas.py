"""A surface to draw on with smooth edges. Needs pygame, and imports it when it is used."""

from __future__ import annotations

import os
from collections.abc import Sequence
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from youbot_env.errors import InputError

Array = NDArray[np.float64]
Color = tuple[int, int, int]


def load_pygame() -> ModuleType:
    """pygame, or InputError that names the extra."""
    os.environ.setdefault("PYGAME_HIDE_SUPPORT_PROMPT", "1")
    try:
        import pygame
        import pygame.gfxdraw  # noqa: F401 - a submodule that pygame does not load itself
    except ImportError:
        raise InputError(
            'rendering needs pygame; install it with: pip install "youbot[render]"'
        ) from None
    return pygame


class Canvas:
    """A surface to draw on, in pixels, with smooth edges."""

    def __init__(self, width: int, height: int) -> None:
        self.pygame = load_pygame()
        self.pygame.font.init()
        self.surface = self.pygame.Surface((width, height))
        self._fonts: dict[int, Any] = {}

    def polygon(self, points: ArrayLike, color: Color) -> None:
        corners = np.rint(points).astype(int).clip(-4000, 4000).tolist()
        self.pygame.gfxdraw.filled_polygon(self.surface, corners, color)
        self.pygame.gfxdraw.aapolygon(self.surface, corners, color)

    def line(self, points: ArrayLike, color: Color, width: int = 1) -> None:
        corners = np.asarray(points, float).clip(-4000, 4000).tolist()
        if width > 1:
            self.pygame.draw.lines(self.surface, color, False, corners, width)
        else:
            self.pygame.draw.aalines(self.surface, color, False, corners)

    def bar(self, start: Array, end: Array, color: Color, width: float) -> None:
        along = unit(end - start) * width / 2
        across = np.array([-along[1], along[0]])
        self.polygon([start + across, end + across, end - across, start - across], color)

    def arrow(self, start: ArrayLike, reach: ArrayLike, color: Color, width: float) -> None:
        start, reach = np.asarray(start, float), np.asarray(reach, float)
        length = float(np.hypot(*reach))
        if length < 3:
            return
        along = reach / length
        across = np.array([-along[1], along[0]])
        head = min(3.2 * width, length)
        neck, tip = start + (length - head) * along, start + reach
        self.bar(start, neck + along, color, width)
        self.polygon([tip, neck + 0.45 * head * across, neck - 0.45 * head * across], color)

    def text(
        self, words: str, at: Sequence[float], color: Color, size: int = 16, side: int = -1
    ) -> None:
        """``side``: -1 starts at the point, 0 is centred on it, 1 ends there."""
        if size not in self._fonts:
            self._fonts[size] = self.pygame.font.Font(None, round(1.35 * size))
        drawn = self._fonts[size].render(words, True, color)
        shift = (side + 1) / 2 * drawn.get_width()
        self.surface.blit(drawn, (round(at[0] - shift), round(at[1] - drawn.get_height() / 2)))


def unit(vector: Array) -> Array:
    """The vector (2,) at length one, or zero."""
    length = float(np.hypot(*vector))
    return vector / length if length > 0 else np.zeros(2)
