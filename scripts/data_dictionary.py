"""Write docs/data_dictionary.md: every column of every file that commands write, from declarations and docstrings, with words for the rest.

Example: python scripts/data_dictionary.py -o docs/data_dictionary.md --overwrite
"""

# ruff: noqa: E501  # a line a column

import argparse
import inspect
import re
from collections.abc import Sequence
from dataclasses import dataclass, field, fields

from reference.calibration import ABOUT, ESTIMATORS, RANKED, EvidenceRow, RankRow
from reference.calibration_statistics import Reliability

from bayes_toe.classical.asymmetry import ASYMMETRY_COLUMNS, Comparison, SubjectAsymmetry
from bayes_toe.classical.covariates import COVARIATE_COLUMNS, CovariateTest
from bayes_toe.classical.fit import SubjectFit, fit_columns
from bayes_toe.cli.supplement import FIT_TABLE_COLUMNS, ORDER_EFFECT_COLUMNS
from bayes_toe.comparison.contrast import CONTRAST_COLUMNS, WORDS, Difference
from bayes_toe.comparison.evidence_table import EVIDENCE_COLUMNS, SubjectEvidence
from bayes_toe.comparison.history import HISTORY_COLUMNS, SubjectHistory
from bayes_toe.comparison.model_comparison import COMPARE_COLUMNS, PARTS_COLUMNS
from bayes_toe.comparison.prior_sensitivity import SensitivityRow, sensitivity_columns
from bayes_toe.comparison.words import EFFECTS
from bayes_toe.data.tasks import SAME_DIFFERENT
from bayes_toe.data.whole_files import whole_file
from bayes_toe.groups.population_table import SUBJECT_COLUMNS, PopulationRow
from bayes_toe.groups.savage_dickey import Ratio
from bayes_toe.inference.subject import SUMMARY_COLUMNS
from bayes_toe.model.ladder import SPACE
from bayes_toe.planning.power import DATA_SET_COLUMNS, POWER_COLUMNS
from bayes_toe.planning.power_of_studies import POPULATION_COLUMNS, STUDY_COLUMNS
from bayes_toe.planning.stopping import STOPPING_COLUMNS
from bayes_toe.planning.study_design import DESIGN_COLUMNS

OUTPUT = "docs/data_dictionary.md"
FITTED = ("mu1", "sigma_p", "sigma_l", "q0")
LN = "natural-log intensity"

