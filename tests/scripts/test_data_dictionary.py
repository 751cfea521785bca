"""docs/data_dictionary.md has every column that is written, as it is declared."""

import data_dictionary
import pandas as pd
import pytest
from commands import good
from populations import made_result
from reference.calibration import calibrate

import bayes_toe as bt
from bayes_toe.design.power import group_power

DOCUMENT = data_dictionary.OUTPUT.read_text(encoding="utf-8")
REFERENCE = {
    section.partition("\n")[0]: data_dictionary.words(section)
    for section in DOCUMENT.split(data_dictionary.SECTION)[1:]
}
#: Columns that not every file of the kind has.
AT_TIMES = {"condition"}


@pytest.fixture(scope="module")
def written(analysis, small_study, tmp_path_factory):
    """By file, the columns of one that is made as its command makes it."""
    folder = tmp_path_factory.mktemp("dictionary")
    options = "--task same/different --subjects 1 --seed 1"
    good(f"simulate -o study.csv --truth truth.csv {options}", cwd=folder)
    verdicts = calibrate(studies=1, data_sets=1, seed=3, workers=1)
    group, asymmetry = made_result(small_study), bt.asymmetry(small_study)
    return {
        "summary.csv": analysis.summary(),
        "evidence.csv": analysis.evidence.frame(full=True),
        "fit.csv": bt.fit(small_study, replicates=20, seed=1, workers=1).frame(full=True),
        "asymmetry.csv": asymmetry.frame(full=True),
        "population.csv": group.summary(),
        "population_subjects.csv": group.subject_table.frame(),
        "study.csv": pd.read_csv(folder / "study.csv"),
        "truth.csv": pd.read_csv(folder / "truth.csv"),
        "calibration.csv": verdicts.rank_verdicts,
        "calibration_ranks.csv": verdicts.ranks,
        "evidence_calibration.csv": verdicts.evidence_verdicts,
        "evidence_data_sets.csv": verdicts.data_sets,
        "posterior.nc, group sample_stats": [*analysis.draws.group("sample_stats").data_vars],
        **planned(folder),
    }


def planned(folder):
    """Those of commands that plan a study."""
    table = bt.design.power(trials=[26], data_sets=1, seed=1, workers=1)
    (folder / "design.csv").write_text("s1,s2,n_trials\n0,0.3,2\n0.3,0,2\n", encoding="utf-8")
    good("design design.csv --list trials.csv --blocks 1 --seed 1", cwd=folder)
    return {
        "power.csv": table.frame(),
        "power_data_sets.csv": table.data_sets_frame(),
        "power_groups.csv": group_power(table, [2]).frame(),
        "design.csv": pd.read_csv(folder / "design.csv"),
        "trials.csv": pd.read_csv(folder / "trials.csv"),
    }


def test_the_document_is_as_declared():
    """Otherwise: python scripts/data_dictionary.py."""
    assert data_dictionary.updated(DOCUMENT) == DOCUMENT


def test_every_column_that_is_written_is_in_it(written):
    assert data_dictionary.FILES.keys() <= REFERENCE.keys()
    undeclared = REFERENCE.keys() - written.keys()
    assert undeclared == {"contrast.csv", "history.csv"}  # whose frames have declared columns
    for name, columns in written.items():
        assert {*columns} - REFERENCE[name].keys() == set(), name
        assert REFERENCE[name].keys() - {*columns} - AT_TIMES == set(), name
