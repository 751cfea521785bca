"""The screens as texts: a table of subjects with all its marks, and no line over 80 columns."""

import re
from dataclasses import replace
from itertools import product

import numpy as np
import pandas as pd
import pytest
from commands import on_one_line, run_command, run_ok
from conftest import WORD_BY_LETTER, leave_pictures_blank, made_subject, order_answer
from populations import independent_draws, two_conditions

import bayes_toe as bt
from bayes_toe.answers.order_effect import (
    MISFIT_FLAG,
    PRIOR_FLAG,
    Problem,
    Size,
)
from bayes_toe.checks.identification import ONE_FIRST_STIMULUS
from bayes_toe.cli.answer_screen import print_answer, print_subjects
from bayes_toe.cli.check_screen import describe_pairs
from bayes_toe.cli.group_screen import print_contrast
from bayes_toe.cli.terminal import WIDTH, Terminal, cell_width
from bayes_toe.inference.goodness_of_fit import PairResidual

NO_SIZE = (0, 0, 0)


def conclusion(name, letters, shift=NO_SIZE, p=NO_SIZE, flag="", problem=""):
    """The answer of a subject whose words have these letters, with sizes and perhaps a flag.

    The letters 'yun', for example, are 'yes', 'undecided' and 'no' for order effect, constant error
    and contraction; WORD_BY_LETTER has all letters. `shift` and `p` are the lower end, the median
    and the upper end of the PSE shift and of the contraction.
    """
    fields = {"sizes": {"pse_shift_percent": Size(*shift), "contraction_p": Size(*p)}}
    _, median_p, _ = p
    if median_p < 0:
        fields["direction"] = "repulsion"
    if flag:
        fields["problems"] = {flag: problem}
    if flag == MISFIT_FLAG:
        fields |= {"fit_p": 0.001, "worst_pairs": (PairResidual(0.0, 0.3, 0.9, 0.4),)}
    if letters[2] == "c":
        fields["reasons"] = {"contraction": ONE_FIRST_STIMULUS}
    return order_answer(name, [WORD_BY_LETTER[letter] for letter in letters], **fields)


MISFIT = Problem("The model does not fit.")
NARROWER = Problem(
    "A prior of the constant error half as wide changes constant error from 'no' to 'undecided'."
)
SWAP = Problem("Responses look swapped in blocks 2 and 4.", "--swap A08:2,4")
ANSWERS = [
    conclusion("A01", "yyy", (8.2, 11.7, 16.1), (0.2, 0.29, 0.36)),
    conclusion("A02", "yyn", (18, 23, 29), NO_SIZE, MISFIT_FLAG, MISFIT),
    conclusion(
        "A03", "yny", NO_SIZE, (-0.38, -0.35, -0.28), f"{PRIOR_FLAG}: constant error", NARROWER
    ),
    conclusion("A04", "yyp", (-14, -9.4, -5.2), (0.03, 0.17, 0.3)),
    conclusion("A05", "puc", (-1.1, 4.0, 8.4)),
    conclusion("A06", "uuu", (-3.1, 2.9, 9.3), (-0.001, 0.1, 0.24)),
    conclusion("A07", "qqq"),
    conclusion("A08", "xxx", flag="responses look swapped", problem=SWAP),
]
SCREEN = """
        order        constant                  PSE shift, %      contraction, %
subject effect       error        contraction  [95 % interval]   [95 % interval]
A01     yes          yes          yes          +12 [+8, +16]     29 [20, 36]
A02 !   yes          yes          no           +23 [+18, +29]    -
A03 ?   yes          no           yes          -                 -35 [-38, -28]
A04     yes          yes          probably     -9 [-14, -5]      17 [3, 30]
A05     probably     undecided    (a)          +4.0 [-1.1, +8.4] -
A06     undecided    undecided    undecided    +2.9 [-3.1, +9.3] 10 [-0.1, 24]
A07     probably not probably not probably not -                 -
A08 !   not interpreted: responses look swapped
(a) Cannot be told, because the first stimulus is always the same, so a
    contraction looks like a constant error.

! A02  The model does not fit. For (s1, s2) = (0, 0.3), 90 % of the responses
       are 'equal', and the model expects 40 %.
! A08  Responses look swapped in blocks 2 and 4.
       type: bayes-toe run study.csv -o results --overwrite --swap A08:2,4

? A03  A prior of the constant error half as wide changes constant error from
       'no' to 'undecided'.

Answer
In most subjects (4 of 7) the order changes the response, and probably in 1
more. The first stimulus is overestimated in 2 subjects and underestimated in 1.
The first stimulus is remembered as nearer to the mean in 1 subject and as
farther from the mean in 1.
Order effect: 4 of 7 subjects yes, 1 probably, 1 undecided, 1 probably not.
Constant error: 3 yes, 2 undecided, 1 probably not, 1 no.
Contraction: 2 yes (1 contraction, 1 repulsion), 1 probably (contraction), 1
undecided, 1 probably not, 1 no, 1 cannot be told.
The model does not fit 1 subject: A02. By chance, 5 % of sound studies have a
poor fit.
In the group of 7, the mean PSE shift is +5 % [-3, +13].
The answer does not count A08. Start with results/report.html. Seed 1.
"""


