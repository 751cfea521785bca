"""The answer on the terminal: a table, what needs action, then the study in a few sentences."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from bayes_toe.answers.order_effect import OrderEffect, Size
from bayes_toe.answers.study_summary import (
    FEWEST_FOR_GROUP,
    describe_pair,
    frequency_line,
    study_lines,
)
from bayes_toe.answers.verdict_words import Word
from bayes_toe.cli.headline import needs_action, p_value
from bayes_toe.cli.terminal import OUTPUT, Terminal, chosen, number, once
from bayes_toe.comparison.history import QUANTITIES

if TYPE_CHECKING:
    from bayes_toe.comparison.history import HistoryTable
    from bayes_toe.data.study import Study

#: Words whose size is not shown: there is probably nothing to measure.
_WITHOUT_SIZE = (Word.NO, Word.PROBABLY_NOT, Word.CANNOT_BE_TOLD)


def say_answers(
    out: Terminal, answers: Sequence[OrderEffect], study: Study, file: str = OUTPUT
) -> None:
    """A row for every subject, what needs action, and the answer of the study."""
    if not answers:
        return
    by_name = {answer.subject: answer for answer in answers}
    acting = {answer.subject for answer in answers if needs_action(answer)}
    rows = [_cells(by_name[name]) for name in chosen(by_name, acting)]
    out.table("order effect of every subject", rows, total=len(answers), file=file)
    out.footnote("Estimates are medians with 95 % intervals. !: not interpreted or a poor fit.")
    out.notes(_actions(answers), "action", "red", file=file)
    out.notes(
        once((answer.subject, note) for answer in answers for note in answer.notes), file=file
    )
    units = study.conditions is not None
    lines = study_lines(answers, synthetic=study.synthetic, units=units)
    if len(answers) < FEWEST_FOR_GROUP and not units:
        lines.append(frequency_line(answers))
    out.answer([f"answer: {lines[0]}", *filter(None, lines[1:])])


def _cells(answer: OrderEffect) -> dict[Any, Any]:
    """An answer as a row of a table."""
    mark = " !" if needs_action(answer) else ""
    dependent = " ?" if answer.depends_on_prior else ""
    return {
        "subject": f"{answer.subject}{mark}{dependent}",
        "order effect": answer.words["order_effect"].value,
        "constant error": answer.words["constant_error"].value,
        "contraction": answer.word("contraction"),
        "PSE shift, %": _estimate(answer, "constant_error", "pse_shift_percent", "+.2g"),
        "contraction p": _estimate(answer, "contraction", "contraction_p", ".2f"),
    }


def _estimate(answer: OrderEffect, question: str, size: str, form: str) -> str:
    """A size with its interval; '-' where there is probably nothing to measure."""
    word = answer.words[question]
    if word in _WITHOUT_SIZE or word is Word.NOT_INTERPRETABLE:
        return "-"
    estimate: Size = answer.sizes[size]
    ends = f"{estimate.q025:{form}}, {estimate.q975:{form}}"
    return f"{estimate.q50:{form}} [{ends}]".replace("0.", ".")


def _actions(answers: Sequence[OrderEffect]) -> list[str]:
    """What stands against answers, and what to do about it."""
    lines = []
    for answer in answers:
        if not needs_action(answer):
            continue
        text = f"{answer.subject}: {'; '.join(answer.flags)}"
        if answer.worst_pairs:
            text += f" ({', '.join(map(describe_pair, answer.worst_pairs))})"
        if answer.options:
            text += f"; run again with {' '.join(answer.options)}"
        lines.append(text)
    return lines


def say_histories(out: Terminal, table: HistoryTable, file: str) -> None:
    """In one line how many subjects' answers follow the trials before, then each subject in a row."""
    out.answer([f"trials before: {table.sentence()}"])
    rows: list[dict[Any, Any]] = [
        {
            "subject": one.subject,
            "follows": one.depends or "-",
            "P(static)": number(one.p_static),
            "log BF": number(one.log_bayes_factor_history, 1),
            "answer before": number(one.log_bayes_factor_previous_answer, 1),
            "median (5 %, 95 %)": f"{QUANTITIES[one.parameter]} {one.q50:.2g} ({one.q05:.2g}, {one.q95:.2g})"
            if one.parameter
            else one.note,
            **{
                head: "-" if p != p else p_value(p)
                for head, p in (("p static", one.history_p_static), ("p with", one.history_p))
            },
        }
        for one in table
    ]
    out.table("what a trial leaves to the next", rows, file=file)
    out.footnote(
        "P(static): nothing is left of the trials before, among models with a pull. log BF: of any history, and of a bias by the answer "
        "before, natural logs. p: of the answers by the trial before, without and with a history.",
    )
