"""Panels of the page: empty Bokeh figures under names by which explorer.js finds and fills them.

The corner has :data:`SLOTS` places for quantities, whatever these are. Sources and columns are
named after the place, and each place has one range. Every panel has its own source of draws, so
that panels which are not shown cost nothing.
"""

from __future__ import annotations

from itertools import combinations
from typing import Any, NamedTuple

from bokeh.document import Document
from bokeh.models import (
    BasicTicker,
    BoxAnnotation,
    BoxSelectTool,
    ColumnDataSource,
    CustomJS,
    FixedTicker,
    HoverTool,
    Line,
    MultiLine,
    Range1d,
    Scatter,
    Segment,
    Title,
    VArea,
    VSpan,
)
from bokeh.plotting import figure

from bayes_toe.data.tasks import WHICH_STRONGER, Task
from bayes_toe.plots.style import ORDERS

#: Largest number of quantities that are shown together.
SLOTS = 6


class _Look(NamedTuple):
    """Colour of an entry, marker of its draws, dash of its lines, and marker of its true value.

    An entry is the posterior of one subject; the page shows one entry or two.
    """

    colour: str
    marker: str
    dash: str
    cross: str


#: The looks of the two entries that are shown together, by the letter that is in the names of the
#: sources of an entry. Their colours are not those of the orders of stimuli.
LOOK_BY_LETTER = {
    "a": _Look("#4B3B8F", "circle", "solid", "x"),
    "b": _Look("#00795C", "triangle", "dashed", "cross"),
}
#: For each order of stimuli, its name in the names of sources, and Bokeh's name of its marker.
NAMES_OF_ORDERS = {-1: ("weaker", "circle"), 1: ("stronger", "square"), 0: ("equal", "diamond")}
#: Colour of text. On a dark page explorer.js changes it, and the colours of LOOK_BY_LETTER.
_INK = "#222222"
#: Colour of the page, which explorer.js changes too.
_PAGE = "#FFFFFF"
#: Columns of a source of :func:`_band`: the mean over all draws, and the mean and both ends of the
#: band over the brushed draws.
_BAND = ("x", "all", "kept", "low", "high")


def document(task: Task) -> Document:
    """All figures of the page: the panels of the corner, and curves and plane of each entry.

    Each figure has the name of the place that embeds it.
    """
    sources = _Sources()
    ranges = [Range1d(0, 1, name=f"range-{i}") for i in range(SLOTS)]
    roots = [_distribution(sources, ranges, i) for i in range(SLOTS)]
    # Panels below the diagonal: the column is smaller than the row.
    for column, row in combinations(range(SLOTS), 2):
        roots.append(_cloud(sources, ranges, row, column))
    for letter in LOOK_BY_LETTER:
        roots += [_curves(sources, letter, task), _plane(sources, letter, task)]
    page = Document()
    with page.models.freeze():  # otherwise all models are collected anew with every root
        for root in roots:
            page.add_root(root)
    return page


class _Sources(dict[str, ColumnDataSource]):
    """Sources of plots by name; each is made when it is first asked for, with empty columns."""

    def get_source(self, name: str, *columns: str) -> ColumnDataSource:
        """The source, which has at least these columns."""
        source = self.setdefault(name, ColumnDataSource(name=name))
        for column in columns:
            source.data.setdefault(column, [])
        return source


def _plot(name: str, tools: list[Any], **options: Any) -> Any:
    """An empty figure that fills its place on the page; `options` are those of Bokeh's figure.

    explorer.js widens borders that have numbers.
    """
    plot = figure(
        name=name,
        tools=tools,
        toolbar_location=None,
        outline_line_color="#777777",
        background_fill_color=_PAGE,
        border_fill_color=_PAGE,
        sizing_mode="stretch_both",
        min_border=3,
        min_width=20,
        min_height=20,
        width=120,
        height=120,
        **options,
    )
    plot.grid.grid_line_color = None
    for axis in plot.axis:
        axis.update(
            major_label_text_font_size="11px",
            axis_label_text_font_size="14px",
            axis_label_text_font_style="normal",
            axis_label_text_color=_INK,
            major_label_text_color=_INK,
            major_tick_line_color=_INK,
            minor_tick_line_color=None,
            axis_line_color=None,
            major_tick_in=0,
            major_tick_out=4,
        )
    return plot