#: What columns mean wherever they stand.
COMMON = {
    "subject": "Name of the subject.",
    "parameter": f"Which quantity; `mu1`, `sigma_p`, `sigma_l`, `sigma1`, `width`, `offset` in {LN}, the others without unit: see model.md.",
    "mean": "Mean of the draws.",
    "sd": "Standard deviation of the draws.",
    **{f"q{p:02d}": f"{p} % quantile of the draws." for p in (5, 25, 50, 75, 95)},
    "ess_bulk": "Effective draws for the middle of the distribution.",
    "ess_tail": "Effective draws for the 5 and 95 % quantiles, the smaller of the two.",
    "r_hat": "Rank-normalised split R-hat: the chains agree where it is below 1.01.",
    "contraction": "1 - (posterior width / prior width)² of the ranges from 5 to 95 %: 1 all from the data, 0 as wide as the prior.",
    **{f"mcse_{name}": f"Monte Carlo standard error of `{name}`: how far it would be off in other draws." for name in ("mean", "q05", "q50", "q95")},
    "n_pairs": "Pairs of stimuli, counted by order (and interval).",
    "n_trials": "Trials.",
    "pareto_k": "Pareto k-hat of the importance weights; above 0.7 what rests on them is withheld.",
    "prior": "The prior, in words.",
    "log_evidence_h1": "Log evidence of the predictive update (H1), nats; empty where withheld.",
    "log_evidence_h1_se": "Its standard error, nats.",
    "log_evidence_h0": "Log evidence of free frequencies (H0), exact, nats.",
    "log_evidence_h1_laplace": "Log evidence of H1 by Laplace's approximation in identified coordinates, nats.",
    "log_evidence_h0_laplace": "Log evidence of H0 by Appendix C's recipe, nats.",
    "log_evidence_h1_laplace_natural": "Log evidence of H1 by Laplace's approximation in the paper's coordinates, nats; empty where the maximum is on an edge.",
    "log_evidence_h1_bootstrap": "Log evidence of H1 by the covariance of bootstrap refits, Appendix C's recipe, nats; empty with intervals.",
    "log_evidence_symmetric": "Log evidence of the model without order effect, nats.",
    "log_evidence_constant_error": "Log evidence of the model with a constant error, nats.",
    "p_none": "Posterior probability that the order has no effect, the three kinds equally probable beforehand.",
    "p_constant_error": "The same of a constant error.",
    "p_update": "The same of a pull, the predictive update.",
    "model": "Name or composition of the model.",
    "parameters": "Number of free parameters of the model.",
    "log_evidence": "Log evidence, nats; empty where withheld.",
    "log_evidence_se": "Its standard error, nats; 0 where exact.",
    "elpd_loo_trial": "Leave-one-out expected log predictive density, an answer left out at a time, summed, nats.",
    "elpd_loo_pair": "The same with a pair left out at a time, nats.",
    **{f"elpd_loo_{unit}_se": f"Standard error of `elpd_loo_{unit}`, nats." for unit in ("trial", "pair")},
    **{f"elpd_loo_{unit}_diff": f"`elpd_loo_{unit}` less the best model's, nats." for unit in ("trial", "pair")},
    **{f"elpd_loo_{unit}_diff_se": f"Standard error of the paired difference `elpd_loo_{unit}_diff`, nats." for unit in ("trial", "pair")},
    "model_probability": "Posterior probability at equal prior probabilities of the models in the table; empty where an evidence is withheld.",
    "p_predictive": "Posterior predictive p-value of the deviance; below 0.01 a misfit.",
    "p_worst_pair": "The smallest one of a pair, not corrected for the number of pairs.",
    "note": "What is withheld and why, and what the model ignores.",
    "parts": "Level of every part of the model, `order: update; noise: sloped; ...`; empty for free frequencies.",
    "part": "Part of the models: order, noise, lapses, curve, peak.",
    "level": "Level of the part.",
    "probability": "Posterior probability of the level over all models that have it, levels equally probable beforehand.",
    "log_inclusion_bayes_factor": "Log of posterior odds over prior odds of the level, nats.",
    "varied": "Which number of the prior differs from the one given.",
    "factor": "By which factor; empty for a location, which is shifted.",
    "value": "The varied value itself.",
    "log_bayes_factor": "Log evidence of H1 less that of H0, nats.",
    "se": "Standard error of `log_bayes_factor`, nats.",
    "method": "`reweighted` or `resampled`: whether draws were made anew under that prior.",
    "s1": f"First stimulus, {LN}.",
    "s2": f"Second stimulus, {LN}.",
    "isi": "Inter-stimulus interval, s; only where the study has such a column.",
    "accuracy": "Share of correct answers of the subject over all pairs, 0 to 1.",
    "covariate": "Name of the covariate.",
    "outcome": "What is held against it.",
    "verdict": "Whether it is calibrated.",
    "design": "`paper` or `sparse`.",
    "batches": "How often each pair is presented in the design.",
    "studies": "Studies of one subject that were simulated.",
    "not_converged": "How many of them did not converge; they are ranked like the others.",
    "largest_difference": "Largest distance of the ranks' distribution function from the uniform one, signed.",
    "at": "Where that is.",
    "quantity": "What is ranked.",
    "estimator": f"How evidence is estimated: {'; '.join(f'{name}: {words}' for name, words in ABOUT.items())}.",
    "data_sets": "Data sets that were simulated, each from H1 or H0 with probability one half.",
    "shortfall": "Which criterion of convergence was missed; empty where none.",
    "imprecise": "Which quantile is not precise enough, and how many draws would do; empty where none.",
    **{name: f"{words}." for name, words in (
        ("mu1", f"Prior mean of the observer, {LN}"),
        ("sigma_p", f"Diffusion of memory, {LN} (per √s with intervals)"),
        ("sigma_l", f"Measurement noise, {LN}"),
        ("q0", "P(equal) where both are perceived alike; asked which was stronger the column is `lapse_rate`, the share of blind answers"),
    )},
}  # fmt: skip


