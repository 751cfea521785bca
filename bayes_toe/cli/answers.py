"""The answer on the screen: a table of subjects, what needs action, then the study."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING

from bayes_toe.answers.order_effect import (
    MISFIT_FLAG,
    PRIOR_FLAG,
    QUESTIONS,
    OrderEffect,
    Problem,
    Size,
    format_percent,
    format_share,
)
from bayes_toe.answers.study_summary import describe_pair, study_lines
from bayes_toe.answers.words import Word
from bayes_toe.cli.headline import needs_action
from bayes_toe.cli.terminal import (
    MANY_SUBJECTS,
    OUTPUT,
    Terminal,
    chosen,
    command_lines,
    is_narrow,
    typed_command,
)
from bayes_toe.data.messages import capitalized, join_words, listed

if TYPE_CHECKING:
    from bayes_toe.data.study import Study

_HEADINGS = (
    "subject",
    "order\neffect",
    "constant\nerror",
    "contraction",
    "PSE shift, %\n[95 % interval]",
    "contraction p\n[95 % int.]",
)
#: Words without a size in the table.
_WITHOUT_SIZE = (Word.NO, Word.PROBABLY_NOT, Word.CANNOT_BE_TOLD)
_MOST_EXCLUDED = 5  # names of subjects that are not counted


def print_subjects(out: Terminal, answers: Sequence[OrderEffect], file: str = OUTPUT) -> None:
    """A row for every subject, the reasons of `(a)`, and what needs action."""
    by_name = {answer.subject: answer for answer in answers}
    names = chosen(by_name, {answer.subject for answer in answers if needs_action(answer)})
    letters = reason_letters([by_name[name] for name in names])
    rows = [subject_row(by_name[name], letters) for name in names]
    longest = max((len(row[0]) for row in rows), default=0)
    for long, short in ((", ", ","), ("probably not", "prob. not")):
        if not is_narrow(_HEADINGS, rows, max(longest, len(_HEADINGS[0]))):
            for row in rows:
                row[1:] = [cell.replace(long, short) for cell in row[1:]]
    if rows:
        out.table(_HEADINGS, rows)
    for reason, letter in letters.items():
        out.line(f"{letter} Cannot be told, because {reason}.", indent=4)
    n_others = len(answers) - len(names)
    if n_others:
        others = f"The other {n_others:,} subjects need no" if names else "No subject needs"
        out.line()
        out.line(f"{others} action. All {len(answers):,} subjects: {file}")
    print_problems(out, answers, file)


def subject_row(answer: OrderEffect, letters: Mapping[str, str]) -> list[str]:
    """The conclusion of a subject as a row of the table."""
    mark = "!" if needs_action(answer) else "?" if answer.depends_on_prior else ""
    name = f"{answer.subject} {mark}".rstrip()
    if not answer.is_interpretable:
        return [name, f"not interpreted: {answer.flags[0]}"]
    cells = [name]
    for question in QUESTIONS:
        word = answer.words[question]
        letter = letters.get(answer.reasons.get(question, ""), "")
        cells.append(letter or str(word.value))
    reasons = {answer.reasons.get(question) for question in QUESTIONS}
    if len(reasons) == 1 and answer.reasons:
        return [name, f"cannot be told {cells[1]}"]
    shift = _estimate(answer, "constant_error", "pse_shift_percent", _bare_percent)
    contraction = _estimate(answer, "contraction", "contraction_p", format_share)
    return [*cells, shift, contraction]


def reason_letters(answers: Sequence[OrderEffect]) -> dict[str, str]:
    """A letter for each reason why a question cannot be told: (a), (b)."""
    reasons = dict[str, None]()
    for answer in answers:
        if answer.is_interpretable:
            reasons |= dict.fromkeys(answer.reasons.values())
    return {reason: f"({chr(ord('a') + i)})" for i, reason in enumerate(reasons)}


def _estimate(answer: OrderEffect, question: str, size: str, form: Callable[[Size], str]) -> str:
    """A size with its interval; '-' if the question has no size."""
    if answer.words[question] in _WITHOUT_SIZE:
        return "-"
    return form(answer.sizes[size])


def _bare_percent(size: Size) -> str:
    """A size in per cent for a column that names the unit."""
    return format_percent(size, "")


def print_problems(out: Terminal, answers: Sequence[OrderEffect], file: str = OUTPUT) -> None:
    """What needs action, with what to type; then what depends on the prior, and the rest."""
    by_mark: dict[str, list[tuple[str, str, str]]] = {"!": [], "?": [], "-": []}
    marked = {answer.subject: _marked_problems(answer) for answer in answers}
    options = list[str]()  # the first of each subject
    for problems in marked.values():
        options += [problem.option for _, problem in problems if problem.option][:1]
    for subject, problems in marked.items():
        for mark, problem in problems:
            option = problem.option
            if option and len(options) == 1:
                option = f"{typed_command()} {option}"
            message = problem.message
            if mark == "?" and len(answers) >= MANY_SUBJECTS:
                message = "A prior half or twice as wide moves a probability past .25 or .75."
            by_mark[mark].append((subject, message, option))
    for mark, notes in by_mark.items():
        out.notes(notes, mark, file=file)
        if mark == "!" and len(options) > 1:
            out.line("To apply all of these, type:")
            out.lines(command_lines(f"{typed_command()} {' '.join(options)}", "  "))


def _marked_problems(answer: OrderEffect) -> list[tuple[str, Problem]]:
    """The problems of a subject with their marks; only the first if it is not interpreted."""
    if not answer.is_interpretable:
        return [("!", problem) for problem in answer.problems[:1]]
    marked = []
    for flag, problem in zip(answer.flags, answer.problems, strict=True):
        message = problem.message
        if flag == MISFIT_FLAG and answer.worst_pairs:
            message += f" Worst pair: {describe_pair(answer.worst_pairs[0])}."
        mark = "-"
        if flag.startswith(PRIOR_FLAG):
            mark = "?"
        elif problem.option or flag == MISFIT_FLAG:
            mark = "!"
        marked.append((mark, Problem(message, problem.option)))
    return marked


def print_answer(
    out: Terminal,
    answers: Sequence[OrderEffect],
    study: Study,
    group: Sequence[str] = (),
    closing: Sequence[str] = (),
) -> None:
    """The answer of a study: counts, directions, the group, and what is not counted."""
    units = study.conditions is not None
    lines = study_lines(answers, synthetic=study.synthetic, units=units)
    lines += group
    for answer in answers:
        for note in answer.notes:
            line = f"{capitalized(note)}."
            if note not in answer.reasons.values() and line not in lines:
                lines.append(line)
    out.answer([*lines, " ".join([*not_counted(answers), *closing])])


def without_decision(answers: Sequence[OrderEffect], problems: Mapping[str, str]) -> list[str]:
    """A sentence that no subject needs a decision; empty if one does, or has another problem."""
    if len(answers) == 1 or problems or any(needs_action(answer) for answer in answers):
        return []
    return ["No subject needs a decision."]


def not_counted(answers: Sequence[OrderEffect]) -> list[str]:
    """A sentence that names the subjects that are not counted; empty if all are."""
    names = [answer.subject for answer in answers if not answer.is_interpretable]
    if not names or len(answers) == 1:
        return []
    if len(names) > _MOST_EXCLUDED:
        return [f"{listed(names, _MOST_EXCLUDED)} are not counted."]
    verb = "is" if len(names) == 1 else "are"
    return [f"{join_words(names)} {verb} not counted."]