def _panel(name: str, x: Range1d, y: Range1d, dimensions: Any) -> Any:
    """A panel of the corner, in which a drag selects draws ("brushes" them).

    `dimensions` says which axes the selection limits, "width" or "both". explorer.js shows the axes
    of the panels at the edges.
    """
    select = BoxSelectTool(dimensions=dimensions, renderers=[], continuous=True)
    plot = _plot(name, [select], x_range=x, y_range=y)
    plot.toolbar.active_drag = select  # so that dragging selects without a click on a tool first
    brushed = "window.explorer.brushed(cb_obj.origin.name, cb_obj.geometry)"
    plot.js_on_event("selectiongeometry", CustomJS(code=brushed))
    for axis in plot.axis:
        axis.update(visible=False, ticker=FixedTicker())
    plot.add_layout(
        BoxAnnotation(
            name=f"brush-{name}",
            visible=False,
            fill_color="#000000",
            fill_alpha=0.08,
            line_color="#000000",
            line_alpha=0.9,
            line_width=1.5,
        )
    )
    return plot


def _distribution(sources: _Sources, ranges: list[Range1d], i: int) -> Any:
    """The panel of the quantity in slot `i` on the diagonal, in which a drag selects an interval.

    The panel has the prior, histograms of all draws and of the brushed draws, and the true value.
    """
    plot = _panel(
        f"panel-{i}-{i}", ranges[i], Range1d(0, 1, name=f"height-{i}"), dimensions="width"
    )
    # Columns of the sources.
    x = f"x{i}"
    y = f"y{i}"
    for letter, look in LOOK_BY_LETTER.items():
        colour = look.colour
        dash = look.dash
        plot.add_glyph(
            sources.get_source(f"prior-{letter}", x, y),
            Line(x=x, y=y, line_color="#8A8A8A", line_width=2, line_dash=dash),
        )
        # Heights of the bars of all draws, and of the bars of the brushed draws.
        bars = sources.get_source(f"bars-{letter}", x, f"all{i}", f"kept{i}")
        plot.add_glyph(bars, VArea(x=x, y1=0, y2=f"kept{i}", fill_color=colour, fill_alpha=0.35))
        plot.add_glyph(
            bars, Line(x=x, y=f"all{i}", line_color=colour, line_width=1.5, line_dash=dash)
        )
        plot.add_glyph(
            sources.get_source(f"truth-{letter}", f"{i}"),
            VSpan(x=f"{i}", line_color=colour, line_width=2.5, line_dash="dotdash"),
        )
    return plot


def _dots(look: _Look, size: int, alpha: float) -> Scatter:
    """The draws of one entry, as dots without an outline."""
    return Scatter(
        x="x",
        y="y",
        marker=look.marker,
        size=size,
        fill_color=look.colour,
        fill_alpha=alpha,
        line_color=None,
    )


def _cloud(sources: _Sources, ranges: list[Range1d], row: int, column: int) -> Any:
    """The panel in a row and a column of the corner: draws, contours and true values.

    The quantity in slot `row` is upward, and the quantity in slot `column` is across. Later glyphs
    cover earlier glyphs. All draws are behind; then come brushed draws with contours; true values
    are in front.
    """
    name = f"panel-{row}-{column}"
    # Columns of the source of true values.
    x = f"{column}"
    y = f"{row}"
    plot = _panel(name, ranges[column], ranges[row], dimensions="both")
    for letter, look in LOOK_BY_LETTER.items():
        draws = sources.get_source(f"all-{letter}-{row}-{column}", "x", "y")
        plot.add_glyph(draws, _dots(look, size=3, alpha=0.12))

    brushed_dots = []
    for letter, look in LOOK_BY_LETTER.items():
        brushed = sources.get_source(f"kept-{letter}-{row}-{column}", "x", "y", "row")
        dots = _dots(look, size=4, alpha=0.35)
        brushed_dots.append(plot.add_glyph(brushed, dots, name=letter.upper()))
        # A wide line in the page's colour, so that the contour is seen on the dots.
        lines = sources.get_source(f"contour-{letter}-{row}-{column}", "xs", "ys", "width")
        plot.add_glyph(
            lines, MultiLine(xs="xs", ys="ys", line_color=_PAGE, line_width=4, line_alpha=0.7)
        )
        plot.add_glyph(
            lines,
            MultiLine(
                xs="xs",
                ys="ys",
                line_color=look.colour,
                line_width="width",
                line_dash=look.dash,
            ),
        )

    for letter, look in LOOK_BY_LETTER.items():
        truth = sources.get_source(f"truth-{letter}", x, y)
        # A cross with an edge in the page's colour: the wider line first.
        for colour, width in ((_PAGE, 6), (look.colour, 3)):
            plot.add_glyph(
                truth,
                Scatter(x=x, y=y, marker=look.cross, size=13, line_color=colour, line_width=width),
            )
    plot.add_tools(
        HoverTool(name=f"hover-{name}", renderers=brushed_dots, limit=1, tooltips=[("", "$name")])
    )
    return plot


