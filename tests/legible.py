"""What is drawn in a figure, and whether its words can be read."""

import numpy as np
from matplotlib.text import Text


def curves_of(ax, n_points):
    """Lines of so many points."""
    return [line for line in ax.lines if len(line.get_xdata()) == n_points]


def marks_of(ax, marker):
    """Lines with a marker."""
    return [line for line in ax.lines if line.get_marker() == marker]


def words_of(texts):
    return [text.get_text() for text in texts]


def titles_of(axes):
    return [ax.get_title() or ax.get_title(loc="left") for ax in axes]


def texts_of(figure):
    """Texts that are drawn: ticks beyond the limits are not."""
    figure.draw_without_rendering()
    labels, visible_labels = set(), set()
    for ax in figure.axes:
        for axis in (ax.xaxis, ax.yaxis):
            labels |= labels_of(axis.majorTicks)
            visible_labels |= labels_of(axis._update_ticks())
    drawn = []
    for text in figure.findobj(Text):
        if text.get_text().strip() and text.get_visible():
            drawn.append(text)
    return [text for text in drawn if text not in labels or text in visible_labels]


def labels_of(ticks):
    """The labels of ticks at both sides of a panel."""
    return {tick.label1 for tick in ticks} | {tick.label2 for tick in ticks}


def require_legible(figure, smallest=7.0):
    """Return the words of a figure: none on another one, outside the page, or below 7 points.

    One point of overlap is allowed, because the boxes of texts have margins.
    """
    texts, page, slack = texts_of(figure), figure.bbox, figure.dpi / 72.0
    words = [text.get_text() for text in texts]
    x0, y0, x1, y1 = np.array([text.get_window_extent().extents for text in texts]).T
    outside = (np.minimum(x0 - page.x0, y0 - page.y0) < -slack) | (
        np.minimum(page.x1 - x1, page.y1 - y1) < -slack
    )
    assert [word for word, out in zip(words, outside, strict=True) if out] == []
    across, down = (
        np.minimum.outer(high, high) - np.maximum.outer(low, low)
        for low, high in ((x0, x1), (y0, y1))
    )
    over = np.argwhere(np.triu((across > slack) & (down > slack), 1))
    assert [(words[element], words[other]) for element, other in over] == []
    assert min(text.get_fontsize() for text in texts) >= smallest - 0.01
    return words
