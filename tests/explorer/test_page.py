"""The page of the explorer: what it has of the draws, what it refuses, and how it is written."""

import base64
import json
import re
from dataclasses import replace
from html import unescape
from itertools import product

import numpy as np
import pytest
from commands import refusal_of, run_ok
from conftest import refused
from scipy.stats import norm

import bayes_toe as bt
from bayes_toe.explorer import page as page_module
from bayes_toe.explorer.entry import Entry, pack_slice
from bayes_toe.explorer.page import MOST_ENTRIES, entries, page, require_few
from bayes_toe.inference.prediction import Predictor


def json_of_page(html):
    # The data in the page by name: 'index', and 'entry-0' and more, one for each subject and model.
    texts = re.findall(
        r'<script type="application/json" id="(index|entry-\d+)">(.*?)</script>', html
    )
    return {name: json.loads(content) for name, content in texts}


def unpacked_numbers(text, kind="<f4"):
    """The page has arrays as texts of their bytes."""
    return np.frombuffer(base64.b64decode(text), kind)


@pytest.fixture(scope="module")
def page_data(explorer):
    return json_of_page(explorer.html)


@pytest.fixture(scope="module")
def entry(page_data):
    """The first entry: draws of subject A under the paper's model."""
    return page_data["entry-0"]


def page_of_made_draws(subject, draws=3000, copies=1):
    """The HTML of a page with made draws of a subject under the model without an order effect."""
    target = bt.model.observer_posterior(subject, model="none")
    x = np.tile(np.linspace(-1, 0, draws)[:, None], len(target.coordinates))
    return page([Entry("none", target, x[None])] * copies).html


def rows_of_draws(packed):
    """The rows of the draws that an entry has, evenly spaced among all draws."""
    return np.arange(packed["rows"]) * packed["of"] // packed["rows"]


def test_the_page_asks_nothing_of_the_network_and_a_notebook_shows_it_as_it_is(explorer):
    # The libraries in its scripts may name addresses. The browser test sees whether they are used.
    html_without_scripts = re.sub(r"<script.*?</script>", "", explorer.html, flags=re.DOTALL)
    assert re.findall(r"https?://", html_without_scripts) == []
    # A notebook shows it in a frame, whose attribute srcdoc is the page.
    frame = explorer._repr_html_()
    assert frame.startswith("<iframe srcdoc=")
    assert unescape(frame.split('"')[1]) == explorer.html


def test_an_entry_holds_draws_and_their_quantiles(entry, analysis):
    gain = analysis.draws.values("A", "gain").ravel()
    assert entry["subject"] == "A"
    assert entry["of"] == len(gain)
    assert entry["names"][0] == "mu1"  # the paper's parameters come first
    position = entry["names"].index("gain")
    # (quantities, draws that the page has)
    values = unpacked_numbers(entry["values"]).reshape(len(entry["names"]), entry["rows"])
    np.testing.assert_array_equal(values[position], gain[rows_of_draws(entry)].astype(np.float32))
    quantiles = np.quantile(gain, [0.025, 0.5, 0.975])
    np.testing.assert_allclose(entry["marked"][position], quantiles, rtol=1e-9)


def test_an_entry_has_the_true_values_of_the_parameters_of_its_model(entry, page_data, truth):
    assert entry["truth"]["sigma_p"] == truth["sigma_p"]
    # Before this entry, three subjects have two entries each: of the paper's model, and of all four
    # models. The model without order effects has q0, but no other parameter with a true value.
    entry_without_effects = page_data["entry-6"]
    assert entry_without_effects["truth"] == {"q0": truth["q0"]}


def test_the_axis_agrees_with_the_beliefs_of_the_closed_form(entry, analysis):
    # The axis has the s2 at which the first stimulus, at both ends of the range, seems equal: there
    # P('equal') is at its peak q0. It has a row for each end, with a value for each draw.
    natural = analysis.draws.natural("A")
    *theta, q0 = (values.ravel()[rows_of_draws(entry)] for values in natural)
    for s1, s2 in zip(
        entry["ends"], unpacked_numbers(entry["axis"]).reshape(2, entry["rows"]), strict=True
    ):
        np.testing.assert_allclose(bt.model.equal_probability(s1, s2, *theta, q0), q0, atol=1e-6)


def test_a_fault_of_the_responses_stands_in_the_place_of_the_words(tmp_path):
    # Responses in one of four blocks of S01 are swapped. That shows in the order of the answers
    # only.
    subject = bt.example_study("2afc")["S01"]
    block = np.arange(subject.total_trials) * 4 // subject.total_trials
    answers = replace(subject.answers, block=block, blocks=tuple("1234"))
    study = bt.Study([replace(subject, answers=answers)]).swap("S01", 2)
    draws = bt.sample(study, model="none", draws=100, seed=1)
    # The draws have counts, which do not show the swap. So an attribute of the file names subjects
    # that are not interpreted.
    loaded = bt.load(draws.save(tmp_path / "posterior.nc"))
    [entry] = entries(loaded)
    assert entry.words == (("not interpreted:", "responses look swapped"),)


@pytest.mark.parametrize(
    "name, expected", [("</script><b>", "</script><b>"), ("a\u202eb", "a\\u202eb")]
)
def test_a_name_can_neither_end_the_page_nor_turn_its_text_around(small_study, name, expected):
    # One name would end the script of the page, and the other has a sign that turns text around.
    html = page_of_made_draws(replace(small_study["A"], name=name), draws=30)
    assert json_of_page(html)["index"]["entries"][0]["subject"] == expected
    assert name not in html


