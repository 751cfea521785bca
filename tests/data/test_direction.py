"""Which stimulus came first, and which answer is 'second': read, or asked in one line."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from commands import output_of, run_command
from conftest import each_row, problems, refused, typed_lines, typed_options
from numpy.random import default_rng

import bayes_toe as bt
from bayes_toe.data.responses import direction
from bayes_toe.data.tasks import WHICH_STRONGER


def made_up_trials(n=240, constant_error=0.1):
    """Trials of one observer with a standard of 0 and a comparison, in random order.

    The second stimulus is chosen where it seems stronger. An observer without a constant error
    would respond by the difference alone.
    """
    rng = default_rng(8)
    table = pd.DataFrame({"subject": "P1", "standard": np.zeros(n)})
    table["comparison"] = rng.choice([-0.3, -0.2, -0.1, 0.1, 0.2, 0.3], n)
    table["first"] = rng.choice(["standard", "comparison"], n)
    difference = np.where(table["first"] == "standard", table.comparison, -table.comparison)
    table["second_is_chosen"] = difference - constant_error + rng.normal(0.0, 0.15, n) > 0.0
    return table


TRIALS = made_up_trials()
#: Whether the standard came first in a trial.
STANDARD_IS_FIRST = TRIALS["first"] == "standard"
WORDS = TRIALS.second_is_chosen.map({True: "second", False: "first"})
IN_ORDER = pd.DataFrame(
    {
        "subject": "P1",
        "s1": np.where(STANDARD_IS_FIRST, TRIALS.standard, TRIALS.comparison),
        "s2": np.where(STANDARD_IS_FIRST, TRIALS.comparison, TRIALS.standard),
        "response": WORDS,
    }
)
#: The study that is meant: all tables below have its trials in another shape.
INTENDED = bt.read_study(IN_ORDER)


#: The stimulus that was chosen in each trial.
CHOSEN_STIMULI = pd.Series(
    np.where(TRIALS.second_is_chosen == STANDARD_IS_FIRST, "comparison", "standard")
)
#: The responses by what they name: the order ('second'), or the stimulus ('comparison').
RESPONSES = {"second": WORDS, "comparison": CHOSEN_STIMULI}


def responses_with_codes(codes):
    """The responses of TRIALS by codes such as `second=j first=f`.

    With `comparison=long standard=short` they name the stimulus that was chosen.
    """
    answer, _, _ = codes.partition("=")
    return RESPONSES[answer].map(dict(code.split("=") for code in codes.split()))


def trials_with_order(column, standard_first, comparison_first, response=WORDS):
    """TRIALS with a column that has one cell where the standard came first, and another elsewhere.

    The responses are 'first' or 'second', unless `response` has other responses.
    """
    order = np.where(STANDARD_IS_FIRST, standard_first, comparison_first)
    table = TRIALS[["subject", "standard", "comparison"]]
    return table.assign(**{column: order, "response": response})


@pytest.mark.parametrize("typed", ["", "--equal-code same"])
def test_the_comparison_may_be_one_of_three_answers(typed):
    # Every fifth trial is answered 'same', and other trials by the stimulus that was chosen: 'long'
    # is the comparison. The study is the same as with the words 'second', 'first' and 'same'.
    is_second = (CHOSEN_STIMULI == "comparison") == STANDARD_IS_FIRST
    words = np.where(is_second, "second", "first")
    words[::5] = "same"
    codes = CHOSEN_STIMULI.where(words != "same", "same")
    table = trials_with_order("standard_interval", 1, 2, codes.replace("comparison", "long"))
    study = bt.read_study(table, typed_options(f"--comparison-code long {typed}"))
    assert study.frame().equals(bt.read_study(IN_ORDER.assign(response=words)).frame())


def result_of_check(folder, table, line=""):
    """The result of `check` on a table: exit code, stdout and stderr."""
    table.to_csv(folder / "study.csv", index=False)
    return run_command(f"check study.csv {line}", cwd=folder)


def is_read_as_intended(table, options=""):
    """Whether a table is read, with typed options if there are any, as the study INTENDED."""
    return bt.read_study(table, typed_options(options)).frame().equals(INTENDED.frame())


#: Name of a column, its cell where the standard was first, and its cell where the comparison was
#: first: the name and the cells say which stimulus came first.
CELLS_OF_ORDER = """
    order | standard_first | comparison_first
    order | Standard first | Test first
    order | standardFirst | comparisonFirst
    order | first_standard | first_comparison
    order | comparison second | standard second
    order | std_first | cmp_first
    order | SC | CS
    order | st | ts
    order | S-C | C-S
    order | St-Co | Co-St
    kind | standard-comparison | comparison-standard
    order | std/cmp | cmp/std
    order | standard then test | test then standard
    order | Standard zuerst | Vergleich zuerst
    first_stimulus | standard | comparison
    whichFirst | ref | test
    first | reference | comp
    second_stimulus | comparison | standard
    standard_first | True | False
    Standard First | 1 | 0
    std_first | yes | no
    isStandardFirst | TRUE | FALSE
    standard_was_shown_first | TRUE | FALSE
    comparison_first | False | True
    compFirst | 0 | 1
    standard_second | 0 | 1
    std_interval | 1 | 2
    StdPos | first | second
    interval_std | 1.0 | 2.0
    std_order | 1 | 2
    reference_position | 1st | 2nd
    comparison_interval | 2 | 1
    testPosition | second | first
