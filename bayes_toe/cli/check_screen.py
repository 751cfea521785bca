"""The screen of `check`: what was read, problems by subject, what the design can show."""

from __future__ import annotations

import re
import textwrap
from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import chain

import bayes_toe as bt
from bayes_toe.checks.answer_checks import Finding, Findings
from bayes_toe.checks.design_checks import NOTES
from bayes_toe.checks.identification import identify
from bayes_toe.cli.terminal import (
    MANY_SUBJECTS,
    Terminal,
    command_lines,
    describe_study,
    merge_notes,
    typed_command,
    with_options,
)
from bayes_toe.data.messages import capitalized, cli_argument, join_words, plural
from bayes_toe.data.study import Study, common_scales
from bayes_toe.model.prior import Prior

FindingsBySubject = Mapping[str, list[Finding]]


def print_check(out: Terminal, study: Study, prior: Prior | None) -> None:
    """Print the screen of `check`: each task of the study, the answer and the commands to type.

    `prior` is printed too, unless it is None.
    """
    findings: list[Finding] = []
    for part in study.by_task:
        if part.task != study.task:  # a further task
            out.line()
            part = replace(part, notes=())  # The first task is printed with the notes of the study.
        findings += _print_task(out, part, prior)
    lines, commands = answer_of_check(study, findings)
    out.answer(lines)
    for command in commands:
        out.lines(command_lines(command, start="  "))


def _print_task(out: Terminal, study: Study, prior: Prior | None) -> tuple[Finding, ...]:
    """Print what was read of one task and its problems; return all findings of the task."""
    findings = bt.check(study)
    by_subject = _by_subject(findings)
    out.line(describe_study(study))
    out.line(describe_pairs(study))
    for note in study.notes[:1]:  # The first note says what the files are.
        out.line(f"Read as {note}", indent=2)
    if prior is not None:
        out.line(f"Prior: {prior.describe_all(study.task)}", indent=2)

    study_findings = [finding for finding in findings if not finding.subject]
    limits = [finding for finding in study_findings if finding.code == "not_identified"]
    _print_problems(out, study, by_subject, limits)
    # The answer says what is not identified, and the remarks below have the notes.
    out.findings(filter(_is_doubt, study_findings))
    notes = [finding.message for finding in study_findings if finding.code in NOTES]
    out.remarks(f"{capitalized(note.rstrip('.'))}." for note in (*study.notes[1:], *notes))
    return findings


def _print_problems(
    out: Terminal, study: Study, by_subject: FindingsBySubject, limits: list[Finding]
) -> None:
    """Print a row for each subject with a problem, and notes with what does not fit into the row.

    If there are few subjects and no problems, each subject has a row. `limits` are findings on the
    design of all subjects, which stand in the row of a subject without a problem.
    """
    if by_subject or len(study) >= MANY_SUBJECTS:
        names = list(by_subject)
    else:
        names = list(study.names)
    rows = []
    findings_below = []
    for name in names:
        findings = by_subject.get(name, limits)
        # Findings on all conditions of a subject have its name; rows have names such as 'S01@left'.
        if name not in study.names:
            findings_below += findings
            continue

        subject = study[name]
        problem = _first_problem(findings)
        # The problem is shortened so that the row is one line.
        short_problem = textwrap.shorten(problem, 52, placeholder="...")
        # All problems but the first stand below the table. The first does too, if its row cuts it.
        n_in_row = int(short_problem == problem)
        findings_below += findings[n_in_row:]
        share = f"{100.0 * subject.fraction_yes:.0f} %"
        rows.append([name, str(subject.total_trials), share, short_problem])

    n_others = len(study) - len(rows)
    if n_others:
        others = f"{n_others:,} more" if rows else f"all {n_others:,}"
        rows.append([others, "", "", "see the answer below" if limits else "none"])
    out.table(["subject", "trials", f"'{study.task.yes}'", "problem"], rows, numeric=(1, 2))
    # A limit of the design has no subject, and stands in the answer.
    out.notes((item.subject, item.message, "") for item in findings_below if item.subject)


def _first_problem(findings: Sequence[Finding]) -> str:
    """The first sentence of the first finding, as a cell of the table; 'none' without findings."""
    if not findings:
        return "none"
    # A capital letter follows the end of a sentence, but not that of 'a.u.'.
    sentence = re.split(r"\. (?=[A-Z])", findings[0].message)[0].rstrip(".")
    problem = f"{sentence[0].lower()}{sentence[1:]}"
    if findings[0].subject:
        return problem
    # A limit of the design is the same for all subjects. The answer has the reason, once for all.
    return problem.partition(", because")[0]


def _is_doubt(finding: Finding) -> bool:
    """Whether a finding makes one doubt the file: a warning on all of it, or useless responses."""
    if finding.subject:
        return finding.code in ("one_answer", "independent_answers")
    return finding.code not in ("not_identified", *NOTES)


