"""Studies with a column isi, from the file to the report, and what is refused of them."""

import numpy as np
import pytest
from conftest import counts, few_replicates, made_subject
from legible import marks_of, titles_of, words_of
from scipy.special import betaln

import bayes_toe as bt
from bayes_toe.cli.results_folder import write_results
from bayes_toe.data.options import ReadOptions
from bayes_toe.design.simulate import (
    PaperObserver,
    simulate_trials,
)
from bayes_toe.design.study_design import at_intervals, reference_design
from bayes_toe.errors import InputError
from bayes_toe.inference.adaptation import fit_proposal
from bayes_toe.inference.evidence import importance_evidence
from bayes_toe.inference.prediction import Predictor
from bayes_toe.model.intervals import at_interval
from bayes_toe.model.paper_equations import Natural

FIRST, SECOND = Natural(-0.6, 0.21, 0.14, 0.93), Natural(1.0, 0.25, 0.18, 0.9)
THREE = (0.25, 1.0, 4.0)


@pytest.fixture(scope="module")
def study():
    observers = [PaperObserver("S01", FIRST), PaperObserver("S02", SECOND)]
    trials = simulate_trials(observers, at_intervals(reference_design(batches=20), THREE), seed=8)
    return bt.Study([element.answered for element in trials], "three intervals", True)


@pytest.fixture(scope="module")
def analysis(study):
    with few_replicates():
        return bt.run(study, draws=300, seed=2, workers=1)


# --- reading --------------------------------------------------------------------------------------


def read(tmp_path, text, **options):
    path = tmp_path / "study.csv"
    path.write_text(text, encoding="utf-8")
    return bt.read_study(path, ReadOptions(**options))


def test_trials_and_counts_keep_intervals_apart(tmp_path):
    rows = "a,0,0.3,1,equal\na,0,0.3,0.5,different\na,0,0.3,0.5,equal\n,,,,\na,,,,\n"
    trials = read(tmp_path, "subject,s1,s2,isi,response\n" + rows)
    assert trials["a"].isi.tolist() == [0.5, 1.0]
    assert counts(trials["a"]) == [(0.0, 0.3, 1, 2), (0.0, 0.3, 1, 1)]
    assert trials.intervals == (0.5, 1.0)
    rows = "a;0;0,3;3;5;0,5\na;0;0,3;1;5;0,5\na;0;0,3;2;5;1\n"
    columns = {"isi": "gap"}
    grouped = read(tmp_path, "subject;s1;s2;n_equal;n_trials;gap\n" + rows, columns=columns)
    assert counts(grouped["a"]) == [(0.0, 0.3, 4, 10), (0.0, 0.3, 2, 5)]
    note = "2 intervals in column gap: 0.5, 1 s; contrast --condition gap compares them"
    assert note in grouped.notes


@pytest.mark.parametrize(
    "isi, message",
    [
        ([0.0], "positive finite numbers of seconds"),
        ([1.0, 2.0], "s1, s2, isi, n_yes and n_trials"),
        (["long"], "isi must be numbers"),
    ],
)
def test_a_subject_refuses_what_is_no_interval(isi, message):
    with pytest.raises(InputError, match=message):
        bt.Subject("b", [0.0], [0.3], [1], [5], isi=isi)


def test_a_pair_at_one_interval_is_there_once():
    with pytest.raises(InputError, match="repeated"):
        made_subject("0 0.3 1 5 1, 0 0.3 1 5 1")


def test_all_subjects_of_a_study_have_intervals_or_none():
    timed = made_subject("0 0.3 1 5 2, 0 0.3 2 5 1")
    assert (timed.intervals, timed.n_yes.tolist()) == ((1.0, 2.0), [2, 1])
    with pytest.raises(InputError, match="or none"):
        bt.Study([timed, made_subject("0 0.3 1 5", "b")])


def test_one_interval_of_a_study_is_open_to_everything(study):
    plain = study.at_isi(1.0)
    assert (plain.intervals, plain["S01"].n_pairs) == ((), 13)
    assert "only pairs with an interval of 1 s" in plain.notes
    assert len(bt.fit(plain, replicates=10, seed=1, workers=1)) == 2
    assert len(bt.asymmetry(study.at_isi(4.0)).rows) == 2


