"""How every figure looks: colours, type, layout, thinning of long lines, and writing to files."""

from __future__ import annotations

import io
import os
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, Any, ParamSpec

import numpy as np
from numpy.typing import NDArray

from youbot_env.caching import private_folder
from youbot_env.errors import InputError, optional_library
from youbot_env.files import write_atomically

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Array = NDArray[np.float64]
Drawing = ParamSpec("Drawing")

# Okabe and Ito's palette (2008), which colour-blind readers can tell apart.
# The model is a thin line over the thick measured one: both stay visible where they agree.
MEASURED = {"color": "#a6a6a6", "linewidth": 3.2, "solid_capstyle": "round"}
PREDICTED = {"color": "#d55e00", "linewidth": 1.0}
REFERENCE = {"color": "#0072b2", "linewidth": 1.1}
RESIDUAL = {"color": "#4d4d4d", "linewidth": 0.6}
ESTIMATE = {"color": "#0072b2", "linewidth": 1.4}
FLOOR = {"color": "#56b4e9", "alpha": 0.4, "linewidth": 0}
BATCH = {"color": "#d55e00", "linewidth": 1.1, "linestyle": (0, (5, 2))}
TRUTH = {"color": "#222222", "linewidth": 1.1, "linestyle": (0, (1, 1.5))}
BAR, WORST = "#9ecae1", "#d55e00"
GREY = "#6e6e6e"

WIDTH = 10.0
"""Inches; with DPI, a picture that fits a README and a laptop's screen at 100 %."""

DPI = 100
BINS = 900
"""Stretches of a line that are drawn: about one for each pixel of an axis."""

BAND = 1.96
"""Standard deviations either side that hold 95 % of normal noise: half the width of a band."""

MAX_CURVES = 5
"""Curves in the figure of a residual: what fits a screen."""

STYLE = {
    "font.family": "DejaVu Sans",  # ships with matplotlib: the same picture everywhere
    "font.size": 10,
    "axes.titlesize": 12,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.labelsize": 10,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.edgecolor": GREY,
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.xmargin": 0.0,
    "grid.color": "#e4e4e4",
    "grid.linewidth": 0.7,
    "legend.frameon": False,
    "legend.fontsize": 10,
    "xtick.color": GREY,
    "ytick.color": GREY,
    "xtick.labelcolor": "black",
    "ytick.labelcolor": "black",
    "xtick.labelsize": 9,
    "ytick.labelsize": 9,
    "svg.hashsalt": "youbot",  # names inside of an SVG: the same figure gives the same bytes
    "figure.constrained_layout.h_pad": 0.03,
    "figure.constrained_layout.w_pad": 0.05,
}


def matplotlib() -> Any:
    """The matplotlib package, loaded only when something is drawn.

    Raises
    ------
    InputError
        If it is not installed.
    """
    instead = "leave --plots and --report out"
    # What is drawn here needs no backend of pyplot, and a wrong name of one would stop the import.
    backend = os.environ.pop("MPLBACKEND", None)
    try:
        _give_folder()
        return optional_library("matplotlib", "plots", "plots need matplotlib", instead)
    finally:
        if backend is not None:
            os.environ["MPLBACKEND"] = backend


def _give_folder() -> None:
    """Name a folder for matplotlib's list of fonts where the user has none: it would warn."""
    try:
        has_home = os.access(Path.home(), os.W_OK)
    except RuntimeError:  # a user without a home, as in a container
        has_home = False
    if not has_home:
        os.environ.setdefault("MPLCONFIGDIR", str(private_folder()))


@contextmanager
def style() -> Iterator[None]:
    """This module's style, independent of the user's settings, which are restored afterwards."""
    mpl = matplotlib()
    with mpl.rc_context():
        mpl.rcdefaults()
        mpl.rcParams.update(STYLE)
        yield


def styled(draw: Callable[Drawing, Figure]) -> Callable[Drawing, Figure]:
    """Decorator: draw in this module's style."""

    @wraps(draw)
    def drawn(*args: Drawing.args, **kwargs: Drawing.kwargs) -> Figure:
        with style():
            return draw(*args, **kwargs)

    return drawn


def new_figure(height: float) -> Figure:
    """An empty figure [inches] that is drawn by Agg, whatever pyplot's backend is."""
    matplotlib()
    # Not pyplot: it keeps figures alive and may open a window or need a display.
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(WIDTH, height), dpi=DPI, layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def png(figure: Figure) -> bytes:
    """A figure as a PNG file's content; the same figure gives the same bytes.

    Its 256 colours are ample for these figures and make the file a third as large.
    """
    from PIL import Image  # which matplotlib needs for its own PNG files

    with style():
        figure.canvas.draw()
    # Without the alpha channel, since the background is opaque.
    picture = Image.fromarray(np.asarray(figure.canvas.buffer_rgba())[..., :3])  # type: ignore
    content = io.BytesIO()
    colours = picture.quantize(256, method=Image.Quantize.MAXCOVERAGE, dither=Image.Dither.NONE)
    colours.save(content, "png", optimize=True, dpi=(DPI, DPI))
    return content.getvalue()


