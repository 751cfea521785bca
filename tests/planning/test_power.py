"""Power by simulation: judged as the program judges, what is counted is counted, commands say it."""

import numpy as np
import pandas as pd
import pytest
from commands import good, refused
from conftest import plain_models_alone

from bayes_toe.comparison.random_effects import random_effects
from bayes_toe.comparison.verdict import verdict
from bayes_toe.errors import InputError
from bayes_toe.planning.judging import Judgement
from bayes_toe.planning.observers import observers_from, prior_of
from bayes_toe.planning.power import (
    FOUND,
    NAMED,
    WRONG,
    DataSet,
    PowerTable,
    power,
    share_of,
)
from bayes_toe.planning.power_of_studies import power_of_studies
from bayes_toe.planning.study_design import narrow_study_design, paper_study_design
from bayes_toe.seeds import generator


@pytest.fixture(scope="module")
def designs():
    return {
        "paper": paper_study_design(),
        "narrow": narrow_study_design(np.linspace(-0.75, 1.25, 5), np.linspace(-0.3, 0.3, 5), 650),
    }


@pytest.fixture(scope="module")
def table(designs):
    with plain_models_alone():
        return power(designs, [650], data_sets=2, seed=1, workers=1)


def test_the_judgement_is_the_verdict(table, designs, three_models):
    observer = observers_from(None, 1, seed=1)[-1]
    subject = observer.answers(designs["paper"], generator(1, observer.name, "answers", 650))
    expected = verdict(subject, prior_of([designs["paper"]], None), 1)[0]
    [found] = [
        one.judgement for one in table if (one.design, one.observer) == ("paper", observer.name)
    ]
    assert found.probability == pytest.approx(expected.p_orders, abs=0.1)  # 0.009 in the middle
    assert found.p_larger == pytest.approx(expected.p_larger, abs=0.05)
    assert (found.verdict.effect, found.verdict.kind) == (expected.effect, expected.kind)


def test_wide_first_stimuli_tell_an_update_that_the_papers_pairs_do_not_whoever_else_is_simulated(
    table, designs, three_models
):
    assert table["narrow", 650, "update", NAMED].value == 1.0
    assert (
        table["paper", 650, "update", "90 % width of gain"].value
        > 3.0 * table["narrow", 650, "update", "90 % width of gain"].value
    )
    assert table["narrow", 650, "none", FOUND].value == 0.0
    again = power(
        {"narrow": designs["narrow"]},
        [650],
        observers_from(None, 2, seed=1)[-1:],
        seed=1,
        workers=1,
    )
    assert again.rows[0] == next(
        one for one in table if (one.design, one.observer) == ("narrow", "update 2")
    )


def made_up(kind, *probabilities):
    return [
        DataSet("d", 100, f"{kind} {i}", kind, Judgement(None if p is None else tuple(np.log(p))))
        for i, p in enumerate(probabilities)
    ]


def test_counts_of_data_sets_one_of_which_is_withheld():
    rows = made_up(
        "update", (0.01, 0.01, 0.98), (0.97, 0.02, 0.01), (0.3, 0.3, 0.4), (0.01, 0.39, 0.6), None
    )
    table = PowerTable(tuple(rows + made_up("none", (0.01, 0.03, 0.96), (0.8, 0.1, 0.1))), 0)
    names = (FOUND, NAMED, WRONG, "evidence withheld", "said: has", "said: none", "said: undecided")
    assert [table["d", 100, "update", name].value for name in names] == [
        0.4,
        0.2,
        0.2,
        0.2,
        0.4,
        0.2,
        0.2,
    ]
    assert [
        table["d", 100, "none", name].value for name in (FOUND, NAMED, WRONG, "said: probably none")
    ] == [0.5] * 4
    assert table["d", 100, "update", "P(update)"].value == pytest.approx(0.4975)
    assert table.sentences() == [
        "with d 100 trials find an order effect in 40 % of observers with a pull (9 to 79 %), and name a pull in 20 %; and wrongly one in "
        "1 of 2 without"
    ]
    assert table.data_sets_frame().kind_named.tolist() == ["pull", "", "", "open", "", "pull", ""]
    with pytest.raises(InputError, match="nothing counted"):
        table["d", 100, "update", "luck"]