def _hover(renderers: list[Any], task: Task) -> HoverTool:
    """A box with the pair under the mouse, and how often it got the counted answer."""
    return HoverTool(
        renderers=renderers,
        tooltips=[
            ("", "$name"),
            ("first, second", "@stimuli"),
            (f"'{task.yes}'", "@k of @n"),
        ],
        limit=2,
    )


def _curves(sources: _Sources, letter: str, task: Task) -> Any:
    """Curves of the probability of the counted answer by order, and the pairs of one slice.

    The axis along x is the stronger stimulus, or s2 - s1.
    """
    stimulus = "s₂ − s₁" if task == WHICH_STRONGER else "stronger stimulus"
    plot = _plot(
        f"curves-{letter}",
        [],
        x_range=Range1d(0, 1, name=f"stronger-{letter}"),
        y_range=Range1d(-0.03, 1.03),
        x_axis_label=f"{stimulus} (ln intensity)",
        y_axis_label=f"P({task.yes})",
    )
    _small_words(plot, plot.xaxis)

    points = []
    for order, (order_name, marker) in NAMES_OF_ORDERS.items():
        colour = ORDERS[order].colour
        _band(plot, sources.get_source(f"curve-{letter}-{order_name}", *_BAND), colour)
        answers = sources.get_source(
            f"answers-{letter}-{order_name}", "x", "estimate", "low", "high", "stimuli", "k", "n"
        )
        plot.add_glyph(
            answers, Segment(x0="x", y0="low", x1="x", y1="high", line_color=colour, line_width=1.5)
        )
        point = Scatter(
            x="x",
            y="estimate",
            marker=marker,
            fill_color=colour,
            line_color=_PAGE,
            size=10 if order_name == "equal" else 8,
        )
        points.append(plot.add_glyph(answers, point, name=ORDERS[order].label))

    plot.add_tools(_hover(points, task))
    plot.add_layout(
        Title(
            name=f"curves-title-{letter}",
            text_color=_INK,
            text_font_size="12px",
            text_font_style="normal",
            standoff=2,
        ),
        "above",
    )
    return plot


def _band(plot: Any, source: ColumnDataSource, colour: str) -> None:
    """Add the mean over all draws (dotted), the mean over the brushed draws, and their band.

    The source has the columns :data:`_BAND`.
    """
    plot.add_glyph(source, VArea(x="x", y1="low", y2="high", fill_color=colour, fill_alpha=0.2))
    plot.add_glyph(
        source, Line(x="x", y="all", line_color=colour, line_width=1.5, line_dash="dotted")
    )
    plot.add_glyph(source, Line(x="x", y="kept", line_color=colour, line_width=2.5))


def _plane(sources: _Sources, letter: str, task: Task) -> Any:
    """The plane of both stimuli.

    It has the pairs, filled by how often the counted answer was given, and the line of pairs that
    seem equal.
    """
    side = Range1d(0, 1, name=f"plane-{letter}-range")
    plot = _plot(
        f"plane-{letter}",
        [],
        x_range=side,
        y_range=side,
        x_axis_label="first stimulus (ln intensity)",
        y_axis_label="second stimulus",
    )
    _small_words(plot, plot.axis)

    axis = sources.get_source(f"axis-{letter}", *_BAND)
    # The line of equal stimuli.
    plot.add_glyph(axis, Line(x="x", y="x", line_color="#777777", line_dash="dashed"))
    _band(plot, axis, LOOK_BY_LETTER[letter].colour)

    points = []
    for order, (order_name, marker) in NAMES_OF_ORDERS.items():
        pairs = sources.get_source(
            f"pairs-{letter}-{order_name}", "s1", "s2", "stimuli", "k", "n", "fill"
        )
        point = Scatter(
            x="s1",
            y="s2",
            marker=marker,
            line_color=ORDERS[order].colour,
            line_width=2,
            fill_color="fill",
            size=12 if order_name == "equal" else 10,
        )
        points.append(plot.add_glyph(pairs, point, name=ORDERS[order].label))
    plot.add_tools(_hover(points, task))
    return plot


def _small_words(plot: Any, axes_of_stimuli: Any) -> None:
    """Make labels small, and leave the ticks of `axes_of_stimuli` to explorer.js."""
    for axis in plot.axis:
        axis.update(axis_label_text_font_size="12px", ticker=BasicTicker(desired_num_ticks=4))
    for axis in axes_of_stimuli:
        axis.ticker = FixedTicker()
