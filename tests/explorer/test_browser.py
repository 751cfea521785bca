"""The explorer in a real browser.

A drag selects the draws under it, of which curves and numbers are made. The page asks nothing of
the network.
"""

import csv

import numpy as np
import pytest
from browsers import BrowserPage

import bayes_toe as bt

#: The columns of a data source of Bokeh by its name, as arrays.
READ_DATA = """name => {
  const data = Bokeh.documents[0].get_model_by_name(name).data;
  return Object.fromEntries(Object.entries(data).map(([key, values]) => [key, Array.from(values)]));
}"""


class Explorer(BrowserPage):
    """The page of the explorer in a browser, when all is drawn, with actions of a user."""

    def __init__(self, *arguments, **options):
        super().__init__(*arguments, **options)
        self.page.wait_for_selector("body[data-ready]", state="attached")
        self.settle()

    def settle(self):
        """Wait until everything that was asked for is drawn."""
        self.page.evaluate(
            "() => new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done)))"
        )
        self.page.wait_for_function("() => Bokeh.documents[0].is_idle")

    def data(self, name):
        return {
            key: np.array(values, float)
            for key, values in self.page.evaluate(f"({READ_DATA})({name!r})").items()
        }

    def limits(self):
        return self.page.evaluate("window.explorer.state.brush.limits")

    def tab(self, name):
        self.page.get_by_role("tab", name=name).click()
        self.settle()

    def shown_quantities(self):
        """Quantities of the panels: rows and columns of the corner, in this order."""
        return self.page.evaluate("window.explorer.state.names")

    def panel(self, y, x):
        """The panel of two quantities as the page names it: '2-1' is in row 2 and column 1."""
        quantities = self.shown_quantities()
        return f"{quantities.index(y)}-{quantities.index(x)}"

    def shown_draws(self, letter, y, x):
        """All draws of the first subject (a) or the second (b) in a panel, with x and y."""
        return self.data(f"all-{letter}-{self.panel(y, x)}")

    def selected_draws(self, letter, y, x):
        """The selected draws of a subject in a panel: x, y and their rows among all shown ones."""
        return self.data(f"kept-{letter}-{self.panel(y, x)}")

    def choose(self, selector, value):
        self.page.select_option(selector, value)
        self.settle()

    def drag(self, y, x, start, end):
        """Drag over the panel of two quantities from start to end.

        Both are shares of its width from the left and of its height from above.
        """
        cell = self.page.locator(f"#cell-{self.panel(y, x)}")
        cell.scroll_into_view_if_needed()
        frame = cell.bounding_box()
        first, last = (
            (frame["x"] + across * frame["width"], frame["y"] + down * frame["height"])
            for across, down in (start, end)
        )
        self.page.mouse.move(*first)
        self.page.mouse.down()
        self.page.mouse.move(*last, steps=4)
        self.page.mouse.up()
        self.settle()


@pytest.fixture(scope="module")
def page_path(explorer, tmp_path_factory):
    return explorer.save(tmp_path_factory.mktemp("explorer") / "explorer.html")


@pytest.fixture(scope="module")
def page(browser, page_path):
    opened = Explorer(browser, page_path, 1200)
    yield opened
    opened.page.close()


@pytest.fixture
def explorer_page(page):
    """The explorer with A as subject a and B as subject b under the paper's model.

    Its parameters are shown, and no draws are selected. In the end the page had no problem.
    """
    page.tab("paper's parameters")
    page.choose("#subject-a", "A")
    page.choose("#subject-b", "B")
    page.page.click("#main")
    page.settle()
    yield page
    assert page.problems == []


def n_shown_and_selected_rows(page):
    """How many draws of subject a are shown, and the rows of those that are selected."""
    panel = ("sigma_p", "mu1")  # all panels have the same draws
    size = len(page.shown_draws("a", *panel)["x"])
    return size, page.selected_draws("a", *panel)["row"].astype(int)


def parameters_of_shown_draws(draws, subject, rows):
    """The natural parameters of so many evenly spaced draws, which are those of the page."""
    theta = draws.natural(subject)
    index = np.arange(rows) * theta.mu1.size // rows
    return {name: values.ravel()[index] for name, values in theta._asdict().items()}


