"""The curves as pictures: one PNG per group of questions, a panel per question, the same colour per method."""

# pyright: reportMissingTypeStubs=false, reportMissingImports=false
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import matplotlib as mpl
from matplotlib.figure import Figure
from matplotlib.ticker import NullLocator

from benchmarks.worth.methods import FIELD_SHARE, RIGHT_PX
from benchmarks.worth.questions import QUESTIONS, Question

# Okabe and Ito's colours, which colour-blind people tell apart; marks and dashes differ as well.
# The marks shrink from method to method, so that those below show where curves coincide.
_LOOKS: Mapping[str, tuple[str, str, str, str, float]] = {
    "ga": ("genetic algorithm (default) + polish", "#0072B2", "o", "-", 10.0),
    "one_slot": ("one slot of it + polish", "#CC79A7", "s", "--", 7.0),
    "centre": ("least squares from the centre", "#D55E00", "v", "-", 5.5),
    "linear": ("DLT-RANSAC + polish", "#009E73", "^", "-.", 3.5),
}
_DODGE = 0.006  # of the axis: curves that lie on each other stay visible
_PER_ROW = 3


def draw(curves: Mapping[str, Any], folder: Path) -> list[str]:
    """Write worth-*.png into the folder, for the questions that `curves` holds. Returns the names."""
    mpl.use("Agg")
    folder.mkdir(parents=True, exist_ok=True)
    groups = dict.fromkeys(QUESTIONS[name].figure for name in curves)
    return [_picture(group, [n for n in curves if QUESTIONS[n].figure == group], curves, folder) for group in groups]


def _picture(group: str, names: list[str], curves: Mapping[str, Any], folder: Path) -> str:
    columns = min(len(names), _PER_ROW)
    rows = -(-len(names) // columns)
    figure = Figure(figsize=(max(3.6 * columns, 7.0), 2.9 * rows + 1.0), layout="constrained", facecolor="white")
    for place, name in enumerate(names, start=1):
        axes = figure.add_subplot(rows, columns, place)
        _panel(axes, name, curves[name])
        if (place - 1) % columns == 0:
            axes.set_ylabel("share of rigs (%)")
    handles, labels = figure.axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=2, frameon=False, fontsize=9)
    path = folder / f"worth-{group}.png"
    figure.savefig(path, dpi=90)
    return path.name


def _panel(axes: Any, name: str, found: Mapping[str, Any]) -> None:
    question = QUESTIONS[name]
    values = [float(value) for value in found["values"]]
    for place, (method, (label, colour, mark, dashes, size)) in enumerate(_LOOKS.items()):
        moved = _dodged(values, place - 1.5, question.logarithmic)
        low, high, success = (_percent(found[method][key]) for key in ("low95", "high95", "success"))
        axes.fill_between(moved, low, high, color=colour, alpha=0.10, lw=0.0)
        axes.plot(moved, success, dashes, color=colour, marker=mark, ms=size, lw=1.5, label=label)
    label = f"the optimum is right: {100.0 * FIELD_SHARE:.0f} % of the field within {RIGHT_PX:g} px"
    axes.plot(values, _percent(found["optimum"]["right"]), ":", color="#333333", lw=1.8, label=label)
    if question.figure == "outliers":
        # The only group in which the polish can lose what the search had found.
        before, label = found["ga"]["right_before_polish"], "the genetic algorithm's best before the polish is right"
        axes.plot(values, _percent(before), ":", color=_LOOKS["ga"][1], lw=1.8, label=label)
    _dress(axes, question, values, found["rigs"])


def _dress(axes: Any, question: Question, values: list[float], rigs: Sequence[int]) -> None:
    axes.set_title(question.title, fontsize=10)
    axes.set_xlabel(f"{question.label}\n{min(rigs)} rigs a point", fontsize=9)
    axes.set_ylim(-4.0, 104.0)
    if question.logarithmic:
        axes.set_xscale("log")
    axes.xaxis.set_minor_locator(NullLocator())
    axes.set_xticks(values, [f"{value:g}" for value in values])
    axes.grid(color="#dddddd", lw=0.6)
    axes.set_axisbelow(True)
    axes.spines[["top", "right"]].set_visible(False)


def _percent(shares: Sequence[float]) -> list[float]:
    return [100.0 * share for share in shares]


def _dodged(values: list[float], steps: float, logarithmic: bool) -> list[float]:
    if logarithmic:
        return [value * (values[-1] / values[0]) ** (_DODGE * steps) for value in values]
    return [value + _DODGE * steps * (values[-1] - values[0]) for value in values]
