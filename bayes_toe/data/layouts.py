"""Stimuli in another layout: a standard and a comparison, or pairs in the names of columns.

`StandardOrder` puts a standard and a comparison in order, `with_pairs` reads wide tables.
`known_names` has the columns that are read, of the names in a table. `stimulus_logs` reads the
numbers of stimuli, and `require_unit` asks for their unit where they may be no natural logs.

The order of presentation is what an order effect is about. A table that has a standard and a
comparison must therefore say which of them came first: a column names the interval of the standard
(1 or 2), or the standard was always first. In a wide table the name of a column, or a cell, tells
both stimuli by a pattern, such as '100_112'.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import chain, filterfalse
from typing import TypeAlias

import numpy as np

from bayes_toe.arrays import BoolArray, FloatArray
from bayes_toe.data.column_roles import (
    TRUE_WORDS,
    VOCABULARY,
    filled_texts,
    from_left_to_right,
    has_word,
    intensity_remedies,
    is_flag,
    named_places,
    plain_name,
    suggested_unit,
    unit_in,
    unit_remedies,
    unordered_stimuli,
    with_likely_columns,
)
from bayes_toe.data.messages import (
    Texts,
    display_name,
    join_display_names,
    join_names,
    join_quoted,
    join_words,
    quoted,
)
from bayes_toe.data.options import COLUMNS, ReadOptions
from bayes_toe.data.stimulus_unit import LOG_UNITS, why_not_logs
from bayes_toe.data.text_table import CELL, PAIR, Column, TextTable, repeated_columns
from bayes_toe.data.validation import number, number_by_sign
from bayes_toe.errors import InputError, Remedy

#: What the column of the interval may hold.
ALLOWED_INTERVALS = (
    "1 or 2, the interval of the standard (also first or second, standard_first or "
    "comparison_first, SC or CS); other codes by --standard-first-code"
)
#: Whether the standard came first, by the texts of a column; None for an unclear text.
OrderByText: TypeAlias = Mapping[str, bool | None]
#: Parts of names that may mean something else: the interval of the right answer, the order of
#: blocks of a test, or a stimulus such as `std1`.
_UNCLEAR = re.compile("target|signal|probe|1|(comp|cmp|test|var).*order|order.*(comp|cmp|test|var)")


class StandardOrder:
    """The trials in which the standard came first; s1 is the standard by default.

    Parameters
    ----------
    table : TextTable
        If a column has one or two codes whose meaning is not certain, the table is refused, with a
        question.
    column : Column or None
        Says which stimulus came first; None where the standard was always first.
    options : ReadOptions

    Attributes
    ----------
    is_first : ndarray of bool, shape (rows,)
    is_unknown : ndarray of bool, shape (rows,)
        Rows in which the column does not say which stimulus came first.
    is_open : bool
        Whether the column has intervals such as '1' and '2', and only options say of what stimulus.
    notes : list of str
        How the column was read, and responses that name a stimulus.
    """

    def __init__(self, table: TextTable, column: Column | None, options: ReadOptions) -> None:
        self.column = column
        self.notes: list[str] = []
        self.is_open = False
        if column is None:
            self.is_first = np.ones(len(table.rows), bool)
            self.is_unknown = np.zeros(len(table.rows), bool)
            return

        order_by_text = _standard_first_by_text(table, column, options)
        texts = join_quoted(filter(order_by_text.get, order_by_text))
        note = f"{column} read as the order: standard first at {texts or 'none'}"
        # A name such as 'std_position' says of which stimulus the intervals are, and a cell such as
        # 'SC' names both stimuli.
        self.is_open = "".join(column.texts).isdecimal() and not named_places(column.name).stimuli
        # Responses by codes would fit the opposite order alike, with the opposite codes.
        if options.standard_first_code is not None or (self.is_open and options.code_by_answer):
            note += "; otherwise order effects have the opposite sign"
        self.notes.append(note)
        # An empty cell is no key of the mapping, so that its row is unknown, too. In an array of
        # bool, None is False.
        self.is_first = column.map(order_by_text.get)
        self.is_unknown = column.map(lambda text: order_by_text.get(text) is None)

    def in_order(self, stimuli: FloatArray) -> FloatArray:
        """First and second stimulus of every row, from the standard and the comparison.

        `stimuli` and the result have the shape (rows, 2).
        """
        return np.where(self.is_first[:, None], stimuli, stimuli[:, ::-1])

    def answers_by_interval(self, table: TextTable, column: Column, options: ReadOptions) -> Column:
        """Responses 'comparison' and 'standard' as 'second' or 'first'; other texts stay.

        With the code of 'comparison', the other code beside 'equal' is 'standard'. The table is
        refused if no response has the code, or there are more codes.
        """
        comparison_code = options.comparison_code
        texts = []
        for text in filter(None, column.texts):  # a missed response is empty
            says_equal = plain_name(text) in VOCABULARY["responses"]["equal"]
            if not says_equal and text != options.equal_code:
                texts.append(text)
        if comparison_code is not None and (comparison_code not in texts or len(texts) > 2):
            problem = (
                f"found {join_names(column.counts(texts))}, allowed: {quoted(comparison_code)} for "
                "'comparison' and one other code for 'standard'"
            )
            _ask_order(table, column, problem, [])

        responses = column.map(str, object)
        for text in texts:
            stimulus = _stimulus_meant(text, options)
            if stimulus:
                # Where the standard was first, the comparison was second, and the other way round.
                is_second = self.is_first == (stimulus == "comparison")
                answers = np.where(is_second, "second", "first")
                responses = np.where(column.matches([text]), answers, responses)
                self.notes.append(
                    f"response {quoted(text)} read as the {stimulus}, first or second by the order"
                )
        return Column.from_texts(column.name, responses)


def _stimulus_meant(text: str, options: ReadOptions) -> str:
    """The stimulus that a response names, 'standard' or 'comparison'; empty if it names neither.

    The options say that the stimuli are these two.
    """
    if options.comparison_code is not None:
        return "comparison" if text == options.comparison_code else "standard"
    for stimulus in options.stimuli:
        # 'B' names the columns 'B_ms' and 'B.ms', and 'test' is a word for the comparison.
        is_column = re.split("[_.]", options.name(stimulus))[0] == text
        if is_column or named_places(text) == named_places(stimulus):
            return stimulus
    return ""


def with_known_order(table: TextTable, options: ReadOptions) -> tuple[TextTable, ReadOptions]:
    """The options with a column that says itself which stimulus came first, and the table with it.

    The options stay as they are if they say the order, if there is no standard and no comparison,
    or if columns contradict each other.
    """
    table = _with_onsets(table)
    if not unordered_stimuli(table.names, options):
        return table, options
    names_in_use = set(map(options.name, COLUMNS))  # such as that of the responses
    name_by_order = {}  # by what a column says of all rows; equal columns are one
    for name, column in table.columns.items():
        order_by_text = _certain_order(column)
        if order_by_text and name not in names_in_use:
            name_by_order[tuple(column.map(order_by_text.get, object))] = name
    if len(name_by_order) != 1:
        return table, options

    (name,) = name_by_order.values()
    # In a column such as 'test_position', which names a comparison and no place, '1' is the
    # interval of the test.
    if named_places(name)[:2] == (["comparison"], []):
        options = replace(options, comparison_interval=name)
    else:
        options = replace(options, standard_interval=name)
    return table, with_likely_columns(table.names, options)


def _with_onsets(table: TextTable) -> TextTable:
    """The table with a column of order, if two columns have the onsets of standard and comparison.

    Columns of onsets have names such as tone_std.started and tone_cmp.started, or tone1.onset and
    tone2.onset. The table stays as it is if one stimulus always began first, since the times may
    then count from two moments.
    """
    onset_names = {"standard": list[str](), "comparison": list[str]()}
    for name in table.columns:
        stimuli, places, other_words = named_places(name)
        is_onset = other_words.intersection(VOCABULARY["words"]["of_onset"])
        if is_onset and len(stimuli + places) == 1:
            is_comparison = stimuli + places in (["comparison"], ["second"])
            onset_names["comparison" if is_comparison else "standard"].append(name)
    if list(map(len, onset_names.values())) != [1, 1]:  # one column for each stimulus
        return table
    pair = onset_names["standard"] + onset_names["comparison"]

    standard, comparison = (table.columns[name].map(number, np.float64) for name in pair)
    delay = comparison - standard
    delays = delay[np.isfinite(delay)]  # of rows with both stimuli
    has_both_orders = (delays > 0.0).any() and (delays < 0.0).any()
    # The shortest delay is not much shorter than the longest. Times that vary by chance, each
    # from its own start, would be nearly equal in some trials.
    if not has_both_orders or abs(delays).min() < 0.05 * abs(delays).max():
        return table
    texts = np.select([delay > 0.0, delay < 0.0], ["standard first", "comparison first"], "")
    order = Column.from_texts("onsets", texts.tolist())
    return replace(
        table,
        names=[*table.names, order.name],
        columns={**table.columns, order.name: order},
        notes=(*table.notes, f"columns {join_display_names(pair)} read as onsets"),
    )


def _certain_order(column: Column) -> OrderByText:
    """Whether the standard came first, by the texts of a column whose name and cells say so.

    A column `std_position` has '1' or '2', `ref_first` has 'yes' or 'no', `first_stimulus` has
    'standard' or 'comparison', and a column of another name has 'SC' or 'CS'. The result is empty
    for all other columns: '1' in `order` or in `target_interval` may be about another stimulus.
    """
    stimuli, places, other_words = named_places(column.name)
    words_of_order = VOCABULARY["words"]["of_order"]
    is_unclear = _UNCLEAR.search(column.name.lower()) or other_words.difference(words_of_order)
    # Without a stimulus or a place in the name, the cells alone say the order, as 'SC' does.
    if is_unclear and (stimuli or places):
        return {}
    # '1' and '2' in a column `std_interval` are intervals of one stimulus. But in a column
    # `std_stim` they may be two stimuli, and '1' alone may be a level.
    has_interval = not other_words.isdisjoint(VOCABULARY["words"]["of_interval"])
    placed_stimulus = ""
    if has_interval and not places and len(stimuli) == 1 and len(column.texts) > 1:
        placed_stimulus = stimuli[0]
    order_by_text = _order_by_text(column, placed_stimulus)
    return {} if None in order_by_text.values() else order_by_text


def _order_by_text(column: Column, placed_stimulus: str) -> OrderByText:
    """Whether the standard came first, by the texts of a column; None for an unclear text.

    A column such as `standard_first` has words for true and false. All other texts must say the
    order themselves, such as 'SC', or '1', which is the interval of `placed_stimulus`.
    """
    texts = filled_texts(column)
    stimuli, places, _ = named_places(column.name)
    if stimuli and places and is_flag(texts):
        is_first_if_true = (stimuli[0] == "standard") == (places[0] == "first")
        return {text: (text.lower() in TRUE_WORDS) == is_first_if_true for text in texts}
    return {text: _is_standard_first(text, placed_stimulus, places) for text in texts}


def _standard_first_by_text(table: TextTable, column: Column, options: ReadOptions) -> OrderByText:
    """Whether the standard came first, by the texts of the column that options name.

    The code that the options give decides first. One or two codes whose meaning is not certain are
    refused, and so is a column of another stimulus.
    """
    placed_stimulus = "comparison" if options.comparison_interval else "standard"
    order_by_text = _order_by_text(column, placed_stimulus)
    code = options.standard_first_code
    # A single text that is not the code means that the comparison was always first. Several texts
    # without the code are read by their words, as if there were no code.
    if code in order_by_text or (code is not None and len(order_by_text) == 1):
        if len(order_by_text) <= 2:  # the other text needs no meaning of its own
            order_by_text = dict.fromkeys(order_by_text, False)
        return {**order_by_text, str(code): True}

    # Of three texts or more, those without a meaning are problems of their rows.
    if None in order_by_text.values() and len(order_by_text) <= 2:
        counts = join_names(column.counts(order_by_text))
        problem = (
            f"the codes are {counts}. Which of them means that the standard was first? With keys "
            "such as f and j, responses fit both, and order effects change their sign"
        )
        texts = _likeliest_first(list(order_by_text), table, column, options)
        _ask_order(table, column, problem, texts)

    # Texts such as '1' or 'first' name an interval, and no stimulus.
    first_intervals = [text for text in order_by_text if named_places(text)[:2] == ([], ["first"])]
    stimuli, places, _ = named_places(column.name)
    is_true_or_false = places and is_flag(order_by_text)  # '1' in 'test_first' is no interval
    names_another = len(stimuli) == 1 and placed_stimulus not in stimuli
    if first_intervals and names_another and not is_true_or_false:
        (named_stimulus,) = stimuli
        problem = f"found as the interval of the {placed_stimulus}, but named as that of the "
        problem += f"{named_stimulus}."
        _ask_order(table, column, problem, first_intervals[:1], named_stimulus)
    return order_by_text


def _ask_order(
    table: TextTable, column: Column, problem: str, texts: Texts, named_stimulus: str = ""
) -> None:
    """Refuse a column, and ask which of these texts means that the standard was first.

    `named_stimulus` is "standard" or "comparison" if the name of the column has this word.
    """
    remedies = []
    if named_stimulus == "comparison":
        meaning = "if it says the interval of the comparison"
        remedies.append(Remedy("comparison_interval", column.name, meaning))
    for text in texts:
        meaning = f"if {text} means that the standard was first"
        remedies.append(Remedy("standard_first_code", text, meaning))
    table.problems.ask(f"{column}: {problem}", remedies)
    table.problems.refuse()


def _likeliest_first(texts: Texts, table: TextTable, column: Column, options: ReadOptions) -> Texts:
    """One or two codes that may mean that the standard was first, the likeliest first.

    With the right code, a larger s2 - s1 goes with the second of two keys. If the responses do not
    show it, 'AB' stands before 'BA', and 'S' before 'C'.
    """
    texts = sorted(texts, key=lambda text: (not "standard".startswith(text.lower()), text))

    response = table.columns.get(options.name("response"))
    if response is None:
        return texts
    keys = from_left_to_right(filled_texts(response))
    standard, comparison = (
        table.columns[name].map(number, np.float64) for name in options.stimulus_names
    )
    # Whether s2 is larger than s1, if the first code is the right code.
    is_larger = (comparison > standard) == column.matches(texts[:1])
    agreement = np.mean(response.matches(keys[1:]) == is_larger)
    if agreement < 0.5 - 1.5 / len(is_larger) ** 0.5:  # by more than three SDs of guesses
        texts.reverse()
    return texts


def _is_standard_first(text: str, placed_stimulus: str, places_of_name: Texts) -> bool | None:
    """Whether a cell says that the standard came first; None where its meaning is not certain.

    '1' is the interval of `placed_stimulus`. Without one, a cell or the name must say stimulus and
    interval, or both stimuli. Else 'standard' stands in the first interval, or in the interval that
    the name of the column says. 'SC' and 'standard, comparison' are both stimuli in their order.
    """
    stimuli, places, other_words = named_places(text)
    if not (stimuli or places) or other_words.difference(VOCABULARY["words"]["filling"]):
        return None

    if len(stimuli) == 1:
        places = places or list(places_of_name)
    # Without a placed stimulus, '1' alone or 'standard' alone has no certain meaning.
    if not placed_stimulus and (not stimuli or len(stimuli) + len(places) < 2):
        return None
    stimulus = (stimuli or [placed_stimulus])[0]
    interval = (places or ["first"])[0]
    return (stimulus == "standard") == (interval == "first")


#: Finds the text before the number, the unit and '.wav' in 'stim/tone_7Hz.wav', and empty texts in
#: '7'. It finds nothing in 'Apr-05', a date that was a number.
_NUMBER_IN_NAME = (
    r"(?m)^[+\u2212-]?(?:[.,]?|(?!\w{3}-\d+$)([./]*[^\W\d_](?:\D*[^\d.,])?))(?:\d|\d.*?\d) *"
    r"(%|[^\W\d_]{0,16})(\.[a-zA-Z]\w*|)$"
)


# --- Numbers of stimuli ---------------------------------------------------------------------------


def stimulus_logs(table: TextTable, columns: Sequence[Column], options: ReadOptions) -> FloatArray:
    """Natural-log intensities in both columns of stimuli, shape (rows, 2); NaN without a number.

    Raises
    ------
    InputError
        If nothing shows whether a sign, as in '1.050', is decimal.
    """
    columns = _without_unit(table, columns, options)
    if options.decimal is None and table.grouping_sign:
        _require_decimal_sign(table, columns, options)
    logs = []
    for column in columns:
        if options.decimal is None:
            # A cell between commas may have a comma, in quotation marks; the question about '1,050'
            # is asked above.
            has_comma = table.decimal_comma or table.delimiter == ","
            values = [number(text, has_comma) for text in column.texts]
        else:
            values = [number_by_sign(text, options.decimal) for text in column.texts]
        if options.has_intensities:
            # The difference of logs, because the ratio itself may overflow.
            origin = options.stimulus_unit.log_reference
            values = [math.log(value) - origin if value > 0 else math.nan for value in values]
        factor = LOG_UNITS.get(options.unit or "ln", 1.0)  # intensities are natural logs by now
        logs.append(np.array(values)[column.codes] * factor)
    return np.column_stack(logs)


def _without_unit(
    table: TextTable, columns: Sequence[Column], options: ReadOptions
) -> Sequence[Column]:
    """Stimuli without the unit that stands behind every number; the options must give the unit.

    A number may stand in the name of a file, as in 'tone_460Hz.wav', if all names are alike.
    """
    texts = "\n".join(chain.from_iterable(column.texts for column in columns))
    # The texts around the numbers, ('tone_', 'Hz', '.wav'). If they differ, they stay in the cells.
    parts = set(re.findall(_NUMBER_IN_NAME, texts))
    beginning, unit, ending = parts.pop() if len(parts) == 1 else ("", "", "")
    unit_name = unit_in(f"1 {unit}") or unit  # 'dB' for 'db'
    remedies = unit_remedies(unit_name)
    if unit and options.unit not in [remedy.value for remedy in remedies]:
        table.problems.ask(f"the stimuli have the unit {quoted(unit)}.", remedies)
        table.problems.refuse()

    bare_columns = []
    for column in columns:
        numbers = [
            text.removeprefix(beginning).removesuffix(unit + ending) for text in column.texts
        ]
        bare_columns.append(Column.from_texts(column.name, numbers, column.codes))
    return bare_columns


def _require_decimal_sign(
    table: TextTable, stimuli: Sequence[Column], options: ReadOptions
) -> None:
    """Refuse stimuli such as '1.050' where nothing shows whether the sign is decimal.

    The table has a :attr:`grouping_sign`.
    """
    sign = table.grouping_sign
    texts = list(chain.from_iterable(column.texts for column in stimuli))
    texts_with_sign = [text for text in texts if sign in text]
    # '1.050' is a decimal number where another cell shows it: '1.05' or '0.950'.
    grouped_digits = re.compile(rf"[-+−]?[1-9]\d{{0,2}}{re.escape(sign)}\d{{3}}")
    if not texts_with_sign or not all(map(grouped_digits.fullmatch, texts_with_sign)):
        return

    # No logarithm is 1050, unless other stimuli are as large: 950 beside 1.050 may be in cents.
    other_texts = [text for text in texts if sign not in text]
    has_large = any(abs(number(text)) >= 100.0 for text in other_texts)
    if not (options.has_intensities or has_large):
        return

    text = texts_with_sign[0]
    grouped = text.replace(sign, "")
    decimal = text.replace(sign, ".")
    other_sign = "," if sign == "." else "."
    remedies = [
        Remedy("decimal", sign, f"if it is {decimal}"),
        Remedy("decimal", other_sign, f"if it is {grouped}"),
    ]
    if has_large:  # then the stimulus is rather as large
        remedies.reverse()
    table.problems.ask(f"the stimulus '{text}' can be {grouped} or {decimal}.", remedies)
    table.problems.refuse()


def require_unit(
    table: TextTable,
    columns: Sequence[Column],
    stimuli: FloatArray,
    selected: BoolArray,
    options: ReadOptions,
) -> None:
    """Ask for the unit if the stimuli of these rows are certainly, or perhaps, no natural logs.

    Columns s1 and s2 have natural logs, unless their values or their names say something else.
    Columns with other names may have intensities, if all are above 0, or logs of another base.
    """
    rows = np.flatnonzero(selected & ~np.isnan(stimuli).any(axis=1))
    if not len(rows):
        return

    names = [column.name for column in columns]
    columns_shown = f"columns {join_words(map(display_name, names))}"
    low = stimuli[rows].min()
    unit = suggested_unit(names[0], low)
    problem = ""
    reason = ""
    if not options.has_intensities:
        reason, index = why_not_logs(*stimuli[rows].T)
        if reason:
            if index is not None:  # the pair that shows it
                columns_shown = f"row {table.rows[rows[index]]}, {columns_shown}"
            problem = f"{columns_shown}: found {reason}, allowed: natural logs or a unit"
            if low == 0.0:
                problem += (
                    ". If they are intensities, correct or remove rows with 0: 0 has no logarithm"
                )

    if not problem:
        # The stimuli of a wide table get the names s1 and s2 here, and have no names in the file.
        has_our_name = not {"s1", "s2"}.isdisjoint(names)
        is_known = options.has_intensities or (has_our_name and options.wide is None)
        # A name such as 'level1' asks even if the stimuli are known: they may be decibels.
        if not unit and (is_known or low <= 0.0):
            return
        problem = f"{columns_shown} may be {f'in {unit}' if unit else 'intensities'}."
    unit = unit or unit_in(f"1 {columns[0].texts[0]}")  # a row below the names may have units
    are_intensities = _are_intensities(names[0], stimuli[rows], reason)
    table.problems.ask(
        problem, intensity_remedies(stimuli[rows], unit, are_intensities=are_intensities)
    )


def _are_intensities(name: str, stimuli: FloatArray, reason: str) -> bool:
    """Whether stimuli without a unit are evidently intensities, by the name of their column.

    `reason` says why the numbers can be no natural logs; it is empty if they can.

    Examples
    --------
    >>> tones = np.array([400.0, 600.0])
    >>> _are_intensities("stim1", tones, "..."), _are_intensities("pitch1", tones, "...")
    (True, False)
    >>> _are_intensities("dur1", tones / 1000.0, ""), _are_intensities("stim1", tones / 10.0, "...")
    (True, False)
    """
    low = stimuli.min()
    high = stimuli.max()
    if not has_word(name, "of_quantities"):
        # No sound has a level of 140 dB. Pitches in cents are large numbers in a narrow range.
        is_scale = has_word(name, "of_scales")
        return bool(reason and low > 140.0 and high > 1.3 * low and not is_scale)
    if reason:
        return bool(low > 1.0)  # whole numbers from 1 may number levels
    # Logarithms of such quantities in their usual units are larger, or below 0.
    return bool(low > 0.0 and high < 2.0)


# --- Pairs in the names of columns ----------------------------------------------------------------

_STIMULUS = r"(-?[\d.,]+ ?(?:[^\W\d_]+|%)?)"  # with a unit or without


def pair_regex(pattern: str) -> re.Pattern[str]:
    """The regular expression that finds both stimuli in names or cells of a pattern.

    Examples
    --------
    >>> pair_regex("*{first}_{second}").fullmatch("q_100_112").groups()
    ('100', '112')
    """
    regex = re.escape(pattern).replace(r"\*", ".*?")
    return re.compile(regex.replace(r"\{first\}", _STIMULUS).replace(r"\{second\}", _STIMULUS))


def known_names(names: Texts, options: ReadOptions) -> set[str]:
    """The names in a table whose columns are read, or choose the rows that are read."""
    pairs = []
    if options.wide is not None:
        pairs = list(filter(pair_regex(options.wide).fullmatch, names))
    likely_options = with_likely_columns(names, options)
    names_read = {likely_options.name(role) for role in (*COLUMNS, "correct", "standard_interval")}
    return {*names_read, "synthetic", *options.where, *pairs} & set(names)


def with_pairs(table: TextTable, options: ReadOptions) -> TextTable:
    """The table with columns of the stimuli, which are read from names of columns or from cells.

    A name or a cell has both stimuli if it fits the pattern `wide` of these options.

    Raises
    ------
    InputError
        If no name of a column fits the pattern, and the cells of no column or of several columns
        do, or if two columns whose names fit have the same name.
    """
    regex = pair_regex(options.wide or "")  # the caller has found that `wide` is not None
    pair_names = list(filter(regex.fullmatch, table.names))  # the columns that name two stimuli
    if pair_names:
        # In a file of Qualtrics, a row of questions stands below the names, and then a row of cells
        # such as '{"ImportId":"QID1"}'. Of fewer than two rows, the slice is empty.
        if "ImportId" in "".join(table.columns[pair_names[0]].map(str, object)[1:2]):
            table = table.only(table.rows > table.rows[1], "2 rows of questions left out")
        table = _by_pair(table, pair_names)
        column = table.columns[PAIR]
        origin = f"names of {len(pair_names)} columns"
    else:
        fitting_columns = [
            column for column in table.columns.values() if all(map(regex.fullmatch, column.texts))
        ]
        if len(fitting_columns) != 1:
            raise InputError(
                f"{table.source}: found {len(fitting_columns)} columns whose cells are all two "
                "numbers as --wide has them, and no such names; allowed: one such column, or "
                "several such names"
            )
        column = fitting_columns[0]
        origin = str(column)

    new_columns = {**table.columns}
    # All texts of the column fit. The filter shows to the type checker that no match is None.
    matches = list(filter(None, map(regex.fullmatch, column.texts)))
    for group, name in enumerate(options.stimulus_names, start=1):
        texts = [match[group] for match in matches]
        new_columns[name] = Column.from_texts(name, texts, column.codes)

    other_names = [name for name in table.names if name != column.name]
    names = [*other_names, *options.stimulus_names]
    return replace(
        table,
        names=names,
        columns=new_columns,
        notes=(*table.notes, f"pairs read from {origin}"),
    )


def _by_pair(table: TextTable, names: Texts) -> TextTable:
    """The table with a row for each cell of the columns with these names.

    Two new columns replace these columns: `PAIR` has the name of the column in which the cell
    stood, and `CELL` has the cell. All other columns of the table stay.
    """
    repeated = repeated_columns(names, dict.fromkeys(names))
    if repeated:
        table.require(repeated)

    # The cells of the first row come first, in the order of the names: each new row has the index
    # of an old row and of a name.
    row, name_code = np.indices((len(table.rows), len(names))).reshape(2, -1)
    # Shape (rows, names).
    cells = np.column_stack([table.columns[name].map(str, object) for name in names])
    long_table = table.only(row)
    pairs = _without_repetitions(names)
    columns = {**long_table.columns, PAIR: Column.from_texts(PAIR, pairs, name_code)}
    columns[CELL] = Column.from_texts(CELL, cells.ravel())
    for name in names:
        del columns[name]
    all_names = [*filterfalse(names.__contains__, table.names), PAIR, CELL]
    return replace(long_table, names=all_names, columns=columns)


def _without_repetitions(names: Texts) -> Texts:
    """Names without the numbers '.1', '.2' that programs add to equal names, as in '100_112.1'.

    Names with such numbers have no other dot, and are mostly equal without them.
    """
    bare_names = [re.sub(r"\.\d+$", "", name) for name in names]
    if len(set(bare_names)) < 0.6 * len(names) and "." not in "".join(bare_names):
        return bare_names
    return names