def test_the_screen_of_run_is_this_text(capsys, monkeypatch):
    # The command that is proposed for A08 repeats what was typed.
    typed_words = ["run", "study.csv", "-o", "results"]
    monkeypatch.setattr("bayes_toe.cli.terminal.TYPED_WORDS", typed_words)
    out = Terminal()
    print_subjects(out, ANSWERS, "results/report.html")
    group_lines = ["In the group of 7, the mean PSE shift is +5 % [-3, +13]."]
    closing = ["Start with results/report.html.", "Seed 1."]
    # Any study will do that is not synthetic and has no conditions. The answer says nothing else
    # about it.
    study = bt.Study([made_subject("0 0.3 2 5")])
    print_answer(out, ANSWERS, study, {}, group_lines, closing)
    assert capsys.readouterr().out == SCREEN


@pytest.mark.parametrize(
    "s1, s2, text",
    # First the pairs (0, 0), (1, 1) and (0, 1). Then (0, 1) and (0, 2), each in both orders.
    [
        ([0, 1, 0], [0, 1, 1], "2 equal ones, and 1 different one in one order only"),
        ([0, 1, 0, 2], [1, 0, 2, 0], "2 different ones, each in both orders"),
    ],
)
def test_pairs_are_counted_whatever_their_order(s1, s2, text):
    for stimuli in ((s1, s2), (s2, s1)):
        subject = bt.Subject("A", *stimuli, [2] * len(s1), [4] * len(s1))
        assert describe_pairs(bt.Study([subject])) == f"Pairs: {text}"


# --- Every command --------------------------------------------------------------------------------

#: Neighbours among four levels, in both orders.
PAIRS = [(0.0, 0.3), (0.3, 0.0), (0.3, 0.6), (0.6, 0.3), (0.6, 0.9), (0.9, 0.6)]
LONG_NAME = "subject with a rather long name"
#: A command and its arguments, as typed after `bayes-toe`, for each screen.
COMMANDS = {
    "check": "trials.csv",
    "check --prior": "default trials.csv",
    "run": "trials.csv -o out --draws 100 --figures none --seed 1",
    "evidence": "trials.csv -o evidence.csv --seed 1",
    "sample": f"trials.csv -o draws.nc --draws 200 --exclude '{LONG_NAME}' --seed 1",
    "fit": "trials.csv -o fit.csv --replicates 5 --seed 1",
    "population": "trials.csv --draws 1600 -o group.nc --seed 1",
    "contrast": "trials.csv --condition hand -o hands.csv --seed 1",
    "history": "trials.csv -o history.csv --seed 1",
    "power": "--trials 130 --simulated 1 --observers none --seed 1",
    "design": (
        "--lowest 0 --highest 1 --step 0.25 --observers both --simulated 1 --trials 100 --seed 1"
    ),
    "design design.csv": "--list list.csv --seed 1",
    "simulate": "-o made.csv --subjects 2 --trials 26 --seed 1",
}
#: Words that no screen has, because the field has other words for the same.
FORBIDDEN = (
    r"\bpull(s|ed)?\b|\b(?<!cannot be )(told|tells?)\b|\bkept\b|\bpictures?\b|kind (is )?open|"
    r"P\(none\)|is said|has a say|not described|\brobust\b|\bverdicts?\b|free frequenc|both ways|"
    r"one peak|sloped|less H0|in the light of|(subjects?|fit) alone|\b(those|for|of) who\b|"
    r"\b0\.00\b|left out|\banswered\b"
)


