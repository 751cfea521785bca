"""What a page is made of: what it holds of draws, what it refuses, and how it is written."""

import base64
import json
import re
from dataclasses import replace
from html import unescape
from itertools import product
from types import SimpleNamespace

import numpy as np
import pytest
from commands import good, refused

import bayes_toe as bt
from bayes_toe.explorer import page as page_module
from bayes_toe.explorer.entry import FRAME, Entry, badges, outlined, slices
from bayes_toe.explorer.page import MOST_ENTRIES, entries, page, symbol
from bayes_toe.inference.prediction import Predictor
from bayes_toe.inference.predictive_checks import FitSummary


def islands(html):
    found = re.findall(
        r'<script type="application/json" id="(index|entry-\d+)">(.*?)</script>', html
    )
    return {name: json.loads(content) for name, content in found}


def numbers(text, kind="<f4"):
    return np.frombuffer(base64.b64decode(text), kind)


@pytest.fixture(scope="module")
def held(explorer):
    return islands(explorer.html)


def shown(subject, draws=3000, copies=1):
    """The page of made draws of a subject under the symmetric model."""
    target = bt.model.observer_posterior(subject, model="none")
    return page(
        [
            Entry(
                "none",
                target,
                np.zeros((1, draws, len(target.coordinates))) + np.linspace(-1, 0, draws)[:, None],
            )
        ]
        * copies
    ).html


def thinned(draws, first):
    """The natural parameters of the draws of A that an entry holds."""
    theta = draws.natural("A")
    at = np.arange(first["rows"]) * theta.mu1.size // first["rows"]
    return [values.ravel()[at] for values in theta]


def test_the_page_asks_nothing_of_the_network_and_a_notebook_shows_it_as_it_is(explorer):
    own = re.sub(r"<script.*?</script>", "", explorer.html, flags=re.DOTALL)
    assert re.findall(r"https?://", own) == []
    frame = explorer._repr_html_()
    assert frame.startswith("<iframe srcdoc=")
    assert unescape(frame.split('"')[1]) == explorer.html


def test_entries_hold_draws_quantiles_and_what_is_known(held, analysis):
    first = held["entry-0"]
    assert (first["subject"], first["names"][0], held["index"]["first"]) == ("A", "mu1", [0, 3])
    values = numbers(first["values"]).reshape(len(first["names"]), first["rows"])
    theta = analysis.draws.values("A", "gain").ravel()
    at = np.arange(first["rows"]) * theta.size // first["rows"]
    np.testing.assert_array_equal(
        values[first["names"].index("gain")], theta[at].astype(np.float32)
    )
    np.testing.assert_allclose(
        first["marked"][first["names"].index("gain")],
        np.quantile(theta, [0.025, 0.5, 0.975]),
        rtol=1e-9,
    )
    summary = analysis.draws.summary().set_index(["subject", "parameter"])["contraction"]
    ruled = {what for kind, what in first["badges"] if kind == "dominated"}
    assert {name for name, value in summary["A"].items() if value < 0.5} == ruled & set(
        summary["A"].index
    )
    assert first["truth"]["sigma_p"] == 0.25
    assert first["truth"]["gain"] == pytest.approx(
        1.0 / bt.model.variance_ratio((0.17 / 0.25) ** 2)
    )
    assert held["entry-1"]["truth"] == {}
    assert (held["entry-3"]["label"], held["entry-3"]["truth"]) == ("none", {"q0": 0.92}), (
        "of a model that has no more"
    )


def test_the_axis_agrees_with_the_beliefs_of_the_closed_form(held, analysis):
    first = held["entry-0"]
    *theta, q0 = thinned(analysis.draws, first)
    for s1, s2 in zip(first["ends"], numbers(first["axis"]).reshape(2, first["rows"]), strict=True):
        np.testing.assert_allclose(bt.model.equal_probability(s1, s2, *theta, q0), q0, atol=1e-6)