"""


@each_row("column, standard_first, comparison_first", CELLS_OF_ORDER)
def test_an_order_that_says_itself_what_it_means_is_read_with_a_note(
    column, standard_first, comparison_first
):
    # Such as a column order with the cells 'standard_first' and 'comparison_first', or a column
    # std_interval with 1 and 2.
    table = trials_with_order(column, standard_first, comparison_first)
    assert is_read_as_intended(table)
    _, note, *_ = bt.read_study(table).notes
    # Whole numbers have no decimals.
    cell = standard_first.removesuffix(".0")
    assert note == f"column {column} read as the order: standard first at '{cell}'"


#: The same of columns that may say something else, with the codes of responses, and the end of the
#: options that are proposed first. Keys are in their usual order. In the last rows the column says
#: itself what it means, and the codes alone are asked for.
COLUMNS_ASKED = """
    interval | 1 | 2 | second=second first=first | --standard-interval interval
    interval | 1.0 | 2.0 | second=second first=first | --standard-interval interval
    interval | first | Second | second=second first=first | --standard-interval interval
    interval | 1st | 2nd | second=second first=first | --standard-interval interval
    interval | interval 1 | interval 2 | second=2nd first=1st | --standard-interval interval
    target_interval | 2 | 1 | second=2nd first=1st | --comparison-interval target_interval
    signal_position | second | first | second=2nd first=1st | --comparison-interval signal_position
    test_order | 2 | 1 | second=2nd first=1st | --comparison-interval test_order
    order | B | A | second=j first=f | order --standard-first-code B --second-code j
    order | 1 | 0 | second=2 first=1 | order --standard-first-code 1 --second-code 2
    order | S | C | second=m first=z | order --standard-first-code S --second-code m
    order | 2 | 1 | second=right first=left | --comparison-interval order --second-code right
    order | 2 | 1 | second=2 first=1 | --comparison-interval order --second-code 2
    order | 2.0 | 1.0 | second=2.0 first=1.0 | --comparison-interval order --second-code 2
    order | SC | CS | second=f first=j | --second-code f
    standard_interval | 1 | 2 | second=j first=f | --second-code j
    standard_interval | 1 | 2 | comparison=longer standard=shorter | --comparison-code longer
    standard_interval | 1 | 2 | comparison=1 standard=0 | --comparison-code 1