@pytest.fixture(scope="module")
def screens(tmp_path_factory):
    """What each command prints, by the name of the command.

    The study has two subjects. The second has a long name, and swapped responses in block 1.
    """
    folder = tmp_path_factory.mktemp("screens")
    rng = np.random.default_rng(4)
    rows = []
    # 240 trials of each subject in 5 blocks, of observers with constant errors of .1 and 0.
    for (name, error), trial in product((("S1", 0.1), (LONG_NAME, 0.0)), range(240)):
        s1, s2 = PAIRS[rng.integers(len(PAIRS))]
        block = trial // 48
        is_swapped = name == LONG_NAME and block == 1
        is_second = (s2 - s1 - error + rng.normal(0.0, 0.2) > 0) ^ is_swapped
        response = ("first", "second")[is_second]
        hand = ("left", "right")[trial % 2]
        rows.append((name, block, trial, s1, s2, response, hand))
    columns = ["subject", "block", "trial", "s1", "s2", "response", "hand"]
    pd.DataFrame(rows, columns=columns).to_csv(folder / "trials.csv", index=False)
    texts = {}
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("bayes_toe.groups.population.sample_group", independent_draws)
        leave_pictures_blank(patch)
        for name, line in COMMANDS.items():
            result = run_command(f"{name} {line}", cwd=folder)
            assert result.returncode in (0, 3), (name, result.stderr)
            texts[name] = result.stdout
    return texts


@pytest.mark.parametrize("name", COMMANDS)
def test_screens_have_the_words_of_the_field_in_lines_of_80_columns(screens, name):
    lines = screens[name].splitlines()
    assert max(map(cell_width, lines)) <= WIDTH
    # A forbidden word is found together with the 20 characters before it.
    assert re.findall(rf".{{20}}(?:{FORBIDDEN})", on_one_line(screens[name])) == []


@pytest.mark.parametrize("name", ["check", "run", "evidence", "population", "history"])
def test_swapped_responses_are_named_with_what_to_type(screens, name):
    # Block 1 of the subject with the long name is swapped.
    text = on_one_line(screens[name])
    assert f"--swap '{LONG_NAME}:1'" in text
    assert text.index("swapped") < text.index("Answer")


def test_false_positives_are_counted_in_brackets(screens):
    # Order effect, constant error and contraction have a share each, such as ' (4 % [1, 9])'.
    assert len(re.findall(r" \(\d+ % \[", screens["power"])) == 3


@pytest.fixture(scope="module")
def contrast_table():
    """The differences between the conditions right and left of one subject, P000."""
    return bt.contrast(two_conditions(1, n_subjects=1), seed=1)


def test_a_word_that_depends_on_lapses_has_a_mark(contrast_table, capsys):
    rows = tuple(row._replace(robust="yes") for row in contrast_table)
    print_contrast(Terminal(), replace(contrast_table, rows=rows))
    text = capsys.readouterr().out
    assert re.match(r"\nsubject +right - left ", text)
    # Three quantities have a line each, and only the first line has the name.
    assert text.count("\nP000") == 1
    assert " ?\n" not in text

    # Now every word would change with another lapse rate. One quantity, the order effect, has a
    # sentence in the answer instead of a line.
    rows = tuple(row._replace(robust="no") for row in contrast_table)
    print_contrast(Terminal(), replace(contrast_table, rows=rows))
    text = capsys.readouterr().out
    assert text.count(" ?\n") == len(contrast_table.quantities) - 1
    assert "? The word changes if the lapse rate" in text


#: Counts of 'second' of a subject, whose name is to be filled in. SECOND_STRONGER has pairs in the
#: order with the stronger stimulus second, and BOTH_ORDERS has the other order, too. In REVERSED, a
#: subject responds to the pairs of BOTH_ORDERS the wrong way round.
SECOND_STRONGER = "{0},0,0.3,36,40\n{0},0.3,0.6,36,40\n{0},0.6,0.9,36,40\n"
BOTH_ORDERS = SECOND_STRONGER + "{0},0.3,0,4,40\n{0},0.6,0.3,4,40\n{0},0.9,0.6,4,40\n"
REVERSED = BOTH_ORDERS.replace(",36,", ",n,").replace(",4,", ",36,").replace(",n,", ",4,")


