"""Animations of closed loops: a view of the floor and time courses for each, side by side."""

from __future__ import annotations

import io
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from controllers.loop import Trace, at_limit
from youbot_env.errors import InputError, optional_library
from youbot_env.files import write_atomically
from youbot_env.physics.geometry import Geometry
from youbot_env.tracking.rendering import Renderer

if TYPE_CHECKING:
    from PIL.Image import Image

LABEL = 26
"""Height [px] of the line above a view that names it."""

COLOURS = 128
"""Of a GIF: the views are flat areas, and each further bit makes the file larger."""

ENDINGS = (".gif", ".mp4")


def check_ending(path: Path) -> None:
    """Refuse a file that no animation is written to, before anything is driven.

    Raises
    ------
    InputError
        If it does not end in one of ``ENDINGS``, or the library for it is missing.
    """
    if path.suffix not in ENDINGS:
        raise InputError(f"{path}: an animation is {' or '.join(ENDINGS)}")
    if path.suffix == ".mp4":
        _encoder()


def frames(
    traces: Mapping[str, Trace], geometry: Geometry, fps: float, height: int
) -> Iterator[Image]:
    """Pictures of all loops at once, one beside the other, ``fps`` of them a second.

    A loop that diverged stays at its last instant.

    Parameters
    ----------
    traces : by what is written above each; all with one period
    height : of a view [px]; it is 1.5 times as wide
    """
    from PIL import Image, ImageDraw, ImageFont

    views = [_View(trace, geometry) for trace in traces.values()]
    width, count = round(1.5 * height), max(len(trace.states) for trace in traces.values())
    font = ImageFont.load_default(size=0.6 * LABEL)
    for at in np.arange(0, count, 1.0 / (fps * views[0].trace.period)).astype(int):
        picture = Image.new("RGB", (width * len(views), height + LABEL), "white")
        pen = ImageDraw.Draw(picture)
        for k, (name, view) in enumerate(zip(traces, views, strict=True)):
            pen.text((k * width + 8, 4), name, fill="black", font=font)
            shown = Image.fromarray(view.at(int(at))).resize((width, height))
            picture.paste(shown, (k * width, LABEL))
        yield picture


class _View:
    """One loop, drawn at later and later instants."""

    def __init__(self, trace: Trace, geometry: Geometry) -> None:
        self.trace, self._next = trace, 0
        self._renderer = Renderer(geometry, trace.torque_limit, trace.period, fps=30)

    def at(self, index: int) -> NDArray[np.uint8]:
        """The picture of an instant, which comes after those asked for before."""
        while self._next <= min(index, len(self.trace.states) - 1):
            info = _info(self.trace, self._next)
            (self._renderer.follow if self._next else self._renderer.begin)(info)
            self._next += 1
        return self._renderer.frame()


def _info(trace: Trace, k: int) -> dict[str, Any]:
    """What the renderer reads, as an environment's ``info`` has it."""
    # The command of an instant acts after it; what is seen at an instant was commanded before.
    torque = trace.command[max(k - 1, 0)]
    return {
        "time": k * trace.period,
        "pose": trace.pose[k],
        "twist": trace.twist[k],
        "reference_twist": trace.reference[k],
        "tracking_error": trace.reference[k] - trace.twist[k],
        "wheel_angle": trace.states[k, 6:10],
        "applied_torque": torque,
        "saturated": at_limit(torque, trace.torque_limit),
    }


def write_animation(path: Path, pictures: Sequence[Image], fps: float) -> None:
    """Write a GIF (it repeats for ever) or an MP4 (H.264), whole or not at all.

    Raises
    ------
    InputError
        If the file cannot be written.
    """
    if path.suffix == ".gif":
        write_atomically(path, gif(pictures, [1000 / fps] * len(pictures)))
    else:
        _write_film(path, pictures, fps)


def gif(pictures: Sequence[Image], milliseconds: Sequence[float]) -> bytes:
    """Pictures as a GIF file's content, each shown for its time.

    All have the same colours, the most frequent ones of some of them; else they would flicker.
    """
    from PIL import Image

    width, height = pictures[0].size
    some = pictures[:: max(1, len(pictures) // 8)]
    sheet = Image.new("RGB", (width, height * len(some)))
    for k, picture in enumerate(some):
        sheet.paste(picture, (0, k * height))
    palette = sheet.quantize(COLOURS, Image.Quantize.FASTOCTREE, dither=Image.Dither.NONE)
    few = [picture.quantize(palette=palette, dither=Image.Dither.NONE) for picture in pictures]
    content = io.BytesIO()
    few[0].save(
        content, "gif", save_all=True, append_images=few[1:],
        duration=[round(time) for time in milliseconds], loop=0, optimize=True,
    )  # fmt: skip
    return content.getvalue()


def _encoder() -> Any:
    instead = "write a .gif"
    return optional_library("imageio_ffmpeg", "video", "mp4 needs imageio-ffmpeg", instead)


def _write_film(path: Path, pictures: Sequence[Image], fps: float) -> None:
    import tempfile

    width, height = pictures[0].size
    # The encoder takes whole blocks of two pixels; the border that is cut off is white.
    size = (width - width % 2, height - height % 2)
    with tempfile.TemporaryDirectory() as folder:
        film = Path(folder) / "film.mp4"
        writer = _encoder().write_frames(str(film), size, fps=fps, macro_block_size=2)
        writer.send(None)
        for picture in pictures:
            writer.send(np.ascontiguousarray(picture.crop((0, 0, *size))))
        writer.close()
        write_atomically(path, film.read_bytes())
