"""The report in a real browser.

It fits a telephone and paper, it sorts, filters and unfolds, it can be read without scripts, and it
asks nothing of the network.
"""

import math

import pytest
from browsers import BrowserPage

from bayes_toe.cli.results_folder import write_results
from bayes_toe.cli.run_context import RunContext

SCREEN = 900  # pixels
A4 = 680  # pixels less the margins: narrower than a page that is not printed may be


@pytest.fixture(scope="module")
def report_path(analysis_with_problems, tmp_path_factory):
    # The report of A, who does not fit, B, and C, who is not interpreted.
    folder = tmp_path_factory.mktemp("report") / "out"
    write_results(analysis_with_problems, folder, RunContext(), figures="flagged")
    return folder / "report.html"


@pytest.fixture
def open_report(browser, report_path):
    """A function that opens the report in a window; in the end no page has had a problem."""
    pages = []

    def open_page(width=1200, medium="screen", scheme="light", **options):
        pages.append(BrowserPage(browser, report_path, width, color_scheme=scheme, **options))
        pages[-1].page.emulate_media(media=medium, color_scheme=scheme)
        return pages[-1]

    yield open_page
    for browser_page in pages:
        browser_page.page.close()
        assert browser_page.problems == []


def visible_names(page):
    """The names of the subjects in the visible rows of the table."""
    return page.locator("#overview-table tbody tr:visible td.name a").all_inner_texts()


#: Backgrounds, and colours of letters on them.
WHITE = "rgb(255, 255, 255)"
BLACK = "rgb(23, 24, 27)"
INK = "rgb(28, 28, 28)"
CHALK = "rgb(228, 228, 228)"


@pytest.mark.parametrize(
    "medium, width, scheme, background, ink",
    [
        ("screen", 400, "light", WHITE, INK),
        ("screen", 400, "dark", BLACK, CHALK),
        ("screen", 1200, "dark", BLACK, CHALK),
        ("print", A4, "dark", WHITE, "rgb(0, 0, 0)"),
    ],
)
def test_nothing_overflows_and_figures_have_the_colours_of_the_page(
    open_report, medium, width, scheme, background, ink
):
    # All parts are unfolded on a screen, and a printed page is light.
    browser_page = open_report(width, medium, scheme)
    if medium == "screen":
        browser_page.page.evaluate(
            "document.querySelectorAll('details').forEach(part => part.open = true)"
        )
    assert browser_page.page_width() == width
    colour = "getComputedStyle(document.body).backgroundColor"
    assert browser_page.page.evaluate(colour) == background
    text = browser_page.page.locator("figure svg text").first
    assert text.evaluate("text => getComputedStyle(text).fill") == ink


def test_a_folded_report_has_four_screens_with_answer_and_figure_in_the_first(open_report):
    page = open_report().page
    assert page.locator("details[open]").count() == 0  # all parts are folded
    assert page.evaluate("document.documentElement.scrollHeight") <= 4 * SCREEN
    parts = (".lead", "#answer figure .parts", "#overview-table", "#trust", "#details")
    boxes = [page.locator(part).first.bounding_box() for part in parts]
    assert [box["y"] for box in boxes] == sorted(box["y"] for box in boxes)
    # At least the upper half of the figure is on the first screen.
    _, figure, *_ = boxes
    assert figure["y"] + 0.5 * figure["height"] < SCREEN


def test_paper_has_answer_table_and_trust_but_nothing_else(open_report):
    page = open_report(A4, "print", "dark").page
    for name in ("#answer", "#overview", "#overview-table thead", "#trust"):
        assert page.locator(name).is_visible(), name
    for name in ("#files", "#details", "header a"):
        assert not page.locator(name).first.is_visible(), name


def test_a_telephone_shows_a_card_for_each_subject(open_report):
    page = open_report(400).page
    assert not page.locator("#overview-table thead").is_visible()
    cells = page.locator("#overview-table tbody tr").first.locator("td").all()
    # The cells of a subject stand one below the other, no two at the same height.
    boxes = [cell.bounding_box() for cell in cells]
    assert len({box["x"] for box in boxes}) == 1
    assert [box["y"] for box in boxes] == sorted({box["y"] for box in boxes})