"""


@each_row("column, standard_first, comparison_first, codes, options", COLUMNS_ASKED)
def test_an_order_that_may_be_another_is_asked_for(
    column, standard_first, comparison_first, codes, options, tmp_path
):
    # Such as a column interval with 1 and 2: it does not say of which stimulus. Responses 1 and 2
    # tell whose interval it is: that with which they are not reversed.
    table = trials_with_order(column, standard_first, comparison_first, responses_with_codes(codes))
    advice, *_ = typed_lines(result_of_check(tmp_path, table).stderr)
    assert advice.endswith(options)
    assert is_read_as_intended(table, advice)


@pytest.mark.parametrize(
    "order_cells, codes, options, depends",
    [
        (["1", "2"], "second=j first=f", {"second_code": "j"}, True),
        (["1.0", "2.0"], "second=j first=f", {"second_code": "j"}, True),
        (["standard", "comparison"], "second=j first=f", {"second_code": "j"}, False),
        (["1", "2"], "second=second first=first", {}, False),
    ],
)
def test_a_note_says_where_the_sign_depends_on_options(order_cells, codes, options, depends):
    # Only options say which stimulus was in interval 1, and which response f means.
    table = trials_with_order("order", *order_cells, responses_with_codes(codes))
    study = bt.read_study(table, bt.ReadOptions(standard_interval="order", **options))
    assert ("opposite sign" in " ".join(study.notes)) == depends


@pytest.mark.parametrize("second_onset, is_read", [(1.7, True), (0.51, True), (0.5, False)])
def test_onsets_of_a_standard_and_a_comparison_are_their_order(second_onset, is_read):
    # The onset of the first stimulus is 0.5. Equal onsets say no order. No other column says which
    # stimulus came first.
    table = trials_with_order("order", "1", "2")
    is_standard_first = table.pop("order") == "1"
    table["std.started"] = np.where(is_standard_first, 0.5, second_onset)
    table["cmp.started"] = np.where(is_standard_first, second_onset, 0.5)
    if is_read:
        assert is_read_as_intended(table)
        assert "columns std.started, cmp.started read as onsets" in bt.read_study(table).notes
    else:
        with refused("do not say which stimulus came first"):
            bt.read_study(table)


#: Name and cells, as in CELLS_OF_ORDER, of a column beside two columns of stimuli, and the names of
#: these columns, which do not say that a stimulus came first.
LABELS = """
    presentation_order | 1-2 | 2-1 | stim1 | stim2
    swapped | 0 | 1 | stim1 | stim2
    flipped | no | yes | s1 | s2
    order_of_presentation | AB | BA | sA | sB
    first_hand | left | right | left | right
"""


@each_row("column, standard_first, comparison_first, name_1, name_2", LABELS)
def test_an_order_beside_labels_is_asked_for(
    column, standard_first, comparison_first, name_1, name_2, tmp_path
):
    # The stimuli have two names, such as stim1 and stim2, and a response is one of these names. A
    # column says which stimulus came first, such as swapped with 0 and 1: 0 where stim1 came first.
    table = trials_with_order(column, standard_first, comparison_first, CHOSEN_STIMULI)
    table = table.replace({"response": {"standard": name_1, "comparison": name_2}})
    table.columns = ["subject", name_1, name_2, column, "response"]
    advice, *_ = typed_lines(result_of_check(tmp_path, table).stderr)
    assert f"{column} --columns standard={name_1},comparison={name_2}" in advice
    assert is_read_as_intended(table, advice)


@pytest.mark.parametrize(
    "order", [np.where(STANDARD_IS_FIRST, "AB", "BA"), ["AB"] * 120 + ["BA"] * 120]
)
def test_an_order_that_follows_from_the_stimuli_or_the_block_is_none(order):
    # The stimuli s1 and s2 say their order themselves, so that a column order has something else.
    assert is_read_as_intended(IN_ORDER.assign(order=order))


#: Name and cells, as in CELLS_OF_ORDER, of a column that may have something else than the order, so
#: that no options are proposed for it.
NOT_SAID = """
    std_stim | 1 | 2
    std1 | 1 | 0
    standard_second | 1 | 2
    standard_position | left | right
    target_first | False | True
    resp_standard_first | 1 | 0
    std_onset | 1 | 2
    Std | 1 | 1
    std_interval | 1 | 1