@dataclass(frozen=True)
class File:
    """One kind of file: who writes it, what a row is, its columns, and where they are explained."""

    name: str
    writers: str
    row: str
    columns: Sequence[str]
    explained: Sequence[type] = ()
    words: dict[str, str] = field(default_factory=dict)

    def meaning(self, column: str) -> str:
        """Its own words, those of a docstring, those that hold everywhere, or those beside the field."""
        told, beside = (next(filter(None, (of(kind, column) for kind in self.explained)), "") for of in (explanation, comment))
        found = self.words.get(column) or told or COMMON.get(column) or beside
        if not found:
            raise SystemExit(f"{self.name}: nothing says what the column {column} means")
        plain = " ".join(re.sub(r":\w+:`~?\.?([^`]+)`", r"`\1`", found).replace("|", r"\|").split())
        plain = re.sub(r"\bNone where\b", "empty where", plain)  # as it is in a file
        return plain[:1].upper() + plain[1:]


def explanation(kind: type, name: str) -> str:
    """What a docstring says of an attribute, or of a property; nothing where it says nothing of this one alone."""
    if isinstance(getattr(kind, name, None), property):
        return inspect.getdoc(getattr(kind, name)) or ""
    entry = re.search(rf"^{name} : [^\n]*\n((?:    [^\n]*\n?)+)", (inspect.getdoc(kind) or "") + "\n", flags=re.MULTILINE)
    return entry[1] if entry else ""


def comment(kind: type, name: str) -> str:
    """What stands beside a field, as a sentence."""
    found = re.search(rf"^    {name}: [^#\n]*  # (.*)$", inspect.getsource(kind), flags=re.MULTILINE)
    return f"{found[1]}." if found else ""


def _names(kind: type) -> list[str]:
    return [one.name for one in fields(kind)]


_RANGES = {"median": "Posterior median", "q05": "5 % quantile", "q95": "95 % quantile"}
_SHOWN = (*FITTED, "gain")
_SUMS = "sum over the subjects that have a value under every model, nats"
_SAMPLED = "by random effects, sampled"
_JUDGED = ("error", "floor", "p_value", "brier", "log_score", "unsure")
_STUDY_COLUMNS = (
    *("model", "subjects", "best", "expected", "exceedance", "protected", "omnibus_risk", "group_log_evidence", "elpd_loo_trial"),
    *("elpd_loo_pair", "expected_exact", "exceedance_exact", "protected_exact", "omnibus_risk_exact", "elpd_loo_trial_subjects"),
    *("elpd_loo_pair_subjects", "elpd_loo_pair_diff", "elpd_loo_pair_diff_se", "elpd_loo_trial_diff", "elpd_loo_trial_diff_se"),
    *("exact_how", "expected_exact_se", "exceedance_exact_se", "omnibus_risk_exact_se"),
)
_FREQUENCIES = {
    "expected": "Expected frequency of the model among subjects of this kind",
    "exceedance": "Probability that it is the most frequent one, if frequencies differ",
    "protected": "The same averaged over whether they differ at all",
    "omnibus_risk": "Probability that all models are equally frequent",
}

_PLANNED = {
    "design": "Name of the design.", "trials": "Trials of a subject.",
    **dict.fromkeys(("observers", "kind"), "Kind of the assumed observers: none, constant error, update; of studies also mixed."),
    "observer": "Name of the simulated observer: the same one in every design.",
}  # fmt: skip

