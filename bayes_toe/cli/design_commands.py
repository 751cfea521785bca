"""Commands that plan a study: design, power and simulate.

`design` also writes a list of trials in random order.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

import bayes_toe as bt
from bayes_toe.cli.options import (
    NUMBER,
    File,
    Number,
    OutputFolder,
    Question,
    Text,
    file_name,
    option,
    rare,
    writes,
)
from bayes_toe.cli.run_context import MODEL, RunContext
from bayes_toe.data.messages import join_names, plural, quoted

if TYPE_CHECKING:
    from bayes_toe.arrays import FloatArray
    from bayes_toe.data.options import ReadOptions
    from bayes_toe.design.optimal_pairs import DesignGoal
    from bayes_toe.design.study_design import StudyDesign

_POWER_FIGURES = ("power.png", "power.pdf")
_POWER_FILES = ("power.csv", "power_groups.csv", *_POWER_FIGURES)
Observers = Annotated[Text, rare("--observers", "NAME", "Kind of observers, or a file.")]
Simulated = Annotated[int, rare("--simulated", NUMBER, "Simulated observers of each kind.", min=1)]
Unit = Annotated[Text, option("--unit", "UNIT", "Unit of the stimuli: um, dB, log10, ...")]


# --- power ----------------------------------------------------------------------------------------


@dataclass(frozen=True)
class StudyPlan:
    """The studies that are simulated: their tasks, trials, subjects and observers."""

    questions: Annotated[
        str, option("--task", "TASK,TASK", "2afc (default), same/different, ternary")
    ] = "2afc"
    unit: Unit = None
    trials: Annotated[str, option("--trials", "N,N", "Trials of each subject.")] = "240,480,960"
    subjects: Annotated[Text, option("--subjects", "N,N", "Numbers of subjects in a study.")] = None
    simulated: Simulated = 50
    observers: Observers = None

    def designs(self, files: Sequence[Path]) -> Mapping[str, StudyDesign]:
        """Designs by name: the name of the file, and of the task if there are several tasks.

        A single file is called 'these pairs'. Without a file, the design is the paper's.
        """
        from bayes_toe.data.tasks import task_of
        from bayes_toe.design.power import GIVEN_PAIRS, PAPER_PAIRS
        from bayes_toe.design.study_design import paper_study_design

        if self.unit and not files:
            raise bt.InputError("--unit: allowed with DESIGN.csv.")
        tasks = dict.fromkeys(map(task_of, self.questions.split(",")))  # each once
        designs = {}
        for task in tasks:
            task_suffix = f", {task.short_name}" if len(tasks) > 1 else ""
            if not files:
                designs[PAPER_PAIRS + task_suffix] = paper_study_design(task)
            for file in files:
                name = (file.stem if len(files) > 1 else GIVEN_PAIRS) + task_suffix
                if name in designs:
                    raise bt.InputError(
                        f"Two design files have the name {quoted(file.stem)}. Names must differ."
                    )
                designs[name] = bt.design.read_study_design(file, task, self.unit)
        return designs


def power(
    *,
    design: Annotated[
        list[Path] | None,
        typer.Argument(
            metavar="[DESIGN.csv]...",
            help="Designs with columns s1,s2,n_trials.",
        ),
    ] = None,
    output: OutputFolder = Path("power"),
    plan: StudyPlan,
    context: Annotated[RunContext, *MODEL],
) -> None:
    """Estimate how often a design detects an order effect.

    [bold]Example[/bold]: bayes-toe power design.csv --trials 240 --subjects 10,20,40 --seed 1
    """
    from bayes_toe.cli.design_screens import print_groups, print_power
    from bayes_toe.data.whole_files import whole_folder
    from bayes_toe.design.observers import GROUPS, KINDS_IN_WORDS
    from bayes_toe.design.power import group_power

    numbers_of_trials = _whole_numbers("--trials", plan.trials)
    if plan.subjects is None:
        numbers_of_subjects = []
        observers = plan.observers
    else:
        # One subject alone has no SD between subjects.
        numbers_of_subjects = _whole_numbers("--subjects", plan.subjects, least=2)
        # The observers of GROUPS differ, as the subjects of a study do.
        observers = plan.observers or GROUPS
    context.require_folder(output, _POWER_FILES)
    designs = plan.designs(design or ())

    n_data_sets = _count_simulated(designs.values(), observers, plan.simulated)
    table = context.work(
        "simulating and analysing",
        n_data_sets * len(numbers_of_trials),
        bt.design.power,
        designs,
        numbers_of_trials,
        observers,
        data_sets=plan.simulated,
        prior=context.prior,
    )
    groups = group_power(table, numbers_of_subjects, context.prior)

    with whole_folder(output, _POWER_FILES, overwrite=context.overwrite) as folder:
        table.save(folder / "power.csv")
        if groups.rows:
            groups.save(folder / "power_groups.csv")
        for name in _POWER_FIGURES:
            bt.plots.save_figure(bt.plots.power(table), folder / name)

    if numbers_of_subjects:
        # Sizes are in natural logs so far; the screen has them in the unit of the design's file.
        unit = bt.ReadOptions(unit=plan.unit).stimulus_unit
        print_groups(context.out, table, groups, unit)
        sentences = groups.sentences()
    else:
        print_power(context.out, table)
        sentences = table.sentences()
    if observers is None:
        context.out.line(KINDS_IN_WORDS)
    context.out.answer([*sentences, f"Tables and figure in {output}. Seed {table.seed}."])


def _count_simulated(designs: Iterable[StudyDesign], observers: str | None, n_each: int) -> int:
    """The number of data sets that are simulated, with `n_each` observers of a kind in each design.

    `observers` may name a file. It is read here, so that a bad file is refused before any work.
    """
    from bayes_toe.design.observers import assume_observers

    # Any seed will do, because the observers are only counted.
    return sum(
        len(assume_observers(observers, n_each, seed=0, designs=[study_design]))
        for study_design in designs
    )


def _whole_numbers(option: str, text: str, least: int = 1) -> list[int]:
    """Parse whole numbers, ascending and each once: '480,240' -> [240, 480].

    Other texts, and numbers below `least`, are refused; the error names the option.
    """
    try:
        numbers = sorted(set(map(int, text.split(","))))
    except ValueError:
        numbers = []  # refused below
    if not numbers or numbers[0] < least:
        raise bt.InputError(
            f"{option} is {quoted(text)}. It must be whole numbers from {least}, separated by "
            "commas."
        )
    return numbers


# --- design ---------------------------------------------------------------------------------------


@dataclass(frozen=True)
class SearchOptions:
    """The search for a design: its goal, its pairs, and the observers that are simulated."""

    output: Annotated[Path, writes("FILE.csv", "Output design.")] = Path("design.csv")
    trials: Annotated[int, option("--trials", NUMBER, "Trials of each subject.", min=1)] = 480
    question: Question = "2afc"
    lowest: Annotated[
        Number, option("--lowest", NUMBER, "Weakest stimulus, in ln or in --unit.")
    ] = None
    highest: Annotated[Number, option("--highest", NUMBER, "Strongest stimulus.")] = None
    unit: Unit = None
    even: Annotated[bool, rare("--even", "", "Spread the trials evenly over the range.")] = False
    step: Annotated[
        Text, rare("--step", "STEP", "Step between levels: 5%, or a number in the unit.")
    ] = None
    levels: Annotated[File, rare("--levels", "levels.csv", "File of levels to choose from.")] = None
    max_pairs: Annotated[int, rare("--max-pairs", NUMBER, "Largest number of pairs.")] = 26
    aim: Annotated[
        str,
        rare(
            "--for",
            "NAME",
            "order-effect (default), constant-error or contraction.",
            show_default=False,
        ),
    ] = "order-effect"
    keep: Annotated[File, rare("--keep", "DESIGN.csv", "Pairs that the design must include.")] = (
        None
    )
    simulated: Simulated = 32
    observers: Observers = None

    def log_levels(self) -> FloatArray:
        """The levels that pairs can have, natural-log intensity, from the range or the file.

        A range is refused if it is incomplete, or if a file of levels is given, too.
        """
        from bayes_toe.design.optimal_pairs import levels_between, read_levels

        options = self.reading()
        if self.levels is not None:
            if (self.lowest, self.highest, self.step) != (None, None, None):
                raise bt.InputError(
                    "The range is given twice. Use either --levels, or --lowest, --highest and "
                    "--step."
                )
            return read_levels(self.levels, options)
        if self.lowest is None or self.highest is None:
            raise bt.InputError(
                "No range of stimuli is given. Use --lowest and --highest with --unit (natural "
                "logs without it), or --levels levels.csv."
            )
        return levels_between(self.lowest, self.highest, self.step, options)

    def reading(self) -> ReadOptions:
        """The options with which levels are read."""
        return bt.ReadOptions(unit=self.unit)

    def goal(self) -> DesignGoal:
        """The effect that the design must show, and the limits of its pairs."""
        from bayes_toe.data.tasks import task_of

        keep = None
        if self.keep is not None:
            keep = bt.design.read_study_design(self.keep, self.question, self.unit)
        return bt.design.DesignGoal(
            self.aim, self.max_pairs, keep, task_of(self.question), is_even=self.even
        )


@dataclass(frozen=True)
class ListOptions:
    """A list of the trials of a given design, in their order."""

    list_output: Annotated[
        File, option("--list", "trials.csv", "List of trials for the experiment.")
    ] = None
    blocks: Annotated[int, rare("--blocks", NUMBER, "Number of blocks in --list.", min=1)] = 10
    subjects: Annotated[
        int, option("--subjects", NUMBER, "Number of subjects in --list.", min=1)
    ] = 1
    conditions: Annotated[Text, rare("--conditions", "left,right", "Conditions in --list.")] = None


def design(
    *,
    file: Annotated[
        File,
        typer.Argument(
            metavar="[DESIGN.csv]",
            help="Design for --list.",
        ),
    ] = None,
    search: SearchOptions,
    lists: ListOptions,
    context: Annotated[RunContext, *MODEL],
) -> None:
    """Find the pairs that show an order effect best.

    [bold]Example[/bold]: bayes-toe design -o design.csv --lowest 45 --highest 213 --unit um
    """
    if file is not None:  # a given design, for which nothing is searched
        _list_trials(file, search, lists, context)
        return
    if lists != ListOptions():
        raise bt.InputError(
            "--list, --blocks, --subjects and --conditions need a design, as in bayes-toe design "
            "design.csv --list trials.csv."
        )
    _find_design(search, context)


def _find_design(search: SearchOptions, context: RunContext) -> None:
    """Search for a design; write its pairs, and its power with that of an even design.

    DESIGN.csv has the pairs, and DESIGN_compared.csv the power.
    """
    from bayes_toe.cli.design_screens import print_power
    from bayes_toe.cli.terminal import repeated_command
    from bayes_toe.data.tables import write_table
    from bayes_toe.design.observers import KINDS_IN_WORDS
    from bayes_toe.design.optimal_pairs import pairs_to_show

    output = search.output
    if output.suffix != ".csv":
        raise bt.InputError(f"{output}: the ending is {output.suffix!r}. A design needs .csv.")
    comparison_file = output.with_name(f"{output.stem}_compared.csv")
    context.require_files(output, comparison_file)

    levels = search.log_levels()  # natural-log intensities
    goal = search.goal()
    plane = pairs_to_show(levels, goal)  # all pairs that a design can have
    optimal = context.work(
        "simulating and analysing",
        # The number of data sets of two designs, the optimal one and an even one. The observers of
        # both are those of `plane`.
        _count_simulated([plane, plane], search.observers, search.simulated),
        bt.design.optimal_design,
        levels,
        search.trials,
        goal,
        search.observers,
        data_sets=search.simulated,
        prior=context.prior,
    )
    # Search and power are in natural logs. The table has the unit of the options.
    optimal = replace(optimal, unit=search.reading().stimulus_unit)
    written = context.write(
        {
            output: partial(write_table, optimal.design.frame(optimal.unit)),
            comparison_file: optimal.power.save,
        },
        optimal.power.seed,
    )

    print_power(context.out, optimal.power)
    if search.observers is None:
        context.out.line(KINDS_IN_WORDS)
    # A warning that subjects may learn a regularity of the pairs; '' if there is none.
    if optimal.learnable:
        # With --even subjects learn no regularity, but --even and --keep exclude each other.
        command = "" if search.keep else f"{repeated_command()} --even"
        context.out.notes([("", optimal.learnable, command)])
    power_command = (
        f"bayes-toe power {output} --task 2afc,same/different,ternary --trials {search.trials}"
    )
    # The mark '-' means advice; the default '!' means a warning.
    context.out.notes(
        [("", "Another task may find more with the same trials.", power_command)], mark="-"
    )
    context.out.answer([*optimal.power.sentences(), *optimal.reasons(), written])


def _list_trials(
    file: Path, search: SearchOptions, lists: ListOptions, context: RunContext
) -> None:
    """Write the trials of a given design in random order, for the experiment to present.

    The table has an empty column of responses. When it is filled, `run` reads the table.
    """
    import pandas as pd

    from bayes_toe.data.tables import write_table
    from bayes_toe.design.simulate import split_levels, subject_names
    from bayes_toe.seeds import root_seed

    # A given design is only read. So no option of the search is allowed, except the task and the
    # unit, which say how a design is read.
    options_of_reading = SearchOptions(question=search.question, unit=search.unit)
    is_search = search != options_of_reading or context.prior or context.processes or context.dask
    if lists.list_output is None or is_search:
        raise bt.InputError(
            f"{file}: a given design needs --list trials.csv, without options of the search such "
            "as --lowest, --trials, --max-pairs and --output."
        )
    context.require_files(lists.list_output)

    levels = split_levels(lists.conditions)
    study_design = bt.design.read_study_design(file, search.question, search.unit)
    seed = root_seed(context.seed)
    tables = [
        bt.design.trial_list(
            study_design,
            blocks=lists.blocks,
            seed=seed,
            conditions=levels,
            unit=search.reading().stimulus_unit,
            subject=name,
        )
        for name in subject_names(lists.subjects)
    ]
    write_table(pd.concat(tables), lists.list_output, overwrite=context.overwrite)
    context.print_written(_describe_list(lists, study_design.total, levels), seed)


def _describe_list(lists: ListOptions, n_trials_each: int, levels: Sequence[str]) -> str:
    """A sentence on the list; `n_trials_each` counts the trials of a subject in a condition."""
    from bayes_toe.design.trial_list import MOST_EQUAL

    n_trials = f"{n_trials_each * max(1, len(levels))} trials"
    if lists.subjects > 1:
        n_trials += " each"
    blocks = plural(lists.blocks, "block")
    if levels:
        blocks += f" ({n_trials_each} in each of {join_names(levels)}, mixed within blocks)"
    return (
        f"{lists.list_output}: {plural(lists.subjects, 'subject')}, {n_trials} in {blocks}. Within "
        "each block, both orders of a pair are as frequent as in the design. At most "
        f"{MOST_EQUAL} equal pairs follow each other"
    )


# --- simulate -------------------------------------------------------------------------------------


@dataclass(frozen=True)
class SimulatedStudy:
    """The pairs of a simulated study, how often each is shown, and its observers."""

    design: Annotated[str, option("--design", "NAME", "Pairs: reference, full, or a CSV file.")] = (
        "reference"
    )
    unit: Unit = None
    trials: Annotated[
        int | None,
        option("--trials", NUMBER, "Trials of each subject (default: 50 per pair).", min=1),
    ] = None
    subjects: Annotated[
        int | None, option("--subjects", NUMBER, "Number of observers (default: 16).", min=1)
    ] = None
    kind: Annotated[
        str,
        option(
            "--observers",
            "NAME",
            "Observers: paper (default), both (default of ternary), or a file.",
        ),
    ] = ""
    carry_over: Annotated[
        float, rare("--carry-over", NUMBER, "Carry-over from trial to trial, 0 to 1.")
    ] = 0.0
    conditions: Annotated[
        Text, option("--conditions", "left,right", "Conditions, each with all pairs.")
    ] = None
    differ: Annotated[Text, rare("--differ", "NAME=MEAN", "Difference between the conditions.")] = (
        None
    )
    question: Question = "2afc"


def simulate(
    *,
    output: Annotated[Path, writes("FILE.csv", "Output table of trials.")],
    truth_output: Annotated[
        File,
        option("--truth", "FILE.csv", "Write the true parameters, too.", parser=file_name),
    ] = None,
    study: SimulatedStudy,
    context: Annotated[RunContext, "seed", "overwrite"],
) -> None:
    """Simulate a study with known order effects.

    [bold]Example[/bold]: bayes-toe simulate -o study.csv --truth truth.csv --seed 1
    """
    import pandas as pd

    from bayes_toe.data.tables import write_table
    from bayes_toe.design.simulate import (
        POPULATIONS,
        make_design,
        read_differences,
        split_levels,
        trial_frame,
    )
    from bayes_toe.design.study_design import PAPER_BATCHES
    from bayes_toe.seeds import root_seed

    context.require_files(*filter(None, (output, truth_output)))  # None without --truth
    if study.subjects and study.kind not in ("", *POPULATIONS):
        raise bt.InputError("--subjects: allowed with a kind of --observers, not with a file.")

    seed = root_seed(context.seed)
    design = make_design(study.design, PAPER_BATCHES, study.trials, study.unit)
    simulated, truth = bt.simulate(
        study.subjects or 16,
        population=study.kind,
        design=design,
        seed=seed,
        task=study.question,
        carry_over=study.carry_over,
        conditions=split_levels(study.conditions),
        differ=read_differences(study.differ),
    )

    trials = trial_frame(simulated, design, bt.ReadOptions(unit=study.unit).stimulus_unit)
    writers = {output: partial(write_table, trials)}
    if truth_output is not None:
        # A row for each subject, or for a subject in a condition.
        rows = [{"subject": name, **truth[name]} for name in simulated.names]
        # Figures mark no carry-over, which is the same for all subjects if there is one.
        frame = pd.DataFrame(rows).drop(columns="carry_over", errors="ignore")
        writers[truth_output] = partial(write_table, frame)
    context.write(writers, seed)

    context.print_written(
        f"{plural(trials['subject'].nunique(), 'synthetic subject')}, "
        f"{plural(len(trials), 'trial')} in {output}",
        seed,
    )
