"""Power by simulation: the analysis is the program's, counts are counted, errors are stated."""

import numpy as np
import pandas as pd
import pytest
from commands import inside

import bayes_toe as bt
from bayes_toe.comparison.random_effects import random_effects
from bayes_toe.errors import InputError
from bayes_toe.planning.observers import observers_from
from bayes_toe.planning.power import NAMED, WRONG, DataSet, PowerTable, power, share
from bayes_toe.planning.power_of_studies import power_of_studies
from bayes_toe.planning.study_design import narrow_study_design, paper_study_design
from bayes_toe.seeds import generator


@pytest.fixture(scope="module")
def designs():
    return {"paper": paper_study_design(), "narrow": narrow_study_design(np.linspace(-0.75, 1.25, 5), np.linspace(-0.3, 0.3, 5), 650)}


@pytest.fixture(scope="module")
def table(designs):
    return power(designs, [650], data_sets=3, seed=1, workers=1)


def test_probabilities_are_those_of_the_command_evidence(table, designs):
    observer = observers_from(None, 1, seed=1)[-1]
    subject = observer.answers(designs["paper"], generator(1, observer.name, "answers", 650))
    row = bt.evidence(bt.Study((subject,)), seed=1, workers=1).rows[0]
    [found] = [one for one in table if (one.design, one.observer) == ("paper", observer.name)]
    assert found.log_evidence == pytest.approx(row.log_evidence_orders, abs=0.05)  # standard errors below 0.01
    assert found.probability == pytest.approx(row.order_probabilities, abs=0.02)


def test_wide_first_stimuli_tell_an_update_that_the_papers_pairs_do_not(table):
    assert table["narrow", 650, "update", NAMED].value == 1.0
    assert table["paper", 650, "update", "90 % width of gain"].value > 3.0 * table["narrow", 650, "update", "90 % width of gain"].value
    assert table["narrow", 650, "none", WRONG].value == 0.0


def test_data_sets_do_not_depend_on_the_others(table, designs):
    again = power({"narrow": designs["narrow"]}, [650], observers_from(None, 3, seed=1)[-1:], seed=1, workers=1)
    [same] = [one for one in table if (one.design, one.observer) == ("narrow", "update 3")]
    assert again.rows[0] == same


def made_up(kind, *probabilities):
    return [DataSet("d", 100, f"{kind} {i}", kind, tuple(np.log(p)), p, None) for i, p in enumerate(probabilities)]


def test_counts():
    rows = made_up("update", (0.01, 0.01, 0.98), (0.97, 0.02, 0.01), (0.3, 0.3, 0.4), (0.01, 0.3, 0.69))
    rows += made_up("none", (0.01, 0.03, 0.96), (0.97, 0.02, 0.01))
    table = PowerTable(tuple(rows), ("d",), 0)
    assert [table["d", 100, "update", name].value for name in (NAMED, WRONG)] == [0.25, 0.25]
    assert [table["d", 100, "update", f"named, BF > {factor}"].value for factor in (3, 10, 30)] == [0.25, 0.25, 0.25]
    assert table["d", 100, "update", "P(update)"].value == pytest.approx(0.52)
    assert table.sentences() == ["with d 100 trials name an update in 25 % of observers (3 to 72 %), and wrongly in 1 of 2 others"]
    with pytest.raises(InputError, match="nothing counted"):
        table["d", 100, "update", "luck"]


def test_whole_studies_name_what_single_subjects_cannot():
    rows = made_up("update", *[(0.02, 0.08, 0.9)] * 16) + made_up("none", *[(0.4, 0.3, 0.3)] * 5)
    found = {(row.observers, row.subjects): row for row in power_of_studies(PowerTable(tuple(rows), ("d",), 0), (4, 8, 16))}
    assert list(found) == [("update", 4), ("update", 8), ("update", 16), ("none", 4)]
    assert [row.studies for row in found.values()] == [4, 2, 1, 1]
    assert (found["update", 16].named, found["none", 4].named, found["update", 16].another_named) == (1.0, 0.0, 0.0)
    protected = random_effects([row.log_evidence for row in rows[:8]]).protected
    assert found["update", 8].named == float(protected[2] > 0.95)


def test_a_mixed_population_names_its_most_frequent_kind():
    rows = made_up("none", *[(0.98, 0.01, 0.01)] * 40) + made_up("update", *[(0.01, 0.01, 0.98)] * 160)
    table = PowerTable(tuple(rows), ("d",), 0)
    found = power_of_studies(table, (10, 20), {"none": 0.1, "update": 0.9})
    ten, twenty = (row for row in found if row.observers == "mixed")
    assert 15 < ten.studies <= 20  # until one kind has no subject left
    assert (twenty.subjects, twenty.another_named) == (20, 0.0)
    assert twenty.named > 0.8
    assert found.sentences()[-1].startswith("with d and 100 trials each, the most frequent kind of the mixed population is named in")
    assert power_of_studies(table, (10, 20)).rows == found.rows[:4]


def test_withheld_evidence_is_counted_as_not_named_and_said():
    rows = [*made_up("update", (0.01, 0.01, 0.98)), DataSet("d", 100, "update 2", "update", None, None, None)]
    table = PowerTable(tuple(rows), ("d",), 0)
    assert table["d", 100, "update", NAMED].value == 0.5
    assert table["d", 100, "update", "evidence withheld"].value == 0.5


def test_intervals_of_shares_cover():
    rng, hits = np.random.default_rng(0), 0
    for found in rng.binomial(20, 0.35, 2000):
        _, low, high = share(int(found), 20)
        hits += low <= 0.35 <= high
    assert 0.91 < hits / 2000 < 0.99  # 0.93 by the exact sum: counts are whole numbers


def test_the_command(tmp_path, designs):
    designs["paper"].save(tmp_path / "design.csv")
    asked = ("power", "design.csv", "--trials", "130,65", "--data-sets", "1", "-o", "out", "--seed", "1", "--workers", "1")
    done = inside(*asked, cwd=tmp_path)
    assert (done.returncode, done.stderr) == (0, "")
    assert "with these pairs 65 trials name an update in" in done.stdout
    assert sorted(path.name for path in (tmp_path / "out").glob("power*")) == [
        "power.csv",
        "power.pdf",
        "power.png",
        "power_data_sets.csv",
        "power_subjects.csv",
    ]
    table, sets = (pd.read_csv(tmp_path / "out" / name) for name in ("power.csv", "power_data_sets.csv"))
    assert (set(table.trials), len(sets), list(sets.columns[:4])) == ({65, 130}, 6, ["design", "trials", "observer", "kind"])
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
    done = inside("power", *more, "-o", "out", cwd=tmp_path)
    assert done.returncode == 2
    assert done.stderr.startswith(said)
    assert done.stderr.count("\n") == 1
    assert not (tmp_path / "out").exists()