"""


@each_row("column, standard_first, comparison_first", NOT_SAID)
def test_a_column_that_may_have_something_else_is_not_read_as_the_order(
    column, standard_first, comparison_first, tmp_path
):
    # Such as std_onset with 1 and 2, which are times, or std_interval with 1 alone.
    result = result_of_check(tmp_path, trials_with_order(column, standard_first, comparison_first))
    assert "do not say which stimulus came first" in result.stderr


def test_two_columns_of_the_order_are_read_if_they_agree(tmp_path):
    table = trials_with_order("std_interval", "1", "2").assign(
        order=np.where(STANDARD_IS_FIRST, "SC", "CS")
    )
    assert is_read_as_intended(table)
    # A column order that contradicts the column std_interval is refused, with options to type.
    contradicting_table = table.assign(order=np.where(STANDARD_IS_FIRST, "CS", "SC"))
    assert typed_lines(result_of_check(tmp_path, contradicting_table).stderr)


#: Names of a standard and of a comparison in other languages and programs.
STIMULI = """
    estandar | comparacion
    patr\u00f3n | comparaci\u00f3n
    standard | confronto
    campione | confronto
    \u00e9talon | comparaison
    standaard | vergelijking
    Referenz | Vergleich
    values.standard | values.comparison
    Std | Probe
"""


@each_row("standard, comparison", STIMULI)
def test_a_standard_and_a_comparison_have_names_of_many_languages(standard, comparison):
    # The names of both columns of stimuli, such as Referenz and Vergleich.
    table = trials_with_order("values.order", "1", "2")
    table = table.rename(columns={"standard": standard, "comparison": comparison})
    assert is_read_as_intended(table, "--standard-interval values.order")


@pytest.mark.parametrize("columns", ["", "--columns s1=standard,s2=peso"])
def test_a_standard_beside_an_order_is_not_read_as_the_first_stimulus(columns, tmp_path):
    # Peso (weight) is a comparison that is not known by its name, so that its place in the advice
    # is NAME. To call the standard s1 would be wrong in half of the trials.
    table = trials_with_order("ordine", "1", "2").rename(columns={"comparison": "peso"})
    result = result_of_check(tmp_path, table, columns)
    assert "do not say which stimulus came first" in result.stderr
    advice, *_ = typed_lines(result.stderr)
    assert advice == "--standard-interval ordine --columns comparison=NAME"
    assert is_read_as_intended(table, advice.replace("NAME", "peso"))


def test_the_responses_of_e_prime_are_read_without_those_of_practice():
    # Beside the responses Probe.RESP, E-Prime has their accuracy, the correct response, the time,
    # and the responses of practice.
    table = IN_ORDER.rename(columns={"response": "Probe.RESP"})
    other_columns = {
        "Probe.ACC": "1",
        "Probe.CRESP": "first",
        "Probe.RT": 400,
        "PracProbe.RESP": "first",
    }
    assert is_read_as_intended(table.assign(**other_columns))


#: Name and cells, as in CELLS_OF_ORDER, of a column, and the options with which it is read. The
#: column may hold the interval of the comparison, or the order of blocks. A name is no proof where
#: cells, a code or both options say more.
READ = """
    block | SC | CS | --standard-interval block
    order | 2 | 1 | --comparison-interval order
    target_interval | second | first | --comparison-interval target_interval
    testInterval | 2 | 1 | --comparison-interval testInterval
    signal_position | 2 | 1 | --comparison-interval signal_position
    testInterval | 2 | 1 | --standard-interval testInterval --comparison-interval testInterval
    testInterval | 1 | 2 | --standard-interval testInterval --standard-first-code 1
    test_position | standard_first | comparison_first | --standard-interval test_position
    standard_interval | 1 | 2 | --comparison-interval standard_interval --standard-first-code 1
"""


@each_row("column, standard_first, comparison_first, options", READ)
def test_an_interval_is_read_with_options(column, standard_first, comparison_first, options):
    # Such as a column order with 2 and 1 and --comparison-interval order: the comparison was in
    # interval 2 where the standard came first.
    table = trials_with_order(column, standard_first, comparison_first)
    assert is_read_as_intended(table, options)
    assert f"first at '{standard_first}'" in bt.read_study(table, typed_options(options)).notes[1]


#: A column, an option that contradicts its name, and the message that refuses the option.
CONTRADICTIONS = """
    comparison_interval | --standard-interval | but named as that of the comparison
    target_interval | --standard-interval | but named as that of the comparison
    testInterval | --standard-interval | but named as that of the comparison
    signal_position | --standard-interval | but named as that of the comparison
    standard_interval | --comparison-interval | named as that of the standard
