"""The bundled study: 16 synthetic subjects in the paper's design, with the parameters that made them.

Both files were written once by `bayes-toe simulate` with the options that :data:`COMMAND` states. The paper's own data are not
public.
"""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import AbstractContextManager
from importlib.resources import as_file, files
from pathlib import Path
from typing import TypeAlias

from bayes_toe.data.number_table import read_numbers
from bayes_toe.data.read_study import read_study
from bayes_toe.data.study import Study

#: What made the bundled files.
COMMAND = "bayes-toe simulate -o example_study.csv --truth example_truth.csv --subjects 16 --batches 50 --seed 2604"
#: True natural parameters by subject.
Truth: TypeAlias = Mapping[str, Mapping[str, float]]
_NATURAL = ("mu1", "sigma_p", "sigma_l", "q0")


def example_study() -> Study:
    """The bundled synthetic study.

    Examples
    --------
    >>> study = example_study()
    >>> len(study), study.synthetic, study.subjects[0].total_trials
    (16, True, 650)
    """
    with _file("example_study.csv") as path:
        study = read_study(path)
    return Study(study.subjects, "bundled example (synthetic)", synthetic=True, notes=study.notes)


def example_truth() -> Truth:
    """True natural parameters of the bundled study, by subject.

    Examples
    --------
    >>> sorted(example_truth()["S01"])
    ['mu1', 'q0', 'sigma_l', 'sigma_p']
    """
    with _file("example_truth.csv") as path:
        names, columns = read_numbers(path, _NATURAL, key="subject")
    return {name: {key: float(values[row]) for key, values in columns.items()} for row, name in enumerate(names)}


def _file(name: str) -> AbstractContextManager[Path]:
    return as_file(files("bayes_toe.data") / name)
