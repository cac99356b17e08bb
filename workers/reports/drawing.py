"""Plots as SVG, drawn by matplotlib, in colours that the page sets and with one element for each point."""

from __future__ import annotations

import io
import re
from html import escape
from typing import Any, Final

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter
from numpy.typing import NDArray

from workers.reports.plots import ARROW_SCALE, Plot, column

Floats = NDArray[np.float64]
Json = dict[str, Any]
POINTS: Final = "points"
# Colours that nothing else is drawn in, and the page's variable for each.
_INK, _LINE, _POINT, _STRONG = "#010203", "#040506", "#070809", "#0a0b0c"
_VARIABLES: Final = {_INK: "--text", _LINE: "--line-strong", _POINT: "--accent", _STRONG: "--warn"}
_STYLE: Final[Any] = {
    "font.family": ["sans-serif"],
    "font.size": 9.0,
    "text.color": _INK,
    "text.parse_math": False,
    "axes.labelcolor": _INK,
    "axes.edgecolor": _LINE,
    "axes.linewidth": 0.7,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": _LINE,
    "grid.linewidth": 0.4,
    "grid.alpha": 0.5,
    "xtick.color": _LINE,
    "ytick.color": _LINE,
    "xtick.labelcolor": _INK,
    "ytick.labelcolor": _INK,
    "svg.fonttype": "none",
    "image.cmap": "viridis",
    "path.simplify": False,
}
_SIZE_IN: Final = (4.3, 3.1)
_DPI: Final = 72
# Above this quantile measured errors share the last colour: one wrong mark must not hide the rest.
_MOST_COLOUR: Final = 0.98
_USE = re.compile(r'<use xlink:href="#(\w+)" x="([-\d.e]+)" y="([-\d.e]+)"(?: style="([^"]*)")?/>')
_FILL = re.compile(r"fill: (#[0-9a-f]{6})")
_ARROW = re.compile(
    r'<path d="M ([-\d.e]+) ([-\d.e]+) \nL ([-\d.e]+) ([-\d.e]+) \n" style="fill: none; stroke: #070809[^"]*"/>'
)


def draw(plot: Plot, document: Json) -> str:
    """The plot as an SVG element. Its group ``NAME-points`` has one element for each point that can be chosen."""
    with mpl.rc_context({**_STYLE, "svg.hashsalt": plot.name}):
        figure = Figure(figsize=_SIZE_IN, dpi=_DPI, layout="constrained")
        FigureCanvasSVG(figure)
        figure.patch.set_visible(False)
        axes = figure.add_subplot()
        axes.patch.set_visible(False)
        axes.set_xlabel(plot.x_label)
        axes.set_ylabel(plot.y_label)
        _scales(axes, plot, document)
        if plot.mesh:
            _mesh(figure, axes, plot, column(document, plot.mesh))
        elif plot.to_x:
            _arrows(axes, plot, document)
        else:
            _points(figure, axes, plot, document)
        file = io.BytesIO()
        figure.savefig(file, format="svg", transparent=True, metadata={"Date": None, "Creator": None})
    return _inline(file.getvalue().decode(), plot)


def _scales(axes: Axes, plot: Plot, document: Json) -> None:
    if plot.is_image:
        width, height = document["result"]["intrinsics"]["image_size"]
        axes.set_xlim(-0.5, width - 0.5)
        axes.set_ylim(height - 0.5, -0.5)
        axes.set_aspect("equal")
    if plot.is_equal:
        axes.set_aspect("equal", adjustable="datalim")
        if "down" in plot.y_label:
            axes.invert_yaxis()
    if plot.is_log:
        axes.set_yscale("log")
        axes.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        axes.yaxis.set_minor_formatter(NullFormatter())


def _numbers(document: Json, path: str) -> Floats:
    return np.array(column(document, path), np.float64)


