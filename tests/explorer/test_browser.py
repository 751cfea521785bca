"""The page in a real browser: what is dragged over is what is selected and drawn, and nothing is asked of the network."""

import csv

import numpy as np
import pytest
from browsers import Opened

import bayes_toe as bt

DATA = "name => Object.fromEntries(Object.entries(Bokeh.documents[0].get_model_by_name(name).data).map(([k, v]) => [k, Array.from(v)]))"


class Explorer(Opened):
    """The page, drawn."""

    def __init__(self, *opened):
        super().__init__(*opened)
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
            for key, values in self.page.evaluate(f"({DATA})({name!r})").items()
        }

    def limits(self):
        return self.page.evaluate("window.explorer.state.brush.limits")

    def choose(self, what, value):
        self.page.select_option(what, value)
        self.settle()

    def drag(self, cell, start, end):
        """Drag over a panel, from and to shares of its width and height."""
        self.page.locator(f"#cell-{cell}").scroll_into_view_if_needed()
        frame = self.page.locator(f"#cell-{cell}").bounding_box()
        places = [
            (frame["x"] + x * frame["width"], frame["y"] + y * frame["height"])
            for x, y in (start, end)
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
    made = Explorer(browser, path, 1200)
    yield made
    made.page.close()


@pytest.fixture
def opened(page):
    """The page as it opens: subject A under both models, natural quantities, nothing brushed."""
    yield page
    page.page.click("#reset")
    for letter, label in (("a", "predictive update"), ("b", "none")):
        page.choose(f"#subject-{letter}", "A")
        page.choose(f"#label-{letter}", label)
    page.page.click("#main")
    page.settle()
    assert page.problems == []


def shown_rows(page):
    """How many draws the page holds, and which of them it shows as selected, of the first subject."""
    return len(page.data("all-a-1-0")["x"]), page.data("kept-a-1-0")["row"].astype(int)


def thinned(draws, subject, rows):
    """The natural parameters of the draws that the page holds."""
    theta = draws.natural(subject)
    at = np.arange(rows) * theta.mu1.size // rows
    return {name: values.ravel()[at] for name, values in theta._asdict().items()}


def test_a_drag_selects_the_draws_and_moves_the_curves(opened, analysis):
    opened.choose("#subject-b", "C")
    opened.choose("#label-b", "predictive update")
    opened.drag("2-1", (0.1, 0.1), (0.6, 0.7))
    limits = opened.limits()
    assert set(limits) == {"sigma_p", "sigma_l"}
    for letter, subject in (("a", "A"), ("b", "C")):
        kept, every = opened.data(f"kept-{letter}-3-0"), opened.data(f"all-{letter}-3-0")
        theta = thinned(analysis.draws, subject, len(every["x"]))
        inside = np.all(
            [
                (np.float32(theta[name]) >= low) & (np.float32(theta[name]) <= high)
                for name, (low, high) in limits.items()
            ],
            axis=0,
        )
        assert kept["row"].tolist() == np.flatnonzero(inside).tolist()
        np.testing.assert_allclose(kept["y"], theta["q0"][inside], rtol=1e-6)
        assert f"{inside.sum():,} of {len(inside):,} draws" in opened.page.inner_text("#share")
    size, rows = shown_rows(opened)
    assert 5 < len(rows) < 0.9 * size
    theta = thinned(analysis.draws, "A", size)
    for kind, weaker_first in (("weaker", True), ("stronger", False)):
        drawn = opened.data(f"curve-a-{kind}")
        low, x = np.full_like(drawn["x"], drawn["x"][0]), drawn["x"]
        first, second = (low, x) if weaker_first else (x, low)
        q = bt.model.equal_probability(
            first,
            second,
            *(theta[name][rows, None] for name in ("mu1", "sigma_p", "sigma_l", "q0")),
        )
        np.testing.assert_allclose(drawn["kept"], q.mean(axis=0), atol=1e-6)
        np.testing.assert_allclose(drawn["low"], np.quantile(q, 0.025, axis=0), atol=1e-6)


def test_a_drag_on_the_diagonal_takes_a_range_and_reset_gives_all_back(opened):
    before = opened.data("curve-a-weaker")["kept"]
    opened.drag("0-0", (0.6, 0.5), (0.9, 0.6))
    assert list(opened.limits()) == ["mu1"]
    assert not np.allclose(opened.data("curve-a-weaker")["kept"], before, atol=1e-4)
    opened.page.click("#reset")
    opened.settle()
    np.testing.assert_array_equal(opened.data("curve-a-weaker")["kept"], before)
    assert "all" in opened.page.inner_text("#share")


def test_the_keyboard_alone_selects_some_or_none_which_have_no_numbers(opened, analysis):
    opened.page.focus("#range-name")
    opened.page.select_option("#range-name", "q0")
    opened.page.keyboard.press("Tab")
    opened.page.keyboard.type("0.9")
    opened.page.keyboard.press("Enter")
    opened.settle()
    size, rows = shown_rows(opened)
    theta = thinned(analysis.draws, "A", size)
    assert rows.tolist() == np.flatnonzero(np.float32(theta["q0"]) >= 0.9).tolist()
    assert opened.page.inner_text("#where") == "selected: q₀ from 0.9"
    quantiles = np.quantile(theta["q0"][theta["q0"] >= 0.9], 0.5)
    shown = (
        opened.page.locator("#table-a tr", has_text="q₀").locator("td:nth-child(3) b").inner_text()
    )
    assert float(shown) == pytest.approx(quantiles, abs=6e-4)
    opened.page.fill("#from", "1e6")
    opened.page.press("#from", "Enter")
    opened.settle()
    assert "none of" in opened.page.inner_text("#share")
    assert np.isnan(opened.data("curve-a-weaker")["kept"]).all()
    assert set(opened.page.locator("#table-a tr td:nth-child(3)").all_inner_texts()) == {"no draws"}
    opened.page.keyboard.press("Escape")
    opened.settle()
    assert opened.page.evaluate("window.explorer.state.brush") is None


def test_subjects_coordinates_and_models_can_be_switched(opened, analysis, symmetric):
    opened.choose("#subject-a", "C")
    rows = len(opened.data("kept-a-1-0")["x"])
    np.testing.assert_allclose(
        opened.data("kept-a-1-0")["x"], thinned(analysis.draws, "C", rows)["mu1"], rtol=1e-6
    )
    opened.page.click("#identified")
    opened.settle()
    shown = [
        one.get_attribute("value") for one in opened.page.locator("#boxes input:checked").all()
    ]
    assert sorted(shown) == ["lapse_rate", "noise", "offset", "pull", "q0", "width"]
    opened.choose("#subject-b", "B")
    opened.choose("#label-b", "none")
    noise = symmetric.values("B", "noise").ravel()
    place = {name: shown.index(name) for name in ("noise", "q0", "pull")}
    down, across = max(place["noise"], place["q0"]), min(place["noise"], place["q0"])
    kept = opened.data(f"kept-b-{down}-{across}")
    axis = "y" if down == place["noise"] else "x"
    np.testing.assert_allclose(
        kept[axis], noise[np.arange(len(kept["row"])) * noise.size // len(kept["row"])], rtol=1e-6
    )
    opened.drag(f"{place['pull']}-{place['pull']}", (0.2, 0.5), (0.5, 0.6))
    assert "lacks the quantity" in opened.page.inner_text("#share .b")


def test_the_selection_becomes_a_table(opened, analysis):
    opened.drag("1-0", (0.5, 0.05), (0.97, 0.9))
    with opened.page.expect_download() as coming:
        opened.page.click("#save")
    lines = list(csv.DictReader(coming.value.path().read_text(encoding="utf-8").splitlines()))
    mine = [line for line in lines if line["which"] == "A"]
    assert len(mine) == len(opened.data("kept-a-1-0")["row"]) > 0
    theta = analysis.draws.natural("A")
    for line in mine[:5]:
        assert float(line["mu1"]) == pytest.approx(
            theta.mu1[int(line["chain"]), int(line["draw"])], rel=1e-6
        )


def test_hovering_reads_a_draw(opened):
    drawn = opened.data("kept-a-2-1")
    limits = [
        opened.page.evaluate(
            f"(r => [r.start, r.end])(Bokeh.documents[0].get_model_by_name('range-{slot}'))"
        )
        for slot in (1, 2)
    ]
    middle = np.argmin(
        sum((drawn[key] - np.median(drawn[key])) ** 2 / np.var(drawn[key]) for key in ("x", "y"))
    )
    along, up = (
        (drawn[key][middle] - low) / (high - low)
        for key, (low, high) in zip(("x", "y"), limits, strict=True)
    )
    opened.page.locator("#cell-2-1").scroll_into_view_if_needed()
    frame = opened.page.locator("#cell-2-1").bounding_box()
    border = 3
    x, y = (
        border + share * (frame[side] - 2 * border)
        for share, side in ((along, "width"), (1 - up, "height"))
    )
    opened.page.mouse.move(frame["x"] + x, frame["y"] + y, steps=3)
    told = opened.page.locator(".bk-tooltip-row-value:visible")
    told.first.wait_for()
    assert told.nth(0).inner_text() == "A"
    assert float(told.nth(1).inner_text().replace("−", "-")) == pytest.approx(
        drawn["x"][middle], abs=0.02
    )


def test_what_is_known_and_badged_and_fits_a_wide_screen(opened):
    assert opened.data("truth-a")["0"].tolist() == [-0.7]
    assert opened.data("prior-a")["y0"].max() > 0.0
    assert "dominated by the prior" in opened.page.inner_text("#badges-a")
    opened.page.click("#identified")
    opened.settle()
    assert opened.wide() <= 1200


def test_a_narrow_screen_has_fewer_panels_that_can_be_read(browser, path):
    made = Explorer(browser, path, 400)
    made.drag("1-0", (0.5, 0.2), (0.9, 0.8))
    assert len(made.limits()) == 2
    assert made.wide() <= 400
    sides = [made.page.locator(f"#cell-{i}-{i}").bounding_box() for i in range(3)]
    assert all(
        box["x"] >= 0 and box["x"] + box["width"] <= 400 and box["width"] > 90 for box in sides
    )
    assert made.page.locator("#cell-3-3").is_hidden()
    made.page.close()
    assert made.problems == []


def test_axes_are_called_what_they_show_whatever_stood_in_the_panel(opened):
    """Layout and content of a panel change at once: it is not painted with old places in new data."""
    data = "{ xs: [[-9, 9, 9]], ys: [[-9, -9, 9]], width: [1] }"  # in sight whatever the panel shows next
    opened.page.evaluate(f"Bokeh.documents[0].get_model_by_name('contour-b-1-0').data = {data}")
    opened.settle()
    opened.choose("#label-a", "none")
    label = "Bokeh.documents[0].get_model_by_name('panel-1-0').left[0].axis_label"
    assert opened.page.evaluate("window.explorer.state.names") == ["q0", "jnd"]
    assert opened.page.evaluate(label) == "JND, %"