"""


@each_row("column, option, message", CONTRADICTIONS)
def test_an_interval_whose_name_says_otherwise_is_asked_for(column, option, message):
    # Such as --standard-interval target_interval.
    with refused(message):
        bt.read_study(trials_with_order(column, "1", "2"), typed_options(f"{option} {column}"))


#: Name and cells, as in CELLS_OF_ORDER, of a column whose cells may mean either order. There is one
#: question, which of the cells means that the standard was first.
UNCERTAIN = """
    interval | True | False
    order | 0 | 1
    order | 1 | 0
    interval | left | right
    order | L | R
    order | A | B
    interval | -1 | 1
    interval | 0.5 | 1
    order | sc1 | x7
    position | standard | other
"""


@each_row("column, standard_first, comparison_first", UNCERTAIN)
def test_codes_that_may_mean_either_are_one_question(
    column, standard_first, comparison_first, tmp_path
):
    # Such as left and right: the question is which of both codes means that the standard was first.
    table = trials_with_order(column, standard_first, comparison_first)
    options = f"--standard-interval {column}"
    result = result_of_check(tmp_path, table, options)
    codes = {f"--standard-first-code {code}" for code in (standard_first, comparison_first)}
    assert set(typed_lines(result.stderr)) == codes
    assert is_read_as_intended(table, f"{options} --standard-first-code {standard_first}")


def test_more_codes_than_two_are_refused_by_value():
    # Three of 240 rows have another code than 1 and 2. A frame's rows have the names of its index.
    table = trials_with_order("interval", "1", "2")
    table.loc[[3, 7, 9], "interval"] = ["3", "x", "3"]
    problem_of_3, problem_of_x = problems(
        bt.read_study, table, bt.ReadOptions(standard_interval="interval")
    )
    message = "column interval: found '3' in 2 rows, the first is row 3, allowed: 1 or 2"
    assert message in problem_of_3
    assert "row 7, column interval: found 'x', allowed: 1 or 2, the interval" in problem_of_x


def test_an_order_that_only_one_file_has_needs_no_other_code():
    """Each file is a block with one order, and has one of the two codes."""
    files = [part for _, part in trials_with_order("order", "A", "B").groupby("order")]
    assert is_read_as_intended(files, "--standard-interval order --standard-first-code A")


#: Codes of the responses, and options that read them beside a column `standard_interval`.
CODES = """
    second=j first=f | --second-code j
    second=j first=f | --first-code f
    second=2 first=1 | --second-code 2
    comparison=longer standard=shorter | --comparison-code longer
    comparison=comparison standard=standard |
    comparison=Test standard=Reference |
    comparison=cmp standard=std |
    comparison=1 standard=0 | --comparison-code 1