VERDICT = {
    "effect": f"The verdict on an order effect: {', '.join(f'`{word}`' for word in EFFECTS if word)}; empty where an evidence is missing.",
    "kind": "Of which kind: `constant error`, `pull`, either with `probably` before it, or `open`; empty where no effect is said.",
    "fit": "Whether the best model describes the answers: `described`, `not described`, `cannot be told` (no more pairs than parameters).",
    "data": "What the data have against them, joined with `; `; empty where nothing was found.",
    "robust": "`yes` where the prior's scales of the order, halved and doubled, change neither the side of the verdict nor the kind; else `no`.",
    "p_none": f"{COMMON['p_none'][:-1]}; over {len(SPACE)} models.",
    "log_bayes_factor_effect": "Log Bayes factor of an effect, both kinds equally probable, against none, nats.",
    "size_q50": "Posterior median of the size of the effect, in just noticeable differences; 0 where P(none) is above one half.",
    "best_model": "The model with the highest evidence.",
    "predictive_p": "Posterior predictive p-value of its deviance; it does not describe the answers below 0.01.",
    "deviance_p": "P-value of its deviance; the same below 0.01; empty without degrees of freedom.",
    "history_p": "Predictive p-value of its answers by the trial before; below 0.01 they seem to depend on it; empty where no order is known.",
}