REFUSED = [
    (lambda study, _: bt.fit(study, replicates=10, seed=1, workers=1), "not for intervals"),
    (lambda study, _: bt.asymmetry(study), r"not for intervals \(column isi\).*Study.at_isi"),
    (lambda study, _: study.at_isi(3.0), "no interval of 3 s; there are: 0.25, 1, 4 s"),
    (lambda study, _: study["S01"].at_isi(3.0), "no interval of 3 s; there are: 0.25, 1, 4 s"),
    (lambda _, analysis: bt.predict(analysis.draws, "S01", 0.0, 0.3), "made with intervals"),
    (lambda _, analysis: bt.predict(analysis.draws, "S01", 0.0, 0.3, -1.0), "positive finite"),
    (lambda *_: bt.simulate(1, isi=(1.0, 1.0)), "each once, for a design without intervals"),
    (lambda *_: bt.simulate(1, isi=(-1.0,)), "positive finite"),
    (lambda *_: bt.simulate(1, isi="x"), "--isi: found 'x'"),
]


@pytest.mark.parametrize("call, message", REFUSED)
def test_what_is_refused(study, analysis, call, message):
    with pytest.raises(InputError, match=message):
        call(study, analysis)


def checked(rows):
    """What `check` finds in a subject."""
    study = bt.Study([made_subject(rows)])
    return {finding.code: finding.message for finding in bt.check(study)}


def test_check_says_what_intervals_change():
    long = checked("0 0.3 3 9 500, 0.3 0 4 9 500")
    assert "long_intervals" in long
    assert "delays" not in long
    separation = checked("0 0.3 3 9 1, 0.3 0 4 9 2")
    # Both orders were presented, and the answer ignores delays.
    assert "one_order" not in separation
    assert separation["delays"].endswith("analyse the delays as a condition.")


# --- posterior and evidence -----------------------------------------------------------------------


def test_evidence_and_moments_agree_with_quadrature():
    # reference.quadrature.integrate: errors 2e-5 nat, 2e-6 in means and standard deviations.
    evidence = -890.1292755
    means = -0.6155167, 0.2134129, 0.1408259, 0.9295392
    sds = 0.0428065, 0.0106820, 0.0053121, 0.0123957
    design = at_intervals(reference_design(), THREE)
    q = bt.model.equal_probability(design.s1, design.s2, *at_interval(FIRST, design.isi))
    n_trials = np.full(len(q), 50)
    subject = bt.Subject("a", design.s1, design.s2, np.rint(50 * q), n_trials, isi=design.isi)
    rng = np.random.default_rng(5)
    fitted = fit_proposal(bt.model.paper_posterior(subject, bt.Prior()), rng)
    estimate = importance_evidence(fitted)
    assert estimate.value == pytest.approx(evidence, abs=4.5 * estimate.se)
    theta = np.array(fitted.proposal.posterior.natural(fitted.draws.x))
    shares = fitted.draws.shares
    error = 4.5 / np.sqrt(fitted.efficiency * len(shares))
    assert (np.abs(theta @ shares - means) < np.multiply(sds, error)).all()
    variances = np.square(theta - (theta @ shares)[:, None]) @ shares
    assert (np.abs(np.sqrt(variances) - sds) < np.multiply(sds, error)).all()


def test_h0_has_one_frequency_for_each_pair_and_interval(study, analysis):
    subject = study["S01"]
    row = analysis.evidence["S01"]
    assert row.n_pairs == 39
    assert row.log_evidence_h0 == pytest.approx(
        float(betaln(subject.n_yes + 1.0, subject.n_trials - subject.n_yes + 1.0).sum())
    )
    assert row.log_bayes_factor > 10
    assert row.log_evidence_h1_laplace == pytest.approx(row.log_evidence_h1, abs=0.5)
    assert row.log_evidence_h1_laplace_natural == pytest.approx(row.log_evidence_h1, abs=0.5)
    assert row.log_evidence_h1_bootstrap is None
    assert any("knows one interval only" in note for note in row.footnotes)
    assert len(analysis.fits) == 0


