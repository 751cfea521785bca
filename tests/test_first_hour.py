"""A new user reads a study of touch after at most two refusals, by typing what they print.

The study has six observers, 240 trials each, standards of 60, 100 and 160 um, and comparisons of
.75, .87, 1.15 and 1.33 of them in both orders. One file is as PsychoPy writes it, the other is
German: semicolons, decimal commas and Windows-1252.

`first_hour` types `bayes-toe check` and adds what each refusal says after 'type:', as it is
printed. Of several lines the user takes the first that says what is true of the study.
"""

import shlex
from itertools import product

import numpy as np
import pandas as pd
import pytest
from commands import inside
from conftest import typed_lines
from numpy.random import default_rng

STANDARDS, RATIOS = (60.0, 100.0, 160.0), (0.75, 0.87, 1.15, 1.33)
N_REPEATS, N_PRACTICE = 10, 6
NOISE, CONSTANT_ERRORS = 0.12, (0.1, 0.0, -0.1, 0.05, 0.0, 0.1)
#: What the user knows: keys, columns and the question. A line with one of the others is wrong.
NOT_TRUE = ("--equal-code", "--different-code", "--comparison-code", "--correct", "--unit ln")
NOT_TRUE += ("--standard-first ", "--second-code f", "--first-code j")
MOST_REFUSALS = 2


def made_up_trials():
    """A table with a row for each trial, practice among them: what was shown and answered."""
    rng = default_rng(63)
    stimuli = product(STANDARDS, RATIOS, (True, False))
    pairs = pd.DataFrame(stimuli, columns=["standard", "ratio", "is_standard_first"])
    tables = []
    for number, constant_error in enumerate(CONSTANT_ERRORS, start=1):
        main = pd.concat([pairs] * N_REPEATS).sample(frac=1.0, random_state=rng)
        practice = main[:N_PRACTICE].assign(part="practice")
        table = pd.concat([practice, main.assign(part="main")])
        difference = np.log(table.ratio) * np.where(table.is_standard_first, 1.0, -1.0)
        is_second = difference - constant_error + rng.normal(0.0, NOISE, len(table)) > 0.0
        tables.append(table.assign(observer=f"VP{number:02}", key=np.where(is_second, "j", "f")))
    trials = pd.concat(tables, ignore_index=True)
    trials["comparison"] = (trials.ratio * trials.standard).map("{:g}".format)
    missed = 40 + trials.observer.eq("VP03").idxmax()
    trials.loc[missed, "key"] = None
    return trials


def psychopy_file(folder):
    """The study as PsychoPy writes it."""
    trials = made_up_trials()
    reaction_times = default_rng(1).uniform(0.3, 1.2, len(trials)).round(4)
    columns = {
        "participant": trials.observer,
        "block": trials.part,
        "trials.thisRepN": 0,
        "trials.thisN": trials.groupby(["observer", "part"]).cumcount(),
        "amp_standard": trials.standard,
        "amp_comparison": trials.comparison,
        "order": np.where(trials.is_standard_first, "standard_first", "comparison_first"),
        "key_resp.keys": trials.key.fillna("None"),
        "key_resp.rt": np.where(trials.key.isna(), np.nan, reaction_times),
        "date": "2026-11-02",
        "frameRate": "60.01",
    }
    pd.DataFrame(columns).to_csv(folder / "study.csv", index=False)
    return "study.csv"


def german_file(folder):
    """The study as a German spreadsheet saves it."""
    trials = made_up_trials()
    columns = {
        "Versuchsperson": trials.observer,
        "Phase": trials.part.replace({"practice": "Übung", "main": "Hauptteil"}),
        "Standard (µm)": trials.standard,
        "Vergleich (µm)": trials.comparison.str.replace(".", ","),
        "Reihenfolge": np.where(trials.is_standard_first, "Standard zuerst", "Vergleich zuerst"),
        "Taste": trials.key,
        "Prüfgröße": "größer",
    }
    format_of_file = {"sep": ";", "decimal": ",", "lineterminator": "\r\n", "encoding": "cp1252"}
    pd.DataFrame(columns).to_csv(folder / "studie.csv", index=False, **format_of_file)
    return "studie.csv"


def first_hour(folder, name):
    """The refusals until `check` answers, and its answer."""
    words, refusals = ["check", name], []
    while len(refusals) <= MOST_REFUSALS:
        finished = inside(*words, cwd=folder)
        if finished.returncode == 0:
            return refusals, finished.stdout
        refusals.append((shlex.join(words), finished.stderr))
        for line in typed_lines(finished.stderr):
            if not any(text in f"{line} " for text in NOT_TRUE):
                words += shlex.split(line)
                break
    return refusals, ""


@pytest.mark.parametrize("write", [psychopy_file, german_file])
def test_a_study_is_read_after_at_most_two_refusals(write, tmp_path):
    refusals, answer = first_hour(tmp_path, write(tmp_path))
    assert 1 <= len(refusals) <= MOST_REFUSALS, refusals
    assert "6 subjects, 1,439 trials, which was stronger (2AFC), 24" in " ".join(answer.split())
    assert "No subject needs a decision." in answer
    assert "6 rows left out as practice" in answer
    assert "1 trial without a response dropped: VP03 1." in answer
