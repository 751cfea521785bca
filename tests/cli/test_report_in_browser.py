"""The report in a real browser.

It fits a telephone and paper, sorts, filters and unfolds, needs no script for being read, asks
nobody.
"""

import math

import pytest
from browsers import Opened

from bayes_toe.cli.results_folder import write_results
from bayes_toe.cli.run_context import RunContext

SCREEN = 900  # pixels
A4 = 680  # pixels less the margins: narrower than a page that is not printed may be


@pytest.fixture(scope="module")
def path(marked, tmp_path_factory):
    folder = tmp_path_factory.mktemp("report") / "out"
    write_results(marked, folder, RunContext(), figures="flagged")
    return folder / "report.html"


@pytest.fixture
def opened(browser, path):
    """Open the report at some width; in the end no page has had a problem."""
    pages = []

    def open_page(width=1200, medium="screen", scheme="light", **options):
        pages.append(Opened(browser, path, width, color_scheme=scheme, **options))
        pages[-1].page.emulate_media(media=medium, color_scheme=scheme)
        return pages[-1]

    yield open_page
    for built in pages:
        built.page.close()
        assert built.problems == []


def names(page):
    return page.locator("#overview-table tbody tr:visible td.name a").all_inner_texts()


WHITE, BLACK = "rgb(255, 255, 255)", "rgb(23, 24, 27)"
INK, CHALK = "rgb(28, 28, 28)", "rgb(228, 228, 228)"


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
    opened, medium, width, scheme, background, ink
):
    built = opened(width, medium, scheme)
    if medium == "screen":
        built.page.evaluate(
            "document.querySelectorAll('details').forEach(part => part.open = true)"
        )
    assert built.page_width() == width
    colour = "getComputedStyle(document.body).backgroundColor"
    assert built.page.evaluate(colour) == background
    text = built.page.locator("figure svg text").first
    assert text.evaluate("text => getComputedStyle(text).fill") == ink


def test_folded_it_has_four_screens_with_answer_and_figure_in_the_first(opened):
    page = opened().page
    assert page.locator("details[open]").count() == 0
    assert page.evaluate("document.documentElement.scrollHeight") <= 4 * SCREEN
    places = (".lead", "#answer figure .parts", "#overview-table", "#trust", "#details")
    boxes = [page.locator(position).first.bounding_box() for position in places]
    assert [box["y"] for box in boxes] == sorted(box["y"] for box in boxes)
    assert boxes[1]["y"] + 0.5 * boxes[1]["height"] < SCREEN


def test_paper_has_answer_table_and_trust_but_nothing_else(opened):
    page = opened(A4, "print", "dark").page
    for name in ("#answer", "#overview", "#overview-table thead", "#trust"):
        assert page.locator(name).is_visible(), name
    for name in ("#files", "#details", "header a"):
        assert not page.locator(name).first.is_visible(), name


def test_a_telephone_shows_a_card_for_each_subject(opened):
    page = opened(400).page
    assert not page.locator("#overview-table thead").is_visible()
    cells = page.locator("#overview-table tbody tr").first.locator("td").all()
    # The cells of a subject stand one below the other.
    boxes = [cell.bounding_box() for cell in cells]
    assert len({box["x"] for box in boxes}) == 1
    assert [box["y"] for box in boxes] == sorted({box["y"] for box in boxes})


@pytest.mark.parametrize(
    "width, visible, hidden", [(400, "narrow", "wide"), (1200, "wide", "narrow")]
)
def test_letters_of_figures_are_legible(opened, width, visible, hidden):
    page = opened(width).page
    assert page.locator(f"figure .{visible} svg").is_visible()
    assert not page.locator(f"figure .{hidden} svg").is_visible()
    pixels = page.locator("figure svg text").evaluate_all(
        "texts => texts.filter(text => text.getClientRects().length)"
        ".map(text => [parseFloat(getComputedStyle(text).fontSize), text.getScreenCTM()])"
        ".map(([size, matrix]) => size * Math.hypot(matrix.a, matrix.b))"  # turned ones, too
    )
    assert len(pixels) > 30
    assert min(pixels) >= 10.0


def test_only_the_scripts_of_the_report_run(browser, path, tmp_path):
    page = path.read_text(encoding="utf-8")
    for script in ("<script>document.title = 'other'</script>", "<script src='x.js'></script>"):
        page = page.replace("</body>", f"{script}</body>")
    (tmp_path / "x.js").write_text("document.title = 'other'")
    (tmp_path / "report.html").write_text(page, encoding="utf-8")
    opened = Opened(browser, tmp_path / "report.html", 1200)
    assert opened.page.title() != "other"
    assert any("Content Security Policy" in problem for problem in opened.problems)
    opened.page.close()


def test_a_link_unfolds_its_subject(opened):
    page = opened().page
    link = page.locator("#overview-table td.name a", has_text="C")
    link.click()
    page.wait_for_function("scrollY > 300")
    assert page.locator("details.subject[open] summary h3").all_inner_texts() == ["C"]
    page.locator("details.subject[open] summary").click()
    link.click()  # the same address once more
    page.wait_for_selector("details.subject[open]")
    page.click("#every")
    assert page.locator("details.subject[open]").count() == 3


def test_a_column_sorts_both_ways_and_what_has_no_value_stays_last(opened, marked):
    reference = [answer.probabilities["constant_error"] for answer in marked.answers[:2]]
    page = opened().page
    head = page.locator("#overview-table thead tr:last-child th:nth-child(3)")
    cells = page.locator("#overview-table tbody td:nth-child(3)")
    for order in ("ascending", "descending"):
        head.click()
        values = cells.evaluate_all("cells => cells.map(cell => cell.dataset.value)")
        numbers = [float(value or math.nan) for value in values]
        assert head.get_attribute("aria-sort") == order
        assert numbers[:2] == sorted(reference, reverse=order == "descending")
        assert math.isnan(numbers[2])
    page.locator("#overview-table thead tr:last-child th:first-child button").press("Enter")
    assert names(page) == ["A", "B", "C"]


def test_the_filter_is_of_table_contents_and_subjects(opened):
    page = opened().page
    page.check("#filter input[type=checkbox]")
    assert names(page) == ["A", "C"]
    headings = page.locator("details.subject:not([hidden]) summary h3")
    assert headings.all_text_contents() == ["A", "C"]
    page.fill("#filter input[type=search]", "c")
    assert names(page) == ["C"]
    assert page.locator("#filter output").inner_text() == "1 of 3 shown"
    page.uncheck("#filter input[type=checkbox]")
    page.fill("#filter input[type=search]", "")
    assert names(page) == ["A", "B", "C"]


def test_without_javascript_it_is_whole(opened):
    page = opened(400, java_script_enabled=False).page
    assert names(page) == ["A", "B", "C"]
    assert not page.locator("#filter").is_visible()
    page.locator("#subjects").click()
    subject = page.locator("details.subject").nth(1)
    assert subject.locator("table").first.is_hidden()
    subject.locator("summary").first.click()
    assert subject.locator("table").first.is_visible()
