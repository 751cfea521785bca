"""The small files beside a study: pairs, designs, populations and covariates.

All of them are read by the strict reader of studies.
"""

import re

import pytest
from conftest import each_row, problems

from bayes_toe.data.covariates import read_covariates
from bayes_toe.data.tasks import SAME_DIFFERENT
from bayes_toe.design.simulate import make_design, read_observers
from bayes_toe.design.study_design import read_study_design


def stimuli_of_design(path):
    """The stimuli s1 and s2 of the pairs of a design, read from its file."""
    design = make_design(str(path), 1)
    return {"s1": design.s1.tolist(), "s2": design.s2.tolist()}


def parameters_by_observer(path):
    """The parameters of each observer of a population by its name, read from its file."""
    observers = read_observers(str(path), SAME_DIFFERENT)
    return {observer.name: list(observer.parameters.values()) for observer in observers}


READERS = {
    "design": stimuli_of_design,
    "study design": read_study_design,
    "population": parameters_by_observer,
    "covariates": read_covariates,
}


@pytest.fixture
def file_of(tmp_path):
    """A function that writes a text into a file and returns its path."""

    def write(text):
        path = tmp_path / "file.csv"
        path.write_text(text, encoding="utf-8")
        return path

    return write


def test_a_design_is_read_and_other_columns_are_ignored_even_if_two_have_one_name(file_of):
    text = "note,s1,s2,note\n,0,0.25,a\n?,0.5,-0.125,inf\n,0.75,0.5,c\n"
    assert stimuli_of_design(file_of(text)) == {"s1": [0.0, 0.5, 0.75], "s2": [0.25, -0.125, 0.5]}


def test_a_population_is_read_by_names_which_are_texts(file_of):
    # The parameters are mu1, sigma_p, sigma_l and q0; the comma behind the last makes no column.
    text = "subject,mu1,sigma_p,sigma_l,q0,\n01,-0.5,0.25,0.125,0.75\nNA,0.5,1.25,0.5,0.875\n"
    observers = {"01": [-0.5, 0.25, 0.125, 0.75], "NA": [0.5, 1.25, 0.5, 0.875]}
    assert parameters_by_observer(file_of(text)) == observers


#: A kind of file, its rows, and the first problem. If rows have one cell too many, readers that
#: guess take the first column for an index, and shift all other columns in silence.
REFUSED = """
    design | s1,s2 / 0,1 / / 0 | row 4: found 1 cell, allowed: 2 cells as in the header
    design | s1,s2 / 0,1,7 | row 2: found 3 cells below 2 names, allowed: a name for each column
    design | s1,s2 / 0,1 / 0,1,7 | row 3: found 3 cells, allowed: 2 cells as in the header
    design | s1,s2 / 0,1 / ,1 | row 3, column s1: found '', allowed: a finite number
    design | s1,s2 / 0,1 / nan,1 | row 3, column s1: found 'nan', allowed: a finite number
    design | s1,s2 / 0,1 / 1e400,1 | row 3, column s1: found '1e400', allowed: a finite number
    design | s1,s2 / 0,1 / 1_0,1 | row 3, column s1: found '1_0', allowed: a finite number
    design | s1,s2 / "1,5",1 | row 2, column s1: found '1,5', allowed: a finite number, with a d
    design | s1,s2,s1 / 0,1,0 | row 1, column s1: found 2 columns of this name, allowed: one
    design | s2,x / 1,0 | row 1, column s1: missing, found 's2', 'x', allowed: a column of this name
    study design | s1,s2 / 0,0 | row 1, column n_trials: missing
    study design | s1,s2,n_trials / 0,0,2.5 | row 2, column n_trials: found '2.5', allowed: a whole
    study design | s1,s2,n_trials / 0,0,0 | row 2, column n_trials: found '0', allowed: a whole num
    study design | s1,s2,n_trials / 0,x,1 | row 2, column s2: found 'x', allowed: a finite number
    population | subject,mu1,sigma_p,sigma_l,q0 / a,0,1 | row 2: found 3 cells, allowed: 5 cells as
    population | subject,mu1,sigma_p,sigma_l,q0 / a,0,1,,1 | row 2, column sigma_l: found '', allowe
    population | subject,mu1,sigma_p,sigma_l,q0 / a,0,1,nan,1 | row 2, column sigma_l: found 'nan'
    population | subject,mu1,sigma_p,sigma_l,q0 / a,0,1,1_0,1 | row 2, column sigma_l: found '1_0'
    population | subject,mu1,sigma_p,q0,q0 / a,0,1,1,1 | row 1, column q0: found 2 columns of this n
    population | subject,mu1,sigma_p,sigma_l,q0 / a,0,1,1,.9 / ,0,1,1,.9 | row 3, column subject: fo
    population | subject,mu1,sigma_p,sigma_l,q0 / a,0,1,1,.9 / a,0,1,1,.9 | row 3, column subject: f
    covariates | subject,age / a,23 / a,24 | row 3, column subject: found 'a', allowed: each name on
    covariates | subject,age / a,23 / ,24 | row 3, column subject: found '', allowed: a text that is
    covariates | subject,x / a,3 /b | row 3: found 1 cell, allowed: 2 cells as in the header. Delete
    covariates | subject,age / a,23 / b,2O / c,31 | row 3, column age: found '2O', allowed: a finite
    covariates | subject,age / a,23 / b,inf / c,31 | row 3, column age: found 'inf'
    covariates | subject,100% sure / a,x / b,y / c,3 | row 2, column 100% sure: found 'x', allowed:
    covariates | name,age / a,23 | row 1, column subject: missing, found 'name', 'age', allowed: a
    covariates | subject / a | row 1: found columns 'subject', allowed: subject and a covariate
    covariates | subject,age,age / a,1,2 | row 1, column age: found 2 columns of this name, allowed:
"""


@each_row("kind, rows, problem", REFUSED)
def test_a_small_table_that_cannot_be_used_is_refused(file_of, kind, rows, problem):
    # A slash stands for a line end. In the design 's1,s2 / 0,1,7', the third cell of row 2 has no
    # name.
    first_problem, *_ = problems(READERS[kind], file_of(re.sub(" ?/ ?", "\n", rows)))
    assert first_problem.startswith(f"file.csv: {problem}")


#: Texts of files of covariates, and the covariates that are read: for each covariate, a value by
#: subject. 'NA' is no value, but a name like any other name.
COVARIATES = {
    "subject,age\nNA,20\n01,23\n02,NA\n\n03,31.5\n04,40\n": {
        "age": {"NA": 20.0, "01": 23.0, "03": 31.5, "04": 40.0}
    },
    "subject,gender,site\n01,f,1\n02,m,2\n": {
        "gender": {"01": "f", "02": "m"},
        "site": {"01": 1.0, "02": 2.0},
    },
    "\ufeffsubject;age\n01;23,5\n1,5;41\n": {"age": {"01": 23.5, "1,5": 41.0}},
    "subject,site,dose\n01,north,1\n02,NA,1\n03,west,x\n04,south,\n": {
        "site": {"01": "north", "03": "west", "04": "south"},
        "dose": {"01": "1", "02": "1", "03": "x"},
    },
}


@pytest.mark.parametrize("text", COVARIATES)
def test_covariates_are_numbers_or_levels_and_missing_ones_are_left_out(file_of, text):
    # The values of a covariate are floats if all of them are numbers. A subject without a value is
    # left out.
    assert read_covariates(file_of(text)) == COVARIATES[text]
