"""Top view of a platform at work: wheels, torques, velocity and reference, trail. Needs pygame."""

from __future__ import annotations

import math
import os
from collections import deque
from collections.abc import Iterable, Mapping, Sequence
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from youbot_env.errors import InputError
from youbot_env.physics.geometry import SIGN_X, SIGN_Y, WHEELS, Geometry

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
        # A Surface needs no display, so frames can be drawn on a server.
        self.surface = self.pygame.Surface((width, height))
        self._fonts: dict[int, Any] = {}

    def polygon(self, points: ArrayLike, color: Color) -> None:
        # gfxdraw takes 16-bit coordinates.
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


VIEW, PANEL = 640, 320
"""Width [px] of the square view, and of the panel of time courses beside it."""

VIEW_WIDTH = 1.6
"""Metres that the view spans for the youBot; it grows with the platform."""

WINDOW = 5.0
"""Seconds that the time courses show."""

TRAIL = 600
"""Points of the trail that are kept, one a twentieth of a second."""

PAPER, GRID, INK, FAINT = (250, 250, 248), (228, 228, 224), (40, 44, 52), (150, 152, 158)
BODY, TYRE, ROLLER = (214, 220, 228), (70, 74, 82), (168, 174, 184)
TRUE, WANTED, PALE_WANTED = (31, 98, 190), (232, 128, 16), (250, 196, 132)
FORWARD, BACKWARD, LIMIT = (30, 150, 90), (150, 80, 170), (214, 40, 40)

AXES = ("VX [m/s]", "VY [m/s]", "W [rad/s]")