def test_a_drag_selects_the_draws_of_both_subjects(explorer_page, analysis):
    explorer_page.choose("#subject-b", "C")
    # Over the panel of both, from 10 to 60 % of its width and from 10 to 70 % of its height.
    explorer_page.drag("sigma_l", "sigma_p", (0.1, 0.1), (0.6, 0.7))
    limits = explorer_page.limits()  # lower and upper ends of what is selected, by parameter
    assert set(limits) == {"sigma_p", "sigma_l"}
    for letter, subject in (("a", "A"), ("b", "C")):
        n_shown = len(explorer_page.shown_draws(letter, "q0", "mu1")["x"])
        # The draws within both limits, by the parameters that were sampled, are the selected ones.
        theta = parameters_of_shown_draws(analysis.draws, subject, n_shown)
        is_inside = np.ones(n_shown, bool)
        for name, (low, high) in limits.items():
            stored = np.float32(theta[name])  # as the page has it
            is_inside &= (stored >= low) & (stored <= high)
        selected = explorer_page.selected_draws(letter, "q0", "mu1")
        assert selected["row"].tolist() == np.flatnonzero(is_inside).tolist()
        np.testing.assert_allclose(selected["y"], theta["q0"][is_inside], rtol=1e-6)
        message = f"{is_inside.sum():,} of {n_shown:,} shown draws are selected"
        assert message in explorer_page.page.inner_text("#share")


def test_after_a_drag_the_curve_is_the_mean_of_the_selected_draws(explorer_page, analysis):
    explorer_page.drag("sigma_l", "sigma_p", (0.1, 0.1), (0.6, 0.7))
    n_shown, rows = n_shown_and_selected_rows(explorer_page)
    assert 5 < len(rows) < 0.9 * n_shown, "some draws, but not all"
    shown_draws = parameters_of_shown_draws(analysis.draws, "A", n_shown)
    selected = [values[rows, None] for values in shown_draws.values()]  # each (draws, 1)
    curve = explorer_page.data("curve-a-weaker")
    stronger = curve["x"]
    weaker = np.full_like(stronger, stronger[0])  # the curve begins with equal stimuli
    p_equal = bt.model.equal_probability(weaker, stronger, *selected)  # (draws, points)
    np.testing.assert_allclose(curve["kept"], p_equal.mean(axis=0), atol=1e-5)


def test_a_drag_on_the_diagonal_takes_a_range_and_reset_gives_all_back(explorer_page):
    earlier = explorer_page.data("curve-a-weaker")["kept"]
    # A panel of the diagonal has one parameter, so that a drag to the right selects a range of it.
    explorer_page.drag("mu1", "mu1", (0.6, 0.5), (0.9, 0.6))
    assert list(explorer_page.limits()) == ["mu1"]
    assert not np.allclose(explorer_page.data("curve-a-weaker")["kept"], earlier, atol=1e-4)
    explorer_page.page.click("#reset")
    explorer_page.settle()
    np.testing.assert_array_equal(explorer_page.data("curve-a-weaker")["kept"], earlier)
    # The page has at most 2,000 draws of a subject, of the 10,240 that were sampled.
    assert "2,000 of 10,240 draws are shown" in explorer_page.page.inner_text("#share .a")


def test_the_keyboard_alone_selects_some_or_none_which_have_no_numbers(explorer_page, analysis):
    # The lower end of the range of q0 is typed: .9 selects some draws, and a million selects none.
    explorer_page.page.focus("#range-name")
    explorer_page.page.select_option("#range-name", "q0")
    explorer_page.page.keyboard.press("Tab")
    explorer_page.page.keyboard.type("0.9")
    explorer_page.page.keyboard.press("Enter")
    explorer_page.settle()
    n_shown, rows = n_shown_and_selected_rows(explorer_page)
    q0 = parameters_of_shown_draws(analysis.draws, "A", n_shown)["q0"]
    assert rows.tolist() == np.flatnonzero(np.float32(q0) >= 0.9).tolist()
    assert explorer_page.page.inner_text("#where") == "selected: peak q₀ from 0.9"
    row = explorer_page.page.locator("#table-a tr", has_text="q₀")
    # The table has three decimals of the median of the selected draws.
    median = float(row.locator("td:nth-child(3) b").inner_text())
    assert median == pytest.approx(np.median(q0[q0 >= 0.9]), abs=6e-4)

    explorer_page.page.fill("#from", "1e6")
    explorer_page.page.press("#from", "Enter")
    explorer_page.settle()
    assert set(explorer_page.page.locator("#table-a tr td:nth-child(3)").all_inner_texts()) == {
        "no draws"
    }
    # Escape gives up the selection.
    explorer_page.page.keyboard.press("Escape")
    explorer_page.settle()
    assert explorer_page.page.evaluate("window.explorer.state.brush") is None


