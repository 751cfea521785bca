"""The report as a page: screens, paper, telephones and colours, measured in a real browser."""

import re

import pytest
from browsers import Opened

import bayes_toe as bt
from bayes_toe.cli.results_folder import FigureChoice, write_results

SCREEN = 900  # pixels
A4 = 680  # pixels less the margins: narrower than a page that is not printed may be


@pytest.fixture(scope="module")
def path(marked, tmp_path_factory):
    folder = tmp_path_factory.mktemp("layout") / "out"
    return write_results(marked, folder, figures=FigureChoice("none"), workers=1) / "report.html"


def luminance(colour):
    channels = [float(number) / 255.0 for number in re.findall(r"[\d.]+", colour)[:3]]
    linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in channels]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


def contrast(colour, other):
    """The ratio by which the guidelines for accessible pages judge two colours."""
    bright, dim = sorted((luminance(colour), luminance(other)), reverse=True)
    return (bright + 0.05) / (dim + 0.05)


def styles(page, element, name):
    script = "(all, name) => [...new Set(all.map(one => getComputedStyle(one)[name]))]"
    return page.locator(f"#answer svg {element}").evaluate_all(script, name)


def test_figure_1_begins_in_the_first_of_four_screens(browser, path):
    made = Opened(browser, path, 1200)
    assert made.page.locator("details[open]").count() == 0
    assert made.page.evaluate("document.documentElement.scrollHeight") <= 4 * SCREEN
    figure = made.page.locator("#answer figure .parts").bounding_box()
    assert figure["y"] + 0.5 * figure["height"] < SCREEN
    made.page.close()
    assert made.problems == []


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_colours_of_figure_1_stand_out_from_the_page(browser, path, scheme):
    made = Opened(browser, path, 1200, color_scheme=scheme)
    background = made.page.evaluate("getComputedStyle(document.body).backgroundColor")
    letters = styles(made.page, "text", "fill")
    lines = [c for c in styles(made.page, "path", "stroke") if c not in ("none", background)]
    made.page.close()
    assert letters
    assert len(lines) > 3
    assert min(contrast(letter, background) for letter in letters) > 7.0
    assert min(contrast(line, background) for line in lines) > 3.0
    assert made.problems == []


def test_paper_has_answer_table_and_trust_but_nothing_else(browser, path):
    made = Opened(browser, path, A4, color_scheme="dark")
    made.page.emulate_media(media="print", color_scheme="dark")
    for name in ("#answer", "#overview", "#overview-table thead", "#trust"):
        assert made.page.locator(name).is_visible(), name
    for name in ("#files", "#details", "header a"):
        assert not made.page.locator(name).first.is_visible(), name
    assert made.wide() == A4
    made.page.close()
    assert made.problems == []


def test_a_telephone_shows_a_card_for_each_subject(browser, path):
    made = Opened(browser, path, 400)
    assert not made.page.locator("#overview-table thead").is_visible()
    cells = made.page.locator("#overview-table tbody tr").first.locator("td").all()
    boxes = [cell.bounding_box() for cell in cells]
    assert len({box["x"] for box in boxes}) == 1
    assert [box["y"] for box in boxes] == sorted({box["y"] for box in boxes})
    assert made.wide() == 400
    made.page.close()
    assert made.problems == []


@pytest.mark.parametrize(("width", "shown"), [(400, "narrow"), (1200, "wide")])
def test_letters_of_figures_are_legible(browser, path, width, shown):
    made = Opened(browser, path, width)
    other = {"narrow": "wide", "wide": "narrow"}[shown]
    assert made.page.locator(f"figure .{shown} svg").is_visible()
    assert not made.page.locator(f"figure .{other} svg").is_visible()
    pixels = made.page.locator("figure svg text").evaluate_all(
        "texts => texts.filter(text => text.getClientRects().length)"
        ".map(text => parseFloat(getComputedStyle(text).fontSize) * text.getScreenCTM().a)"
        ".filter(size => size > 0)"
    )
    made.page.close()
    assert len(pixels) > 30
    assert min(pixels) >= 10.0
    assert made.problems == []


def test_figures_of_the_page_are_small_and_a_poor_fit_has_one(path):
    text = path.read_text(encoding="utf-8")
    figures = re.findall(r"<svg.*?</svg>", text, flags=re.DOTALL)
    assert len(figures) == 4
    assert max(map(len, figures)) < 90_000
    assert 'class="misfits"' in text


def test_one_subject_has_no_search_and_no_figure_of_poor_fits(small_study, tmp_path):
    alone = bt.run(small_study.select(["B"]), draws=100, seed=1, prior="paper", workers=1)
    folder = write_results(alone, tmp_path / "out", figures=FigureChoice("none"), workers=1)
    page = (folder / "report.html").read_text(encoding="utf-8")
    assert 'type="search"' not in page
    assert 'class="misfits"' not in page
    assert "1 subject, 650 trials, same-different task, 13 pairs" in page


def test_sentences_of_the_answer_end_once(path):
    text = path.read_text(encoding="utf-8")
    sentences = re.findall(r'<p class="lead">(.*?)</p>', text)
    sentences += re.findall(r"<dd>(.*?)</dd>", text)
    assert len(sentences) > 8
    assert [
        sentence for sentence in sentences if not sentence.endswith(".") or sentence.endswith("..")
    ] == []