class Renderer:
    """Keeps what an episode has shown so far and draws it.

    Parameters
    ----------
    geometry : of the platform
    torque_limit : length of a full torque bar [N m]
    period : time between two ``follow`` [s]
    fps : frames per second of the window

    Raises
    ------
    InputError
        If pygame is not installed.
    """

    def __init__(self, geometry: Geometry, torque_limit: float, period: float, fps: int) -> None:
        load_pygame()
        self.geometry, self.torque_limit = geometry, torque_limit
        self.period, self.fps = period, fps
        size = max(1.0, geometry.L / Geometry().L)
        self.pixels_per_metre = VIEW / (VIEW_WIDTH * size)
        self._samples = max(2, round(WINDOW / period))
        self._stride = max(1, round(0.05 / period))
        self._followed = 0
        self._canvas: Canvas | None = None
        self._window: Any = None
        self._clock: Any = None
        self._info: Mapping[str, Any] = {}
        self._wanted_pose = np.zeros(3)
        self._trail: deque[Array] = deque(maxlen=TRAIL)
        self._wanted_trail: deque[Array] = deque(maxlen=TRAIL)
        self._courses: deque[Array] = deque(maxlen=self._samples)

    def __getstate__(self) -> dict[str, Any]:
        # pygame's objects cannot be pickled; they are made again when they are needed.
        return {**self.__dict__, "_canvas": None, "_window": None, "_clock": None}

    def begin(self, info: Mapping[str, Any]) -> None:
        """Start an episode with the ``info`` of ``reset``."""
        for past in (self._trail, self._wanted_trail, self._courses):
            past.clear()
        self._wanted_pose = np.array(info["pose"])
        self._followed = 0
        self.follow(info)

    def follow(self, info: Mapping[str, Any]) -> None:
        """Take in the ``info`` of a step."""
        if self._followed:
            self._move_wanted(info["reference_twist"])
        self._info = info
        if self._followed % self._stride == 0:
            self._trail.append(info["pose"][:2])
            self._wanted_trail.append(self._wanted_pose[:2].copy())
        self._followed += 1
        self._courses.append(np.concatenate([info["twist"], info["reference_twist"]]))

    def _move_wanted(self, twist: Array) -> None:
        """Integrate the reference's pose. It is only drawn, so one midpoint step is enough."""
        vx, vy, wz = twist * self.period
        c, s = math.cos(self._wanted_pose[2] + wz / 2), math.sin(self._wanted_pose[2] + wz / 2)
        self._wanted_pose += (c * vx - s * vy, s * vx + c * vy, wz)

    def frame(self) -> NDArray[np.uint8]:
        """The picture (640, 960, 3)."""
        surface = self._draw()
        pixels = load_pygame().surfarray.pixels3d(surface)
        # pygame's first axis is x; images have rows first. A copy: the surface changes.
        return np.ascontiguousarray(pixels.transpose(1, 0, 2))

    def show(self) -> None:
        """Show the picture in a window, no faster than ``fps``."""
        pygame = load_pygame()
        if self._window is None:
            pygame.display.init()
            self._window = pygame.display.set_mode((VIEW + PANEL, VIEW))
            pygame.display.set_caption("YouBotTracking-v0")
            self._clock = pygame.time.Clock()
        # Without it the system takes the window for one that hangs.
        pygame.event.pump()
        self._window.blit(self._draw(), (0, 0))
        pygame.display.flip()
        self._clock.tick(self.fps)

    def close(self) -> None:
        """Close the window; a later ``show`` opens a new one."""
        if self._window is not None:
            load_pygame().display.quit()
        self._window = self._clock = None

    # Drawing ------------------------------------------------------------------------------------

    def _draw(self) -> Any:
        if not self._info:
            raise InputError("render: nothing to show yet; call reset() first")
        if self._canvas is None:
            self._canvas = Canvas(VIEW + PANEL, VIEW)
        canvas, info = self._canvas, self._info
        if not np.isfinite(info["pose"]).all():
            return canvas.surface  # a diverged platform is nowhere: keep the last picture
        canvas.surface.fill(PAPER)
        self._grid(canvas)
        self._platform(canvas)
        self._trails(canvas)
        self._velocities(canvas)
        self._panel(canvas)
        return canvas.surface

    def _pixels(self, points: ArrayLike) -> Array:
        """Pixels (..., 2) of world points (..., 2) [m]; the view moves with the platform."""
        away = np.asarray(points, float) - self._info["pose"][:2]
        # Pixels count downwards, world Y upwards.
        return VIEW / 2 + self.pixels_per_metre * away * (1.0, -1.0)

    def _placed(self, points: ArrayLike) -> Array:
        """Pixels (..., 2) of points (..., 2) [m] of the body frame."""
        return VIEW / 2 + self._turned(points)

    def _turned(self, vectors: ArrayLike) -> Array:
        yaw = self._info["pose"][2]
        c, s = math.cos(yaw), math.sin(yaw)
        turned = np.asarray(vectors, float) @ np.array([[c, s], [-s, c]])
        return self.pixels_per_metre * turned * (1.0, -1.0)

    def _grid(self, canvas: Canvas) -> None:
        x, y = self._info["pose"][:2]
        reach = VIEW / self.pixels_per_metre / 2
        for at in np.arange(math.ceil((x - reach) * 2), (x + reach) * 2) / 2:
            canvas.line(self._pixels([(at, y - reach), (at, y + reach)]), GRID)
        for at in np.arange(math.ceil((y - reach) * 2), (y + reach) * 2) / 2:
            canvas.line(self._pixels([(x - reach, at), (x + reach, at)]), GRID)

    def _trails(self, canvas: Canvas) -> None:
        ends = self._wanted_pose[:2], self._info["pose"][:2]
        past = ((self._wanted_trail, PALE_WANTED, 4), (self._trail, TRUE, 2))
        for (trail, color, width), end in zip(past, ends, strict=True):
            canvas.line(self._pixels([*trail, end]), color, width)

    def _platform(self, canvas: Canvas) -> None:
        g, info = self.geometry, self._info
        length, width = g.h + 0.6 * g.R, g.l - 0.6 * g.R
        canvas.polygon(self._placed(_box(0, 0, length, width)), BODY)
        nose = [(length, 0.3 * width), (length, -0.3 * width), (length - 0.3 * width, 0)]
        canvas.polygon(self._placed(nose), FAINT)
        for i in range(4):
            x, y = SIGN_X[i] * g.h, SIGN_Y[i] * g.l
            canvas.polygon(self._placed(_box(x, y, g.R, 0.5 * g.R)), TYRE)
            for stripe in _stripes(g.R, -g.tangents[i], float(info["wheel_angle"][i])):
                canvas.line(self._placed(np.add(stripe, (x, y))), ROLLER, 2)
            self._torque(canvas, i, x, y + SIGN_Y[i] * 1.6 * g.R)

    def _torque(self, canvas: Canvas, wheel: int, x: float, y: float) -> None:
        """A bar along the wheel, as long as the wheel at a quarter of the limit."""
        torque = float(self._info["applied_torque"][wheel])
        full = 4 * self.geometry.R
        length = full * max(-1.2, min(1.2, torque / self.torque_limit))
        color = FORWARD if torque >= 0 else BACKWARD
        if self._info["saturated"][wheel]:
            color = LIMIT
        thick = 0.22 * self.geometry.R
        canvas.polygon(self._placed(_box(x, y, full, thick)), GRID)
        canvas.polygon(self._placed(_box(x + length / 2, y, abs(length) / 2, thick)), color)
        ends = self._placed([(x, y - 1.6 * thick), (x, y + 1.6 * thick)])
        canvas.line(ends, INK, 2)

    def _velocities(self, canvas: Canvas) -> None:
        """Both arrows from O; an arrow of the view's half is 0.8 m/s. Yaw rates are arcs."""
        for key, color, width in (("reference_twist", WANTED, 9.0), ("twist", TRUE, 4.0)):
            twist = self._info[key]
            canvas.arrow(self._placed((0, 0)), self._turned(1.25 * twist[:2]), color, width)
            self._arc(canvas, float(twist[2]), color, width)

    def _arc(self, canvas: Canvas, yaw_rate: float, color: Color, width: float) -> None:
        """From straight ahead, as long as the platform would turn in a second."""
        radius = 1.75 * self.geometry.L
        swing = max(-3.0, min(3.0, yaw_rate))
        if abs(swing) < 0.02:
            return
        angle = np.linspace(0, swing, max(2, math.ceil(abs(swing) / 0.05)))
        points = self._placed(radius * np.column_stack([np.cos(angle), np.sin(angle)]))
        canvas.line(points, color, round(0.6 * width))
        canvas.arrow(points[-1], 14 * unit(points[-1] - points[-2]), color, width)

    def _panel(self, canvas: Canvas) -> None:
        info = self._info
        canvas.pygame.draw.rect(canvas.surface, (255, 255, 255), (VIEW, 0, PANEL, VIEW))
        canvas.line([(VIEW, 0), (VIEW, VIEW)], FAINT)
        canvas.text(f"t = {info['time']:.2f} s", (14, 20), INK, 18)
        canvas.text("grid 0.5 m", (14, 42), FAINT, 13)
        canvas.text("platform", (VIEW + 14, 20), TRUE)
        canvas.text("reference", (VIEW + 100, 20), WANTED)
        courses = np.array(self._courses)
        for axis, title in enumerate(AXES):
            self._course(canvas, axis, title, courses[:, [axis + 3, axis]])
        self._torque_list(canvas, VIEW - 68)

    def _course(self, canvas: Canvas, axis: int, title: str, values: Array) -> None:
        """One axis over the last seconds: reference below, platform on top."""
        left, right, top, height = VIEW + 14, VIEW + PANEL - 14, 44 + 174 * axis, 124
        middle = top + 26 + height / 2
        error = float(self._info["tracking_error"][axis])
        canvas.text(title, (left, top + 12), INK, 14)
        canvas.text(f"error {error:+.3f}", (right, top + 12), INK, 14, side=1)
        # At least 0.05, so that noise about zero does not fill the panel.
        reach = max(0.05, _round_up(float(np.nanmax(np.abs(values)))))
        for level in (-reach, 0.0, reach):
            y = middle - level / reach * height / 2
            canvas.line([(left, y), (right, y)], GRID)
        canvas.text(f"{reach:g}", (right, middle - height / 2 + 8), FAINT, 11, side=1)
        if len(values) > 1:
            step = (right - left) / (self._samples - 1)
            x = right - step * np.arange(len(values))[::-1]
            for k, color, width in ((0, PALE_WANTED, 5), (1, TRUE, 2)):
                y = middle - values[:, k].clip(-reach, reach) / reach * height / 2
                canvas.line(np.column_stack([x, y]), color, width)

    def _torque_list(self, canvas: Canvas, top: float) -> None:
        canvas.text("torque [N m]", (VIEW + 14, top), INK, 14)
        torques: Iterable[float] = self._info["applied_torque"].tolist()
        for i, torque in enumerate(torques):
            color = LIMIT if self._info["saturated"][i] else INK
            at = VIEW + 14 + 74 * i
            canvas.text(WHEELS[i], (at, top + 22), FAINT, 13)
            canvas.text(f"{torque:+.2f}", (at + 66, top + 22), color, 14, side=1)