@pytest.fixture
def check_answer(tmp_path):
    """A function that gives the answer of `check` to rows of counts, on one line."""

    def check(rows, options=""):
        text = "subject,s1,s2,n_second,n_trials\n" + rows
        (tmp_path / "study.csv").write_text(text)
        screen = run_ok(f"check study.csv {options}", cwd=tmp_path)
        _, _, answer = screen.partition("Answer\n")
        return on_one_line(answer)

    return check


def test_subjects_whose_design_can_show_an_effect_are_counted(check_answer):
    # Subject Z has the stronger stimulus always second, and A, B and C have both orders.
    text = check_answer(SECOND_STRONGER.format("Z") + "".join(map(BOTH_ORDERS.format, "ABC")))
    effects = "a constant error (3 of 4 subjects) and a contraction (3 of 4 subjects)."
    assert text.startswith(f"The design can show {effects} Order effect, constant error and")
    assert "unequal stimuli were presented in one order only (1 of 4 subjects)." in text
    # The names z and Z look alike, so the answer refers to a problem that stands above it.
    command = "that stand above. Then type: bayes-toe run study.csv"
    assert check_answer("".join(map(BOTH_ORDERS.format, "zZ"))).endswith(command)


def test_a_decision_that_was_typed_stays_in_what_is_proposed(check_answer):
    # A and B respond by the stimuli, and C and D the wrong way round: two subjects need a decision.
    # With --swap C, this option stays in the commands that are proposed for D.
    rows = "".join([*map(BOTH_ORDERS.format, "AB"), *map(REVERSED.format, "CD")])
    command = "bayes-toe run study.csv --swap C"
    assert "2 of 4 subjects need a decision. Type one of these:" in check_answer(rows)
    proposal = "1 of 4 subjects needs a decision. Type one of these: "
    proposal += f"{command} --swap D {command} --exclude D"
    assert check_answer(rows, "--swap C").endswith(proposal)


#: Counts that fall with the distance between the stimuli, as those of 'equal' do.
SAME_OR_DIFFERENT = """subject,s1,s2,n,n_trials
A,0,0,54,60
A,0.2,0.2,54,60
A,0.4,0.4,54,60
A,0,0.2,24,60
A,0.2,0,24,60
A,0.2,0.4,24,60
A,0.4,0.2,24,60
A,0,0.4,2,60
A,0.4,0,2,60
"""


def test_where_the_task_is_another_one_nobody_is_analysed(tmp_path):
    # Counts of 'equal' are read as counts of 'second'.
    (tmp_path / "study.csv").write_text(SAME_OR_DIFFERENT)
    screen = run_ok("check study.csv --columns n_second=n", cwd=tmp_path)
    decision = "All subjects need a decision: was the task 'same or different?'"
    assert decision in on_one_line(screen)
    right_task = run_ok("check study.csv --columns n_equal=n", cwd=tmp_path)
    assert "No subject needs a decision" in right_task


def test_where_nothing_can_be_analysed_no_command_is_proposed(check_answer):
    # The only trial has only one response.
    sentence = "No subject gave both responses, so that nothing can be analysed."
    assert check_answer("A,0,0.3,1,1").endswith(sentence)
    # The only pair has equal stimuli.
    sentence = "because no pair has two different stimuli."
    assert check_answer("A,0,0,4,40").endswith(sentence)


def test_comparisons_have_a_column_of_their_own(contrast_table, capsys):
    # The table has the same rows twice, the second time for another comparison, 6 - 4.
    other_rows = [row._replace(comparison="6 - 4") for row in contrast_table]
    print_contrast(Terminal(), replace(contrast_table, rows=(*contrast_table, *other_rows)))
    text = capsys.readouterr().out
    comparisons = re.findall(r"^P000 +(\w+ - \w+) +constant error", text, re.MULTILINE)
    assert comparisons == ["right - left", "6 - 4"]
    assert "BF and word refer to a difference between any two conditions." in text