def svg(figure: Figure) -> bytes:
    """A figure as an SVG file's content, for a paper; the same figure gives the same bytes."""
    content = io.BytesIO()
    with style():
        figure.savefig(content, format="svg", metadata={"Date": None})
    return content.getvalue()


def write_figure(path: Path, figure: Figure) -> Path:
    """Write a PNG file and an SVG file beside it, each whole or not at all; the PNG's path.

    Raises
    ------
    InputError
        If the file cannot be written.
    """
    write_atomically(path, png(figure))
    write_atomically(path.with_suffix(".svg"), svg(figure))
    return path


def write_figures(folder: str | Path, named: Iterable[tuple[str, Figure]]) -> list[Path]:
    """Write figures as NAME.png into a folder, which is made if missing.

    Each is drawn and written before the next, so that memory holds one.

    Raises
    ------
    InputError
        If matplotlib is not installed or a file cannot be written.
    """
    matplotlib()
    folder = Path(folder)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"{folder}: cannot be made a folder: {error.strerror}") from None
    return [write_figure(folder / f"{name}.png", figure) for name, figure in named]


def thin(time: Array, values: Array, bins: int = BINS) -> tuple[Array, Array]:
    """A line (n,) reduced to the least and the greatest value of each of ``bins``."""
    # Two points are kept for each bin: a shorter line has none to lose.
    if len(time) <= 2 * bins:
        return time, values
    edges = np.linspace(0, len(time), bins + 1).astype(int)
    rows = [0, len(time) - 1]
    for a, b in zip(edges, edges[1:], strict=False):
        rows += [a + int(values[a:b].argmin()), a + int(values[a:b].argmax())]
    kept = np.unique(rows)
    return time[kept], values[kept]


def line(axes: Axes, time: Array, values: Array, **look: Any) -> None:
    """Draw a line, thinned where it is long."""
    axes.plot(*thin(time, values), **look)


def header(axes: Axes, title: str) -> None:
    """Above the axes, from the top: title, legend, room for names of stretches."""
    from matplotlib.transforms import ScaledTranslation

    axes.set_title(plain(title), pad=38)
    figure = axes.get_figure()
    assert figure is not None
    # 17 points (1/72 inch) above the axes leave room for the names of stretches.
    legend = axes.legend(
        loc="lower left",
        bbox_to_anchor=(0, 1),
        bbox_transform=axes.transAxes + ScaledTranslation(0, 17 / 72, figure.dpi_scale_trans),
        ncols=5,
        borderaxespad=0,
        borderpad=0,
        handlelength=2.2,
        columnspacing=1.8,
    )
    legend.set_in_layout(False)  # wider than its panel, where there are two columns


def plain(text: str) -> str:
    """Text of a user's (a file's name, say) that matplotlib must not read as mathematics."""
    return text.replace("$", r"\$")


def margin_note(axes: Axes, text: str) -> None:
    """Small text in the right margin."""
    axes.annotate(
        text, (1, 0.5), (6, 0), "axes fraction", "offset points",
        va="center", ha="left", fontsize=9, color=GREY, linespacing=1.35,
    )  # fmt: skip


def mark_stretches(panels: Sequence[Axes], stretches: Sequence[tuple[str, float, float]]) -> None:
    """Name stretches (name, start, end) [s] above the first panel; lines part them in all."""
    for name, start, end in stretches:
        panels[0].annotate(
            plain(name), (0.5 * (start + end), 1), (0, 3), ("data", "axes fraction"),
            "offset points",
            ha="center", va="bottom", fontsize=9, color=GREY,
        )  # fmt: skip
    for (_, _, end), (_, start, _) in zip(stretches, stretches[1:], strict=False):
        for axes in panels:
            axes.axvline(0.5 * (end + start), color="#bdbdbd", linewidth=0.9, zorder=0.5)


def symmetric(axes: Axes, half: float) -> None:
    """Ordinate from -half to half, so that zero is in the middle."""
    half = half if np.isfinite(half) and half > 0 else 1.0
    axes.set_ylim(-half, half)


def percent(value: float) -> str:
    """A ratio with two digits for people; "-" where there is none."""
    if not np.isfinite(value):
        return "-"
    # 99.5 and more would be 1.0e+02 with two digits.
    few = value < 0.995
    return f"{100 * value:#.2g} %".replace(". %", " %") if few else f"{100 * value:.0f} %"
