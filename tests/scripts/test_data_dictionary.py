"""docs/data_dictionary.md has every column that is written, as it is declared."""

import data_dictionary
import pytest
from populations import made_result

import bayes_toe as bt

DOCUMENT = data_dictionary.OUTPUT.read_text(encoding="utf-8")
#: By file, the meanings of its columns in the document.
REFERENCE = {
    section.partition("\n")[0]: data_dictionary.words(section)
    for section in DOCUMENT.split(data_dictionary.SECTION)[1:]
}
#: Columns that not every file of the kind has.
AT_TIMES = {"condition"}


@pytest.fixture(scope="module")
def written(analysis, small_study):
    """By file, the table that its command writes, or the columns of it."""
    group = made_result(small_study)
    asymmetry = bt.asymmetry(small_study)
    fits = bt.fit(small_study, replicates=5, seed=1)
    power = bt.design.power(trials=[26], observers="none", data_sets=1, seed=1)
    return {
        "summary.csv": analysis.summary(),
        "evidence.csv": analysis.evidence.frame(full=True),
        "fit.csv": fits.frame(full=True),
        "asymmetry.csv": asymmetry.frame(full=True),
        "population.csv": group.summary(),
        "population_subjects.csv": group.subject_table,
        "power.csv": power.frame(),
        "posterior.nc, group sample_stats": list(analysis.draws.group("sample_stats").data_vars),
    }


def test_the_document_is_as_declared():
    """Otherwise: python scripts/data_dictionary.py."""
    assert data_dictionary.updated(DOCUMENT) == DOCUMENT
    assert data_dictionary.FILES.keys() <= REFERENCE.keys()


def test_the_document_has_every_column_that_is_written_and_no_other(written):
    for name, columns in written.items():
        documented = REFERENCE[name].keys()
        assert documented >= set(columns), name
        assert set(columns) >= documented - AT_TIMES, name