def test_subjects_and_models_can_be_switched(explorer_page, draws_without_effects):
    explorer_page.tab("effects")
    explorer_page.choose("#subject-a", "C")
    explorer_page.choose("#subject-b", "B")
    explorer_page.choose("#label-b", "model 'none'")
    explorer_page.page.check("#boxes input[value=noise]")
    explorer_page.settle()
    assert explorer_page.shown_quantities() == ["constant_error", "contraction", "jnd", "noise"]
    noise = draws_without_effects.values("B", "noise").ravel()
    # Without a selection all are selected: evenly spaced draws of the model 'none'.
    selected = explorer_page.selected_draws("b", "noise", "jnd")
    rows = np.arange(len(selected["row"])) * noise.size // len(selected["row"])
    np.testing.assert_allclose(selected["y"], noise[rows], rtol=1e-6)
    panel = explorer_page.panel("noise", "jnd")
    label = f"Bokeh.documents[0].get_model_by_name('panel-{panel}').below[0].axis_label"
    assert explorer_page.page.evaluate(label) == "JND, %"
    # Subject b is shown under the model 'none', which has no contraction.
    explorer_page.drag("contraction", "contraction", (0.2, 0.5), (0.5, 0.6))
    assert "does not have the selected quantity" in explorer_page.page.inner_text("#share .b")


def test_effects_are_averaged_over_the_four_models_with_the_words_of_the_answer(
    explorer_page, analysis
):
    explorer_page.tab("effects")
    explorer_page.choose("#label-a", "four models averaged")
    # The average has 4,000 draws of the four models in proportion to their probabilities.
    assert "of 4,000 draws are shown" in explorer_page.page.inner_text("#share .a")
    answer = analysis.evidence["A"].answer
    words = [f"{key.replace('_', ' ')} {answer.word(key)}" for key in answer.words]
    assert explorer_page.page.locator("#answer-a span").all_inner_texts() == words
    # Draws of models without a contraction have no value of it, so that the share of draws with one
    # is its posterior probability, but for sampling error.
    share = np.isfinite(
        explorer_page.selected_draws("a", "contraction", "constant_error")["y"]
    ).mean()
    assert share == pytest.approx(answer.probabilities["contraction"], abs=0.06)
    explorer_page.tab("paper's parameters")
    assert explorer_page.page.locator("#banner").is_visible()
    assert explorer_page.shown_quantities() == ["mu1", "sigma_p", "sigma_l", "q0"]


def test_the_selection_becomes_a_table(explorer_page, analysis):
    explorer_page.drag("sigma_p", "mu1", (0.5, 0.05), (0.97, 0.9))
    with explorer_page.page.expect_download() as coming:
        explorer_page.page.click("#save")
    # The file has a row for each selected draw, with its subject, chain and number.
    lines = list(csv.DictReader(coming.value.path().read_text(encoding="utf-8").splitlines()))
    rows_of_a = [line for line in lines if line["which"] == "A"]
    assert len(rows_of_a) == len(explorer_page.selected_draws("a", "sigma_p", "mu1")["row"])
    row, *_ = rows_of_a
    mu1 = analysis.draws.natural("A").mu1[int(row["chain"]), int(row["draw"])]
    assert float(row["mu1"]) == pytest.approx(mu1, rel=1e-6)


def test_truth_prior_and_badge_are_shown_and_the_page_fits_a_wide_screen(explorer_page):
    assert explorer_page.data("truth-a")["0"].tolist() == [-0.7]  # the true mu1 of A
    assert explorer_page.data("prior-a")["y0"].max() > 0.0
    assert "determined by the prior" in explorer_page.page.inner_text("#badges-a")
    assert explorer_page.page_width() <= 1200


def test_a_narrow_screen_has_the_corner_first_and_panels_that_can_be_read(browser, page_path):
    opened = Explorer(browser, page_path, 400)
    assert opened.shown_quantities() == ["constant_error", "contraction", "jnd"]
    curves, corner = (opened.page.locator(name).bounding_box() for name in ("#curves-a", "#corner"))
    assert corner["y"] + corner["height"] <= curves["y"]
    opened.drag("contraction", "constant_error", (0.5, 0.2), (0.9, 0.8))
    assert set(opened.limits()) == {"constant_error", "contraction"}
    assert opened.page_width() <= 400
    last_panel = opened.page.locator(f"#cell-{opened.panel('jnd', 'jnd')}")
    assert last_panel.bounding_box()["width"] > 90
    opened.page.close()
    assert opened.problems == []
