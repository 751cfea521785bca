"""Figures and tables of docs/order_effect.md, from the tables that order_effect.py and order_effect_studies.py write."""

from __future__ import annotations

from itertools import product
from pathlib import Path

import numpy as np
import pandas as pd
from order_effect import COMPOSITIONS, DESIGNS, KINDS, PLAIN, TABLE, resampled
from scipy.special import logsumexp

from bayes_toe.errors import InputError
from bayes_toe.experiments.reliability import reliability, reliability_bins
from bayes_toe.inference.adaptation import fit_proposal
from bayes_toe.model.parts import compose
from bayes_toe.plots.figure_files import save_figure
from bayes_toe.plots.style import EQUAL, LETTERS, PAGE, SMALL, STRONGER_FIRST, WEAKER_FIRST, dress, new_figure
from bayes_toe.seeds import generator

STUDIES = "order_effect_studies.csv"
#: Models over which an order part's probability is the sum.
SPACES = {"12 compositions": COMPOSITIONS, "three plain models": PLAIN}
SHORT = {"none": "none", "constant error": "const.\nerror", "update": "update"}
COLOURS = {"none": "#8A8A8A", "constant error": WEAKER_FIRST, "update": STRONGER_FIRST}
POOR = "#B00000"


def draw(folder: Path, *, overwrite: bool) -> None:
    """Write the figures whose tables are there, and print the tables of the page."""
    if not (folder / TABLE).exists():
        raise InputError(f"{folder / TABLE}: not there, allowed: a folder with this table")
    frame = pd.read_csv(folder / TABLE)
    known = frame.dropna(subset=[f"log_evidence: {model.name}" for model in COMPOSITIONS])
    print(f"{len(frame)} observers, {len(frame) - len(known)} left out because an evidence was withheld")
    save_figure(confusion_figure(known), folder / "order_effect_confusion.png", overwrite=overwrite)
    save_figure(reliability_figure(known), folder / "order_effect_reliability.png", overwrite=overwrite)
    print(scores(known))
    if (folder / STUDIES).exists():
        save_figure(studies_figure(pd.read_csv(folder / STUDIES)), folder / "order_effect_studies.png", overwrite=overwrite)


def level_log_evidences(frame: pd.DataFrame, space: str) -> np.ndarray:
    """Log evidence of each kind of order effect, averaged over the models that have it, shape (observers, 3)."""
    models = {kind: [f"log_evidence: {m.name}" for m in SPACES[space] if dict(m.levels)["order"] == kind] for kind in KINDS}
    return np.stack([logsumexp(frame[names], axis=1) for names in models.values()], axis=1)


def log_odds(frame: pd.DataFrame, space: str, kind: str) -> np.ndarray:
    """Posterior log odds of a kind of order effect against the other two."""
    of, place = level_log_evidences(frame, space), KINDS.index(kind)
    return np.asarray(of[:, place] - logsumexp(np.delete(of, place, axis=1), axis=1))


def groups(frame: pd.DataFrame) -> dict[str, pd.DataFrame]:
    """Observers whom the three plain models can describe, and the others."""
    plain = (frame["noise"] == "Weber") & (frame["lapses"] == "misses")
    return {"no slope, no floor": frame[plain], "slope or floor": frame[~plain]}


# --- Confusion ----------------------------------------------------------------------------------------


def confusion(frame: pd.DataFrame, space: str) -> np.ndarray:
    """Observers by true kind (rows) and kind with the highest probability (columns)."""
    found = level_log_evidences(frame, space).argmax(axis=1)
    return np.array([[np.sum((frame["kind"] == kind) & (found == i)) for i in range(3)] for kind in KINDS])


