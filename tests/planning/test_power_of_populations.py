"""Power of the analysis of groups: whose studies are simulated, what counts as found, and that the command writes and says it."""

import numpy as np
import pandas as pd
import pytest
from commands import inside
from populations import made_up

import bayes_toe as bt
from bayes_toe.errors import InputError
from bayes_toe.groups.asymmetries import asymmetries
from bayes_toe.planning.observers import observers_from
from bayes_toe.planning.power_of_studies import (
    ON_AVERAGE,
    REVERSED,
    SOMEWHERE,
    AnalysedStudy,
    PopulationPower,
    asymmetry_of,
    comparisons,
    outside_band,
    planned_studies,
)
from bayes_toe.planning.study_design import StudyDesign, paper_study_design


def analysed(kind, *found, subjects=8):
    """Studies of which (probability of direction, found in some pair) is known, by subjects whose asymmetry is negative."""
    return [AnalysedStudy("d", 100, subjects, kind, p, -0.1, some, (0.1,) * 5, warned=p == 0.5) for p, some in found]


def test_counts():
    rows = analysed("none", (0.5, False), (0.99, True)) + analysed("update", (0.01, True), (0.03, True), (0.98, False), (0.5, False))
    table = PopulationPower(tuple(rows), 1, {})
    counted = {name: table.counted["d", "update", 8, name].value for name in (ON_AVERAGE, REVERSED, SOMEWHERE, "analysed with warnings")}
    assert counted == {ON_AVERAGE: 0.5, REVERSED: 0.25, SOMEWHERE: 0.5, "analysed with warnings": 0.25}
    assert ("d", "none", 8, REVERSED) not in table.counted
    assert table.sentences() == [
        "with d and 100 trials each, population shows an order effect of subjects who update in 50 % of studies with 8 subjects (of 4), "
        "and wrongly of others in 1 of 2"
    ]


def test_many_pairs_are_no_more_chances():
    """Columns without effect: 0 is outside of the band in 5 % of posteriors about estimates that scatter by chance, as their sd says."""
    rng, hits = np.random.default_rng(2), 0
    for _ in range(400):
        hits += outside_band(rng.standard_normal(12) + rng.standard_normal((1000, 12)))
    assert 0.02 < hits / 400 < 0.09  # 99.9 % of 400 with a rate of 0.05


def test_smaller_studies_are_parts_of_larger_ones_and_no_subject_is_in_two_of_a_size():
    planned = list(planned_studies(observers_from(None, 9, seed=1), [2, 4], {}, 1))
    assert [(one.kind, len(one.people)) for one in planned[:4]] == [("none", 2), ("none", 2), ("none", 4), ("none", 4)]
    assert len({one.name for one in planned}) == len(planned) == 12
    small, large = (planned[i].people for i in (1, 3))
    assert small == large[:2]
    assert not set(map(id, planned[2].people)) & set(map(id, large))


def test_studies_of_a_mixed_population_have_about_its_shares_and_no_subject_twice():
    people, shares = observers_from(None, 600, seed=1), {"none": 0.2, "constant error": 0.2, "update": 0.6}
    large = [one.people for one in planned_studies(people, [3, 12], shares, 1) if one.kind == "mixed" and len(one.people) == 12]
    kinds = [one.kind for study in large for one in study]
    assert len(large) == 50
    assert len({one.name for study in large for one in study}) == 600
    assert kinds.count("update") / 600 == pytest.approx(0.6, abs=3.3 * np.sqrt(0.24 / 600))  # false alarm 1 in 1,000
    small = next(one.people for one in planned_studies(people, [3, 12], shares, 1) if one.kind == "mixed")
    assert small == large[0][:3]


def test_asymmetries_of_observers_have_the_sign_of_the_populations():
    pairs = comparisons(StudyDesign([0.0, 0.5, 0.5], [0.3, 0.2, 0.5], [1, 1, 1]))
    assert pairs.tolist() == [[0.0, 0.3], [0.2, 0.5]]
    none, _, update = observers_from(None, 1, seed=1)
    assert asymmetry_of(none, pairs) == pytest.approx(0.0, abs=1e-12)
    given = [update.quantities[name] for name in ("mu1", "sigma_p", "sigma_l", "q0")]
    strong_first = bt.model.equal_probability(np.array([0.3, 0.5]), np.array([0.0, 0.2]), *given).mean()
    weak_first = bt.model.equal_probability(np.array([0.0, 0.2]), np.array([0.3, 0.5]), *given).mean()
    assert asymmetry_of(update, pairs) == pytest.approx(strong_first - weak_first, rel=1e-9)


def test_pairs_may_be_asked_for_that_nobody_met_in_both_orders():
    design = paper_study_design()
    found = made_up(bt.Study([design.answered(design.n_trials // 2, name) for name in "AB"]))
    assert np.array_equal(asymmetries(found, comparisons(design)).draws, found.asymmetries.draws)  # all were met in both
    further = asymmetries(found, np.array([[0.1, 0.6]]))
    assert further.comparisons[1:] == ("P(equal) 0.6 then 0.1 less 0.1 then 0.6",)


def test_the_command(tmp_path):
    (tmp_path / "some.toml").write_text("[update]\npull = 0.3\nmu1 = 0.3\nwidth = 0.3\nq0 = 0.9\n", encoding="utf-8")
    asked = (
        "power",
        "--observers",
        "some.toml",
        "--trials",
        "20000",
        "--subjects",
        "1,2",
        "--data-sets",
        "1",
        "--seed",
        "1",
        "--workers",
        "1",
    )
    # of so many trials the analysis takes 3 seconds, of few 8
    done = inside(*asked, "--population", "--studies", "1", "-o", "out", cwd=tmp_path)
    assert (done.returncode, done.stderr) == (0, "")
    assert "and 20000 trials each, population shows an order effect of subjects who update in" in " ".join(done.stdout.split())
    table = pd.read_csv(tmp_path / "out" / "power_population.csv")
    assert (set(table.subjects), set(table.studies), set(table.observers)) == ({2}, {1}, {"update"})
    assert table.set_index("quantity").value["90 % width of pull at the means"] > 0.0
    assert not (tmp_path / "out.partial").exists()


def test_refusals():
    with pytest.raises(InputError, match=r"studies=1, subjects=\[1\]: allowed is at least 1 study of at least 2 subjects"):
        bt.power_of_populations(subjects=[1], studies=1)