def answer_of_check(study: Study, findings: Findings) -> tuple[list[str], list[str]]:
    """Sentences of the answer, and the commands to type next.

    The sentences say what the design can show, and how many subjects need a decision.
    """
    lines = _limits_of_design(study, findings)
    if common_scales(*study) is None:  # No pair has different stimuli, so that no command can run.
        return lines, []
    obstacle = _obstacle(study, findings)
    if obstacle:
        return [*lines, obstacle], []

    by_subject = _by_subject(findings)
    # At most one option of each subject, because the first option may settle other problems, too.
    options = []
    for subject_findings in by_subject.values():
        options += [finding.option for finding in subject_findings if finding.option][:1]
    run_command = typed_command("run" if len(study.by_task) == 1 else "contrast")
    if not options:
        if any(map(_is_doubt, findings)):
            decision = "First settle the doubts that stand above. Then type:"
        elif by_subject:
            decision = "No subject must be excluded; the table says what to keep in mind. Type:"
        else:
            decision = "No subject needs a decision. Type:"
        return [*lines, decision], [run_command]

    # Blocks that look swapped may be swapped or excluded: two commands.
    exclusions = [option.replace("--swap", "--exclude", 1) for option in options]
    commands = []
    if exclusions != options:
        commands.append(with_options(run_command, options))
    if {f"--exclude {cli_argument(name)}" for name in study.names}.issubset(exclusions):
        lines.append("Without the subjects that need a decision, no subject is left.")
    else:
        commands.append(with_options(run_command, exclusions))

    verb = "needs" if len(options) == 1 else "need"
    decision = f"{len(options)} of {plural(len(study), 'subject')} {verb} a decision."
    # There are no commands, one command or two commands.
    instruction = ("", " Type this:", " Type one of these:")[len(commands)]
    return [*lines, decision + instruction], commands


def _obstacle(study: Study, findings: Findings) -> str:
    """A sentence on why nothing can be analysed yet; '' if something can."""
    codes = [finding.code for finding in findings]
    if "other_task" in codes:  # a finding on all subjects, whose task was read as 2AFC
        question = "All subjects need a decision: was the task 'same or different?'"
        words = [f"--equal-code {cli_argument(code)}" for code in study.reading.codes]
        if words:
            question += f" If so, type {' or '.join(words)} in place of the present codes."
        return question
    if codes.count("one_answer") == len(study):
        return "No subject gave both responses, so that nothing can be analysed."
    return ""


def _limits_of_design(study: Study, findings: Findings) -> list[str]:
    """Sentences on the effects that the design can show, and on the effects that it cannot."""
    all_subjects = plural(len(study), "subject")
    identifications = [identify(subject) for subject in study]
    effects = []
    for effect in ("constant_error", "contraction"):
        # `reasons` has the effects that the design of a subject cannot show.
        n_able = sum(effect not in identification.reasons for identification in identifications)
        if n_able:
            share = "" if n_able == len(study) else f" ({n_able} of {all_subjects})"
            effects.append(f"a {effect.replace('_', ' ')}{share}")
    lines = [f"The design can show {join_words(effects)}."] if effects else []
    # Notes without an option. Notes with the same message become one.
    limits = (
        (finding.subject, finding.message, "")
        for finding in findings
        if finding.code == "not_identified"
    )
    for subjects, message, _ in merge_notes(limits):
        if subjects:  # A limit of the whole study names no subjects.
            message = f"{message.rstrip('.')} ({len(subjects)} of {all_subjects})."
        lines.append(message)
    return lines


def describe_pairs(study: Study) -> str:
    """How many pairs there are, and whether each came in both orders.

    Examples
    --------
    >>> subject = bt.Subject("S01", [0, 0, 1], [0, 1, 0], [9, 5, 4], [9, 9, 9])
    >>> describe_pairs(bt.Study([subject]))
    'Pairs: 1 equal one, and 1 different one, in both orders'
    """
    # Ordered pairs (s1, s2): a pair in both orders is there twice.
    pairs = set(chain.from_iterable(subject.pairs for subject in study))
    n_equal = sum(first == second for first, second in pairs)
    n_single = sum((second, first) not in pairs for first, second in pairs)
    n_both = (len(pairs) - n_equal - n_single) // 2
    descriptions = []
    if n_equal:
        descriptions.append(plural(n_equal, "equal one"))
    if n_both:
        separator = ", each" if n_both > 1 else ","
        descriptions.append(f"{plural(n_both, 'different one')}{separator} in both orders")
    if n_single:
        descriptions.append(f"{plural(n_single, 'different one')} in one order only")
    return f"Pairs: {', and '.join(descriptions)}"


def _by_subject(findings: Findings) -> FindingsBySubject:
    """The findings by subject; swapped blocks come first, because they may cause other findings.

    Subjects without findings are left out.
    """
    by_subject = defaultdict(list)
    for finding in findings:
        if finding.subject:
            by_subject[finding.subject].append(finding)
    for subject_findings in by_subject.values():
        # False comes before True, and sorting keeps the order of findings with the same key.
        subject_findings.sort(key=lambda finding: not finding.option.startswith("--swap"))
    return by_subject