def confusion_figure(frame: pd.DataFrame):
    """Rows: designs. Columns: space of models, and observers without and with noise and lapses that the plain models lack."""
    figure = new_figure(PAGE, 4.1)
    panels = figure.subplots(len(DESIGNS), 4, sharex=True, sharey=True)
    for axes, design in zip(panels, DESIGNS, strict=True):
        there = frame[frame["design"] == design]
        for ax, (space, (group, some)) in zip(axes, product(SPACES, groups(there).items()), strict=True):
            counts = confusion(some, space)
            shares = counts / np.maximum(counts.sum(axis=1, keepdims=True), 1)
            ax.imshow(shares, vmin=0.0, vmax=1.0, cmap="Blues")
            for i, j in product(range(3), range(3)):
                ax.text(
                    j, i, f"{counts[i, j]}", ha="center", va="center", fontsize=LETTERS, color="white" if shares[i, j] > 0.6 else "black"
                )
            if design == next(iter(DESIGNS)):
                ax.set_title(f"{space}\n{group}", fontsize=LETTERS)
            ax.set_xticks(range(3), list(SHORT.values()))
            ax.set_yticks(range(3), list(SHORT.values()))
            ax.tick_params(labelsize=SMALL, length=0)
        axes[0].set_ylabel(f"{design} design\ntrue", fontsize=LETTERS)
    for ax in panels[-1]:
        ax.set_xlabel("most probable", fontsize=LETTERS)
    return figure


# --- Calibration --------------------------------------------------------------------------------------


def judged(frame: pd.DataFrame, space: str, kind: str):
    """Calibration of one probability; the same simulations of its floor for every one."""
    return reliability(log_odds(frame, space, kind), frame["kind"] == kind, np.random.default_rng(1))


def reliability_figure(frame: pd.DataFrame):
    """How often a kind was true where its probability was p; exact 95 % intervals."""
    figure = new_figure(PAGE, 4.3)
    panels = figure.subplots(2, 4, sharex=True, sharey=True)
    for axes, design in zip(panels, DESIGNS, strict=True):
        there = frame[frame["design"] == design]
        for ax, (space, kind) in zip(axes, product(SPACES, ("none", "update")), strict=True):
            bins, score = reliability_bins(log_odds(there, space, kind), there["kind"] == kind), judged(there, space, kind)
            ax.plot([0, 1], [0, 1], color="black", lw=0.5)
            error = [bins.observed - bins.lower, bins.upper - bins.observed]
            ax.errorbar(bins.stated, bins.observed, error, fmt="o", ms=3.5, lw=0.8, color=COLOURS[kind])
            ax.text(0.03, 1.16, f"ECE {score.error:.3f}, floor {score.floor:.3f}", fontsize=SMALL, va="center")
            ax.set_title(f"P({kind}), {space}" if design == next(iter(DESIGNS)) else "", fontsize=SMALL)
            ax.set(xlim=(-0.03, 1.03), ylim=(-0.03, 1.25), aspect="equal", xticks=(0, 0.5, 1), yticks=(0, 0.5, 1))
            dress(ax)
        axes[0].set_ylabel(f"{design} design\nshare that was true")
    for ax in panels[-1]:
        ax.set_xlabel("stated probability")
    for ax in panels[0]:
        ax.title.set_fontsize(SMALL)
    return figure


def scores(frame: pd.DataFrame) -> str:
    """The page's table: share of observers whose kind is found, and calibration."""
    lines = [
        "| design | models | observers | right | no slope, no floor | slope or floor "
        "| P(none): ECE / floor / log score | P(update): the same | calibrated |",
        "|---|---|--:|--:|--:|--:|---|---|---|",
    ]
    for design, space in product(DESIGNS, SPACES):
        there = frame[frame["design"] == design]
        right = [f"{100 * right_share(some, space):.0f} %" for some in (there, *groups(there).values())]
        found = [judged(there, space, kind) for kind in ("none", "update")]
        said = [f"{one.error:.3f} / {one.floor:.3f} / {one.log_score:.3f}" for one in found]
        fine = "yes" if all(one.calibrated for one in found) else "no"
        lines.append(f"| {' | '.join([design, space, str(len(there)), *right, *said, fine])} |")
    return "\n".join(lines)


def right_share(frame: pd.DataFrame, space: str) -> float:
    """Share of observers whose kind of order effect has the highest probability."""
    counts = confusion(frame, space)
    return float(np.trace(counts) / counts.sum())


# --- Real studies -------------------------------------------------------------------------------------


