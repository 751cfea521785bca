"""What the terminal says of order effects: the answer first, then one table, then what to do about subjects whom no model describes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from bayes_toe.cli.headline import legend
from bayes_toe.cli.terminal import OUTPUT, Terminal, chosen, number, once, safe
from bayes_toe.comparison.study_answer import doubts_of, of_new_subject, study_sentence, way_on
from bayes_toe.comparison.verdict import Verdict
from bayes_toe.data.messages import counted, named_few

if TYPE_CHECKING:
    from bayes_toe.answers.serial_dependence import SerialDependence
    from bayes_toe.data.study import Study


def say_verdicts(
    out: Terminal,
    verdicts: Sequence[Verdict],
    seed: int,
    study: Study,
    file: str = OUTPUT,
) -> None:
    """The study in a sentence, a new subject of its population, every subject in a row, and a way on where no model describes one."""
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
    if follow:
        how = f"answers of {counted(len(follow), 'subject')} seem to depend on the trial before ({named_few(follow)})"
        out.note(f"trials before: {how}; bayes-toe history tells")
    out.notes(once((one.subject, note) for one in verdicts for note in one.notes))


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
