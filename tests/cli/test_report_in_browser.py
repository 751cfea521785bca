"""The report in a real browser: it fits a telephone and paper, sorts, filters and unfolds, needs no script for being read, asks nobody."""

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
    return page.locator(f"#overview tbody td:nth-child({column})").evaluate_all(
        "cells => cells.map(cell => cell.dataset.value)"
    )


def names(page):
    return page.locator("#overview tbody tr:visible td.name a").all_inner_texts()


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
    made.page.evaluate("dispatchEvent(new Event('beforeprint'))")  # everything is open
    assert made.page.locator("details:not([open])").count() == 0
    assert made.wide() == width
    assert dark == (
        made.page.evaluate("getComputedStyle(document.body).backgroundColor")
        != "rgb(255, 255, 255)"
    )
    made.page.close()
    assert made.problems == []


def test_contents_stay_in_view_and_a_link_unfolds_its_subject(opened):
    page = opened.page
    assert page.locator("details.subject[open]").count() == 0
    page.locator("nav li li", has_text="C").locator("a").click()
    page.wait_for_function("scrollY > 500")
    assert page.locator("details.subject[open] summary h3").all_inner_texts() == ["C"]
    assert page.locator("nav").bounding_box()["y"] == 0.0
    page.locator("details.subject[open] summary").click()
    page.locator("nav li li", has_text="C").locator("a").click()  # the same address once more
    page.wait_for_selector("details.subject[open]")
    page.click("#every")
    assert page.locator("details.subject[open]").count() == 3


def test_a_column_sorts_both_ways_and_what_has_no_value_stays_last(opened, marked):
    known = [answer.probabilities["constant_error"] for answer in marked.answers[:2]]
    head = opened.page.locator("#overview thead tr:last-child th:nth-child(3)")
    for order in ("ascending", "descending"):
        head.click()
        found = [float(one) if one else math.nan for one in values(opened.page, 3)]
        assert head.get_attribute("aria-sort") == order
        assert found[:2] == sorted(known, reverse=order == "descending")
        assert math.isnan(found[2])
    opened.page.locator("#overview thead tr:last-child th:first-child button").press("Enter")
    assert names(opened.page) == ["A", "B", "C"]


def test_the_filter_is_of_table_contents_and_subjects(opened):
    page = opened.page
    page.check("nav input[type=checkbox]")
    assert names(page) == ["A", "C"]
    assert page.locator("details.subject:visible summary h3").all_inner_texts() == ["A", "C"]
    page.fill("nav input[type=search]", "c")
    assert names(page) == page.locator("nav li li:visible").all_inner_texts() == ["C"]
    assert page.locator("nav output").inner_text() == "1 of 3 shown"
    page.uncheck("nav input[type=checkbox]")
    page.fill("nav input[type=search]", "")
    assert names(page) == ["A", "B", "C"]


def test_the_answer_is_in_sight_first_and_the_table_below_it(browser, path):
    made = Opened(browser, path, 1200, 700)
    answer, table, others = (
        made.page.locator(what).first.bounding_box() for what in (".lead", "#overview", "#read")
    )
    assert answer["y"] < table["y"] < table["y"] + table["height"] < 700 < others["y"]
    made.page.close()
    assert made.problems == []


def test_without_javascript_it_is_whole(browser, path):
    made = Opened(browser, path, 400, java_script_enabled=False)
    assert names(made.page) == ["A", "B", "C"]
    assert not made.page.locator("#filter").is_visible()
    subject = made.page.locator("details.subject").nth(1)
    assert subject.locator("table").first.is_hidden()
    subject.locator("summary").click()
    assert subject.locator("table").first.is_visible()
    made.page.close()
    assert made.problems == []
