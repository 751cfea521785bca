"""What is drawn in a figure, and whether its words can be read."""

import numpy as np
from matplotlib.text import Text


def curves_of(ax, n_points):
    """The lines of a panel that have `n_points` points: curves, not marks or axes."""
    return [line for line in ax.lines if len(line.get_xdata()) == n_points]


def marks_of(ax, marker):
    """The lines of a panel whose points have a marker, such as "o"; each has its x and y data."""
    return [line for line in ax.lines if line.get_marker() == marker]


def words_of(texts):
    return [text.get_text() for text in texts]


def titles_of(axes):
    return [ax.get_title() or ax.get_title(loc="left") for ax in axes]


def texts_of(figure):
    """The texts of a figure that are drawn; labels of ticks beyond the limits are not."""
    figure.draw_without_rendering()
    labels, visible_labels = set(), set()
    for ax in figure.axes:
        for axis in (ax.xaxis, ax.yaxis):
            labels |= labels_of(axis.majorTicks)
            # A private method, because no public one knows which ticks lie within the limits.
            visible_labels |= labels_of(axis._update_ticks())
    visible_texts = []
    for text in figure.findobj(Text):
        if text.get_text().strip() and text.get_visible():
            visible_texts.append(text)
    return [text for text in visible_texts if text not in labels or text in visible_labels]


def labels_of(ticks):
    """The labels of ticks at both sides of a panel."""
    return {tick.label1 for tick in ticks} | {tick.label2 for tick in ticks}


def require_legible(figure):
    """No word of a figure is on another word, outside the page, or smaller than 7 points.

    One point of overlap is allowed, because the boxes of texts have margins.
    """
    texts, page, slack = texts_of(figure), figure.bbox, figure.dpi / 72.0  # slack is one point
    words = words_of(texts)
    boxes = [text.get_window_extent() for text in texts]
    # Left and lower ends, and right and upper ends, in pixels, shape (texts, 2) each.
    low, high = np.array([box.min for box in boxes]), np.array([box.max for box in boxes])
    is_outside = ((low < page.min - slack) | (high > page.max + slack)).any(axis=1)
    assert [word for word, outside in zip(words, is_outside, strict=True) if outside] == []

    # Width and height of the overlap of two boxes, (texts, texts, 2); below 0 without an overlap.
    overlaps = np.minimum(high[:, None], high) - np.maximum(low[:, None], low)
    pairs = np.argwhere(np.triu((overlaps > slack).all(axis=2), 1))  # each pair of texts once
    assert [(words[i], words[j]) for i, j in pairs] == []
    assert min(text.get_fontsize() for text in texts) >= 6.99  # 7, but for rounding