def test_draws_of_the_four_models_open_with_shift_contraction_and_jnd(small_study):
    draws = bt.sample(small_study.select(["A"]), model="both", draws=300, seed=3, workers=1)
    [entry] = entries(draws)
    packed = entry.packed(100, 1)
    assert (
        list(packed["main"])
        == list(packed["names"][:3])
        == ["constant_error", "contraction", "jnd"]
    )
    assert symbol("constant_error") == "PSE shift c, %"
    # A pair on the axis seems equal: its distance is 0 at the draw to which the axis belongs.
    points = draws.points("A").reshape(-1, 7)
    x = points[np.arange(packed["rows"]) * packed["of"] // packed["rows"]]
    low = numbers(packed["axis"]).reshape(2, -1)[0].astype(float)
    x, low = x[np.argsort(low)], np.sort(low)  # as a subject has its pairs
    once = np.ones(len(low), int)
    pairs = bt.Subject("pairs", np.full(len(low), packed["ends"][0]), low, 0 * once, once)
    distance = draws.posterior("A").for_subject(pairs).distance(x)
    np.testing.assert_allclose(np.diagonal(distance), 0.0, atol=1e-5)


def test_contours_hold_their_shares():
    samples = np.random.default_rng(1).normal(size=(40_000, 2)) * [1.0, 0.2]
    spans = [(-4.0, 4.0), (-0.8, 0.8)]
    made = outlined(samples, spans)
    low, high = np.array(made["frames"]).T
    inside_of = []
    for text in made["contours"][0]:
        points = numbers(text, "<u2").reshape(-1, 2)
        points = low + points[points[:, 0] <= FRAME] / FRAME * (high - low)
        radius = np.hypot(points[:, 0], points[:, 1] / 0.2)
        inside_of.append(1.0 - np.exp(-0.5 * np.mean(radius**2)))
    # Smoothed over one bin of a fifth of a standard deviation; 0.02 is several times what 40,000 draws scatter.
    assert inside_of == pytest.approx([0.5, 0.95], abs=0.02)


def test_curves_are_of_the_weaker_stimuli_with_most_trials_at_each_interval():
    one = bt.Subject(
        "S",
        [0, 0, 0.1, 0.2, 0],
        [0.2, 0.2, 0.2, 0.2, 0],
        [1] * 5,
        [50, 40, 9, 50, 50],
        isi=[1, 2, 1, 1, 1],
    )
    found = slices(one, 2)
    assert [(each.weaker, each.isi, each.orders) for each in found] == [
        (0.0, 1.0, (-1, 0)),
        (0.0, 2.0, (-1,)),
    ]
    assert len(slices(one, 9)) == 3
    assert sorted((one.s1[pair], one.s2[pair], one.isi[pair]) for pair in found[0].pairs) == [
        (0, 0, 1),
        (0, 0.2, 1),
        (0.2, 0.2, 1),
    ]


def test_badges_say_what_is_wrong_before_what_is_right():
    def told(missed, p_overall, p_deviance, *, parameters_as_pairs=False):
        fit = FitSummary(
            9.0,
            0 if parameters_as_pairs else 3,
            p_overall,
            0.0,
            0.5,
            0.0,
            0.0,
            p_deviance=p_deviance,
        )
        return badges(SimpleNamespace(fit=lambda name: fit), "A", missed)

    assert told({"A": "R-hat of q0 1.2"}, 0.4, 0.3) == (
        ("unconverged", "R-hat of q0 1.2"),
        ("fine", "fit: good, predictive p 0.4"),
    )
    assert told({}, 0.0, 0.02) == (
        ("fine", "converged"),
        ("misfit", "predictive p below 0.001, p of the deviance 0.02"),
    )
    assert told({}, np.nan, np.nan) == (("fine", "converged"),)
    untold = ("untold", "fit: not testable, predictive p 0.4")
    assert told({}, 0.4, np.nan, parameters_as_pairs=True) == (("fine", "converged"), untold)


def test_a_name_cannot_end_the_page(small_study):
    html = shown(replace(small_study["A"], name="</script><b>"), 30)
    assert islands(html)["index"]["entries"][0]["subject"] == "</script><b>"
    assert "</script><b>" not in html


MANY = {"H1": SimpleNamespace(names=[f"S{i}" for i in range(MOST_ENTRIES + 1)])}


@pytest.mark.parametrize(
    ("explored", "said"),
    [
        (lambda draws, *_: bt.explore(draws, subjects=["D"]), "no subject 'D' among the draws"),
        (lambda draws, *_: bt.explore(draws, subjects=[]), "found no subjects"),
        (
            lambda draws, *_: bt.explore(draws, truths={"A": {"mu": 1.0}}),
            "truths of 'A': unknown quantity 'mu'",
        ),
        (lambda *_: bt.explore([]), "found no draws"),
        (
            lambda *_: entries(MANY),
            "found 201 subjects, allowed: at most 200 in a page; name some with --subject",
        ),
    ],
)
def test_what_cannot_be_shown_is_refused(analysis, symmetric, explored, said):
    with pytest.raises(bt.InputError, match=said):
        explored(analysis.draws, symmetric)


def test_without_bokeh_the_extra_is_named(analysis, monkeypatch):
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(bt.InputError, match=r"pip install 'bayes_toe\[explore\]'"):
        bt.explore(analysis.draws)


def test_a_lone_subject_has_all_its_curves_and_many_posteriors_have_fewer_draws(
    small_study, monkeypatch
):
    s1, s2 = np.transpose(list(product(np.arange(5) / 5, repeat=2)))
    alone = islands(shown(bt.Subject("S", s1, s2, np.full(25, 3), np.full(25, 9))))["entry-0"]
    assert (len(alone["slices"]), alone["undrawn"], alone["rows"]) == (4, 0, 1000)
    monkeypatch.setattr(page_module, "_BYTES", 3 * 100e3)
    made = islands(shown(small_study["A"], copies=3))["entry-0"]
    assert 300 <= made["rows"] < 1000
    assert len(made["values"]) + len(made["slices"][0]["equal"]) < 100e3 * 4 / 3


def test_the_command_writes_the_page_and_refuses_to_replace_it(analysis, symmetric, tmp_path):
    symmetric.save(tmp_path / "posterior.nc")
    (tmp_path / "truth.csv").write_text("subject,q0,noise\nA,0.9,0.3\n", encoding="utf-8")
    assert "Explorer in a.html" in good(
        "explore",
        "posterior.nc",
        "-o",
        "a.html",
        "--truth",
        "truth.csv",
        "--subject",
        "A",
        cwd=tmp_path,
    )
    assert islands((tmp_path / "a.html").read_text(encoding="utf-8"))["entry-0"]["truth"] == {
        "q0": 0.9,
        "noise": 0.3,
        "jnd": pytest.approx(100 * np.expm1(0.3 * 0.6744897501960817)),
        "zone": pytest.approx(100 * np.expm1(0.3 * 1.6448536269514722)),
    }
    assert "a.html: exists" in refused("explore", "posterior.nc", "-o", "a.html", cwd=tmp_path)


def test_curves_of_which_is_stronger_are_over_the_difference_by_the_first_stimulus(stronger):
    subject, fitted = stronger.study["pulled"], Predictor.of(stronger.draws, "pulled", most=50)
    found = slices(subject, 3)
    assert [one.orders for one in found] == [(0,)] * 3
    middle = found[1]
    assert {subject.s1[pair] for pair in middle.pairs} == {middle.weaker}
    assert middle.title(True) == f"first stimulus {middle.weaker:.3g}"
    [curve] = middle.yes(fitted)
    np.testing.assert_allclose(
        curve[3], fitted.yes(np.array([middle.weaker]), middle.weaker + middle.x[3:4])[:, 0]
    )
    told = page(entries(stronger.draws)).html
    assert "P(second)" in told
    assert "'equal'" not in told.partition('<section id="answers"')[2].partition("</section>")[0]