FILES = (
    File("summary.csv", "`run`", "subject and parameter", SUMMARY_COLUMNS),
    File("evidence.csv", "`run`, `evidence`", "subject, in nats; empty where a value does not exist", EVIDENCE_COLUMNS, [SubjectEvidence], {
        "log_bayes_factor_laplace": "`log_evidence_h1_laplace` less `log_evidence_h0_laplace`.",
        **VERDICT,
        "log_evidence_symmetric": "Log evidence of the paper's model without an order effect, nats.",
        "log_evidence_constant_error": "Log evidence of the paper's model with a constant error in the place of the pull, nats.",
    }),
    File("compare.csv", "`compare`", "subject and model", COMPARE_COLUMNS),
    File("compare_parts.csv", "`compare`", "subject, part and level; `*` is the study, a new subject of its population", PARTS_COLUMNS),
    File(
        "compare_models.csv", "`compare`", "model, over the whole study", _STUDY_COLUMNS, (), {
            "subjects": "Subjects with every evidence, who alone count.",
            "best": "For how many of them the model has the highest evidence.",
            **{name: f"{said}; {_SAMPLED}." for name, said in _FREQUENCIES.items()},
            **{f"{name}_exact": f"The same as `{name}`." for name in _FREQUENCIES},
            **{f"{name}_exact_se": f"Monte Carlo standard error of `{name}`." for name in _FREQUENCIES},
            "group_log_evidence": "Log evidence of all subjects, as if all of them followed the model; nats.",
            "elpd_loo_trial": f"Leave-one-out by trial, {_SUMS}.", "elpd_loo_pair": f"Leave-one-out by pair, {_SUMS}.",
            **{f"elpd_loo_{unit}_subjects": f"Over how many subjects `elpd_loo_{unit}` goes." for unit in ("trial", "pair")},
            "exact_how": "`sampled`, where there are frequencies.",
        },
    ),
    File("compare_history.csv", "`compare --history`; history.csv of `run`", "subject", HISTORY_COLUMNS, [SubjectHistory], {
        "depends": "Whether answers follow the trials before: `yes`, `probably`, `undecided`, `probably not`, `no`; `no pull` where none is likelier.",
        **{f"p_{level}": f"Posterior probability of the history {said}, among compositions with a pull; empty where it was not tried." for level, said in {
            "static": "none", "carry_over": "carry-over", "carry_over_by_time": "carry-over by time", "running_average": "running average"}.items()},
        "parameter": "The best history's own: `carry_over` (rho, without unit), `carry_over_tau` (s), `half_life` (trials).",
        **{name: f"{quantile} % posterior quantile of it." for name, quantile in {"q05": 5, "q50": 50, "q95": 95}.items()},
        "best_model": "The best model with a history of stimuli.", "static_model": "The best model without.",
        "history_p_static": "Predictive p of the answers by the trial before, of `static_model`.", "history_p": "The same of `best_model`.",
    }),
    File("contrast.csv", "`contrast`", "subject, quantity and comparison of two conditions", CONTRAST_COLUMNS, [Difference], {
        "quantity": "`constant error`, `pull`, `width`, or `order effect`: constant error and pull together.",
        "comparison": "A level less the one that it is held against, `right - left`; of numbers the largest less the smallest.",
        "mean": "Mean of the difference, if the quantity differs: natural-log intensity, of a pull without unit; of the order effect the size of "
        "the change, root mean square over the first stimuli shown.",
        **{name: f"{quantile} % quantile of the same." for name, quantile in {"q05": 5, "q50": 50, "q95": 95}.items()},
        "sd": "Standard deviation of the same.",
        "p_direction": "Probability of the more probable sign; empty for a size.",
        "log_bf_differs": "Log Bayes factor of a difference, between any levels, against none, nats; empty where an evidence is withheld.",
        "log_bf_differs_se": "Its Monte Carlo standard error.",
        "word": f"`{'`, `'.join(WORDS)}`: from Bayes factors of 20 and 3 on, either way.",
        "robust": "`yes` where lapses that differ too leave the word as it is; empty where that is not known.",
        "model": "Model of every condition.",
    }),
    File(
        "sensitivity.csv", "`sensitivity`", "subject and value of the prior", sensitivity_columns(), [SensitivityRow],
        {f"{name}_{key}": f"{key[1:].lstrip('0')} % quantile of {name} under that prior." for name in _SHOWN for key in ("q05", "q50", "q95")}
        | {"method": COMMON["method"], "log_bayes_factor": COMMON["log_bayes_factor"] + " Empty where k-hat is too large."},
    ),
    File(
        "population.csv", "`population`, `run --population`", "quantity of the population", PopulationRow._fields, [PopulationRow], {
            "quantity": "`mean`, `sd` (between subjects), `correlation`, `effect`, `condition_effect` (how much conditions differ on average), "
            "`condition_sd` (how far subjects differ in that), `asymmetry` or `new_subject` (a further one).",
            "bf_zero": "Of the means that may be none, `pull`, `constant error` and both together (`order effect`, empty where the model "
            "always has a pull): Bayes factor of none against any.",
            "bf_no_difference": "Of effects: Bayes factor of no difference against a difference; below 1 the answers speak for a difference.",
            "bf_error": explanation(Ratio, "error"), "bf_below": explanation(Ratio, "below"),
        },
    ),
    File(
        "population_subjects.csv", "`population`, `run --population`", "subject and parameter, in the light of the others", SUBJECT_COLUMNS, (),
        {f"alone_{key}": f"{key[1:].lstrip('0')} % quantile of the same subject analysed alone." for key in ("q05", "q50", "q95")},
    ),
    File(
        "fit.csv", "`fit`", "subject", fit_columns(SAME_DIFFERENT), [SubjectFit], {
            **{name: f"{COMMON[name][:-1]}: the maximum; empty where the answers leave it open." for name in FITTED},
            **{f"{name}_{side}": f"{side.capitalize()} end of the bootstrap interval of {name}." for name in FITTED for side in ("lower", "upper")},
            "level": "Share of the replicates inside the intervals.", "replicates": "Bootstrap replicates.",
            "penalty": "The normal of mu1 that is added to the log likelihood.",
            "at_edge": "Edges on which the maximum lies, such as `gamma=1` or `q0=1`, or `lapse_rate=0`, joined with `;`; empty where it lies inside.",
        },
    ),
    File(
        "asymmetry.csv", "`asymmetry`", "subject and comparison, a pair of different stimuli (r, c) met in both orders", ASYMMETRY_COLUMNS,
        [Comparison, SubjectAsymmetry], {
            "s_weak": f"The weaker stimulus r, {LN}.", "s_strong": f"The stronger stimulus c, {LN}.",
            **{f"n_{what}_{order}_first": f"{said} with the {order}er stimulus first." for order in ("weak", "strong")
               for what, said in (("equal", "Answers 'equal'"), ("trials", "Trials"))},
            "q_weak_first_se": "Standard error of `q_weak_first`.", "q_strong_first_se": "Standard error of `q_strong_first`.",
            "test": "Which exact test: `boschloo`, or `fisher` where there are too many trials for it.",
        },
    ),
    File(
        "asymmetry_covariates.csv", "`asymmetry --covariates`", "covariate and outcome", COVARIATE_COLUMNS, [CovariateTest], {
            "statistic": "Student's t.", "df": "Its degrees of freedom.", "p_value": "Two-sided p-value.",
            "note": "Why there is no test, or what to know about it.",
        },
    ),
    File(
        "predictions.csv", "`predict`", "subject and pair", ("subject", "s1", "s2", "isi", "mean", "q05", "q25", "q50", "q75", "q95"), (),
        {"mean": "Posterior mean of P(equal).", **{f"q{p:02d}": f"{p} % quantile of P(equal)." for p in (5, 25, 50, 75, 95)}},
    ),
    File(
        "study.csv", "`simulate`", "trial", ("subject", "condition", "batch", "trial", "s1", "s2", "isi", "response", "synthetic"), (), {
            "condition": "Level of the condition; only with `--conditions`.",
            "batch": "Repetition of the design.", "trial": "Number of the trial of the subject, from 1.", "response": "`equal` or `different`.",
            "synthetic": "1: the answer was simulated. The mark goes with the study into all results.",
        },
    ),
    File(
        "truth.csv", "`simulate --truth`", "subject, or with `--conditions` subject and condition (`S01@left`), with the parameters that made "
        "its answers", ("subject", *FITTED),
    ),
    File(
        "methods_parameters.csv", "`methods`", "subject; other models have their own parameters",
        ("subject", *(f"{name}_{key}" for name in _SHOWN for key in _RANGES), "prior_dominated", "min_ess", "max_r_hat", "converged"), (), {
            **{f"{name}_{key}": f"{said} of {name}." for name in _SHOWN for key, said in _RANGES.items()},
            "prior_dominated": "Parameters whose contraction is below 0.5.", "min_ess": "Smallest bulk or tail effective draws of a parameter.",
            "max_r_hat": "Largest R-hat of a parameter.", "converged": "`yes` or `no`.",
        },
    ),
    File("methods_order_effect.csv", "`methods`", "subject", ORDER_EFFECT_COLUMNS, [SubjectEvidence], VERDICT),
    File(
        "methods_fit.csv", "`methods` where there is no evidence.csv", "subject", FIT_TABLE_COLUMNS, (), {
            "predictive_p": "Posterior predictive p-value of the deviance, of the model of the draws.",
            "p_deviance": "p-value of the smallest deviance; empty without degrees of freedom.",
            "fits": "`no` where one of these is below 0.01, empty where they are withheld, or there are no more pairs than parameters.",
        },
    ),
    File(
        "calibration.csv", "`scripts/calibration.py`", "design and quantity", (*_names(RankRow), "verdict"), [RankRow],
        {"verdict": "`inside` or `outside` the band that holds for the whole distribution of ranks.", "quantity": COMMON["quantity"]},
    ),
    File(
        "calibration_ranks.csv", "`scripts/calibration.py`", "simulated study", ("design", "subject", *(f"true_{name}" for name in FITTED), *RANKED, "shortfall"),
        (), {**{f"true_{name}": f"True {name}." for name in FITTED}, **{name: f"Place of the true {name} among its draws, 0 to 1." for name in RANKED}},
    ),
    File(
        "evidence_calibration.csv", "`scripts/calibration.py`", "design and estimator",
        (*(name for name in _names(EvidenceRow) if name != "judged"), *_JUDGED, "verdict"), [EvidenceRow, Reliability], {
            "missing_h1": "Data sets from H1 for which the estimator gives no number.", "missing_h0": "The same from H0.",
            "median_shift": "Median difference of its log Bayes factor from the default estimator's, nats.",
            "largest_shift": "The largest such difference, signed, nats.",
            "verdict": "`calibrated` or `not calibrated`.",
        },
    ),
    File(
        "evidence_data_sets.csv", "`scripts/calibration.py`", "simulated data set", ("design", "data_set", "from", *ESTIMATORS), (),
        {"data_set": "Its name.", "from": "`H1` or `H0`, which made it.", **{name: f"Log Bayes factor, nats: {ABOUT[name]}." for name in ESTIMATORS}},
    ),
    File(
        "what check prints", "`check`, which writes no file", "subject",
        ("subject", "n_pairs", "n_intervals", "n_trials", "n_both_orders", "n_one_order", "n_equal_pairs", "fraction_equal"), (), {
            "n_intervals": "Distinct inter-stimulus intervals; only where the study has such a column.",
            "n_both_orders": "Pairs of different stimuli met in both orders.", "n_one_order": "Those met in one order only.",
            "n_equal_pairs": "Pairs of equal stimuli.", "fraction_equal": "Share of answers 'equal', 0 to 1.",
        },
    ),
    File(
        "posterior.nc, group sample_stats", "`run`, `sample`", "subject",
        ("acceptance_rate", "converged", "shortfall", "imprecise", "min_ess", "max_r_hat", "thin", "steps", "proposal_efficiency", "pareto_k", "deviance",
         "degrees_of_freedom", "predictive_p", "predictive_p_se", "worst_pair_p", "worst_pair_s1", "worst_pair_s2", "worst_pair_isi",
         "deviance_p", "lp"), (), {
            "acceptance_rate": "Share of accepted proposals, by chain.", "converged": "1 where all criteria were met.",
            "min_ess": "Smallest bulk or tail effective draws of a parameter.", "max_r_hat": "Largest R-hat of a parameter.",
            "thin": "Every how many steps of the last pass a draw was kept.", "steps": "Steps of each walker over all passes.",
            "proposal_efficiency": "Effective share of independent draws from the fitted proposal, 0 to 1.",
            "pareto_k": "Pareto k-hat of that proposal.", "deviance": "Smallest deviance over the draws.",
            "degrees_of_freedom": "Pairs less free parameters.", "predictive_p": "Posterior predictive p-value of the deviance.",
            "predictive_p_se": "Its Monte Carlo standard error.", "worst_pair_p": "Smallest two-sided predictive p-value of a pair.",
            "worst_pair_s1": f"That pair, {LN}.", "worst_pair_s2": f"That pair, {LN}.", "worst_pair_isi": "Its interval, s.",
            "deviance_p": "p-value of the smallest deviance.", "lp": "Log posterior density of each draw in unconstrained coordinates.",
        },
    ),
    File(
        "power.csv", "`power`; `design` as NAME_compared.csv", "design, number of trials, kind of observers and quantity", POWER_COLUMNS, (), _PLANNED | {
            "quantity": "What is counted or averaged: mean probabilities; how often the verdict says each word, finds an effect (has, probably has), names the "
            "observer's kind or another (probably counts; a negligible effect is none); widths of 90 % intervals.",
            "value": "The share or the mean.", "low": "Lower end of its 95 % interval of Monte Carlo error.", "high": "Upper end.",
            "data_sets": "Over how many simulated observers.",
        },
    ),
    File(
        "power_history.csv", "`power --carry-over`", "design, number of trials, what is carried over, and quantity", POWER_COLUMNS, (), _PLANNED | {
            "observers": "What is carried over from trial to trial: the share, or nothing.",
            "quantity": "How often `compare --history` says each of its words; `yes` or `probably` together.",
            "value": "The share.", "low": "Lower end of its 95 % interval of Monte Carlo error.", "high": "Upper end.",
            "data_sets": "Over how many simulated observers.",
        },
    ),
    File(
        "power_data_sets.csv", "`power`", "simulated observer", DATA_SET_COLUMNS, [SubjectEvidence], _PLANNED | {
            "effect": "What the verdict says of an effect.", "kind_named": "And of its kind.",
            **{f"log_evidence_{one}": f"Log evidence (nats) of {said}, the mean over its models." for one, said in
               (("none", "no order effect"), ("constant_error", "a constant error"), ("update", "a pull"))},
            **{f"{name}_90": f"Width of the 90 % interval of {name} under the update." for name in ("gain", "mu1", "width")},
        },
    ),
    File(
        "power_subjects.csv", "`power`", "design, number of trials, kind and number of subjects of a study", STUDY_COLUMNS, (), _PLANNED | {
            "subjects": "Subjects of a study.", "studies": "How many such studies there are.",
            "named": "Share of them that names this kind, or the one that is the most frequent in the mixed population, as the most frequent, protected exceedance above 0.95.",
            "low": "Lower end of its 95 % interval.", "high": "Upper end.", "another_named": "Share that names another kind.",
        },
    ),
    File(
        "power_population.csv", "`power --population`", "design, kind and number of subjects of a study, and quantity", POPULATION_COLUMNS, (),
        _PLANNED | {
            "subjects": "Subjects of a study.",
            "quantity": "How often `population` says an order effect on average (for sure or probably), names a pull or a constant error, or "
            "says none; mean widths of 90 % intervals of means and sds; how often the analysis warned.",
            "value": "The share or the mean.", "low": "Lower end of its 95 % interval of Monte Carlo error.", "high": "Upper end.",
            "studies": "Over how many simulated studies.",
        },
    ),
    File(
        "power_conditions.csv", "`power --differ`", "design, number of trials, what differs, number of subjects of a study, and quantity",
        POPULATION_COLUMNS, (), _PLANNED | {
            "trials": "Trials of a subject, half of them under either condition.",
            "observers": "What differs between the conditions, on the scales on which subjects scatter.", "subjects": "Subjects of a study.",
            "quantity": "How often `contrast` says of a subject, or `population` of several on average, that constant error, pull, width or order effect "
            "differs, or does not; for sure (a Bayes factor of 20), or probably too (3).",
            "value": "The share.", "low": "Lower end of its 95 % interval of Monte Carlo error.", "high": "Upper end.",
            "studies": "Over how many simulated studies.",
        },
    ),
    File(
        "power_stopping.csv", "`power --stop`", "simulated session", STOPPING_COLUMNS, [SubjectEvidence], _PLANNED | {
            "trials": "Trials until it stopped.", "effect": "What the verdict then said of an effect.", "kind_named": "And of its kind.",
        },
    ),
    File(
        "design.csv", "`design`, which reads it too, as `power` does", "pair", DESIGN_COLUMNS, (),
        {"n_trials": "How often the pair is presented.", "isi": "Inter-stimulus interval, s; only where there are several."},
    ),
    File(
        "trials.csv", "`design --list`", "trial, in the order of presentation", ("subject", "condition", "block", "trial", "s1", "s2", "isi", "response"), (), {
            "condition": "Level of the condition; only with `--conditions`.",
            "block": "Number of the block, from 1.", "trial": "Number of the trial of the subject, from 1.",
            "isi": "Inter-stimulus interval, s; only where the design has several.",
            "response": "Empty: the answer goes here, `equal` or `different`, and `run` reads the file.",
        },
    ),
)  # fmt: skip