"""


@each_row("codes, options", CODES)
def test_one_code_of_the_responses_is_enough_with_a_standard(codes, options):
    # Such as responses j (second) and f (first) with --second-code j, or words that need no option.
    table = trials_with_order("standard_interval", "1", "2", responses_with_codes(codes))
    assert is_read_as_intended(table, f"--standard-interval standard_interval {options}")


def test_of_several_other_codes_one_is_asked_for(tmp_path):
    # Responses are j (second), f (first), and x in one row.
    table = trials_with_order(
        "standard_interval", "1", "2", responses_with_codes("second=j first=f")
    )
    table.loc[5, "response"] = "x"
    options = "--standard-interval standard_interval --second-code j"
    result = result_of_check(tmp_path, table, options)
    assert "Which of them is 'first'?" in result.stderr
    assert typed_lines(result.stderr)[0].startswith("--first-code f")


def test_a_code_that_no_response_has_is_refused(tmp_path):
    # Responses are j and f. Without a code to propose, there is no line to type.
    table = trials_with_order("order", "SC", "CS", responses_with_codes("second=j first=f"))
    result = result_of_check(tmp_path, table, "--standard-interval order --second-code x")
    assert "None of them is the code that was given." in result.stderr
    assert typed_lines(result.stderr) == []


def test_a_standard_that_is_always_first_needs_no_column():
    # Only the trials in which the standard came first are in the table.
    table = trials_with_order("interval", "1", "2")[STANDARD_IS_FIRST]
    always_first = bt.read_study(table, bt.ReadOptions(standard_first=True))
    by_column = bt.read_study(table, bt.ReadOptions(standard_interval="interval"))
    assert always_first.frame().equals(by_column.frame())


#: Cells of a column x (12: 1 where the standard was first, 2 where the comparison was; none where
#: the file has s1 and s2), codes that are reversed under the options, and what is typed.
REVERSED = """
    | second=first first=second |  | --second-code first --first-code second
    | second=s1 first=s2 |  | --second-code s1 --first-code s2
    | second=-1 first=1 | --second-code 1 | --second-code -1 --first-code 1
    | second=-1 first=1 | --second-code 1 --first-code -1 | --second-code -1 --first-code 1
    12 | comparison=n standard=y | --comparison-code y | --comparison-code n
    21 | second=2 first=1 | --second-code 2 | --comparison-interval x --second-code 1 --first-code 2
"""


@each_row("order, codes, options, expected", REVERSED)
def test_the_advice_for_reversed_answers_works_when_it_is_typed(
    order, codes, options, expected, tmp_path
):
    # With the options of the first command, the answers fall with s2 - s1. The advice `expected`
    # has to be typed in addition. An order '12' stands for a column x with 1 where the standard was
    # first, and 2 elsewhere; without an order the table has s1 and s2.
    table = IN_ORDER.assign(response=responses_with_codes(codes))
    if order:
        standard, comparison = order
        table = trials_with_order("x", standard, comparison, responses_with_codes(codes))
        options = f"--standard-interval x {options}"
    result = result_of_check(tmp_path, table, options)
    assert "found 'second' less often" in result.stderr
    lines = typed_lines(result.stderr)
    assert " ".join(lines) == expected
    for line in lines:
        output_of(result_of_check(tmp_path, table, f"{options} {line}"))


def test_the_other_stimulus_of_an_interval_is_proposed_before_codes_of_words(tmp_path):
    # The column order has the interval of the standard, so that with --comparison-interval all
    # answers are reversed.
    table = trials_with_order("order", "1", "2")
    result = result_of_check(tmp_path, table, "--comparison-interval order")
    advice, *_ = typed_lines(result.stderr)
    assert advice == "--standard-interval order"
    assert "if it says the interval of the standard, in place of what" in result.stderr
    assert is_read_as_intended(table, advice)


def subjects_with_slope(n_subjects, slope, n=40):
    """Subjects whose P(second) rises with s2 - s1, or falls where the slope is negative."""
    levels = np.array([-0.3, -0.2, -0.1, 0.1, 0.2, 0.3])
    n_yes = np.rint(n / (1.0 + np.exp(-slope * levels))).astype(int)
    counts = 0.0 * levels, levels, n_yes, np.full(6, n)
    names = [f"{slope} {i}" for i in range(n_subjects)]
    return [bt.Subject(name, *counts, task=WHICH_STRONGER) for name in names]


@pytest.mark.parametrize(
    "n_reversed, n_straight, slope, expected",
    [
        (1, 0, 6.0, -1),
        (13, 0, 6.0, -1),
        (40, 0, 1.0, -1),
        (3, 10, 6.0, 0),
        (7, 6, 6.0, 0),
        (12, 1, 6.0, 0),
        (0, 13, 6.0, 1),
    ],
)
def test_a_whole_study_is_reversed_if_all_subjects_are(n_reversed, n_straight, slope, expected):
    """The direction of a study is -1 if it is reversed, 1 if it is not, and 0 if it is not clear.

    P(second) falls with s2 - s1 in `n_reversed` subjects, and rises in `n_straight` subjects.
    """
    subjects = subjects_with_slope(n_reversed, -slope) + subjects_with_slope(n_straight, slope)
    assert direction(bt.Study(subjects)) == expected


def test_a_file_of_one_reversed_subject_is_read_beside_that_of_another():
    """By itself, the file of the reversed subject would be refused as a reversed study."""
    # Names of subjects are their slopes and numbers.
    files = [bt.Study(subjects_with_slope(1, slope)).frame() for slope in (6.0, -6.0)]
    assert bt.read_study(files).names == ("6.0 0", "-6.0 0")


@pytest.mark.parametrize("n_subjects", [1, 12, 40])
def test_subjects_who_guess_are_no_reversed_study(n_subjects):
    """Responses by chance look reversed in one study of three million."""
    rng = default_rng(n_subjects)
    subjects = subjects_with_slope(n_subjects, 6.0, n=20)
    for _ in range(50):
        guesses = rng.binomial(20, 0.5, (n_subjects, 6))  # 'second' in 20 trials of each of 6 pairs
        guessing = [replace(s, n_yes=n_yes) for s, n_yes in zip(subjects, guesses, strict=True)]
        assert direction(bt.Study(guessing)) == 0


OUTCOME = (IN_ORDER.s2 > IN_ORDER.s1) == TRIALS.second_is_chosen
#: Columns that look like a condition by name, and whether they are offered as a condition.
CONDITIONS = {
    "right or wrong": (OUTCOME.map({True: "correct", False: "wrong"}), False),
    "side of the answer": (TRIALS.second_is_chosen.map({True: "left", False: "right"}), False),
    "name of the pair": (IN_ORDER.s1.astype(str) + "_" + IN_ORDER.s2.astype(str), False),
    "a text for each trial": (IN_ORDER.index.map("t{}".format), False),
    "blocks": (IN_ORDER.index // 60 % 2, True),
    "right or wrong in half": (OUTCOME.where(IN_ORDER.index < 120, "none"), False),
}


@pytest.mark.parametrize("name", CONDITIONS)
def test_what_follows_from_stimuli_and_answers_is_offered_as_no_condition(name, tmp_path):
    # Such as a column of right and wrong answers. A column that follows from the answers in the
    # first half of the trials alone is no condition either, because one of its levels, 'wrong', is
    # rare.
    column, is_offered = CONDITIONS[name]
    result = result_of_check(tmp_path, IN_ORDER.assign(cue=column))
    assert ("--condition cue" in result.stdout) == is_offered


#: Names of columns beside the stimuli, and the columns that are read from them.
PSYCHOPY = """
    key_resp.keys trials.thisN | response trial
    key_resp.keys practice_trials.thisN trials.thisN | response trial
    key_resp.keys blocks.thisN main.thisN | response trial
    key_resp.keys inner.thisN outer.thisN | response
    key_resp_2.keys key_resp_2.rt | response
