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
import pytest
from commands import inside

STANDARDS, RATIOS = (60.0, 100.0, 160.0), (0.75, 0.87, 1.15, 1.33)
N_REPEATS, N_PRACTICE = 10, 6
KEYS, SIGNS = {True: "j", False: "f"}, {True: 1.0, False: -1.0}
PSYCHOPY_ORDERS = {True: "standard_first", False: "comparison_first"}
GERMAN_ORDERS = {True: "Standard zuerst", False: "Vergleich zuerst"}
GERMAN_PARTS = {"practice": "Übung", "main": "Hauptteil"}
NOISE, CONSTANT_ERRORS = 0.12, (0.1, 0.0, -0.1, 0.05, 0.0, 0.1)
#: What the user knows: keys, columns and the question. A line with one of the others is wrong.
NOT_TRUE = ("--equal-code", "--different-code", "--comparison-code", "--correct", "--unit ln")
NOT_TRUE += ("--standard-first ", "--second-code f", "--first-code j")
MOST_REFUSALS = 2


def made_up_trials():
    """One record for each trial, practice among them: what was shown and answered."""
    rng = np.random.default_rng(63)
    pairs = list(product(STANDARDS, RATIOS, (True, False)))
    trials = []
    for observer, constant_error in enumerate(CONSTANT_ERRORS, start=1):
        main = [*pairs] * N_REPEATS
        rng.shuffle(main)
        for part, pairs_shown in (("practice", main[:N_PRACTICE]), ("main", main)):
            for number, (standard, ratio, is_first) in enumerate(pairs_shown):
                comparison = ratio * standard
                difference = np.log(ratio) * SIGNS[is_first]
                is_second = difference - constant_error + rng.normal(0.0, NOISE) > 0.0
                trials.append(
                    {
                        "observer": f"VP{observer:02}",
                        "part": part,
                        "number": number,
                        "standard": standard,
                        "comparison": comparison,
                        "is_standard_first": is_first,
                        "key": KEYS[bool(is_second)],
                        "rt": f"{rng.uniform(0.3, 1.2):.4f}",
                    }
                )
    missed = next(i for i, trial in enumerate(trials) if trial["observer"] == "VP03")
    trials[missed + 40] |= {"key": "None", "rt": ""}
    return trials


def psychopy_file(folder):
    """The study as PsychoPy writes it."""
    head = "participant,block,trials.thisRepN,trials.thisN,amp_standard,amp_comparison,order,"
    lines = [f"{head}key_resp.keys,key_resp.rt,date,frameRate"]
    for trial in made_up_trials():
        order = PSYCHOPY_ORDERS[trial["is_standard_first"]]
        cells = [trial["observer"], trial["part"], "0", trial["number"], trial["standard"]]
        cells += [f"{trial['comparison']:g}", order, trial["key"], trial["rt"]]
        cells += ["2026-11-02", "60.01"]
        lines.append(",".join(map(str, cells)))
    (folder / "study.csv").write_text("\n".join(lines), encoding="utf-8")
    return "study.csv"


def german_file(folder):
    """The study as a German spreadsheet saves it."""
    lines = ["Versuchsperson;Phase;Standard (µm);Vergleich (µm);Reihenfolge;Taste;Prüfgröße"]
    for trial in made_up_trials():
        order, part = GERMAN_ORDERS[trial["is_standard_first"]], GERMAN_PARTS[trial["part"]]
        key = trial["key"].replace("None", "")
        cells = [trial["observer"], part, f"{trial['standard']:g}", f"{trial['comparison']:g}"]
        lines.append(";".join([*cells, order, key, "größer"]).replace(".", ","))
    (folder / "studie.csv").write_bytes("\r\n".join(lines).encode("cp1252"))
    return "studie.csv"


def proposals(stderr):
    """The options that a refusal says to type, without what they mean."""
    lines = stderr.splitlines()
    places = [i for i, line in enumerate(lines) if line.startswith("type:")]
    if not places:
        return []
    return [line[7:].partition("  ")[0] for line in lines[places[0] :]]


def first_hour(folder, name):
    """The refusals until `check` answers, and its answer."""
    words, refusals = ["check", name], []
    while True:
        finished = inside(*words, cwd=folder)
        if finished.returncode == 0:
            return refusals, finished.stdout
        refusals.append((shlex.join(words), finished.stderr))
        true_lines = []
        for line in proposals(finished.stderr):
            if not any(text in f"{line} " for text in NOT_TRUE):
                true_lines.append(line)
        if not true_lines or len(refusals) > MOST_REFUSALS:
            return refusals, ""
        words += shlex.split(true_lines[0])


@pytest.mark.parametrize(
    "write",
    [psychopy_file, german_file],
    ids=lambda write: write.__name__,
)
def test_a_study_is_read_after_at_most_two_refusals(write, tmp_path):
    refusals, answer = first_hour(tmp_path, write(tmp_path))
    assert 1 <= len(refusals) <= MOST_REFUSALS, refusals
    assert "6 subjects, 1,439 trials, which was stronger (2AFC), 24" in " ".join(answer.split())
    assert "No subject needs a decision." in answer
    assert "6 rows left out as practice" in answer
    assert "1 trial without a response dropped: VP03 1." in answer
