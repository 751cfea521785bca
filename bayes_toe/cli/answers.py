"""The answer on the terminal: a table, what needs action, then the study in a few sentences."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

from bayes_toe.answers.order_effect import OrderEffect, Size, format_percent, format_share
from bayes_toe.answers.study_summary import (
    FEWEST_FOR_GROUP,
    describe_pair,
    frequency_line,
    study_lines,
)
from bayes_toe.answers.words import Word
from bayes_toe.cli.headline import needs_action
from bayes_toe.cli.terminal import OUTPUT, Terminal, chosen, once

if TYPE_CHECKING:
    from bayes_toe.answers.serial_dependence import SerialDependence
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
        "PSE shift, %": _estimate(answer, "constant_error", "pse_shift_percent", _bare_percent),
        "contraction p": _estimate(answer, "contraction", "contraction_p", format_share),
    }


def _estimate(answer: OrderEffect, question: str, size: str, form: Callable[[Size], str]) -> str:
    """A size with its interval; '-' where there is probably nothing to measure."""
    word = answer.words[question]
    if word in _WITHOUT_SIZE or word is Word.NOT_INTERPRETABLE:
        return "-"
    return form(answer.sizes[size])


def _bare_percent(size: Size) -> str:
    """A size in per cent for a column that names the unit."""
    return format_percent(size).replace(" %", "")


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


def say_histories(out: Terminal, table: SerialDependence, file: str) -> None:
    """Both answers over the study in a line each, then every subject in a row."""
    for line in table.sentence().split("; "):
        out.answer([line])
    rows: list[dict[Any, Any]] = []
    for row in table:
        rho, kappa = (_interval(size) for size in (row.rho, row.kappa))
        cells = {
            "subject": row.subject,
            "carry-over": row.word("carry_over") or "-",
            "rho [95 %]": rho,
            "previous response": row.word("previous_response") or "-",
            "kappa [95 %]": kappa,
        }
        rows.append(cells)
    out.table("serial dependence", rows, file=file)
    out.footnote(
        "rho: share of the stimuli of a trial that is carried over to the next. kappa: effect of "
        "the previous response; above 0 it is repeated, below 0 alternated.",
    )
    out.notes((f"{row.subject}: {row.note}" for row in table if not row.is_known), file=file)


def _interval(size: tuple[float, ...]) -> str:
    """A median with its interval, two digits."""
    if not size:
        return "-"
    low, median, high = size
    return f"{median:.2f} [{low:.2f}, {high:.2f}]"
