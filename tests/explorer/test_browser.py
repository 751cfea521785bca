"""The page in a real browser.

What is dragged over is what is selected and drawn, and nothing is asked of the network.
"""

import csv

import numpy as np
import pytest
from browsers import Opened

import bayes_toe as bt

READ_DATA = """name => {
  const data = Bokeh.documents[0].get_model_by_name(name).data;
  return Object.fromEntries(Object.entries(data).map(([key, values]) => [key, Array.from(values)]));
}"""


class Explorer(Opened):
    """The page, drawn."""

    def __init__(self, *opened, **options):
        super().__init__(*opened, **options)
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
        """Draws of subject a or b, before anything is selected."""
        return self.data(f"all-{letter}-{self.panel(y, x)}")

    def selected_draws(self, letter, y, x):
        """Draws that are selected, and their rows among those that are shown."""
        return self.data(f"kept-{letter}-{self.panel(y, x)}")

    def choose(self, selector, value):
        self.page.select_option(selector, value)
        self.settle()

    def drag(self, y, x, start, end):
        """Drag over the panel of two quantities, from and to shares of its width and height."""
        cell = self.page.locator(f"#cell-{self.panel(y, x)}")
        cell.scroll_into_view_if_needed()
        frame = cell.bounding_box()
        places = [
            (frame["x"] + across * frame["width"], frame["y"] + down * frame["height"])
            for across, down in (start, end)
        ]
        self.page.mouse.move(*places[0])
        self.page.mouse.down()
        self.page.mouse.move(*places[1], steps=4)
        self.page.mouse.up()
        self.settle()


@pytest.fixture(scope="module")
def path(explorer, tmp_path_factory):
    return explorer.save(tmp_path_factory.mktemp("explorer") / "explorer.html")


@pytest.fixture(scope="module")
def page(browser, path):
    built = Explorer(browser, path, 1200)
    yield built
    built.page.close()


@pytest.fixture
def opened(page):
    """Subjects A and B under the paper's model, its parameters, nothing brushed."""
    page.tab("paper's parameters")
    page.choose("#subject-a", "A")
    page.choose("#subject-b", "B")
    page.page.click("#main")
    page.settle()
    yield page
    assert page.problems == []


def shown_rows(page):
    """How many draws of the first subject the page has, and which of them are selected."""
    panel = ("sigma_p", "mu1")  # all panels have the same draws
    size = len(page.shown_draws("a", *panel)["x"])
    return size, page.selected_draws("a", *panel)["row"].astype(int)


def thinned(draws, subject, rows):
    """The natural parameters of the draws that the page holds."""
    theta = draws.natural(subject)
    index = np.arange(rows) * theta.mu1.size // rows
    return {name: values.ravel()[index] for name, values in theta._asdict().items()}


def test_a_drag_selects_the_draws_of_both_subjects(opened, analysis):
    opened.choose("#subject-b", "C")
    opened.drag("sigma_l", "sigma_p", (0.1, 0.1), (0.6, 0.7))
    limits = opened.limits()
    assert set(limits) == {"sigma_p", "sigma_l"}
    for letter, subject in (("a", "A"), ("b", "C")):
        n_shown = len(opened.shown_draws(letter, "q0", "mu1")["x"])
        theta = thinned(analysis.draws, subject, n_shown)
        is_inside = np.ones(n_shown, bool)
        for name, (low, high) in limits.items():
            stored = np.float32(theta[name])  # as the page has it
            is_inside &= (stored >= low) & (stored <= high)
        selected = opened.selected_draws(letter, "q0", "mu1")
        assert selected["row"].tolist() == np.flatnonzero(is_inside).tolist()
        np.testing.assert_allclose(selected["y"], theta["q0"][is_inside], rtol=1e-6)
        message = f"{is_inside.sum():,} of {n_shown:,} shown draws are selected"
        assert message in opened.page.inner_text("#share")


def test_after_a_drag_the_curve_is_the_mean_of_the_selected_draws(opened, analysis):
    opened.drag("sigma_l", "sigma_p", (0.1, 0.1), (0.6, 0.7))
    size, rows = shown_rows(opened)
    assert 5 < len(rows) < 0.9 * size, "some draws, but not all"
    selected = [values[rows, None] for values in thinned(analysis.draws, "A", size).values()]
    curve = opened.data("curve-a-weaker")
    stronger = curve["x"]
    weaker = np.full_like(stronger, stronger[0])  # the curve begins with equal stimuli
    q = bt.model.equal_probability(weaker, stronger, *selected)
    np.testing.assert_allclose(curve["kept"], q.mean(axis=0), atol=1e-5)


def test_a_drag_on_the_diagonal_takes_a_range_and_reset_gives_all_back(opened):
    earlier = opened.data("curve-a-weaker")["kept"]
    opened.drag("mu1", "mu1", (0.6, 0.5), (0.9, 0.6))
    assert list(opened.limits()) == ["mu1"]
    assert not np.allclose(opened.data("curve-a-weaker")["kept"], earlier, atol=1e-4)
    opened.page.click("#reset")
    opened.settle()
    np.testing.assert_array_equal(opened.data("curve-a-weaker")["kept"], earlier)
    assert "2,000 of 10,240 draws are shown" in opened.page.inner_text("#share .a")


