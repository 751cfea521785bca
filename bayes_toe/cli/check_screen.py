"""The screen of `check`: what was read, problems by subject, what the design can show."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import bayes_toe as bt
from bayes_toe.checks.answer_checks import Finding
from bayes_toe.checks.design_checks import NOTES
from bayes_toe.checks.identification import identify
from bayes_toe.cli.terminal import (
    MANY_SUBJECTS,
    Terminal,
    command_lines,
    describe_study,
    typed_command,
)
from bayes_toe.data.messages import capitalized, counted

if TYPE_CHECKING:
    from bayes_toe.data.study import Study
    from bayes_toe.model.prior import Prior

_LONGEST_PROBLEM = 52  # characters of a problem in the table


def print_check(out: Terminal, study: Study, prior: Prior, *, shows_prior: bool = False) -> None:
    """Everything that `check` prints."""
    findings = bt.check(study, prior)
    by_subject = _by_subject(findings)
    out.line(describe_study(study))
    out.line(describe_pairs(study))
    for note in study.notes[:1]:
        out.line(f"Read as {note}", indent=2)
    if shows_prior:
        out.line(f"Prior: {prior.describe_orders(study.task)}", indent=2)
    _print_problems(out, study, by_subject)
    of_study = [finding for finding in findings if not finding.subject]
    out.findings(finding for finding in of_study if finding.code not in (*NOTES, "not_identified"))
    notes = [*study.notes[1:], *(item.message for item in of_study if item.code in NOTES)]
    out.notes((("", f"{capitalized(note.rstrip('.'))}.", "") for note in notes), "-")
    lines, commands = answer_of_check(study, of_study, by_subject)
    out.answer(lines)
    for command in commands:
        out.lines(command_lines(command, "  "))


def _print_problems(out: Terminal, study: Study, by_subject: dict[str, list[Finding]]) -> None:
    """A row for each subject with a problem, and in full what does not fit into it."""
    names, others = list(by_subject), [name for name in study.names if name not in by_subject]
    if not names and len(study) < MANY_SUBJECTS:
        names, others = others, []
    rows, full = [], list[Finding]()
    for name in names:
        subject, findings = study[name], by_subject.get(name, [])
        problem = "none"
        if findings:
            sentence = findings[0].message.partition(". ")[0].rstrip(".")
            problem = f"{sentence[0].lower()}{sentence[1:]}"
            full += findings if len(problem) > _LONGEST_PROBLEM else findings[1:]
        share = f"{100.0 * subject.fraction_yes:.0f} %"
        rows.append([name, str(subject.total_trials), share, _cut(problem)])
    if others:
        rows.append([f"{len(others):,} more" if names else f"all {len(others):,}", "", "", "none"])
    out.table(["subject", "trials", f"'{study.task.yes}'", "problem"], rows, (1, 2))
    out.notes((item.subject, item.message, "") for item in full)


def _cut(problem: str) -> str:
    """A problem that fits into its column."""
    if len(problem) <= _LONGEST_PROBLEM:
        return problem
    return f"{problem[: _LONGEST_PROBLEM - 3].rstrip()}..."


def answer_of_check(
    study: Study, of_study: Sequence[Finding], by_subject: Mapping[str, Sequence[Finding]]
) -> tuple[list[str], list[str]]:
    """What the design can show, who needs a decision, and the commands to type."""
    lines = [finding.message for finding in of_study if finding.code == "not_identified"]
    if not lines:
        lines = ["The design can show a constant error and a contraction."]
    elif identify(study.subjects[0]).constant_error:
        lines = ["The design can show a constant error.", *lines]
    options = []
    for findings in by_subject.values():
        options += [finding.option for finding in findings if finding.option][:1]
    run = typed_command("run")
    if not options:
        return [*lines, "No subject needs a decision. Type:"], [run]
    exclude = [option.replace("--swap", "--exclude") for option in options]
    commands = [f"{run} {' '.join(exclude)}"]
    swap = [option for option in options if option.startswith("--swap")]
    if swap:
        commands.insert(0, f"{run} {' '.join(swap)}")
    which = "one of these" if swap else "this"
    verb = "needs" if len(options) == 1 else "need"
    n_all = counted(len(study), "subject")
    lines.append(f"{len(options)} of {n_all} {verb} a decision. Type {which}:")
    return lines, commands


def describe_pairs(study: Study) -> str:
    """How many pairs there are, and whether each came in both orders.

    Examples
    --------
    >>> subject = bt.Subject("S01", [0, 0, 1], [0, 1, 0], [9, 5, 4], [9, 9, 9])
    >>> describe_pairs(bt.Study([subject]))
    'Pairs: 1 equal one, and 1 different one, in both orders'
    """
    shown = set[tuple[float, float]]()
    for subject in study:
        shown.update(zip(subject.s1.tolist(), subject.s2.tolist(), strict=True))
    n_equal = sum(first == second for first, second in shown)
    different = {tuple(sorted(pair)) for pair in shown if pair[0] != pair[1]}
    n_both = sum((a, b) in shown and (b, a) in shown for a, b in different)
    parts = []
    if n_equal:
        parts.append(counted(n_equal, "equal one"))
    if n_both:
        each = ", each" if n_both > 1 else ","
        parts.append(f"{counted(n_both, 'different one')}{each} in both orders")
    if len(different) > n_both:
        parts.append(f"{counted(len(different) - n_both, 'different one')} in one order only")
    return f"Pairs: {', and '.join(parts)}"


def _by_subject(findings: Sequence[Finding]) -> dict[str, list[Finding]]:
    """The findings of each subject that has any, swapped blocks first: they may cause others."""
    by_subject: dict[str, list[Finding]] = {}
    for finding in findings:
        if finding.subject:
            by_subject.setdefault(finding.subject, []).append(finding)
    for own in by_subject.values():
        own.sort(key=lambda finding: not finding.option.startswith("--swap"))
    return by_subject
