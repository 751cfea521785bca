"""The answer of a study on the screen: a table of subjects, their problems, and the conclusion.

`print_subjects` prints the table and the problems, `print_answer` the conclusion. Reports use
`flagged` too.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Collection, Iterable, Mapping, Sequence
from typing import TypeAlias

from bayes_toe.answers.order_effect import (
    MISFIT_FLAG,
    PRIOR_FLAG,
    SIZE_OF,
    OrderEffect,
)
from bayes_toe.answers.study_summary import describe_pair, study_lines
from bayes_toe.cli.terminal import (
    MANY_SUBJECTS,
    Terminal,
    command_lines,
    is_narrow,
    names_to_show,
    repeated_command,
    with_options,
)
from bayes_toe.data.messages import Texts, capitalized, join_names
from bayes_toe.data.study import Study

OrderEffects: TypeAlias = Sequence[OrderEffect]
_HEADINGS = (
    "subject",
    "order\neffect",
    "constant\nerror",
    "contraction",
    "PSE shift, {unit}\n[95 % interval]",
    "contraction, %\n[95 % interval]",
)


# --- What screens and report share ---------------------------------------------------------------


def flagged(answers: Iterable[OrderEffect], not_converged: Collection[str] = ()) -> list[str]:
    """Subjects that need action: those with the mark '!', and those in `not_converged`.

    `not_converged` has the subjects whose draws did not converge.
    """
    names = []
    for answer in answers:
        if answer.mark == "!" or answer.subject in not_converged:
            names.append(answer.subject)
    return names


# --- The screen ----------------------------------------------------------------------------------


def print_subjects(out: Terminal, answers: OrderEffects, file: str) -> None:
    """Print the table of subjects, the reasons of '(a)' in it, and the problems.

    If the subjects are many, only subjects that need action have a row. `file` has all subjects.
    """
    names = names_to_show([answer.subject for answer in answers], flagged(answers))
    selected_answers = [answer for answer in answers if answer.subject in names]
    letters = reason_letters(selected_answers)
    rows = [subject_row(answer, letters) for answer in selected_answers]
    if rows:
        _print_rows(out, rows, answers[0].unit.difference_unit)  # all subjects have one unit
    for reason, letter in letters.items():
        out.line(f"{letter} Cannot be told, because {reason}.", indent=4)

    n_others = len(answers) - len(rows)
    if n_others:
        needs = f"The other {n_others:,} subjects need no" if rows else "No subject needs"
        out.line()
        out.line(f"{needs} action. All {len(answers):,} subjects: {file}")
    print_problems(out, answers, file)


def _print_rows(out: Terminal, rows: list[list[str]], unit: str) -> None:
    """Print the table of subjects; if it is too wide, its cells get shorter words.

    `unit` is the unit of differences between stimuli.
    """
    headings = [heading.format(unit=unit) for heading in _HEADINGS]
    # Words are shortened before a name is cut, because two names may be the same once cut.
    name_width = max(len(row[0]) for row in (headings, *rows))
    # Intervals lose their space first, '[8, 16]' -> '[8,16]', and then words are shortened.
    for text, shorter_text in ((", ", ","), ("probably not", "prob. not")):
        if is_narrow(headings, rows, name_width):
            break
        for row in rows:
            row[1:] = [cell.replace(text, shorter_text) for cell in row[1:]]  # all but the name
    out.table(headings, rows)


def subject_row(answer: OrderEffect, letters: Mapping[str, str]) -> list[str]:
    """The conclusion of a subject as a row of the table: the words, then the sizes.

    If the subject is not interpreted, or no question can be told, all for the same reason, a single
    cell says so. `letters` has the letter, such as '(a)', of each reason why a question cannot be
    told.
    """
    name = f"{answer.subject} {answer.mark}".rstrip()
    if not answer.is_interpretable:
        return [name, f"not interpreted: {answer.flags[0]}"]
    reasons = {line.reason for line in answer.lines.values()}  # '' if a question can be told
    if len(reasons) == 1 and "" not in reasons:
        return [name, f"cannot be told {letters[reasons.pop()]}"]

    cells = [name]
    for question, line in answer.lines.items():
        cells.append(letters.get(line.reason) or str(answer.words[question]))
    # The headings have the units: '+12 dB [8, 16]' -> '+12 [8, 16]'.
    unit = f" {answer.unit.difference_unit}"
    for question in SIZE_OF:
        size = answer.lines[question].size
        cells.append(size.replace(unit, "").replace(" %", "") or "-")
    return cells


def reason_letters(answers: Iterable[OrderEffect]) -> dict[str, str]:
    """A letter for each reason why a question cannot be told, as in {'no equal pairs': '(a)'}."""
    letters: dict[str, str] = {}
    for answer in answers:
        if answer.is_interpretable:
            for reason in answer.reasons.values():
                letters.setdefault(reason, f"({chr(ord('a') + len(letters))})")
    return letters


def print_problems(out: Terminal, answers: OrderEffects, file: str) -> None:
    """Print problems by mark: '!' needs action, '?' depends on the prior, '-' is a note.

    An option such as '--exclude A08' stands below its problem. If only one subject has options, the
    whole command stands there in place of the option. If several subjects have options, a command
    with the first option of each of these subjects follows the '!' notes.
    """
    problems_by_subject = {answer.subject: _marked_problems(answer) for answer in answers}
    # At most one option of each subject, because the first option may settle other problems, too.
    first_options = []
    for problems in problems_by_subject.values():
        first_options += [option for _, _, option in problems if option][:1]

    command = repeated_command()
    notes_by_mark = defaultdict(list)
    for subject, problems in problems_by_subject.items():
        for mark, message, option in problems:
            if option and len(first_options) == 1:  # the only subject with options
                option = with_options(command, [option])
            # The same text for all subjects, so that the notes of many subjects become one note.
            if mark == "?" and len(answers) >= MANY_SUBJECTS:
                message = "With another prior width, a 'yes' or a 'no' becomes undecided."
            notes_by_mark[mark].append((subject, message, option))

    for mark in "!?-":
        out.notes(notes_by_mark[mark], mark, file=file)
        if mark == "!" and len(first_options) > 1:
            out.line("To apply all of these, type:")
            out.lines(command_lines(with_options(command, first_options), start="  "))


def _marked_problems(answer: OrderEffect) -> list[tuple[str, str, str]]:
    """Mark, message and option of each problem, such as ('!', 'The model does not fit.', '').

    If a subject is not interpreted, only the problem that forbids the interpretation is returned.
    """
    if not answer.is_interpretable:
        problem = answer.problems[answer.flags[0]]
        return [("!", problem.message, problem.option)]
    marked = []
    for flag, problem in answer.problems.items():
        message = problem.message
        if flag == MISFIT_FLAG and answer.worst_pairs:
            message += f" {describe_pair(answer.worst_pairs[0], answer.unit)}"
        if flag.startswith(PRIOR_FLAG):
            mark = "?"
        elif problem.option or flag == MISFIT_FLAG:
            mark = "!"
        else:
            mark = "-"
        marked.append((mark, message, problem.option))
    return marked


def print_answer(
    out: Terminal,
    answers: OrderEffects,
    study: Study,
    problems: Collection[str],
    group_lines: Texts = (),
    closing: Texts = (),
) -> None:
    """Print the answer of a study: counts, directions, the group, and what is not counted.

    `problems` has the subjects without a result, or without enough draws. `group_lines` are the
    conclusions on group and conditions, and `closing` has the last sentences of the last line.
    """
    lines = [*answer_lines(study, answers), *group_lines]
    for answer in answers:
        # The table has the reasons already, each with its letter.
        notes = [note for note in answer.notes if note not in answer.reasons.values()]
        lines += [f"{capitalized(note)}." for note in notes]
    last_line = [*not_counted(answers), *without_decision(answers, problems), *closing]
    # A dict has each line once, because many subjects have the same note.
    out.answer([*dict.fromkeys(lines), " ".join(last_line)])


def answer_lines(study: Study, answers: OrderEffects) -> list[str]:
    """The sentences of the answer of a study: counts and directions for each question."""
    return study_lines(
        answers, synthetic=study.synthetic, by_condition=study.conditions is not None
    )


def without_decision(answers: OrderEffects, problems: Collection[str]) -> list[str]:
    """A list with the sentence that no subject needs a decision.

    The list is empty if a subject needs a decision, if there are `problems`, and in a study of a
    single subject.
    """
    if len(answers) == 1 or problems or flagged(answers):
        return []
    return ["No subject needs a decision."]


def not_counted(answers: OrderEffects) -> list[str]:
    """A list with the sentence that names the subjects that the answer does not count.

    The list is empty if the answer counts all subjects. It is also empty in a study of a single
    subject, whose answer says itself that the subject is not interpreted.
    """
    names = [answer.subject for answer in answers if not answer.is_interpretable]
    if not names or len(answers) == 1:
        return []
    return [f"The answer does not count {join_names(names, max_items=5)}."]