def test_the_keyboard_alone_selects_some_or_none_which_have_no_numbers(opened, analysis):
    opened.page.focus("#range-name")
    opened.page.select_option("#range-name", "q0")
    opened.page.keyboard.press("Tab")
    opened.page.keyboard.type("0.9")
    opened.page.keyboard.press("Enter")
    opened.settle()
    size, rows = shown_rows(opened)
    q0 = thinned(analysis.draws, "A", size)["q0"]
    assert rows.tolist() == np.flatnonzero(np.float32(q0) >= 0.9).tolist()
    assert opened.page.inner_text("#where") == "selected: peak q₀ from 0.9"
    row = opened.page.locator("#table-a tr", has_text="q₀")
    median = float(row.locator("td:nth-child(3) b").inner_text())
    assert median == pytest.approx(np.median(q0[q0 >= 0.9]), abs=6e-4)
    opened.page.fill("#from", "1e6")
    opened.page.press("#from", "Enter")
    opened.settle()
    assert set(opened.page.locator("#table-a tr td:nth-child(3)").all_inner_texts()) == {"no draws"}
    opened.page.keyboard.press("Escape")
    opened.settle()
    assert opened.page.evaluate("window.explorer.state.brush") is None


def test_subjects_and_models_can_be_switched(opened, symmetric):
    opened.tab("effects")
    opened.choose("#subject-a", "C")
    opened.choose("#subject-b", "B")
    opened.choose("#label-b", "model 'none'")
    opened.page.check("#boxes input[value=noise]")
    opened.settle()
    assert opened.shown_quantities() == ["constant_error", "contraction", "jnd", "noise"]
    noise = symmetric.values("B", "noise").ravel()
    stored = opened.selected_draws("b", "noise", "jnd")
    rows = np.arange(len(stored["row"])) * noise.size // len(stored["row"])
    np.testing.assert_allclose(stored["y"], noise[rows], rtol=1e-6)
    label = "Bokeh.documents[0].get_model_by_name('panel-3-2').below[0].axis_label"
    assert opened.page.evaluate(label) == "JND, %"
    opened.drag("contraction", "contraction", (0.2, 0.5), (0.5, 0.6))
    assert "does not have the selected quantity" in opened.page.inner_text("#share .b")


def test_effects_are_averaged_over_the_four_models_with_the_words_of_the_answer(opened, analysis):
    opened.tab("effects")
    opened.choose("#label-a", "four models averaged")
    assert "of 4,000 draws are shown" in opened.page.inner_text("#share .a")
    answer = analysis.evidence["A"].answer
    words = [f"{key.replace('_', ' ')} {answer.word(key)}" for key in answer.words]
    assert opened.page.locator("#answer-a span").all_inner_texts() == words
    # Draws without the effect are in no panel of it.
    share = np.isfinite(opened.selected_draws("a", "contraction", "constant_error")["y"]).mean()
    assert share == pytest.approx(answer.probabilities["contraction"], abs=0.06)
    opened.tab("paper's parameters")
    assert opened.page.locator("#banner").is_visible()
    assert opened.shown_quantities() == ["mu1", "sigma_p", "sigma_l", "q0"]


def test_the_selection_becomes_a_table(opened, analysis):
    opened.drag("sigma_p", "mu1", (0.5, 0.05), (0.97, 0.9))
    with opened.page.expect_download() as coming:
        opened.page.click("#save")
    lines = list(csv.DictReader(coming.value.path().read_text(encoding="utf-8").splitlines()))
    mine = [line for line in lines if line["which"] == "A"]
    assert len(mine) == len(opened.selected_draws("a", "sigma_p", "mu1")["row"]) > 0
    mu1 = analysis.draws.natural("A").mu1[int(mine[0]["chain"]), int(mine[0]["draw"])]
    assert float(mine[0]["mu1"]) == pytest.approx(mu1, rel=1e-6)


def test_truth_prior_and_badge_are_shown_and_the_page_fits_a_wide_screen(opened):
    assert opened.data("truth-a")["0"].tolist() == [-0.7]
    assert opened.data("prior-a")["y0"].max() > 0.0
    assert "determined by the prior" in opened.page.inner_text("#badges-a")
    assert opened.page_width() <= 1200


def test_a_narrow_screen_has_the_corner_first_and_panels_that_can_be_read(browser, path):
    built = Explorer(browser, path, 400)
    assert built.shown_quantities() == ["constant_error", "contraction", "jnd"]
    curves, corner = (built.page.locator(name).bounding_box() for name in ("#curves-a", "#corner"))
    assert corner["y"] + corner["height"] <= curves["y"]
    built.drag("contraction", "constant_error", (0.5, 0.2), (0.9, 0.8))
    assert set(built.limits()) == {"constant_error", "contraction"}
    assert built.page_width() <= 400
    last_panel = built.page.locator(f"#cell-{built.panel('jnd', 'jnd')}")
    assert last_panel.bounding_box()["width"] > 90
    built.page.close()
    assert built.problems == []
