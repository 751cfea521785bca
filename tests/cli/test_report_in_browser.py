"""The report in a real browser.

It fits a telephone and paper, sorts, filters and unfolds, needs no script for being read, asks
nobody.
"""

import math

import pytest
from browsers import Opened

from bayes_toe.cli.results_folder import FigureChoice, write_results


@pytest.fixture(scope="module")
def path(marked, tmp_path_factory):
    return (
        write_results(
            marked,
            tmp_path_factory.mktemp("report") / "out",
            figures=FigureChoice("flagged"),
            workers=1,
        )
        / "report.html"
    )


@pytest.fixture
def opened(browser, path):
    made = Opened(browser, path, 1200)
    yield made
    made.page.close()
    assert made.problems == []


def values(page, column):
    return page.locator(f"#overview-table tbody td:nth-child({column})").evaluate_all(
        "cells => cells.map(cell => cell.dataset.value)"
    )


def names(page):
    return page.locator("#overview-table tbody tr:visible td.name a").all_inner_texts()


@pytest.mark.parametrize(
    ("medium", "width", "scheme", "dark"),
    [
        ("screen", 400, "light", False),
        ("screen", 400, "dark", True),
        ("screen", 1200, "dark", True),
        ("print", 718, "dark", False),
    ],
)
def test_nothing_overflows(browser, path, medium, width, scheme, dark):
    made = Opened(browser, path, width, color_scheme=scheme)
    made.page.emulate_media(media=medium, color_scheme=scheme)
    if medium == "screen":
        made.page.evaluate("document.querySelectorAll('details').forEach(part => part.open = true)")
    assert made.wide() == width
    assert dark == (
        made.page.evaluate("getComputedStyle(document.body).backgroundColor")
        != "rgb(255, 255, 255)"
    )
    made.page.close()
    assert made.problems == []


def test_a_link_unfolds_its_subject(opened):
    page = opened.page
    assert page.locator("details[open]").count() == 0
    page.locator("#overview-table td.name a", has_text="C").click()
    page.wait_for_function("scrollY > 300")
    assert page.locator("details.subject[open] summary h3").all_inner_texts() == ["C"]
    page.locator("details.subject[open] summary").click()
    page.locator("#overview-table td.name a", has_text="C").click()  # the same address once more
    page.wait_for_selector("details.subject[open]")
    page.click("#every")
    assert page.locator("details.subject[open]").count() == 3


def test_folded_it_has_four_screens_and_figures_follow_the_colours_of_the_page(browser, path):
    made = Opened(browser, path, 1200)
    assert made.page.evaluate("document.documentElement.scrollHeight") <= 4 * 900
    made.page.close()
    inks = []
    for scheme in ("light", "dark"):
        made = Opened(browser, path, 1200, color_scheme=scheme)
        text = made.page.locator("figure svg text").first
        inks.append(text.evaluate("text => getComputedStyle(text).fill"))
        made.page.close()
    assert inks == ["rgb(28, 28, 28)", "rgb(228, 228, 228)"]


def test_print_has_the_answer_subjects_and_trust_alone(browser, path):
    made = Opened(browser, path, 718)
    made.page.emulate_media(media="print")
    assert made.page.locator("#trust").is_visible()
    assert made.page.locator("#details").is_hidden()
    made.page.close()


def test_a_column_sorts_both_ways_and_what_has_no_value_stays_last(opened, marked):
    known = [answer.probabilities["constant_error"] for answer in marked.answers[:2]]
    head = opened.page.locator("#overview-table thead tr:last-child th:nth-child(3)")
    for order in ("ascending", "descending"):
        head.click()
        found = [float(one) if one else math.nan for one in values(opened.page, 3)]
        assert head.get_attribute("aria-sort") == order
        assert found[:2] == sorted(known, reverse=order == "descending")
        assert math.isnan(found[2])
    opened.page.locator("#overview-table thead tr:last-child th:first-child button").press("Enter")
    assert names(opened.page) == ["A", "B", "C"]


def test_the_filter_is_of_table_contents_and_subjects(opened):
    page = opened.page
    page.check("#filter input[type=checkbox]")
    assert names(page) == ["A", "C"]
    assert page.locator("details.subject:not([hidden]) summary h3").all_text_contents() == [
        "A",
        "C",
    ]
    page.fill("#filter input[type=search]", "c")
    assert names(page) == ["C"]
    assert page.locator("#filter output").inner_text() == "1 of 3 shown"
    page.uncheck("#filter input[type=checkbox]")
    page.fill("#filter input[type=search]", "")
    assert names(page) == ["A", "B", "C"]


def test_the_answer_is_in_sight_first_and_the_table_below_it(browser, path):
    made = Opened(browser, path, 1200, 900)
    places = (".lead", "figure", "#overview-table", "#trust", "#details")
    tops = [made.page.locator(place).first.bounding_box()["y"] for place in places]
    assert tops == sorted(tops)
    assert tops[1] < 900
    made.page.close()
    assert made.problems == []


def test_without_javascript_it_is_whole(browser, path):
    made = Opened(browser, path, 400, java_script_enabled=False)
    assert names(made.page) == ["A", "B", "C"]
    assert not made.page.locator("#filter").is_visible()
    made.page.locator("#subjects").click()
    subject = made.page.locator("details.subject").nth(1)
    assert subject.locator("table").first.is_hidden()
    subject.locator("summary").first.click()
    assert subject.locator("table").first.is_visible()
    made.page.close()
    assert made.problems == []