def test_draws_are_stored_with_intervals_and_units(analysis, study, tmp_path):
    analysis.draws.save(tmp_path / "posterior.nc")
    back = bt.load(tmp_path / "posterior.nc")
    assert back.intervals == THREE
    assert np.array_equal(back.subject("S02").isi, study["S02"].isi)
    assert back["S02"].intervals == THREE
    assert back.group("posterior")["sigma_p"].attrs["units"] == "ln intensity / (1 s)^(1/2)"
    assert back.attrs["model"] == "predictive update"
    assert "self-consistent prior for each interval" in back.attrs["about_model"]
    assert back.values("S01", "offset").shape == back.values("S01", "mu1").shape


# --- prediction -----------------------------------------------------------------------------------


def test_predictions_are_those_of_the_draws_at_intervals_never_run(analysis):
    isi = np.array([0.1, 0.5, 2.0, 8.0])
    table = bt.predict(analysis.draws, "S01", 0.0, 0.3, isi)
    draws = analysis.draws.natural("S01")
    for row, t in zip(table[["q05", "q50", "q95"]].to_numpy(), isi, strict=True):
        q = bt.model.equal_probability(0.0, 0.3, *at_interval(draws, t))
        assert row == pytest.approx(np.quantile(q, [0.05, 0.5, 0.95]), rel=1e-12)
    predictor = Predictor.from_draws(analysis.draws, "S01")
    gains = predictor.target.gain(predictor.x, isi)
    low, middle, high = np.quantile(gains, [0.05, 0.5, 0.95], axis=0)
    truth = bt.model.gain(at_interval(FIRST, isi).gamma)
    assert (np.abs(middle - truth) < 4.5 * (high - low) / 3.29).all()


def test_without_intervals_none_may_be_asked_for(study):
    plain = bt.sample(study.at_isi(1.0).select(["S01"]), draws=100, seed=1, workers=1)
    assert bt.predict(plain, "S01", [0.0, 0.3], 0.3).columns.tolist()[:3] == ["s1", "s2", "mean"]
    with pytest.raises(InputError, match="made without intervals"):
        bt.predict(plain, "S01", 0.0, 0.3, 1.0)


# --- figures, report, and what refuses ------------------------------------------------------------


def test_panels_that_show_one_of_several_weaker_stimuli_name_it():
    rows = """-0.5 -0.2 30 40 ISI, -0.2 -0.5 20 40 ISI, -0.5 0 9 40 ISI, 0 -0.5 8 40 ISI,
        -0.2 0 25 40 ISI, 0 -0.2 30 40 ISI"""
    subject = made_subject(rows.replace("ISI", "0.5") + "," + rows.replace("ISI", "2"))
    draws = bt.sample(bt.Study([subject]), draws=100, seed=1, workers=1)
    notes = [words_of(ax.texts) for ax in bt.plots.curves(draws, "S").axes[:2]]
    assert notes == [["weaker stimulus 77 % of mean"]] * 2


def test_figures_show_answers_where_they_were_given(analysis):
    *panels, gain = bt.plots.curves(analysis.draws, "S01").axes
    assert titles_of(panels) == [f"{isi:g} s" for isi in THREE]
    counts = analysis.study["S01"]
    for ax, isi in zip(panels, THREE, strict=True):
        local = counts.at_isi(isi)
        expected = np.sort((local.n_yes + 1.0) / (local.n_trials + 2.0))
        drawn = np.concatenate([bars[0].get_ydata() for bars in ax.containers[:3]])
        assert np.sort(drawn) == pytest.approx(expected)
    assert gain.get_xlim() == (0.5 * min(THREE), 2.0 * max(THREE))
    [tested] = marks_of(gain, "|")
    assert tested.get_xdata() == pytest.approx(THREE)


def test_a_results_folder_has_everything_but_what_knows_one_interval(
    analysis, tmp_path, blank_pictures
):
    write_results(analysis, tmp_path / "results", workers=1)
    text = (tmp_path / "results" / "report.html").read_text(encoding="utf-8")
    assert "The inter-stimulus intervals are 0.25, 1, 4 s." in text
    assert "does not pool asymmetries over inter-stimulus intervals" in text
    assert "maximum likelihood at an edge" not in text
    assert len(list((tmp_path / "results" / "corner").iterdir())) == 2