def _box(x: float, y: float, half_length: float, half_width: float) -> Array:
    """Corners (4, 2) of a rectangle along the body's axes."""
    corners = np.array([(1, 1), (1, -1), (-1, -1), (-1, 1)])
    return corners * (half_length, half_width) + (x, y)


def _stripes(radius: float, slant: float, angle: float) -> Array:
    """Rollers (k, 2, 2) as seen from above, on a wheel at the origin turned by ``angle`` [rad].

    What the eye sees is the wheel's upper side: its rollers slant the other way than the ones on
    the floor, and they move forward with the rim as the wheel rolls forward.
    """
    count = 8
    at = (np.arange(count) * 2 * math.pi / count + angle) % (2 * math.pi)
    upper = at[at < math.pi]
    x = -0.9 * radius * np.cos(upper)
    lean = 0.42 * radius * np.sin(upper)  # foreshortened towards the rim
    return np.stack([np.column_stack([x + k * lean, k * slant * lean]) for k in (-1, 1)], axis=1)


def _round_up(value: float) -> float:
    """The next of 1, 2, 5 times a power of ten."""
    if not value > 0 or not math.isfinite(value):
        return 0.0
    base = 10.0 ** math.floor(math.log10(value))
    return next(base * step for step in (1, 2, 5, 10) if base * step >= value * 0.999)
