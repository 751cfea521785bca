"""Wall time against error, one marker a method; and cost against size."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from bayes_toe.data.whole_files import whole_file
from speed.cases import HARD, ORDINARY
from speed.method import NATURAL
from speed.methods import MANY
from speed.summary import common_subjects, medians

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

#: Colours that stay apart for colour-blind readers (Okabe and Ito 2008); markers differ too.
STYLES = {
    "Laplace": ("#000000", "X"),
    "emcee stretch": ("#E69F00", "s"),
    MANY: ("#E69F00", "H"),
    "emcee DE + stretch": ("#D55E00", "D"),
    "global move": ("#0072B2", "*"),
    "importance sampling": ("#56B4E9", "P"),
    "nutpie NUTS": ("#009E73", "o"),
    "NumPyro NUTS": ("#CC79A7", "^"),
    "NumPyro NUTS in one jit": ("#CC79A7", "v"),
    "dynesty": ("#777777", "<"),
    "nautilus": ("#777777", ">"),
}
_ROWS = (
    ("error_worst", "worst standardised error (10: or more)\nof mean, sd, 5/50/95 % quantiles"),
    ("log_evidence_error", "error of log evidence\n(nats; 10: or more)"),
)
_KINDS = {ORDINARY: "ordinary subjects", HARD: "hard cases"}
_CAP = 10.0  # posterior sds, or nats: what is worse is wrong, however wrong
_PNG_DPI = 130


def race_figure(table: pd.DataFrame) -> Figure:
    """Two columns (ordinary, hard) and two rows (moments and quantiles, evidence)."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9.2, 8.6), layout="constrained")
    axes = figure.subplots(2, 2, sharex=True, sharey="row")
    handles: dict[str, Any] = {}
    for column, (kind, title) in enumerate(_KINDS.items()):
        subjects = common_subjects(table, kind)
        chosen = table[table.kind == kind]
        for row, (value, label) in enumerate(_ROWS):
            ax = axes[row, column]
            _panel(ax, chosen, medians(table, subjects), value, handles)
            ax.set(xscale="log", yscale="log")
            ax.grid(True, which="major", color="#DDDDDD", linewidth=0.6)
            if column == 0:
                ax.set_ylabel(label)
            if row == 0:
                ax.set_title(f"{title}: median of {len(subjects)} (faint: each of {chosen.subject.nunique()})", fontsize=10.5)
            else:
                ax.set_xlabel("wall time of one run (s), compiling apart")
    figure.legend(
        handles.values(),
        handles.keys(),
        loc="outside lower center",
        ncols=3,
        frameon=False,
        fontsize=9,
        title="filled: identified coordinates; hollow: natural coordinates",
    )
    return figure


def _panel(ax: Axes, chosen: pd.DataFrame, middle: pd.DataFrame, value: str, handles: dict[str, Any]) -> None:
    for (method, coordinates), part in middle.groupby(["method", "coordinates"], sort=False):
        colour, marker = STYLES[method]
        face = "white" if coordinates == NATURAL else colour
        every = chosen[(chosen.method == method) & (chosen.coordinates == coordinates)]
        ax.plot(
            every.wall_s, every[value].clip(upper=_CAP), marker, color=colour, markersize=4, alpha=0.4, markeredgewidth=0, linestyle="none"
        )
        (line,) = ax.plot(
            part.wall_s,
            part[value].clip(upper=_CAP),
            color=colour,
            marker=marker,
            markerfacecolor=face,
            markersize=13 if marker == "*" else 8,
            linewidth=1.2,
            markeredgewidth=1.2,
            zorder=5 if marker == "*" else 3,
        )
        if part[value].notna().any():
            handles.setdefault(f"{method} ({coordinates})", line)


def scaling_figure(table: pd.DataFrame) -> Figure:
    """Seconds of the whole route against distinct pairs, and against trials on 13 pairs."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9.2, 3.9), layout="constrained")
    axes = figure.subplots(1, 2, sharey=True)
    titles = {"pairs": "distinct pairs (10 trials each)", "trials": "trials (13 pairs)"}
    stages = {"total_s": ("#000000", "o", "total"), "maxima_s": ("#E69F00", "s", "maximum")}
    stages |= {"fit_s": ("#56B4E9", "P", "fitting the proposal"), "chains_s": ("#0072B2", "*", "ensembles")}
    for ax, (axis, title) in zip(axes, titles.items(), strict=True):
        part = table[table.axis == axis]
        for key, (colour, marker, label) in stages.items():
            ax.plot(part[axis], part[key], color=colour, marker=marker, label=label, linewidth=1.2, markersize=9 if marker == "*" else 6)
        ax.set(xscale="log", yscale="log", xlabel=title)
        ax.grid(True, which="major", color="#DDDDDD", linewidth=0.6)
    axes[0].set_ylabel("wall time (s), 4,000 effective draws")
    figure.legend(*axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=4, frameon=False, fontsize=9)
    return figure


def save(figure: Figure, path: Path, *, overwrite: bool) -> None:
    """Write the format that the suffix names, whole or not at all, the same bytes for the same figure."""
    from matplotlib import rc_context

    with whole_file(path, overwrite=overwrite) as target, rc_context({"svg.hashsalt": path.stem}):
        undated = {"metadata": {"Date": None}} if path.suffix == ".svg" else {}
        figure.savefig(target, dpi=_PNG_DPI, **undated)