@pytest.mark.parametrize(
    "width, visible_form, hidden_form", [(400, "narrow", "wide"), (1200, "wide", "narrow")]
)
def test_letters_of_figures_are_legible(open_report, width, visible_form, hidden_form):
    # A figure has two forms, for a narrow and a wide screen. One form is shown.
    page = open_report(width).page
    assert page.locator(f"figure .{visible_form} svg").is_visible()
    assert not page.locator(f"figure .{hidden_form} svg").is_visible()
    pixels = page.locator("figure svg text").evaluate_all(
        "texts => texts.filter(text => text.getClientRects().length)"
        ".map(text => [parseFloat(getComputedStyle(text).fontSize), text.getScreenCTM()])"
        ".map(([size, matrix]) => size * Math.hypot(matrix.a, matrix.b))"  # also of turned texts
    )
    assert len(pixels) > 30  # texts of the figures that are shown
    assert min(pixels) >= 10.0


def test_only_the_scripts_of_the_report_run(browser, report_path, tmp_path):
    # Two scripts that are added to the page, in it and beside it, would change its title.
    page = report_path.read_text(encoding="utf-8")
    for script in ("<script>document.title = 'other'</script>", "<script src='x.js'></script>"):
        page = page.replace("</body>", f"{script}</body>")
    (tmp_path / "x.js").write_text("document.title = 'other'")
    (tmp_path / "report.html").write_text(page, encoding="utf-8")
    browser_page = BrowserPage(browser, tmp_path / "report.html", 1200)
    assert browser_page.page.title() != "other"
    assert any("Content Security Policy" in problem for problem in browser_page.problems)
    browser_page.page.close()


def test_a_link_unfolds_its_subject(open_report):
    # A link in the table leads to a part of the page, which is folded at first.
    page = open_report().page
    link = page.locator("#overview-table td.name a", has_text="C")
    link.click()
    page.wait_for_function("scrollY > 300")
    assert page.locator("details.subject[open] summary h3").all_inner_texts() == ["C"]
    page.locator("details.subject[open] summary").click()
    link.click()  # the same address once more
    page.wait_for_selector("details.subject[open]")
    page.click("#every")  # unfolds all subjects
    assert page.locator("details.subject[open]").count() == 3


def test_a_column_sorts_both_ways_and_what_has_no_value_stays_last(
    open_report, analysis_with_problems
):
    # The cells of A and B have these probabilities. The cell of C, who is not interpreted, is
    # empty.
    expected = [
        answer.probabilities["constant_error"] for answer in analysis_with_problems.answers[:2]
    ]
    page = open_report().page
    heading = page.locator("#overview-table thead tr:last-child th:nth-child(3)")
    cells = page.locator("#overview-table tbody td:nth-child(3)")
    for order in ("ascending", "descending"):
        heading.click()
        values = cells.evaluate_all("cells => cells.map(cell => cell.dataset.value)")
        numbers = [float(value or math.nan) for value in values]
        assert heading.get_attribute("aria-sort") == order
        assert numbers[:2] == sorted(expected, reverse=order == "descending")
        assert math.isnan(numbers[2])
    # The first column, of names, sorts by the keyboard, too.
    page.locator("#overview-table thead tr:last-child th:first-child button").press("Enter")
    assert visible_names(page) == ["A", "B", "C"]


def test_the_filter_hides_subjects_in_the_table_and_below_it(open_report):
    page = open_report().page
    page.check("#filter input[type=checkbox]")  # only subjects that need action
    assert visible_names(page) == ["A", "C"]
    headings = page.locator("details.subject:not([hidden]) summary h3")
    assert headings.all_text_contents() == ["A", "C"]
    page.fill("#filter input[type=search]", "c")
    assert visible_names(page) == ["C"]
    assert page.locator("#filter output").inner_text() == "1 of 3 shown"
    page.uncheck("#filter input[type=checkbox]")
    page.fill("#filter input[type=search]", "")
    assert visible_names(page) == ["A", "B", "C"]


def test_without_javascript_the_report_can_be_read(open_report):
    page = open_report(400, java_script_enabled=False).page
    # All subjects are in the table, there is no filter, and a part unfolds.
    assert visible_names(page) == ["A", "B", "C"]
    assert not page.locator("#filter").is_visible()
    page.locator("#subjects").click()
    subject = page.locator("details.subject").nth(1)
    assert subject.locator("table").first.is_hidden()
    subject.locator("summary").first.click()
    assert subject.locator("table").first.is_visible()