@pytest.mark.parametrize(
    "explore, message",
    [
        (lambda draws: bt.explore(draws, subjects=["D"]), "no subject 'D' among the draws"),
        (lambda draws: bt.explore(draws, subjects=[]), "found 0 subjects, allowed: 1 to 200"),
        (
            lambda draws: bt.explore(draws, truths={"A": {"mu": 1.0}}),
            "truths of 'A': unknown quantity 'mu'",
        ),
        (lambda _: bt.explore([]), "found no draws"),
        (
            lambda _: require_few(MOST_ENTRIES + 1, "subjects"),
            "found 201 subjects, allowed: 1 to 200 in a page; name some with --subject",
        ),
    ],
)
def test_subjects_and_truths_that_are_not_there_are_refused(analysis, explore, message):
    # The draws are of A, B and C.
    with refused(message):
        explore(analysis.draws)


def test_a_lone_subject_has_all_its_curves_and_the_most_draws_that_an_entry_can_have():
    # The subject has all 25 pairs of five levels. The page takes 2,000 of 3,000 draws.
    s1, s2 = np.transpose(list(product(np.arange(5) / 5, repeat=2)))
    subject = bt.Subject("S", s1, s2, [3] * 25, [9] * 25)
    packed = json_of_page(page_of_made_draws(subject))["entry-0"]
    # A slice has the pairs with one weaker stimulus. Four of the five levels are weaker stimuli.
    assert len(packed["slices"]) == 4
    assert packed["undrawn"] == 0
    assert packed["rows"] == 2000


def test_many_posteriors_share_the_rows_of_the_page(small_study, monkeypatch):
    # The page may have 1,500 rows in all. With its limit of 16,000, three entries would have all
    # the rows that they can have.
    monkeypatch.setattr(page_module, "_ROWS", 3 * 500)
    data = json_of_page(page_of_made_draws(small_study["A"], copies=3))
    assert [data[f"entry-{i}"]["rows"] for i in range(3)] == [500, 500, 500]


def test_the_command_writes_the_page_and_refuses_to_replace_it(draws_without_effects, tmp_path):
    draws_without_effects.save(tmp_path / "posterior.nc")
    (tmp_path / "truth.csv").write_text("subject,q0,noise\nA,0.9,0.3\n")
    line = "explore posterior.nc -o a.html --truth truth.csv --subject A"
    assert "Explorer in a.html" in run_ok(line, cwd=tmp_path)
    # From q0 and the noise follow two quantities in per cent: the JND is the 75 % quantile of the
    # noise, and the zone its 95 % quantile, because 2 Phi(k) - 1 is q0 = .9 at the criterion k.
    truth = json_of_page((tmp_path / "a.html").read_text(encoding="utf-8"))["entry-0"]["truth"]
    jnd, zone = 100 * np.expm1(0.3 * norm.ppf([0.75, 0.95]))
    assert truth == pytest.approx({"q0": 0.9, "noise": 0.3, "jnd": jnd, "zone": zone})
    assert "a.html: exists" in refusal_of("explore posterior.nc -o a.html", cwd=tmp_path)


def test_curves_of_which_is_stronger_are_over_the_difference_by_the_first_stimulus(stronger):
    subject = stronger.study["pulled"]
    predictor = Predictor.from_draws(stronger.draws, "pulled", n_draws=50)
    middle = np.sort(subject.s1)[len(subject.s1) // 2]  # a first stimulus of some pairs
    panel = pack_slice(predictor, middle, has_title=True)
    assert panel["orders"] == [0]
    assert {subject.s1[pair] for pair in panel["pairs"]} == {middle}
    assert panel["title"] == f"first stimulus {middle:.3g}"
    # P('second') of each draw at each difference x, as whole numbers from 0 to 65535.
    expected = predictor.yes(middle, middle + np.array(panel["x"])).T.ravel()
    assert unpacked_numbers(panel["yes"], "<u2") / 65535 == pytest.approx(expected, abs=1e-5)
    html = page(entries(stronger.draws)).html
    assert "P(second)" in html
    # The section on answers does not name an answer of the other task.
    assert "'equal'" not in html.partition('<section id="answers"')[2].partition("</section>")[0]


def test_an_equal_pair_below_all_others_is_in_the_panel_of_the_weakest_stimulus():
    # The pairs are (-0.4, -0.4) and (0, 0.3). No curve has the stimulus -0.4, so that both pairs
    # are in the panel of 0.
    html = page_of_made_draws(bt.Subject("S", [-0.4, 0], [-0.4, 0.3], [9, 4], [10, 10]))
    (panel,) = json_of_page(html)["entry-0"]["slices"]
    assert panel["pairs"] == [0, 1]


def test_a_known_unit_is_that_of_all_axes():
    table = bt.example_study().select(["S01"]).frame().drop(columns="synthetic")
    # The stimuli in grams; the reference is 100 g.
    table[["s1", "s2"]] = 100.0 * np.exp(table[["s1", "s2"]])
    grams = bt.read_study(table, bt.ReadOptions(unit="g"))
    (entry,) = entries(bt.sample(grams, seed=1, model="both"))
    packed = entry.packed(most_rows=500)
    assert packed["plane"]["label"] == "first stimulus, g"
    assert packed["slices"][0]["scale"]["label"] == "second stimulus, % of the first"
    assert packed["pairs"]["stimuli"][0] == "100 g, 135 g"