"""


@each_row("names, expected", PSYCHOPY)
def test_columns_of_psychopy_are_read_where_one_is_similar(names, expected):
    # Such as the columns key_resp.keys and trials.thisN, which are read as response and trial.
    response, *other_names = names.split()
    table = IN_ORDER.rename(columns={"response": response})
    for name in other_names:
        table[name] = np.arange(len(table))
    study = bt.read_study(table)
    assert " ".join(study.reading.read) == f"subject s1 s2 {expected}"
    assert study.frame().equals(INTENDED.frame())


def test_all_that_is_missing_is_asked_at_once(tmp_path):
    """Columns, order and codes are missing. The first line answers all questions."""
    table = trials_with_order(
        "Reihenfolge", "1", "2", responses_with_codes("second=j first=f")
    ).rename(columns={"standard": "amp_std", "comparison": "amp_cmp", "response": "Taste"})
    result = result_of_check(tmp_path, table)
    assert result.stderr.count("error:") == 2
    first_line, *other_lines = typed_lines(result.stderr)
    assert first_line == "--standard-interval Reihenfolge --second-code j"
    assert result_of_check(tmp_path, table, first_line).returncode == 0
    for line in other_lines:  # Each line leads to the next question, or to a screen.
        assert "found together" not in result_of_check(tmp_path, table, line).stderr