HEAD = """# Data dictionary

Every column of every file that `bayes-toe` writes; made by `scripts/data_dictionary.py`. Names are those that a command takes by default:
with `-o NAME.csv` the others are `NAME_parts.csv` and so on. CSV files are UTF-8 with a comma and a decimal point, numbers read back to
the same bits, and an empty cell is a value that does not exist or is withheld. With `-o NAME.parquet` the tables are Parquet files with the
same columns. Logarithms are natural (nats). `methods_population.csv` has the columns of `population.csv`. Of a study with a condition
within subjects tables of single subjects have a column `condition` behind `subject`.
"""


def text() -> str:
    """The whole document."""
    parts = [HEAD]
    for file in FILES:
        rows = "\n".join(f"| `{name}` | {file.meaning(name)} |" for name in file.columns)
        parts.append(f"## {file.name}\n\nWritten by {file.writers}. One row per {file.row}.\n\n| column | meaning |\n|---|---|\n{rows}\n")
    return "\n".join(parts)


def main() -> None:
    """Write the document."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("-o", "--output", default=OUTPUT)
    parser.add_argument("--overwrite", action="store_true")
    given = parser.parse_args()
    with whole_file(given.output, overwrite=given.overwrite) as path:
        path.write_text(text(), encoding="utf-8")


if __name__ == "__main__":
    main()