def studies_figure(frame: pd.DataFrame):
    """Every subject: lead of plain H1 and of the best composition over free frequencies, whether that one fits, and the order effect."""
    figure = new_figure(PAGE, 3.4)
    lead, order = figure.subplots(1, 2, sharey=True, width_ratios=(2.0, 1.0))
    subjects = list(dict.fromkeys(frame["subject"]))[::-1]
    space = [model.name for model in COMPOSITIONS]
    for y, name in enumerate(subjects):
        rows = frame[(frame["subject"] == name) & frame["model"].isin(space)].drop_duplicates("model").set_index("model")
        best, plain = rows.iloc[0], rows.loc["predictive update"]
        poor = best["predictive_p"] < 0.01
        lead.plot([max(plain["lead"], -40.0), best["lead"]], [y, y], color="#BBBBBB", lw=0.8, zorder=1)
        lead.plot(max(plain["lead"], -40.0), y, "o", mfc="white", mec=EQUAL, ms=4, label="H1 (plain)" if y == 0 else None)
        lead.plot(best["lead"], y, "X" if poor else "o", color=POOR if poor else STRONGER_FIRST, ms=5)
        lead.text(25.0, y, f"{best.name}, p {best['predictive_p']:.3f}", fontsize=SMALL, va="center", color=POOR if poor else "black")
        probability = np.exp(rows["lead"] - logsumexp(rows["lead"]))
        left = 0.0
        for kind in KINDS:
            share = probability[rows["order"] == kind].sum()
            order.barh(y, share, left=left, color=COLOURS[kind], height=0.7, label=kind if y == 0 else None)
            left += share
    lead.axvline(0.0, color="black", lw=0.5)
    lead.set_yticks(range(len(subjects)), subjects)
    lead.plot([], [], "o", color=STRONGER_FIRST, ms=5, label="best of 12")
    lead.plot([], [], "X", color=POOR, ms=5, label="best of 12, does not fit (p < 0.01)")
    lead.set_xlim(-42.0, 100.0)
    lead.set_xticks([-40, -20, 0, 20], ["≤ -40", "-20", "0", "20"])
    lead.set_xlabel("lead over free frequencies (nats)")
    order.set_xlim(0.0, 1.0)
    order.set_xlabel("probability of the kind of order effect")
    for ax in (dress(lead), dress(order)):
        ax.legend(
            loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=3, frameon=False, fontsize=SMALL, handletextpad=0.3, columnspacing=0.8
        )
    return figure


def misfit_figure(subjects, frame: pd.DataFrame):
    """Answers of subjects whom the best of the 12 compositions does not describe, beside it and beside it with a free exponent (90 %)."""
    figure = new_figure(PAGE, 2.3 * len(subjects))
    for ax, subject in zip(np.atleast_1d(figure.subplots(len(subjects), 1)), subjects, strict=True):
        best = frame[frame["subject"] == subject.name].iloc[0]
        order = np.lexsort([subject.s1, np.abs(subject.s2 - subject.s1).round(1)])
        names = [f"{a:.0f}\n{b:.0f}" for a, b in np.exp(np.stack([subject.s1, subject.s2], axis=1)[order])]
        for shift, curve, colour in ((-0.15, best["curve"], STRONGER_FIRST), (0.15, "exponent", WEAKER_FIRST)):
            model = compose(**{part: best[part] for part in ("order", "noise", "lapses", "spread")}, curve=curve)
            posterior, rng = model.posterior(subject), generator(1, subject.name, "figure")
            x = resampled(fit_proposal(posterior, rng, draws=4000), rng, 2000)
            low, middle, high = np.quantile(np.exp(posterior.log_answers(x)[0]), [0.05, 0.5, 0.95], axis=0)[:, order]
            places = np.arange(len(order)) + shift
            ax.errorbar(places, middle, [middle - low, high - middle], fmt="_", ms=5, lw=1.5, color=colour, label=model.name)
        share = (subject.n_equal / subject.n_trials)[order]
        error = np.sqrt(share * (1 - share) / subject.n_trials[order])
        ax.errorbar(np.arange(len(order)), share, error, fmt="o", ms=3.5, mfc="none", lw=0.8, color="black", label="answers (s.e.)")
        ax.set_xticks(range(len(order)), names)
        ax.set_title(f"subject {subject.name}: predictive p of {best['model']} = {best['predictive_p']:.3f}")
        ax.set_ylabel("share called equal")
        dress(ax)
        ax.legend(frameon=False, fontsize=SMALL)
    figure.axes[-1].set_xlabel("pulses per second, first above second")
    return figure