def _points(figure: Figure, axes: Axes, plot: Plot, document: Json) -> None:
    y = _numbers(document, plot.y)
    x = _numbers(document, plot.x) if plot.x else np.arange(len(y), dtype=np.float64)
    shown = np.isfinite(x) & np.isfinite(y)
    if plot.colour:
        values = _numbers(document, plot.colour)
        most = float(np.nanquantile(values, _MOST_COLOUR)) if np.isfinite(values).any() else 1.0
        drawn = axes.scatter(
            x[shown], y[shown], s=11, c=values[shown], vmin=0.0, vmax=most, linewidths=0, plotnonfinite=True
        )
        figure.colorbar(drawn, ax=axes, label=plot.colour_label, extend="max")
    else:
        drawn = axes.scatter(x[shown], y[shown], s=9, c=_POINT, linewidths=0)
    drawn.set_gid(f"{plot.name}-{POINTS}")
    drawn.set_clip_on(False)
    drawn.set_in_layout(False)
    if plot.steps:
        _rings(axes, document[plot.steps])
    if plot.person:
        people = column(document, plot.person)
        axes.plot(people["mean_u"], people["mean_v"], "+", color=_STRONG, markersize=14, markeredgewidth=2)
    if plot.y.endswith("error_px"):
        axes.set_ylim(bottom=0.0)


def _rings(axes: Axes, rings: list[Json]) -> None:
    for ring in rings:
        axes.plot([ring["from_deg"], ring["to_deg"]], [ring["rms_px"]] * 2, color=_STRONG, linewidth=2)


def _arrows(axes: Axes, plot: Plot, document: Json) -> None:
    start = np.column_stack([_numbers(document, plot.x), _numbers(document, plot.y)])
    off = np.column_stack([_numbers(document, plot.to_x), _numbers(document, plot.to_y)])
    shown = np.isfinite(start).all(axis=1)
    ends = start[shown] + ARROW_SCALE * off[shown]
    lines = LineCollection(np.stack([start[shown], ends], axis=1).tolist(), colors=_POINT, linewidths=1.1)
    lines.set_gid(f"{plot.name}-{POINTS}")
    # Long arrows reach beyond the axes; they must not push these aside.
    lines.set_clip_on(False)
    lines.set_in_layout(False)
    axes.add_collection(lines, autolim=False)
    axes.plot(*start[shown].T, ".", color=_STRONG, markersize=2.0)


def _mesh(figure: Figure, axes: Axes, plot: Plot, grid: Json) -> None:
    table = np.array(grid["sigma_px"], np.float64)
    if not np.isfinite(table).any():
        axes.text(0.5, 0.5, "not stated", transform=axes.transAxes, ha="center")
        return
    drawn = axes.pcolormesh(
        grid["across"],
        grid["down"],
        np.ma.masked_invalid(table),
        vmin=0.0,
        vmax=float(np.nanquantile(table, _MOST_COLOUR)),
        shading="nearest",
        rasterized=True,
    )
    figure.colorbar(drawn, ax=axes, label=plot.colour_label, extend="max")


def _inline(svg: str, plot: Plot) -> str:
    """The bare element: smaller numbers, the page's colours, and words for who does not see it."""
    svg = svg[svg.index("<svg") :]
    svg = re.sub(r"<metadata>.*?</metadata>", "", svg, flags=re.DOTALL)
    svg = _ARROW.sub(
        lambda match: '<path d="M{:.1f} {:.1f}L{:.1f} {:.1f}"/>'.format(*map(float, match.groups())), svg
    )
    svg = _USE.sub(_short, svg)
    for colour, variable in _VARIABLES.items():
        svg = svg.replace(colour, f"var({variable})")
    # Groups are numbered anew in each plot, and the page has a font.
    svg = re.sub(r' id="[\w.]+_\d+"', "", svg)
    svg = re.sub(r"font-family: [^;\"]*; ?", "", svg)
    svg = re.sub(r">\s+<", "><", svg)
    return svg.replace("<svg ", f'<svg role="img" aria-label="{escape(plot.says)}" focusable="false" ', 1)


def _short(match: re.Match[str]) -> str:
    href, x, y, style = match.groups()
    fill = _FILL.search(style or "")
    # The page gives points its own colour, where they do not show a value.
    colour = f' style="fill:{fill[1]}"' if fill and fill[1] != _POINT else ""
    return f'<use xlink:href="#{href}" x="{float(x):.2f}" y="{float(y):.2f}"{colour}/>'
