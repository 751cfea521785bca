"""Studies with a column isi, from the file to the report: read, sampled, compared, predicted, drawn, and refused where unknown."""

from types import SimpleNamespace

import numpy as np
import pytest
from conftest import few_replicates
from scipy.special import betaln

import bayes_toe as bt
from bayes_toe.cli.look import read_truth
from bayes_toe.cli.results_folder import write_results
from bayes_toe.data.options import ReadOptions
from bayes_toe.design.simulate import (
    PaperObserver,
    make_batch_design,
    simulate_trials,
    trial_frame,
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
    return bt.Study([one.answered for one in trials], "three intervals", True)


@pytest.fixture(scope="module")
def analysis(study):
    with few_replicates():
        return bt.run(study, draws=300, seed=2, workers=1)


# --- reading --------------------------------------------------------------------------------------


def read(tmp_path, text, **options):
    path = tmp_path / "study.csv"
    path.write_text(text, encoding="utf-8")
    return bt.read_study(path, ReadOptions(**options))


HEADER = "subject,s1,s2,isi,response\n"


def test_trials_and_counts_keep_intervals_apart(tmp_path):
    trials = read(
        tmp_path,
        f"{HEADER}a,0,0.3,1,equal\na,0,0.3,0.5,different\na,0,0.3,0.5,equal\n,,,,\na,,,,\n",
    )
    assert trials["a"].isi.tolist() == [0.5, 1.0]
    assert trials["a"].n_trials.tolist() == [2, 1]
    assert trials.intervals == (0.5, 1.0)
    counts = read(
        tmp_path,
        "subject;s1;s2;n_equal;n_trials;gap\na;0;0,3;3;5;0,5\na;0;0,3;1;5;0,5\na;0;0,3;2;5;1\n",
        columns={"isi": "gap"},
    )
    assert counts["a"].n_yes.tolist() == [4, 2]
    assert counts["a"].isi.tolist() == [0.5, 1.0]
    assert {
        "column gap read as isi",
        "2 intervals in column gap: 0.5, 1 s; contrast --condition gap compares them",
    } <= set(counts.notes)


@pytest.mark.parametrize("bad", ["", "abc", "1e400"])
def test_a_cell_that_is_no_interval_is_named(tmp_path, bad):
    allowed = "a positive finite number of seconds, in every row or no such column"
    message = f"^study.csv: row 3, column isi: found '{bad}', allowed: {allowed}$"
    with pytest.raises(InputError, match=message):
        read(tmp_path, f"{HEADER}a,0,0.3,1,equal\na,0,0.3,{bad},different\n")


@pytest.mark.parametrize(
    ("s1", "isi", "said"),
    [
        ([0.0, 0.0], [1.0, 1.0], "repeated"),
        ([0.0], [0.0], "positive finite numbers of seconds"),
        ([0.0], [1.0, 2.0], "s1, s2, isi, n_yes and n_trials"),
        ([0.0], ["long"], "isi must be numbers"),
        ([0.0], None, "or none"),
    ],
)
def test_subjects_and_studies_refuse_what_is_no_interval(s1, isi, said):
    one = bt.Subject("a", [0.0, 0.0], [0.3, 0.3], [1, 2], [5, 5], isi=[2.0, 1.0])
    assert (one.intervals, one.n_yes.tolist()) == ((1.0, 2.0), [2, 1])
    with pytest.raises(InputError, match=said):
        bt.Study([one, bt.Subject("b", s1, [0.3] * len(s1), [1] * len(s1), [5] * len(s1), isi=isi)])


def test_one_interval_of_a_study_is_open_to_everything(study):
    plain = study.at_isi(1.0)
    assert (plain.intervals, plain["S01"].n_pairs) == ((), 13)
    assert "only pairs with an interval of 1 s" in plain.notes
    assert len(bt.fit(plain, replicates=10, seed=1, workers=1)) == 2
    assert len(bt.asymmetry(study.at_isi(4.0)).rows) == 2


REFUSED = [
    (lambda study, _: bt.fit(study, replicates=10, seed=1, workers=1), "not for intervals"),
    (lambda study, _: bt.asymmetry(study), r"not for intervals \(column isi\).*Study.at_isi"),
    (lambda _, analysis: bt.plots.paper_figures(analysis), "not for intervals"),
    (lambda study, _: study.at_isi(3.0), "no interval of 3 s; there are: 0.25, 1, 4 s"),
    (lambda study, _: study["S01"].at_isi(3.0), "no interval of 3 s; there are: 0.25, 1, 4 s"),
    (lambda _, analysis: bt.predict(analysis.draws, "S01", 0.0, 0.3), "made with intervals"),
    (lambda _, analysis: bt.predict(analysis.draws, "S01", 0.0, 0.3, -1.0), "positive finite"),
    (lambda *_: bt.simulate(1, isi=(1.0, 1.0)), "each once, for a design without intervals"),
    (lambda *_: bt.simulate(1, isi=(-1.0,)), "positive finite"),
    (lambda *_: bt.simulate(1, isi="x"), "--isi: found 'x'"),
]


@pytest.mark.parametrize(("call", "message"), REFUSED)
def test_what_is_refused(study, analysis, call, message):
    with pytest.raises(InputError, match=message):
        call(study, analysis)


def test_check_says_what_intervals_change():
    lone = bt.Study([bt.Subject("a", [0.0, 0.3], [0.3, 0.0], [3, 4], [9, 9], isi=[500.0, 500.0])])
    codes = [finding.code for finding in bt.check(lone)]
    assert "long_intervals" in codes
    assert "delays" not in codes
    apart = bt.Subject("a", [0.0, 0.3], [0.3, 0.0], [3, 4], [9, 9], isi=[1.0, 2.0])
    messages = {finding.code: finding.message for finding in bt.check(bt.Study([apart]))}
    assert "one_order" not in messages, "both orders were shown, and the answer ignores delays"
    assert messages["delays"].endswith("analyse the delays as a condition.")


# --- simulation -----------------------------------------------------------------------------------


def test_simulated_trials_have_their_intervals_and_read_back(tmp_path):
    (tmp_path / "design.csv").write_text("s1,s2,isi\n0,0.3,0.5\n0.3,0,2\n", encoding="utf-8")
    design = make_batch_design(str(tmp_path / "design.csv"), "", 5)
    frame = trial_frame(simulate_trials([PaperObserver("a", FIRST)], design, seed=1))
    assert list(frame.columns[3:7]) == ["s1", "s2", "isi", "response"]
    frame.to_csv(tmp_path / "study.csv", index=False)
    back = bt.read_study(tmp_path / "study.csv")["a"]
    assert back.n_trials.tolist() == [5, 5]
    assert back.isi.tolist() == [0.5, 2.0]


# --- posterior and evidence -----------------------------------------------------------------------


def answering(s1, s2, isi, trials):
    """Counts without scatter of the first observer to pairs at these intervals."""
    q = bt.model.equal_probability(s1, s2, *at_interval(FIRST, isi))
    return bt.Subject("a", s1, s2, np.rint(trials * q), np.full(len(q), trials), isi=isi)


def fitted(subject):
    """Weighted draws under the paper's prior: natural parameters, (4, draws), and the share of each."""
    found = fit_proposal(bt.model.paper_posterior(subject, bt.Prior()), np.random.default_rng(5))
    return found, found.proposal.posterior.natural(found.draws.x), found.draws.shares


def test_one_first_stimulus_at_several_intervals_tells_the_pull():
    # At one interval the pull drops out of the likelihood and sigma_l over sigma_p is as the prior
    # has it.
    s2 = np.array([-0.3, -0.15, 0.0, 0.15, 0.3])

    def spread(isi):
        t = np.repeat(isi, 5)
        subject = answering(np.zeros(len(t)), np.tile(s2, len(isi)), t, 600 // len(isi))
        _, theta, shares = fitted(subject)
        return np.sqrt((theta.gamma - theta.gamma @ shares) ** 2 @ shares)

    assert spread([1.0]) > 0.25  # of a uniform gamma 0.289
    assert spread([0.25, 1.0, 4.0]) < 0.12


def test_evidence_and_moments_agree_with_quadrature():
    # reference.quadrature.integrate of this posterior: errors 2e-5 nat, 2e-6 in means and standard
    # deviations.
    evidence = -890.1292755
    means = -0.6155167, 0.2134129, 0.1408259, 0.9295392
    sds = 0.0428065, 0.0106820, 0.0053121, 0.0123957
    design = at_intervals(reference_design(), THREE)
    proposal, theta, shares = fitted(answering(design.s1, design.s2, design.isi, 50))
    estimate = importance_evidence(proposal)
    error = 4.5 / np.sqrt(proposal.efficiency * len(shares))
    assert estimate.value == pytest.approx(evidence, abs=4.5 * estimate.se)
    for values, mean, sd in zip(theta, means, sds, strict=True):
        own_mean = values @ shares
        assert own_mean == pytest.approx(mean, abs=sd * error)
        assert np.sqrt(np.square(values - own_mean) @ shares) == pytest.approx(sd, abs=sd * error)


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
    predictor = Predictor.of(analysis.draws, "S01")
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
    s1, s2 = [-0.5, -0.2, -0.5, 0.0, -0.2, 0.0], [-0.2, -0.5, 0.0, -0.5, 0.0, -0.2]
    twice = [np.tile(values, 2) for values in (s1, s2, [30, 20, 9, 8, 25, 30], [40] * 6)]
    draws = bt.sample(
        bt.Study([bt.Subject("S", *twice, np.repeat([0.5, 2.0], 6))]), draws=100, seed=1, workers=1
    )
    panels = bt.plots.curves(draws, "S").axes[:2]
    assert [ax.get_title() for ax in panels] == [
        "0.5 s, weaker stimulus 77 %",
        "2 s, weaker stimulus 77 %",
    ]


def test_figures_show_answers_where_they_were_given(analysis):
    *panels, gain = bt.plots.curves(analysis.draws, "S01").axes
    assert [ax.get_title() for ax in panels] == [f"{isi:g} s" for isi in THREE]
    counts = analysis.study["S01"]
    for ax, isi in zip(panels, THREE, strict=True):
        here = counts.at_isi(isi)
        expected = np.sort((here.n_yes + 1.0) / (here.n_trials + 2.0))
        drawn = np.concatenate([container.lines[0].get_ydata() for container in ax.containers])
        assert np.sort(drawn) == pytest.approx(expected)
    assert gain.get_xlim() == (0.5 * min(THREE), 2.0 * max(THREE))
    [tested] = [line for line in gain.lines if line.get_marker() == "|"]
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


def test_a_true_sigma_p_per_root_second_is_marked_over_the_reference_interval(analysis, tmp_path):
    (tmp_path / "truth.csv").write_text(
        "subject,mu1,sigma_p\nS01,0.5,0.25\nS02,,\n", encoding="utf-8"
    )
    draws = analysis.draws
    over_four = SimpleNamespace(
        names=draws.names,
        posterior=draws.posterior,
        intervals=draws.intervals,
        prior=bt.Prior(reference_interval=4.0),
    )
    assert read_truth(tmp_path / "truth.csv", [over_four], ["S01"]) == {
        "S01": {"mu1": 0.5, "sigma_p": 0.5},
        "S02": {},
    }
    over_four.intervals = ()
    assert read_truth(tmp_path / "truth.csv", [over_four], ["S01"])["S01"]["sigma_p"] == 0.25