def test_a_negligible_effect_is_none():
    assert Judgement(tuple(np.log((0.5, 0.3, 0.2))), 0.01).named == "none"
    assert Judgement(tuple(np.log((0.5, 0.3, 0.2))), 0.4).named is None


def test_intervals_of_shares_cover():
    rng, hits = np.random.default_rng(0), 0
    for found in rng.binomial(20, 0.35, 2000):
        _, low, high, _ = share_of([1] * found + [0] * (20 - found))
        hits += low <= 0.35 <= high
    assert 0.91 < hits / 2000 < 0.99  # 0.93 by the exact sum: counts are whole numbers


# --- Studies --------------------------------------------------------------------------------------


def test_whole_studies_name_what_single_subjects_cannot():
    rows = made_up("update", *[(0.02, 0.08, 0.9)] * 16) + made_up("none", *[(0.4, 0.3, 0.3)] * 5)
    found = (
        power_of_studies(PowerTable(tuple(rows), 0), (4, 8, 16))
        .frame()
        .set_index(["observers", "subjects"])
    )
    assert list(found.index) == [("update", 4), ("update", 8), ("update", 16), ("none", 4)]
    assert found.studies.tolist() == [4, 2, 1, 1]
    assert (
        found.named["update", 16],
        found.named["none", 4],
        found.another_named["update", 16],
    ) == (1.0, 0.0, 0.0)
    protected = random_effects([row.judgement.log_evidence for row in rows[:8]]).protected
    assert found.named["update", 8] == float(protected[2] > 0.95)


def test_a_mixed_population_names_its_most_frequent_kind():
    table = PowerTable(
        tuple(
            made_up("none", *[(0.98, 0.01, 0.01)] * 20)
            + made_up("update", *[(0.01, 0.01, 0.98)] * 80)
        ),
        0,
    )
    found = power_of_studies(table, (10, 20), {"none": 0.1, "update": 0.9})
    ten, twenty = (row for row in found.frame().itertuples() if row.observers == "mixed")
    assert 6 < ten.studies <= 10  # until one kind has no subject left
    assert (twenty.subjects, twenty.another_named) == (20, 0.0)
    assert twenty.named > 0.7
    assert found.sentences()[-1].startswith(
        "with d and 100 trials each, the most frequent kind of the mixed population is named in"
    )


# --- The command ----------------------------------------------------------------------------------


ALONE = ("--data-sets", "1", "--seed", "1", "--workers", "1", "-o", "out")


def test_the_command(tmp_path, designs, three_models):
    designs["paper"].save(tmp_path / "design.csv")
    said = good(
        "power",
        "design.csv",
        "--trials",
        "130,65",
        *ALONE,
        cwd=tmp_path,
    )
    assert "with these pairs 65 trials find an order effect in" in said
    names = [
        "power.csv",
        "power.pdf",
        "power.png",
        "power_data_sets.csv",
        "power_subjects.csv",
    ]
    assert sorted(path.name for path in (tmp_path / "out").glob("power*")) == names
    table, sets = (
        pd.read_csv(tmp_path / "out" / f"power{name}.csv") for name in ("", "_data_sets")
    )
    assert (set(table.trials), len(sets), list(sets.columns[:4])) == (
        {65, 130},
        6,
        ["design", "trials", "observer", "kind"],
    )
    assert not (tmp_path / "out.partial").exists()


@pytest.mark.parametrize(
    ("more", "said"),
    [
        (("--trials", "5"), "error: 5 trials for 13 pairs: allowed is at least one trial a pair"),
        (("--trials", "a"), "error: --trials: found 'a', allowed: whole numbers of at least 1"),
        (("--observers", "nobody.toml"), "error: nobody.toml: no such file"),
        (("absent.csv",), "error: absent.csv: cannot be read"),
    ],
)
def test_bad_input_is_one_line(tmp_path, more, said):
    assert refused("power", *more, "-o", "out", cwd=tmp_path).startswith(said)
