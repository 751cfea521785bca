"""What the terminal says of order effects: the answer first, then one table, then what to do about subjects whom no model describes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from bayes_toe.cli.headline import legend, p_value
from bayes_toe.cli.terminal import OUTPUT, Terminal, chosen, number, once, safe
from bayes_toe.comparison.history import QUANTITIES
from bayes_toe.comparison.study_answer import doubts_of, of_new_subject, study_sentence, way_on
from bayes_toe.comparison.verdict import Verdict
from bayes_toe.data.messages import counted, named_few

if TYPE_CHECKING:
    from bayes_toe.comparison.history import HistoryTable
    from bayes_toe.data.study import Study


def say_verdicts(
    out: Terminal,
    verdicts: Sequence[Verdict],
    seed: int,
    study: Study,
    file: str = OUTPUT,
    *,
    followed: bool = True,
) -> None:
    """The study in a sentence, a new subject of its population, every subject in a row, and a way on where no model describes one.

    `followed`: also whose answers seem to depend on the trial before, where histories are not told.
    """
    if not verdicts:
        return
    units = study.conditions is not None
    out.answer([f"answer: {study_sentence(verdicts, synthetic=study.synthetic, units=units)}"])
    if new := of_new_subject(verdicts, seed, units=units):
        out.line(safe(new))
    looked_at = {one.subject for one in verdicts if one.fit == "not described" or one.data}
    of_subject = {one.subject: one for one in verdicts}
    rows = [_cells(of_subject[name]) for name in chosen(of_subject, looked_at)]
    out.table("order effect of every subject", rows, total=len(verdicts), file=file)
    out.footnote(f"{legend(study.task)}.")
    out.notes(
        (f"{one.subject}: {doubts_of(one)}" for one in verdicts if one.data), "data", file=file
    )
    out.notes(
        (f"{one.subject}: {way}" for one in verdicts if (way := way_on(one))),
        "look",
        "red",
        file=file,
    )
    follow = [one.subject for one in verdicts if one.follows]
    if follow and followed:
        how = f"answers of {counted(len(follow), 'subject')} seem to depend on the trial before ({named_few(follow)})"
        out.note(f"trials before: {how}; bayes-toe history tells")
    out.notes(once((one.subject, note) for one in verdicts for note in one.notes))


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


def _cells(one: Verdict) -> dict[Any, Any]:
    """A verdict as a row for people."""
    kind = "kind open" if one.kind == "open" else one.kind
    return {
        "subject": one.subject,
        "order effect": ", ".join(word for word in (one.effect or "-", kind) if word),
        "P(none)": number(one.p_none),
        "constant": number(one.p_constant_error),
        "pull": number(one.p_update),
        "size": number(one.size_q50),
        "fit": one.fit,
        "data": ", ".join(doubt.kind for doubt in one.data) or "-",
        "robust": "no, P(none) {:.2f}-{:.2f}".format(*one.p_none_range)
        if one.robust == "no"
        else one.robust or "-",
    }
