"""Whether the words of a figure can be read."""

from itertools import combinations

from matplotlib.text import Text


def texts_of(figure):
    """Texts that are drawn: ticks beyond the limits are not."""
    figure.draw_without_rendering()
    ticks = {text for ax in figure.axes for axis in (ax.xaxis, ax.yaxis) for tick in axis.majorTicks for text in (tick.label1, tick.label2)}
    shown = {tick.label1 for ax in figure.axes for axis in (ax.xaxis, ax.yaxis) for tick in axis._update_ticks()}
    shown |= {
        tick.label2 for ax in figure.axes for axis in (ax.xaxis, ax.yaxis) for tick in axis._update_ticks() if tick.label2.get_visible()
    }
    found = [text for text in figure.findobj(Text) if text.get_text().strip() and text.get_visible()]
    return [text for text in found if text not in ticks or text in shown]


def require_legible(figure):
    """No word on another one, none outside the page, none below 7 points; a slack of one point for the boxes' own margins. The words."""
    texts = texts_of(figure)
    slack = figure.dpi / 72.0
    boxes = [(text.get_text(), text.get_window_extent()) for text in texts]
    page = figure.bbox
    for word, box in boxes:
        inside = page.x0 - slack <= box.x0 and box.x1 <= page.x1 + slack and page.y0 - slack <= box.y0 and box.y1 <= page.y1 + slack
        assert inside, f"{word!r} leaves the page"
    for (one, a), (other, b) in combinations(boxes, 2):
        across, down = min(a.x1, b.x1) - max(a.x0, b.x0), min(a.y1, b.y1) - max(a.y0, b.y0)
        assert across <= slack or down <= slack, f"{one!r} on {other!r}"
    assert min(text.get_fontsize() for text in texts) >= 6.99
    return [word for word, _ in boxes]
