"""Files as labs have them: each is read as it is meant, or refused with what to type.

Most files hold the same trials of two subjects, 'which was stronger?', each in another shape.
"""

import gzip
import io
import json
import random
import re
import shlex
import zipfile
from contextlib import suppress

import h5py
import numpy as np
import pandas as pd
import pytest
from commands import on_one_line, refusal_of, run_command
from conftest import each_row, problems, read, refused, text_table, typed_options
from numpy.random import default_rng
from scipy.io import savemat

import bayes_toe as bt
from bayes_toe.data.messages import display_name

GRAMS = (740, 905, 1105, 1350)


def made_up_trials():
    """A table with all columns that a shape may need: 40 trials of P03, and 40 of P12.

    Two weights in grams are compared; the natural logs of kilograms are rounded to 4 decimals.
    """
    rng = default_rng(1)
    table = pd.DataFrame({"subject": ["P03"] * 40 + ["P12"] * 40})
    table["w1"], table["w2"] = (rng.choice(GRAMS, 80) for _ in range(2))
    table["s1"], table["s2"] = (np.log(table[name] / 1000).round(4) for name in ("w1", "w2"))
    difference = np.log(table.w2 / table.w1)
    is_second = difference + rng.normal(0.05, 0.2, 80) > 0
    table["response"] = np.where(is_second, "second", "first")
    table["correct"] = is_second == (difference > 0)
    return table


TRIALS = made_up_trials()
#: The trials as the program expects them; all shapes below are compared with these.
IN_LOGS = TRIALS[["subject", "s1", "s2", "response"]]
IN_GRAMS = TRIALS[["subject", "w1", "w2", "response"]]
UNEQUAL = TRIALS[TRIALS.w1 != TRIALS.w2]
COUNTS = (
    IN_LOGS.assign(n_second=TRIALS.response == "second")
    .groupby(["subject", "s1", "s2"])
    .n_second.agg(["sum", "size"])
    .reset_index()
    .set_axis(["subject", "s1", "s2", "n_second", "n_trials"], axis=1)
)
PROPORTIONS = COUNTS.assign(n_second=(COUNTS.n_second / COUNTS.n_trials).round(3))
RIGHT_COUNTS = COUNTS[COUNTS.s1 != COUNTS.s2].assign(
    hits=COUNTS.n_second.where(COUNTS.s2 > COUNTS.s1, COUNTS.n_trials - COUNTS.n_second)
)
TALLY = COUNTS.assign(n_first=COUNTS.n_trials - COUNTS.n_second).drop(columns="n_trials")
FIRST_COUNTS = TALLY.drop(columns="n_second").assign(n_trials=COUNTS.n_trials)
STANDARD_FIRST = COUNTS.s1 <= COUNTS.s2
BY_COMPARISON = pd.DataFrame(
    {
        "subject": COUNTS.subject,
        "standard": COUNTS.s1.where(STANDARD_FIRST, COUNTS.s2),
        "comparison": COUNTS.s2.where(STANDARD_FIRST, COUNTS.s1),
        "order": np.where(STANDARD_FIRST, "SC", "CS"),
        "n_chosen": COUNTS.n_second.where(STANDARD_FIRST, COUNTS.n_trials - COUNTS.n_second),
        "n_trials": COUNTS.n_trials,
    }
)
BY_LETTER = BY_COMPARISON.set_axis(
    ["subject", "toneA", "toneB", "order", "n_comparison", "n_trials"], axis=1
).replace({"SC": "AB", "CS": "BA"})
CORRECT_ANSWERS = np.where(TRIALS.w2 > TRIALS.w1, "second", "first")
IN_PERCENT = PROPORTIONS.assign(n_second=PROPORTIONS.n_second.map("{:.1%}".format))

TERNARY = IN_LOGS.assign(response=TRIALS.response.where(TRIALS.s1 != TRIALS.s2, "same"))
TERNARY_COUNTS = "subject,s1,s2,first,same,second\na,0,0.3,1,2,5\na,0.3,0,4,2,1\n"

FREQUENCIES = IN_LOGS.value_counts(sort=False).reset_index(name="Freq")
IN_ROOMS = IN_LOGS.assign(room=["A", "B"] * 40).value_counts(sort=False).reset_index(name="n")


def comparable_rows(study):
    """The rows of a study with subjects by number, and levels above the lowest one to 0.01.

    So studies in different units or with other names of subjects are the same table.
    """
    frame = study.frame()
    levels = (frame[["s1", "s2"]] - frame.s1.min()).round(2) + 0.0
    return frame.assign(subject=frame.subject.map(study.names.index), s1=levels.s1, s2=levels.s2)


def csv_bytes(table, encoding="utf-8", **style):
    return table.to_csv(index=False, **style).encode(encoding)


def excel_bytes(**sheets):
    data = io.BytesIO()
    with pd.ExcelWriter(data) as writer:
        for name, table in sheets.items():
            table.to_excel(writer, sheet_name=name, index=False)
    return data.getvalue()


def matlab_bytes(variables):
    data = io.BytesIO()
    savemat(data, variables)
    return data.getvalue()


def matlab_cell(file, path, value):
    """A reference to a text or a number, as MATLAB keeps them in cells and fields."""
    kind = "double"
    if isinstance(value, str):
        value, kind = np.array([list(map(ord, value))], np.uint16).T, "char"
    cell = file.create_dataset(path, data=value)
    cell.attrs["MATLAB_class"] = np.bytes_(kind)
    return cell.ref


def matlab_73(columns, home=""):
    """Vectors, or fields of a struct `home`, as MATLAB writes them into a file of version 7.3."""
    data = io.BytesIO()
    with h5py.File(data, "w", userblock_size=512) as file:
        for name, values in columns.items():
            if home or isinstance(values[0], str):
                cells = []
                for i, value in enumerate(values):
                    cells.append(matlab_cell(file, f"#refs#/{name}{i}", value))
                file[f"{home}/{name}"] = np.array([cells], h5py.ref_dtype)
            else:
                matlab_cell(file, name, [values])
    header = b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(124) + b"\0\2IM"
    return header + data.getvalue()[128:]


def linked_73():
    """A file of version 7.3 that leads to another file."""
    data = io.BytesIO(matlab_73({"s1": [0.0]}))
    with h5py.File(data, "a") as file:
        file["subject"] = h5py.ExternalLink("other.h5", "/subject")
    return data.getvalue()


def labelled(table, **names):
    return table.rename(columns=names)


def with_responses(table, first, second):
    return table.assign(response=table.response.map({"first": first, "second": second}))


def with_rows_above(table, rows):
    return pd.concat([pd.DataFrame(rows, columns=table.columns), table])


def german_number(value):
    return f"{value:.4f}".replace(".", ",")


GERMAN = pd.DataFrame(
    {
        "Versuchsperson": TRIALS.subject,
        "Reiz 1": TRIALS.s1.map(german_number),
        "Reiz 2": TRIALS.s2.map(german_number),
        "Urteil": TRIALS.response.map({"first": "erster", "second": "zweiter"}),
    }
)
GERMAN_PAIR = "--columns 's1=Reiz 1,s2=Reiz 2'"
BY_NUMBER = "--columns subject=1,s1=2,s2=3,response=4"
LISTS = IN_LOGS.to_dict("list")
P03 = IN_LOGS[:40]
WITHOUT_SUBJECT = P03.drop(columns="subject")
NESTED = {"info": {"subject": "P03"}, "trials": P03[["s1", "s2", "response"]].to_dict("list")}
MATRIX = {
    "subject": "P03",
    "data": with_responses(P03, 1, 2).drop(columns="subject").to_numpy(float),
}
RECORDS = IN_LOGS.to_dict("records")
BY_PERSON = []
for name, part in IN_LOGS.groupby("subject"):
    trials = part.drop(columns="subject").to_dict("records")
    BY_PERSON.append({"subject": name, "trials": trials})
DECIBEL = IN_GRAMS[["subject", "response"]].assign(
    s1_dB=20 * np.log10(TRIALS.w1), s2_dB=20 * np.log10(TRIALS.w2)
)
SCORED = UNEQUAL[["subject", "s1", "s2", "correct"]].assign(key="j", rt="0.4")
PAIRS = IN_GRAMS.assign(pair=TRIALS.w1.astype(str) + "_" + TRIALS.w2.astype(str))
WIDE = (
    PAIRS.assign(repetition=PAIRS.groupby(["subject", "pair"]).cumcount())
    .pivot(index=["subject", "repetition"], columns="pair", values="response")
    .reset_index()
)


def with_repetitions(name):
    """A row for each subject, with the trials of each pair in columns of this name."""
    table = WIDE.set_index(["subject", "repetition"]).unstack()
    names = [name.format(pair, repetition) for pair, repetition in table.columns]
    return table.set_axis(names, axis=1).reset_index()


WIDE_COUNTS = "subject,740_905,905_740,905_1105,1105_905,n\nP03,31,9,28,11,40\nP12,28,4,34,12,40\n"
IN_SHARES = WIDE_COUNTS.replace(",40", ",100").replace("31,9", "31%,9.0%")
NO_RESPONSES = "NA|n/a||none|null|-99|999|.|timeout|no response"


def with_practice(column, practice, main):
    """All trials below eight rows of practice of P03; `column` has these two cells."""
    rows = with_rows_above(IN_LOGS, [["P03", 0, 0.3, "second"]] * 8)
    return rows.assign(**{column: [practice] * 8 + [main] * 80})


def with_rows_of_zeros(table, n_rows=20, **zeros):
    """Trials above rows of zeros, as of a session that stopped before a matrix was filled."""
    rows = pd.DataFrame(0, index=range(n_rows), columns=table.columns)
    return pd.concat([table, rows.assign(**zeros)])


def workbook_with(workbook, pattern, replacement):
    """A workbook with something replaced in its XML, by regular expression."""
    data = io.BytesIO()
    with zipfile.ZipFile(io.BytesIO(workbook)) as book, zipfile.ZipFile(data, "w") as saved:
        for name in book.namelist():
            saved.writestr(name, re.sub(pattern, replacement, book.read(name)))
    return data.getvalue()


CODED = with_responses(IN_LOGS, 0, 1)
RARE_CODE = with_rows_above(with_responses(IN_LOGS, 1, 2), [["P03", 0, 0.3, -9]] * 7)
PSYCHOPY = with_rows_above(
    labelled(IN_LOGS, response="key_resp.keys"), [["P03", 0, 0.3, "second"]] * 2
).assign(
    **{"practice.thisN": [0, 1, *[""] * 80], "trials.thisN": ["", "", *range(80)]},
    **{"key_practice.keys": "space", "instr.keys": ""},
)
JATOS = "\n".join(part.to_json(orient="records") for _, part in IN_LOGS.groupby("subject"))
SEPARATORS = "\n".join(
    json.dumps({**record, "note": "a\u2028b\u0085c"}, ensure_ascii=False) for record in RECORDS
)
ROW_NAMES = IN_LOGS.set_axis(range(1, 81)).to_csv().removeprefix(",")
WITH_LEFT_CELLS = "\n".join(
    "".join(map("{:12}".format, cells)) for cells in [IN_LOGS.columns, *IN_LOGS.astype(str).values]
)
WITH_TITLE = pd.DataFrame([GERMAN.columns, *GERMAN.values], columns=["Versuch 1", "", "", ""])
WITH_FORMULA = with_rows_above(IN_LOGS, [["P03", 0, 0.3, '=IF(A2="", "", B2)']])
WITH_ERRORS = IN_LOGS.assign(mean="#DIV/0!", sum="=A2")
FORMATTED_ROW = '<row r="{0}" s="1"><c r="A{0}" s="1"/><c r="XFD{0}" s="1"/></row>'
FORMATTED_ROWS = "".join(map(FORMATTED_ROW.format, range(100, 50_000)))

#: The name of a file with the options that are typed after it, and its content: a table is written
#: as CSV, records as JSON.
READ = {
    "dots.csv --columns s1=n_first,s2=n_second --unit ln": labelled(
        IN_LOGS, s1="n_first", s2="n_second"
    ),
    "frequencies.csv": FREQUENCIES,
    "no_trials_without_frequency.csv": pd.concat(
        [FREQUENCIES, FREQUENCIES[:1].assign(response="first", s2=2.0, Freq=0)]
    ),
    "frequencies_in_rooms.csv": IN_ROOMS,
    "weights.csv --columns n_trials=weight": labelled(FREQUENCIES, Freq="weight"),
    "counts_of_both.csv": TALLY,
    "counts_of_first.csv": FIRST_COUNTS,
    # The standard and the comparison have each other's names.
    "counts_of_the_standard.csv --standard-interval order --standard-first-code CS": labelled(
        BY_COMPARISON, standard="comparison", comparison="standard", n_chosen="n_standard"
    ),
    "missed_trials_counted.csv": TALLY.assign(n_missed=9 - TALLY.n_first - TALLY.n_second),
    "n_erster_zweiter.csv": labelled(TALLY, n_first="n erster", n_second="n zweiter"),
    "counts_of_unclear_answers.csv --columns n_first=lighter,n_second=heavier,response=heavier": (
        labelled(TALLY, n_first="lighter", n_second="heavier")
    ),
    "counts_by_stimulus.csv --standard-interval order": BY_COMPARISON.drop(
        columns="n_trials"
    ).assign(
        standard_heavier=BY_COMPARISON.n_trials - BY_COMPARISON.n_chosen,
        comparison_heavier=BY_COMPARISON.n_chosen,
    ),
    "counter.csv": IN_LOGS.assign(n=np.arange(80) % 20),
    "comma.csv": IN_LOGS,
    "tab.tsv": csv_bytes(IN_LOGS, sep="\t"),
    "tab.xls": csv_bytes(IN_LOGS, sep="\t"),
    "bar.txt": csv_bytes(IN_LOGS, sep="|"),
    "aligned.txt": IN_LOGS.to_string(index=False),
    "aligned_left.txt": WITH_LEFT_CELLS,
    "spaces.txt": csv_bytes(IN_LOGS, sep=" ", quoting=2),
    "utf16_without_mark.csv": csv_bytes(IN_LOGS, "utf-16-le"),
    "windows.csv": csv_bytes(IN_LOGS.assign(note="größer"), "cp1252"),
    "encoding.csv --encoding mac_roman": csv_bytes(IN_LOGS.assign(note="größer"), "mac_roman"),
    "lines_above.csv": b"Experiment 1\n\nlab 3\n" + csv_bytes(IN_LOGS),
    f"no_names.csv {BY_NUMBER}": csv_bytes(IN_LOGS, header=False),
    f"no_names.txt {BY_NUMBER}": csv_bytes(IN_LOGS, sep=" ", header=False),
    f"no_names.xlsx {BY_NUMBER}": excel_bytes(
        T=IN_LOGS[1:].set_axis(list(IN_LOGS.iloc[0]), axis=1)
    ),
    "expyriment.xpd": b"# -*- coding: UTF-8 -*-\n#e Experiment: A, B\n#s id: 3\n"
    + csv_bytes(IN_LOGS),
    "names_in_two_lines.csv --columns 's1=First (ln)'": labelled(IN_LOGS, s1="First\n(ln)"),
    "ln_in_names.csv": IN_LOGS.rename(columns={"s1": "ln 1", "s2": "ln 2"}),
    "logs_from_0.csv --columns s1=x1,s2=x2": IN_LOGS.rename(columns={"s1": "x1", "s2": "x2"}),
    "decimal_commas.csv": csv_bytes(IN_LOGS, decimal=","),
    "last_comma.csv": IN_LOGS.assign(**{"": ""}),
    "last_comma_of_rows.csv": re.sub("(?<=[td])\n", ",\n", "trial," + ROW_NAMES),
    "gorilla.csv": csv_bytes(IN_LOGS) + b"END OF FILE\n",
    "remarks_below.csv": csv_bytes(IN_LOGS) + b"\n# stopped at 12:30, by hand\n#\n",
    "names_of_history.csv": IN_LOGS.assign(Trial=list(range(40)) * 2, Block=1, Session="a"),
    "quoted.csv": csv_bytes(IN_LOGS.assign(note="two\nlines"), quoting=1),
    f"german_windows.csv {GERMAN_PAIR}": csv_bytes(GERMAN, "cp1252", sep=";"),
    "french.csv": labelled(with_responses(IN_LOGS, "première", "deuxième"), response="réponse"),
    "participant.csv": labelled(IN_LOGS, subject="Participant ID", response="choice"),
    "true_false.csv --second-code True": with_responses(IN_LOGS, False, True),
    "interval.csv": labelled(
        with_responses(IN_LOGS, "interval 1", "Interval 2"), response="Response_Interval"
    ),
    "heavier.csv": with_responses(IN_LOGS, "first heavier", "second was heavier"),
    "surely.csv": with_responses(IN_LOGS, "surely first", "vielleicht zweiter"),
    "trials.json": RECORDS,
    "by_person.json": BY_PERSON,
    "pandas.json": IN_LOGS.to_json(),
    "in_a_key.json": {"trials": RECORDS, "version": 2},
    "by_column.json": LISTS,
    "table.xlsx": excel_bytes(Trials=IN_LOGS),
    f"german.xlsx {GERMAN_PAIR}": excel_bytes(Info=pd.DataFrame({"by": ["lab"]}), Daten=GERMAN),
    f"title.xlsx {GERMAN_PAIR}": excel_bytes(Daten=WITH_TITLE),
    "two_sheets.xlsx --sheet B": excel_bytes(A=IN_LOGS, B=IN_LOGS),
    "a_sheet_a_subject.xlsx --sheet {}": excel_bytes(
        **{name: rows.drop(columns="subject") for name, rows in IN_LOGS.groupby("subject")},
        Codes=pd.DataFrame({"response": ["first"], "meaning": ["the first was stronger"]}),
    ),
    "a_sheet_a_session.xlsx --sheet *": excel_bytes(A=IN_LOGS[:30], B=IN_LOGS[30:]),
    "some_sheets.xlsx --sheet 'day *'": excel_bytes(
        **{"day 1": IN_LOGS[:9], "day 2": IN_LOGS[9:], "practice": IN_LOGS}
    ),
    "errors_elsewhere.xlsx": excel_bytes(Trials=WITH_ERRORS, Info=pd.DataFrame(["#REF!"])),
    "formulas_below.xlsx": excel_bytes(
        T=pd.concat([IN_LOGS, IN_LOGS[:1].assign(subject="mean", s1="=B2", s2="=C2", response="")])
    ),
    "session_by_date.xlsx": excel_bytes(T=IN_LOGS.assign(session=pd.Timestamp("2026-11-30"))),
    # As Excel saves it if all formulas give an empty text.
    "empty_texts.xlsx": workbook_with(
        excel_bytes(T=WITH_FORMULA), rb'("[A-Z]\d+")(?=><f>)', rb'\1 t="str"'
    ),
    "vectors.mat": matlab_bytes(LISTS),
    "struct_and_vector.mat": matlab_bytes({"data": LISTS, "screen": [1920, 1080]}),
    "struct.mat": matlab_bytes({"data": LISTS}),
    "nested.mat": matlab_bytes({"data": NESTED}),
    "matrix.mat --second-code 2": matlab_bytes(
        {"test": {**MATRIX, "names": np.array(["s1", "s2", "answer"], "O")}}
    ),
    "matrix.mat --columns s1=1,s2=2,response=3 --second-code 2": matlab_bytes(MATRIX),
    "nested.json": NESTED,
    "parts.json --columns s1=a.ms,s2=b.ms --unit ln": [
        {**record, "a": {"ms": record["s1"], "x": 0}, "b": {"ms": record["s2"], "x": 1}}
        for record in RECORDS
    ],
    "vectors_73.mat": matlab_73(LISTS),
    "struct_array_73.mat": matlab_73(LISTS, home="data"),
    "counts.csv": COUNTS,
    "other_counts.csv": labelled(COUNTS, n_second="second", n_trials="total"),
    "proportions.csv": PROPORTIONS,
    "counts_of_the_comparison.csv --standard-interval order": labelled(
        BY_COMPARISON, standard="fixed", comparison="level", n_chosen="n_comparison"
    ),
    "a_and_b.csv --standard-interval order --columns standard=toneA,comparison=toneB "
    "--standard-first-code AB": BY_LETTER,
    "right_answers.csv --columns n_correct=hits": RIGHT_COUNTS.drop(columns="n_second"),
    "counts_by_a_name.csv --standard-interval order --columns n_comparison=n_chosen": BY_COMPARISON,
    "percent_and_n.csv": labelled(IN_PERCENT, n_second="% second", n_trials="N"),
    "grams.csv --intensity 1000 --columns i1=w1,i2=w2": IN_GRAMS,
    "grams_by_unit.csv --unit g": labelled(IN_GRAMS, w1="i1", w2="i2"),
    "decibel.csv": DECIBEL,
    "decibel_by_option.csv --unit dB --columns s1=s1_dB,s2=s2_dB": DECIBEL,
    "decibel_by_columns.csv --columns s1=s1_dB,s2=s2_dB": DECIBEL,
    "grams_by_name.csv": labelled(IN_GRAMS, w1="weight1_g", w2="weight2_g").assign(
        rt1_ms=1, rt2_ms=2, click1_s=1, click2_s=2
    ),
    "sign_of_micro.csv": labelled(IN_GRAMS, w1="a1 \u00b5m", w2="a2 \u00b5m"),
    "letter_mu.csv": labelled(IN_GRAMS, w1="a1 \u03bcm", w2="a2 \u03bcm"),
    "units_in_cells.csv --unit g --columns i1=w1,i2=w2": IN_GRAMS.assign(
        w1=TRIALS.w1.map("{} g".format), w2=TRIALS.w2.map("{}g".format)
    ),
    "names_of_files.csv --unit g --columns s1=w1,s2=w2": IN_GRAMS.assign(
        w1=TRIALS.w1.map("./pictures/weight-{}g.png".format),
        w2=TRIALS.w2.map("./pictures/weight-{}g.png".format),
    ),
    "decadic.csv --unit log10": IN_LOGS.assign(s1=np.log10(TRIALS.w1), s2=np.log10(TRIALS.w2)),
    "cents.csv --unit cents": IN_LOGS.assign(
        s1=1200 * np.log2(TRIALS.w1), s2=1200 * np.log2(TRIALS.w2)
    ),
    "wide.csv --wide {first}_{second} --unit g": WIDE,
    "questions.csv --wide {first}_{second} --unit g": with_rows_above(
        WIDE, [["Which one?"] * 18, ['{"ImportId":"Q"}'] * 18]
    ),
    "pair_in_a_cell.csv --wide {first}_{second} --unit g": PAIRS[["subject", "pair", "response"]],
    "pair_with_units.csv --wide '{first} vs {second}' --unit Hz": PAIRS.assign(
        pair=TRIALS.w1.map("{} Hz vs ".format) + TRIALS.w2.map("{} Hz".format)
    )[["subject", "pair", "response"]],
    "signs_in_a_name.csv --columns 'response=key (1=first, 2=second)'": labelled(
        IN_LOGS, response="key (1=first, 2=second)"
    ),
    "missing_words.csv": with_rows_above(
        IN_LOGS, [["P03", 0, 0.3, word] for word in NO_RESPONSES.split("|")]
    ),
    "practice_counter.csv": IN_LOGS.assign(practice=range(80)),
    "where.csv --where kind=main": with_practice("kind", "other", "main"),
    "practice.csv": with_practice("phase", "practice", "main"),
    "merged.csv": IN_LOGS.assign(subject=IN_LOGS.subject.mask(IN_LOGS.subject.duplicated())),
    "units.csv --second-code 1": with_rows_above(
        CODED, [["", "ln", "ln", "0/1"], ["P03", "null", "NA", '{"age":"23"}']]
    ),
    "instructions.csv": with_rows_above(IN_LOGS, [["P03", "", "", ""]] * 2),
    "start_screen.csv": with_rows_above(
        IN_LOGS, [["P03", "", "", "first"], ["P12", 0.3, "NA", "second"]]
    ),
    "missed_trials.csv --correct correct": with_rows_above(
        SCORED, [["P03", 0.3, 0.0, False, "", ""]] * 9
    ),
    "trained.csv": IN_LOGS.assign(training=1),
    "trained_with_a_screen.csv": with_rows_above(IN_LOGS, [["P03", "", "", ""]]).assign(
        loop=[""] + ["training"] * 80
    ),
    "psychopy.csv": PSYCHOPY,
    "trained_group.csv": IN_LOGS.assign(training=[1] * 40 + [0] * 40),
    "trained_groups.csv": IN_LOGS.assign(group=["training"] * 40 + ["control"] * 40),
    "unfilled.csv --second-code 1": with_rows_of_zeros(CODED, subject="P12"),
    "unfilled_subject.csv --second-code 1": with_rows_of_zeros(
        CODED.replace({"P03": "3", "P12": "12"})
    ),
    "unfilled_grams.csv --intensity 1000 --columns i1=w1,i2=w2 --second-code 39 --first-code 37": (
        with_rows_of_zeros(with_responses(IN_GRAMS, 37, 39).assign(rt=512), subject="P12")
    ),
    "rare_code.csv --missed -9 --second-code 2": RARE_CODE,
    "header_again.xlsx": excel_bytes(
        T=pd.concat([P03, with_rows_above(IN_LOGS[40:], [IN_LOGS.columns])])
    ),
    "files_below_each_other.csv": csv_bytes(IN_LOGS[:30])
    + b"# end\n# day 2, 9:30\n"
    + csv_bytes(IN_LOGS[30:]),
    "arrays_line_by_line.txt": JATOS,
    "separators.jsonl": SEPARATORS,
    "row_names.csv": ROW_NAMES,
    "chinese.csv": labelled(
        with_responses(IN_GRAMS, "第一个", "第二个"),
        subject="被试",
        w1="第一_g",
        w2="第二_g",
        response="反应",
    ),
    "presentation.txt": "Scenario - pitch\nLogfile written - 1 May\n\n"
    + csv_bytes(IN_LOGS, sep="\t").decode(),
    "forces.csv": labelled(IN_GRAMS, w1="first_N", w2="second_N"),
    "luminances.csv": labelled(IN_GRAMS, w1="lum1_cd_m2", w2="lum2_cd_m2"),
    "row_names.txt": ROW_NAMES.replace(",", " "),
    "list_keys.csv --second-code j": with_responses(IN_LOGS, "['f']", "['j']"),
    "row_names_from_0.csv": IN_LOGS.to_csv().removeprefix(","),
    "sample.csv --columns s1=sample,s2=probe": labelled(IN_LOGS, s1="sample", s2="probe"),
    "other_names.txt --columns subject=p,s1=w1,s2=w2,response=r": csv_bytes(
        labelled(IN_LOGS, subject="p", s1="w1", s2="w2", response="r"), sep=" "
    ),
    "formats.xlsx": workbook_with(
        excel_bytes(T=IN_LOGS), b"</sheetData>", f"{FORMATTED_ROWS}</sheetData>".encode()
    ),
    "7.csv --subject-from {}.*": WITHOUT_SUBJECT,
    "more_columns.csv": IN_LOGS.assign(rt=0.5, confidence=3, index=range(80)),
}
#: The trials that are read, by the name of the file, where they are not all trials.
READ_IN_PART = {
    "third_answer.csv": pd.DataFrame(
        [["a", 0, 0.3, 1, 2, 5], ["a", 0.3, 0, 4, 2, 2], ["a", 0, 0, 3, 3, 2]],
        columns=["subject", "s1", "s2", "n_first", "n_equal", "n_second"],
    ),
    **dict.fromkeys(["nested.mat", "matrix.mat", "nested.json", "7.csv", "P03.csv"], P03),
    "missed_trials.csv": UNEQUAL[IN_LOGS.columns],
    "right_answers.csv": UNEQUAL[IN_LOGS.columns],
    "scored_rats.csv": UNEQUAL[IN_LOGS.columns],
}
#: The beginning of a note on a file, by the name of the file, for some of the files.
NOTES = """
    windows.csv | trial rows, comma-separated, Windows-1252 (--encoding NAME if that is wrong), resp
    utf16_without_mark.csv | trial rows, comma-separated, UTF-16, resp
    encoding.csv | trial rows, comma-separated, mac_roman, resp
    lines_above.csv | rows above row 4 left out
    header_again.xlsx | 1 repeated header left out
    participant.csv | column Participant ID read as subject
    psychopy.csv | 2 rows left out as practice or catch trials (column practice.thisN: '0', '1')
    units.csv | 2 rows without stimuli and response left out
    questions.csv | 2 rows of questions left out
    merged.csv | column subject: 78 empty cells filled with the name above
    practice.csv | 8 rows left out as practice or catch trials (column phase: 'practice')
    unfilled.csv | 20 rows left out as unfilled (stimuli and response are 0 in the last rows): P12
    separators.jsonl | trial rows, JSON, UTF-8, resp
    start_screen.csv | 2 rows with a response and without both stimuli left out: P03 1, P12 1
    missed_trials.csv | 9 trials without a response dropped (empty in column key, empty in column rt
    table.xlsx | trial rows, Excel, resp
    counts_of_both.csv | grouped rows, comma-separated, UTF-8, 80 trials, 50 'second', 30 'first'
    decibel.csv | column s1_dB read as s1, dB
    grams_by_name.csv | column weight2_g read as i2, intensity in g
    gorilla.csv | remarks below rows left out
    files_below_each_other.csv | remarks below rows left out
    forces.csv | column first_N read as i1, intensity in N
    luminances.csv | column lum1_cd_m2 read as i1, intensity in cd/m2
    names_of_history.csv | column Trial read as trial
    decimal_commas.csv | trial rows, comma-separated, UTF-8, decimal comma, resp
    a_sheet_a_session.xlsx | 1 subject in several files
    german.xlsx | sheet Daten read, not Info
    title.xlsx | rows above row 2 left out
    missing_words.csv | 10 trials without a response dropped ('-99', '999', '.', 'timeout',
"""
NOTE_BY_NAME = dict(text_table(NOTES))

#: The name of a file with options, its content, and parts of the refusal: the problem, and what to
#: type.
REFUSED = {
    "dots.csv": (
        "subject,n_first,n_second,response\na,18,12,first\na,12,18,second\n",
        "type:  --columns s1=n_first,s2=n_second --unit a.u. ",
    ),
    "speeds.csv --columns standard=v,comparison=v_test": (
        "subject,v,v_test,response\na,18,12,first\na,12,18,second\n",
        "columns v and v_test do not say which stimulus came first",
    ),
    "keys_beside_ratings.csv": (
        "subject,s1,s2,key,response\n" + "a,0,1,j,4\na,1,0,f,3\na,0,1,j,2\na,1,0,f,1\n" * 9,
        "type:  --columns response=key --second-code j\n",
    ),
    "opposite_keys.csv": (
        "subject,s1,s2,key,correct\n" + "a,0,1,j,1\na,1,0,f,1\n" * 8 + "b,0,1,f,1\nb,1,0,j,1\n" * 8,
        "In b they seem to mean the opposite, as where keys are counterbalanced: --correct",
        "type:  --columns response=key --correct correct ",
    ),
    "responses_and_trials.csv": (
        IN_LOGS.assign(n_trials=40),
        "column n_trials: found beside responses, allowed: one row for each response of a",
    ),
    "most_trials.csv": (
        FREQUENCIES.assign(Freq=10**6),
        "column Freq: found 37,000,000 trials, allowed: at most 10,000,000",
    ),
    "half_trials.csv --columns n_trials=Freq": (
        FREQUENCIES.assign(Freq=0.5),
        "column Freq: found '0.5' in 37 rows",
        "a whole number from 0 to 10^12",
    ),
    "no_names.csv": (
        csv_bytes(IN_LOGS, header=False),
        "The columns are 1, 2, 3, 4. The file has no header, so these are the numbers of its col",
        "type:  --columns subject=1,s1=2,s2=3,response=4",
    ),
    "row_names_of_a_part.csv": (
        IN_LOGS.set_axis(range(3, 83)).to_csv().removeprefix(","),
        "row 2: found 5 cells below 4 names, allowed: a name for each column",
    ),
    "numbers.json": ("[1, 2]", "error: numbers.json: found "),
    "trial.csv": (
        labelled(IN_LOGS, s1="trial.s1", s2="trial.s2"),
        "type:  --columns s1=trial.s1,s2=trial.s2",
    ),
    "a_key_twice.json": (
        '[{"subject": "a", "s1": 0, "s2": 1, "response": "second", " response": "first"}]',
        "found the key 'response' twice in a record, allowed: once",
    ),
    "cut.json": ("{", "error: cut.json: found "),
    "deep.json": ("[" * 100_000, "error: deep.json: found "),
    "a.csv --encoding klingon": (IN_LOGS, "--encoding: found 'klingon', allowed: a name such"),
    "scores_of_same_different.csv --correct correct": (
        "subject,s1,s2,correct\na,0,0.3,1\na,0.3,0.3,1\na,0,0,0\na,0.3,0,1\n",
        "column correct: found 1 right and 1 wrong answers to equal stimuli, allowed: answers to",
    ),
    "right_if_equal.csv --correct correct": (
        "subject,s1,s2,correct\na,0,0,0\n" + "a,0,0,1\n" * 9 + "a,0,0.3,1\na,0.3,0,0\n" * 20,
        "column correct: found 9 right and 1 wrong answers to equal stimuli",
        "add a column with 'same' in these rows and 'different'",
    ),
    "codes_of_two_labs.csv": (
        "subject,s1,s2,response\na,0,1,1\na,1,0,0\nb,0,1,2\nb,1,0,1\n",
        "codes differ between subjects, 1 of a, b; 0 of a; 2 of b. Write the same codes for all",
    ),
    "rare_code_of_two.csv": (
        "subject,s1,s2,response\n" + "a,0,0.3,1\na,0.3,0,1\na,0,0,1\n" * 15 + "a,0,0.3,2\n" * 2,
        "type:  --second-code 2  if 2 is 'the second was stronger' (2AFC)\n"
        "       --second-code 1  if 1 is 'the second was stronger' (2AFC)\n"
        "       --equal-code 1   if 1 is 'equal' in a same-different task\n"
        "       --equal-code 2   if 2 is 'equal' in a same-different task\n",
    ),
    "rare_code.csv": (
        RARE_CODE,
        "type:  --missed -9 --second-code 2\n",
        "\n       --equal-code 2 --second-code -9  if 2 is 'equal' and -9 is 'second' of three",
    ),
    "rare_code.csv --second-code 2": (
        RARE_CODE,
        "type:  --missed -9                      only if nobody responded in these 7 trials; it dr",
    ),
    "three_codes_of_unknown_unit.csv": (
        "subject,i1,i2,response\na,1,2,x\na,2,1,y\na,2,2,z\n",
        "type:  --equal-code z --unit a.u. --second-code x\n",
        "\n       --second-code x --unit a.u.  ",
    ),
    "missing_cell.txt": (
        IN_LOGS.replace({"subject": {"P03": ""}}).to_string(index=False),
        "row 2: found 3 cells, allowed: 4 cells as in the header",
    ),
    "said_same.csv": (
        with_responses(IN_LOGS, 0, 1).rename(columns={"response": "said_same"}),
        "type:  --columns response=said_same --equal-code ",
    ),
    "comparison_of_three.csv": (
        "subject,standard,comparison,std_first,response\na,0,1,1,long\na,0,1,0,long\n"
        "a,0,-1,1,short\na,0,-1,0,short\na,0,0,1,equal\na,0,0,0,equal\n",
        "type:  --equal-code equal --comparison-code long  ",
    ),
    "keys.csv": (with_responses(IN_LOGS, "f", "j"), "'f' (", "--equal-code", "--second-code j"),
    "keys_of_same.csv": (with_responses(IN_LOGS, "s", "d"), "type:  --equal-code "),
    "same.csv": (
        labelled(with_responses(IN_LOGS, "Yes", "No"), response="Same?"),
        "type:  --columns 'response=Same?' --equal-code ",
    ),
    "two_keys.csv": (
        "subject,s1,s2,k.keys,k_2.keys\na,,,space,\na,0,0.3,,j\na,0.3,0,,f\n",
        "type:  --columns response=k_2.keys --second-code j",
    ),
    "rated.csv": (
        labelled(IN_LOGS, response="rating").replace({"first": 2, "second": 5}),
        "type:  --columns response=rating --second-code 5",
    ),
    "a_and_b.csv --columns s1=toneA,s2=toneB": (
        BY_LETTER,
        "columns toneA and toneB do not say which stimulus came first",
        "--standard-interval order --columns standard=toneA,comparison=toneB --standard-first-code "
        "AB\n",
        "--standard-first  ",
    ),
    "proposed_names.csv": (
        "worker,toneA,toneB,louder\na,0,0.3,B\na,0.3,0,A\n",
        "type:  --columns subject=worker,s1=toneA,s2=toneB,response=louder --second-code B",
    ),
    "german_names.csv": (csv_bytes(GERMAN, sep=";"), GERMAN_PAIR),
    "two_sheets.xlsx": (
        excel_bytes(A=IN_LOGS, B=IN_LOGS),
        "the sheets A and B have tables",
        "--sheet '{}'",
        "if all sheets are of one study",
        "--sheet A",
    ),
    "two_sheets.xlsx --sheet C": (
        excel_bytes(A=IN_LOGS, B=IN_LOGS),
        "found the sheets A, B, allowed: one of them",
    ),
    "two_sheets.xlsx --sheet C{}": (
        excel_bytes(A=IN_LOGS, B=IN_LOGS),
        "found the sheets A, B, allowed: one of them",
    ),
    "no_subjects.xlsx --sheet *": (
        excel_bytes(A=WITHOUT_SUBJECT, B=WITHOUT_SUBJECT),
        "--subject-from '{}'",
    ),
    "a.csv --sheet A": (IN_LOGS, "a.csv: found --sheet A, allowed: with an Excel file\n"),
    "formula.xlsx": (
        excel_bytes(T=IN_LOGS.assign(s1="=1+1")),
        "column s1: found '#N/A (a formula without a value)' in 80 rows, the first is row 2",
    ),
    "error.xlsx": (
        excel_bytes(T=IN_LOGS.assign(s1="#DIV/0!")),
        "column s1: found '#DIV/0!' in 80 rows, the first is row 2, allowed: a finite number",
    ),
    "error_for_a_name.xlsx": (
        excel_bytes(T=with_rows_above(IN_LOGS, [["#REF!", 0.3, 0.0, "first"]])),
        "column subject: found '#REF!', allowed: a text, and no error of a spreadsheet",
    ),
    "percent_in_cells.csv": (
        "subject,s1,s2,response\na,7.0%,5 %,first\na,5%,7%,second\n",
        "error: percent_in_cells.csv: the stimuli have the unit '%'.\ntype:  --unit %  if",
    ),
    "seconds.csv --columns s1=dur1,s2=dur2": (
        "subject,dur1,dur2,response\na,0.4,0.6,first\na,0.6,0.4,second\n",
        "columns dur1 and dur2 may be intensities.\ntype:  --unit a.u.  if they are intensities",
        "\n       --unit ln    if the numbers are natural logs",
    ),
    "mixed_units.csv": (
        "subject,d1_ms,d2_ms,response\na,500,550,second\na,0.5,550,second\n",
        "row 3, column d1_ms: found '0.5', allowed: a stimulus within a factor of 148 of the ot",
    ),
    "base_and_delta.csv": (
        "subject,base,delta_ms,response\na,500,50,second\na,500,-50,first\n",
        "If delta_ms is a difference from a standard, or a ratio to it, add columns standard and",
    ),
    "contrasts.csv --columns standard=logStd,comparison=logComp --standard-first": (
        "subject,logStd,logComp,response\na,-1,-0.8,second\na,-1,-1.2,first\n",
        "columns logStd and logComp may be in log10.\ntype:  --unit log10  if they are",
    ),
    "levels.csv --columns s1=level1,s2=level2": (
        "subject,level1,level2,response\na,60,63,second\na,63,60,first\n",
        "\ntype:  --unit dB        if 20 dB are a factor of ten\n",
        "\n       --unit dB-power  ",
        "\n       --unit a.u.      ",
    ),
    "dates_of_numbers.csv --columns s1=w1,s2=w2 --unit g": (
        "subject,w1,w2,response\na,Apr-05,Apr-06,first\na,Apr-06,Apr-05,second\n",
        "column w1: found 'Apr-05', allowed: a positive finite number",
    ),
    "names_of_pictures.csv --columns s1=w1,s2=w2": (
        "subject,w1,w2,response\na,p12.png,p14.png,first\na,p14.png,p12.png,second\n",
        "found whole numbers from 12 to 14, allowed: natural logs or a unit\ntype:  --unit a.u.",
    ),
    "decibels.csv": (
        "subject,s1,s2,response\na,60,60.5,second\na,60.5,60,first\n",
        "found numbers from 60 to 60.5, allowed: natural logs or a unit",
    ),
    "rates.csv": (  # each pair has near rates
        "subject,s1,s2,response\na,5.9,7.5,second\na,9.1,7.5,first\n",
        "found numbers from 5.9 to 9.1, allowed: natural logs or a unit",
    ),
    "another_unit.csv --unit g": (
        "subject,s1,s2,response\na,70 dB,55 dB,first\n",
        "the stimuli have the unit 'dB'.\n",
        "--unit dB ",
        "--unit dB-power",
    ),
    "decibel_as_intensity.csv --intensity 1 --columns i1=s1_dB,i2=s2_dB": (
        DECIBEL,
        "columns s1_dB and s2_dB may be in dB.",
    ),
    "zero_grams.csv": (
        labelled(with_rows_above(IN_GRAMS, [["P03", 0, 905, "second"]]), w1="s1", w2="s2"),
        "natural logs or a unit. If they are intensities, correct or remove rows with 0",
        "--unit ln",
    ),
    "comparison_alone.csv": (
        labelled(IN_LOGS, s2="comparison").drop(columns="s1"),
        "If one standard was in all trials, add a column standard with its level.",
    ),
    "percent.csv": (
        labelled(COUNTS, n_second="pct_second").drop(columns="n_trials"),
        "there is no column n_trials",
        "--columns n_trials=NAME",
    ),
    "proportion_of_others.csv": (
        labelled(PROPORTIONS.assign(n_trials=7), n_second="p_second"),
        "column p_second: found '0.",
        "a share that makes a whole number of 7 trials",
    ),
    "few_decimals.csv": (
        PROPORTIONS.assign(n_second=0.5, n_trials=40),
        "column n_second: found '0.5' in 31 rows",
        "a share that makes a whole number of 40",
    ),
    "wide.csv": ("subject,740_905\nP03,3\n", "no column s1"),
    "wide_counts.csv --wide {first}_{second} --unit g": (
        WIDE_COUNTS,
        "do they count?\ntype:  --columns n_second=cell  if",
        "--columns n_equal=cell   if",
    ),
    "wide_counts_alone.csv --wide {first}_{second} --unit g": (
        WIDE_COUNTS.replace(",n", "").replace(",40", ""),
        "--columns n_second=cell --columns n_trials=NAME",
        "if they count 'second'",
    ),
    "counts_of_unclear_answers.csv --standard-interval order": (
        BY_COMPARISON.assign(
            heavier=BY_COMPARISON.n_chosen, lighter=9 - BY_COMPARISON.n_chosen
        ).drop(columns=["n_chosen", "n_trials"]),
        "What do they count?\ntype:  --columns response=heavier "
        "--columns n_comparison=heavier,n_standard=lighter  ",
    ),
    "blank.csv --columns response=NAME": (
        labelled(IN_LOGS, response="x"),
        "no column NAME. The columns are subject, s1, s2, x. In the place of NAME, type one of t",
    ),
    "counts_under_other_names.csv": (
        labelled(COUNTS, n_second="k", n_trials="m"),
        "type:  --columns n_second=k,n_trials=m  if k counts 'second'\n",
    ),
    "counts_of_what.csv --standard-interval order": (
        BY_COMPARISON,
        "there is no column n_equal",
        "n_comparison=n_chosen,n_trials=n_trials  if n_chosen counts 'comparison'\n",
    ),
    "e_prime.txt": (
        "*** Header Start ***\nSubject: 12\n*** Header End ***\n",
        "found a log of E-Prime, allowed: its trials as CSV, which E-DataAid exports",
    ),
    "presentation.log": (
        "Scenario - pitch\n\nSubject\tTrial\tEvent Type\tCode\n",
        "found a log of Presentation, allowed: its trials as CSV",
    ),
    "below_names_of_other_things.csv": (
        "name,date,subject no.\nx,1 May,7\nvp,dur1,dur2,key\na,1,2,f\na,2,1,j\n",
        "row 3: there is no column s1",
        "The columns are vp, dur1, dur2, key.",
    ),
    "merged_cells.csv": (
        "subject,s1,s2,response\n,0,0.3,first\n,0,0.3,second\na,0.3,0,first\n",
        "column subject: found '' in 2 rows",
        "repeat the text of merged cells in each row",
    ),
    "right_answers_of_equal_stimuli.csv --columns n_correct=hits": (
        "subject,s1,s2,hits,n_trials\na,0,0.3,5,6\na,0.3,0.3,5,6\n",
        "row 3, column n_trials: found '6', allowed: 0 where stimuli are equal, of which no answer",
    ),
    "right_answers.csv": (
        RIGHT_COUNTS.drop(columns="n_second").rename(columns={"hits": "r"}),
        "type:  --columns n_correct=r,n_trials=n_trials  if r counts 'correct'\n",
    ),
    "first_by_another_name.csv": (
        labelled(FIRST_COUNTS, n_first="k"),
        "type:  --columns n_first=k,n_trials=n_trials  if k counts 'first'\n",
    ),
    "pairs_without_a_pattern.csv": (
        "subject,pair,response\na,4-6,second\na,6-4,first\n",
        "--wide '{first}-{second}'",
        "if the cells of column pair are pairs of stimuli",
    ),
    "names_with_a_point.csv": (
        "subject,values.dur1,values.dur2,key\na,1,2,f\na,2,1,j\n",
        "type:  --columns s1=values.dur1,s2=values.dur2",
    ),
    "wide_counts_without_a_pattern.csv": (
        WIDE_COUNTS,
        "--wide '{first}_{second}'",
        "the names of 4 columns are pairs",
    ),
    "counts_that_do_not_add_up.csv": (
        "subject,s1,s2,first,second,n\na,0,0.3,1,5,7\na,0.3,0,4,2,6\n",
        "row 2, column n: found '7', allowed: the sum of its counts, 6",
    ),
    "counts_of_three_that_do_not_add_up.csv": (
        "subject,s1,s2,n_first,n_equal,n_second,n_trials\na,0,1,1,2,1,4\na,1,0,1,1,1,4\n",
        "row 3, column n_trials: found '4', allowed: the sum",
    ),
    "columns_of_subjects.csv": (
        "w1_s1,w2_s1,resp_s1,w1_s2,w2_s2,resp_s2\n5,6,x,6,7,x\n6,5,y,7,6,y\n",
        "type:  --columns subject=NAME,s1=NAME,s2=NAME,response=NAME  with the names in your file",
        "both stimuli, and a response, or n_second (a count or a share) and n_trials",
    ),
    "proportions_by_another_name.csv --columns p_second=cell": (
        "",
        "p_second=cell', allowed",
        "; proportions are named as counts",
    ),
    "wide_by_another_name.csv --wide {first}-{second}": (
        WIDE,
        "found 0 columns whose cells are all two numbers as --wide has them",
    ),
    "wide_and_unknown.csv --wide {first}_{second} --columns response=cell": (
        "subject,1_2,2_1\nP03,first,second\nP04,first,maybe\n",
        "row 3, column 2_1: found 'maybe', allowed: second",
    ),
    "table.xls": ("<html><table><tr><td>subject</td></tr></table></html>", "found a web page, al"),
    "table.ods": ("PK", "its copy as .xlsx or CSV"),
    "table.csv.gz": (gzip.compress(csv_bytes(IN_LOGS)), "an archive, allowed: the file in it"),
    "data.RData": ("RDX3", "R data"),
    "1_stairs.psydat": (b"\x80\x04", "data of another program, allowed: its copy as CSV"),
    "study.toml": ('files = ["a.csv"]', "settings, allowed: a table of trials or counts"),
    "cut_73.mat": (matlab_73(LISTS)[:2000], "found a damaged MATLAB file"),
    "cut.mat": (
        matlab_bytes(LISTS)[:200],
        "found a damaged MATLAB file (",
        "allowed: one that MATLAB has saved with '-v7'",
    ),
    "link_73.mat": (linked_73(), "damaged MATLAB file (subject is a link)"),
    "table_73.mat": (
        matlab_73({"#subsystem#": [1.0]}),
        "a table or another object of MATLAB's own",
    ),
    "several_structs.mat": (
        matlab_bytes({"a": LISTS, "b": LISTS}),
        "found a, b, no columns of one length",
        "data frame",
    ),
    "sides.csv": (
        "subject,left_g,right_g,lifted_first,heavier\na,50,60,left,right\na,60,50,right,left\n",
        "columns left_g and right_g do not say which stimulus came first",
        "type:  --standard-interval lifted_first --columns standard=left_g,comparison=right_g,resp",
    ),
    "no_second_stimulus.csv": (
        "subject,s1,order,response\na,0.1,1,second\na,0.2,2,first\n",
        "there is no column s2. The columns are subject, s1, order, response.",
    ),
    "three_tones.csv": (
        "subject,s1_ms,s2_ms,s3_ms,response\na,500,550,500,2\na,550,500,500,1\na,500,500,550,3\n",
        "column s3_ms: found a third stimulus, allowed: trials with two stimuli",
    ),
    "subjects_by_a_name.csv": (
        "the participant,s1,s2,response\n5c91,0,1,second\n5c92,1,0,first\n5c91,1,0,first\n",
        "type:  --columns 'subject=the participant'",
    ),
    "first_row_of_zero.csv": (
        "0,480,500,2\n0,500,480,1\n1,480,500,2\n1,500,480,1\n",
        "The columns are 1, 2, 3, 4. The file has no header, so",
    ),
    "few_rows_with_a_solution.csv": (
        "subject,s1,s2,is_larger,responded_larger\na,0,1,1,0\na,1,0,0,0\na,0,1,1,1\na,1,0,0,0\n",
        "type:  --columns response=responded_larger ",
        "\n       --columns response=is_larger",
    ),
    "counts_of_psychopy.csv": (
        "subject,a_1.thisN,a_2.thisN,pos_1,pos_2,response\na,0,1,1,2,second\na,1,2,2,1,first\n",
        "type:  --columns s1=NAME,s2=NAME ",
    ),
    "thresholds.csv": (
        "subject,d1,d2,DL_1,DL_2,response\n"
        + "a,2,3,4,5,second\na,3,2,4,5,first\n" * 3
        + "b,2,3,6,7,second\nb,3,2,6,7,first\n" * 3,
        "type:  --columns s1=d1,s2=d2 --unit a.u.  if they are intensities; better with the name "
        "of their unit, such as Hz\n       --columns s1=d1,s2=d2 --unit ln",
    ),
    "flags_and_subjects.csv": (
        "success,Rat,s1,s2,response\n" + "true,p,0,1,second\n" * 3 + "false,q,1,0,first\n" * 3,
        "type:  --columns subject=Rat",
    ),
    "order_of_unknown_stimuli.csv": (
        "subject,vel,vel_pest,pest_interval,response\na,8,9,first,second\na,8,9,second,first\n",
        "type:  --standard-interval pest_interval --columns standard=NAME,comparison=NAME",
        "\n       --comparison-interval pest_interval ",
    ),
    "left_and_right.csv": (
        "subject,left,right,response\na,1,2,second\na,2,1,first\n",
        "--comparison-interval NAME  if NAME says the interval of the comparison\nEND",
    ),
    "all_rows_too_long.csv": (
        "repetition\tsubject\t1350_1105\t905_1350\t905_740\t905_905\n\t\t\t\t\t\t\t\t\n1\t\t\t\t\t\t\tx\n",
        "row 3: found 8 cells, allowed: 6 cells as in the header",
    ),
    "far_apart.csv": (
        "subject,s1,s2,response\na,-1.5,4.1,first\n",
        "found -1.5 and 4.1 in one pair, too far apart for natural logs, allowed: natural logs or",
    ),
    "frequencies.csv --columns s1=freq1,s2=freq2": (
        "subject,freq1,freq2,response\na,440,460,second\na,460,440,first\n",
        "type:  --unit Hz    if",
    ),
    "pictures.csv --columns s1=w1,s2=w2": (
        "subject,w1,w2,response\na,p,1,second\na,q,1,second\na,r,1,second\na,s,1,second\n",
        "error: pictures.csv: row 2, column w1: found 'p', allowed: a finite number, which no cell "
        "of the column is\nEND",
    ),
    "a_row_for_each_stimulus.csv": (
        "subject,trial,interval,tone,response\n" + "a,1,1,500,\na,1,2,700,second\n" * 9,
        "If a row is one event, such as a stimulus or a response, write a row for each trial",
    ),
    "names_in_two_rows.csv": (
        "subject,tone (Hz),,response\n,first,second,\na,500,700,second\n",
        "If names stand in two rows, write them in one row.",
    ),
    "columns_of_trials.csv": (
        "subject,Q1_1,Q1_2,Q1_3,Q1_4,Q1_5,Q1_6,Q1_7,Q1_8\na,1,2,1,2,1,1,2,2\n",
        "If each of the 8 columns such as Q1_1 belongs to a trial, write a row for each trial with",
    ),
    "decimal_commas_without_quotes.csv": (
        "subject,s1,s2,response\n" + "a,0,1,0,3,second\n" * 20,
        "20 rows have another number of cells than row 1, which has the names. Between commas, a ",
    ),
    "monitors.csv": (
        WITHOUT_SUBJECT.assign(monitor=[1] * 20 + [2] * 20),
        "type:  --subject-from '{}.*'  ",
    ),
    "start_key.csv": (
        "subject,s1,s2,go.keys,key.keys\na,0,1,space,j\na,1,0,space,f\n",
        "type:  --columns response=key.keys ",
    ),
    "letters_of_same.csv": (
        "subject,s1,s2,response\na,0,1,s\na,1,0,s\na,0,0,d\na,1,1,d\n",
        "type:  --equal-code s   if",
        "\n       --equal-code d   if",
    ),
    "unit_below_names.csv": (
        "subject,s1,s2,response\n,ms,ms,\na,500,700,first\na,700,500,second\n",
        "type:  --unit ms ",
    ),
    "no_stimuli_in_a_row.csv": (
        "subject,s1,s2,response\na,n/a,n/a,n/a\na,500,700,first\na,700,500,second\n",
        "type:  --unit a.u. ",
    ),
    "loud.csv": (
        "subject,level1,level2,shorter\na,500,700,1\na,700,500,2\n",
        "type:  --columns s1=level1,s2=level2,response=shorter --second-code 1 --unit a.u.\n",
    ),
    "7.csv": (WITHOUT_SUBJECT, "--subject-from '{}.*'"),
    "two_tasks.csv": (with_rows_above(IN_LOGS, [["P03", 0, 0, "different"]]), "words of two tasks"),
    "saved_as_text.tsv": (
        "subject\ts1\ts2\tn\tkey_raw\t\t\torder\na\t0\t1\t3\t2\t2\t1\t0\n"
        "a\t1\t0\t3\t1\t1\t1\t1\n\nextraInfo\nsubject\tS01\n",
        "column key_raw: the codes are '2' (2), '1' (4).",
        "type:  --columns response=key_raw --second-code 2",
    ),
    "log.csv": (
        "subject,trial,event,code\na,1,tone,s1_5\na,1,tone,s2_6\na,1,key,s2_0\n",
        "If a row is one event, such as a stimulus or a response, write a row for each trial",
        "and response.\nEND",  # and no advice
    ),
    "pairs_beside_an_event.csv": (
        "subject,pair,event name,response\na,500 vs 400,Response,first\n"
        "a,400 vs 500,Response,second\n",
        "type:  --wide '{first} vs {second}'",
    ),
    "mistyped.csv": (
        "subject,s1,s2,response\na,0,1,secnd\n" + "a,0,1,second\na,1,0,first\n" * 20,
        "row 2, column response: found 'secnd', allowed: second, s2, 2nd (second) or first, s1, ",
        "--first-code\nEND",  # and no advice
    ),
    "damaged.csv": (
        "subject,s1,s2,response\na,#REF!,1,#N/A\na,0,1,s\ufffdcond\n"
        + "a,0,1,second\na,1,0,first\n" * 9,
        "row 2, column s1: found '#REF!', allowed: a finite number\nerror: damaged.csv: row 3, col",
        "--first-code\nEND",
    ),
}

#: Weights with the names of durations in seconds.
IN_KILOGRAMS = IN_GRAMS[["subject", "response"]].assign(
    dur1=IN_GRAMS.w1 / 1000, dur2=IN_GRAMS.w2 / 1000
)
#: Keys whose scores prove what they mean.
SCORED_KEYS = with_responses(IN_LOGS, "f", "j").assign(correct=TRIALS.correct)
#: By the options that names and cells suggest, a table that is read without options.
EVIDENT = {
    "--columns subject=id": labelled(IN_LOGS, subject="id"),
    "--columns s1=w1,s2=w2 --unit a.u.": IN_GRAMS.assign(
        time=[f"10:{minute}" for minute in range(10, 50)] * 2
    ),
    "--columns s1=w1,s2=w2,response=pressed --unit a.u.": labelled(
        IN_GRAMS, response="pressed"
    ).assign(CRESP=CORRECT_ANSWERS),
    "--columns response=weight2.heavier --second-code 1": labelled(
        with_responses(IN_LOGS, 0, 1), response="weight2.heavier"
    ),
    "--columns response=heavier_one": labelled(IN_LOGS, response="heavier_one").assign(
        key_pressed=IN_LOGS.response.map({"first": "f", "second": "j"})
    ),
    "--columns response=heavier --second-code 2": labelled(
        with_responses(IN_LOGS, 1, 2), response="heavier"
    ),
    "--columns s1=dur1,s2=dur2 --unit a.u.": IN_KILOGRAMS,
    "--second-code j": SCORED_KEYS,
    "--second-code T2": with_responses(IN_LOGS, "T1", "T2"),
}
IS_FIRST_UNEQUAL = TRIALS.index == UNEQUAL.index[0]
#: Tables that leave a question open.
OPEN = {
    "names that do not say the order": labelled(IN_GRAMS, w1="wA", w2="wB"),
    "two pairs": IN_GRAMS.assign(v1=IN_GRAMS.w1, v2=IN_GRAMS.w2),
    "numbers that may be logarithms": labelled(IN_LOGS, s1="w1", s2="w2").assign(w1=-IN_LOGS.s1),
    "durations that may be logarithms": IN_KILOGRAMS.assign(
        dur1=np.log10(IN_GRAMS.w1), dur2=np.log10(IN_GRAMS.w2)
    ),
    "codes of sessions or of subjects": labelled(IN_LOGS, subject="code"),
    "pitches": labelled(IN_GRAMS, w1="pitch1", w2="pitch2"),
    "forces that were measured": IN_GRAMS.assign(w1=IN_GRAMS.w1 + TRIALS.index / 1000.0),
    "scattered rows": labelled(IN_LOGS[::2], subject="id").sample(frac=1.0, random_state=1),
    "a wrong score": SCORED_KEYS.assign(correct=TRIALS.correct ^ IS_FIRST_UNEQUAL),
    "responses that do not follow": IN_GRAMS.assign(response=["first", "second"] * 40),
    "stimuli that begin in both orders": IN_GRAMS.assign(
        **{"w1.started": [0, 1] * 40, "w2.started": [1, 0] * 40}
    ),
    "orders of groups": IN_GRAMS.assign(order=["SC"] * 40 + ["CS"] * 40),
    "two kinds of trials": IN_GRAMS.assign(modality=["a", "a", "b", "b"] * 20),
    "rows that do not count": IN_GRAMS.assign(exclude=[1, 0, 0, 0] * 20),
}
#: The name of a file, its content, and the first advice, which reads it.
ADVISED = {
    "words_of_weight.csv": (
        labelled(with_responses(IN_LOGS, "heavier", "lighter"), response="first_was").assign(
            sex=["f"] * 40 + ["m"] * 40, reversal=[0, 1] * 40
        ),
        "--columns response=first_was --second-code lighter",
    ),
    "two_units.csv": (
        IN_GRAMS.assign(w1_g=TRIALS.w1, w2_g=TRIALS.w2),
        "--columns s1=w1_g,s2=w2_g",
    ),
    "times_of_stimuli.csv": (
        IN_GRAMS.assign(
            **{"stim1.started": TRIALS.index, "stim2.started": TRIALS.index + 1},
            dur1_ms=200,
            dur2_ms=200,
        ),
        "--columns s1=w1,s2=w2 --unit a.u.",
    ),
    "wide.csv": (
        WIDE.rename(columns=lambda name: f"Q5_{name}" if "_" in name else "ResponseId").loc[
            :, lambda table: ~table.columns.duplicated()
        ],
        "--wide 'Q*_{first}_{second}' --columns subject=ResponseId --unit a.u.",
    ),
    "wide_with_repetitions.csv": (
        with_repetitions("W{}_{}"),
        "--wide 'W{first}_{second}_*' --unit a.u.",
    ),
    "wide_with_equal_names.csv": (
        with_repetitions("{}.{}"),
        "--wide '{first}_{second}' --unit a.u.",
    ),
    "lists.csv": (
        IN_GRAMS.assign(pair=TRIALS.w1.map("[{},".format) + TRIALS.w2.map("{}]".format))[
            ["subject", "pair", "response"]
        ],
        "--wide '[{first},{second}]' --unit a.u.",
    ),
    "right_answers.csv": (
        labelled(SCORED.drop(columns=["key", "rt"]), correct="response"),
        "--correct response",
    ),
    "third_answer.csv": (
        "subject,s1,s2,n_first,maybe,n_second\na,0,0.3,1,2,5\na,0.3,0,4,2,2\na,0,0,3,3,2\n",
        "--columns n_equal=maybe",
    ),
    "rats.csv": (labelled(IN_LOGS, subject="Rat"), "--columns subject=Rat"),
    "scored_rats.csv": (
        labelled(SCORED, subject="Rat").drop(columns=["key", "rt"]),
        "--columns subject=Rat --correct correct",
    ),
    "sessions.xlsx": (excel_bytes(A=IN_LOGS[:30], B=IN_LOGS[30:]), "--sheet '*'"),
    "subjects.xlsx": (
        excel_bytes(P03=WITHOUT_SUBJECT, P12=IN_LOGS[40:].drop(columns="subject")),
        "--sheet '*' --subject-from '{}'",
    ),
    "P03.csv": (
        IN_GRAMS[:40].drop(columns="subject"),
        "--columns s1=w1,s2=w2 --subject-from '{}.*' --unit a.u.",
    ),
}

#: Parts of warnings of `check`, and the table that each warns of.
WARNED = {
    "--unit with the name of their unit, such as --unit s;": (
        "subject,s1,s2,response\na,0.4,0.525,second\na,0.525,0.4,first\n"
    ),
    "--condition task": (
        "subject,task,s1,s2,response\na,time,0,0.3,first\na,time,0.3,0,second\n"
        "a,force,5,5.3,second\na,force,5.3,5,first\n" * 5
    ),
    "percentages": COUNTS.assign(n_second=np.arange(len(COUNTS)), n_trials=100),
    "--condition Pause_ms": IN_LOGS.assign(Pause_ms=[600, 1200] * 40),
    "If it has correct answers, --columns": IN_LOGS.assign(response=CORRECT_ANSWERS),
    "column response is read, and not column response_2, which has the same codes.": IN_LOGS.assign(
        response_2=TRIALS.response
    ),
    "column studyId changes. If it tells subjects apart, type --columns subject=studyId": (
        "subject,studyId,trial,s1,s2,response\n0,a,1,0,1,first\n0,a,2,1,0,second\n0,a,3,0,1,first\n"
        "0,b,1,0,1,first\n0,b,2,1,0,first\n0,b,3,1,0,first\n"
    ),
    "all rows are of subject 1, but trial numbers begin anew. If there are several": IN_LOGS.assign(
        subject=1, trial=[*range(40)] * 2
    ),
    "10 rows of subject 'NA'": IN_LOGS.assign(subject=["NA"] * 10 + ["P03"] * 70),
}


def write_file(path, content):
    """Write a table as CSV, records as JSON, a text or bytes."""
    if isinstance(content, pd.DataFrame):
        content = csv_bytes(content)
    if isinstance(content, list | dict):
        content = json.dumps(content)
    if isinstance(content, str):
        content = content.encode()
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(content)


def result_of_check(folder, line, content):
    """The result of `check` on a file with this content: exit code, stdout and stderr.

    The line has the name of the file and the options, such as `keys.csv --second-code j`.
    """
    write_file(folder / line.split()[0], content)
    return run_command(f"check {line}", cwd=folder)


@pytest.mark.parametrize("line", READ)
def test_a_shape_is_read_as_it_is_meant(line, tmp_path):
    # A key of READ is the name of a file and options, such as 'weights.csv --columns
    # n_trials=weight', and its value is the content of the file. All files are other shapes of the
    # same trials, IN_LOGS, unless READ_IN_PART has other trials. NOTE_BY_NAME has the beginning of
    # a note.
    name, _, options = line.partition(" ")
    write_file(tmp_path / name, READ[line])
    study = bt.read_study(tmp_path / name, typed_options(options))
    expected = bt.read_study(READ_IN_PART.get(name, IN_LOGS))
    pd.testing.assert_frame_equal(comparable_rows(study), comparable_rows(expected))
    assert any(note.startswith(NOTE_BY_NAME.get(name, "")) for note in study.notes), study.notes


@pytest.mark.parametrize("size", ["A1", "A1:D21", "A1:C81", "D1:D81", "A50:D81", "A1:XFD1048576"])
def test_a_wrong_size_in_a_workbook_is_not_believed(size, tmp_path):
    # Some programs write a wrong size of the table, which is A1:D81, or leave it at the first cell.
    book = workbook_with(excel_bytes(T=IN_LOGS), rb'(?<=<dimension ref=")[^"]*', size.encode())
    write_file(tmp_path / "size.xlsx", book)
    assert bt.read_study(tmp_path / "size.xlsx").frame().equals(bt.read_study(IN_LOGS).frame())


#: A column that marks practice, catch trials or instructions: its name, its text in such rows, and
#: its text in other rows.
PRACTICE = """
    test_part | practice | test
    phase | practice | main
    task | practice | comparison
    is_practice | 1 | 0
    Procedure | PracProc | TrialProc
    Running | PracticeList | TrialList
    training | 1 | 0
    is_training | true | false
    PracticeMode | yes | no
    exp_stage | Training | main
    sender | Practice trial | Trial
    blockcode | practiceblock | test
    part | 0_training | 1_main
    set | TRAIN | TEST
    display | Instructions | Trial
    mode | demo | real
    catch | 1 | 0
    trial_kind | catch | normal
    Teil | Übung | Versuch
    warm_up | TRUE | FALSE
    trial_type | attention_check | exp
    blok | oefen | echt
    treino | sim | não
    pratica | sì | no
    練習 | 1 | 0
    type | essai entraînement | essai
    fase | ensayos de práctica | prueba
    Durchgang | Probedurchgang | Hauptversuch
    faza | trening | badanie
    фаза | тренировка | опыт
    blok | alıştırma | deney
    vaihe | harjoitus | koe
    阶段 | 练习 | 正式
"""


@each_row("column, practice, main", PRACTICE)
def test_rows_of_practice_are_read_only_where_it_is_asked_for(column, practice, main):
    # Such as a column phase with 'practice' in the first 8 rows of P03 and 'main' in the 80 trials.
    table = with_practice(column, practice, main)
    study = bt.read_study(table)
    assert study.frame().equals(bt.read_study(IN_LOGS).frame())
    note = f"8 rows left out as practice or catch trials (column {column}: '{practice}')"
    assert any(line.startswith(note) for line in study.notes), study.notes
    study_with_practice = bt.read_study(table, bt.ReadOptions(ignore="practice"))
    assert study_with_practice["P03"].total_trials == 40 + 8


@pytest.mark.parametrize("line", REFUSED)
def test_a_shape_that_needs_an_option_is_refused_with_that_option(line, tmp_path):
    # A key of REFUSED is the name of a file, with options. Its value has the content of the file,
    # and parts of the refusal: the problem, and what to type. Nothing follows a part with END.
    content, *parts = REFUSED[line]
    result = result_of_check(tmp_path, line, content)
    assert result.returncode == 2
    assert all(part in f"{result.stderr}END" for part in parts), result.stderr


def first_advice(source, options=None):
    """The options that a table is read with, or that its refusal proposes first, as one text."""
    try:
        remedies = bt.read_study(source, options).reading.evident
    except bt.InputError as error:
        remedies, _ = error.choices[0]
    return " ".join(remedy.typed for remedy in remedies)


@pytest.mark.parametrize("name", ADVISED)
def test_the_first_advice_reads_a_table(name, tmp_path):
    # ADVISED has the content of a file, and the options that its refusal proposes first. Read with
    # these options, the file has the same trials as the other shapes.
    content, advice = ADVISED[name]
    write_file(tmp_path / name, content)
    assert first_advice(tmp_path / name) == advice
    study = bt.read_study(tmp_path / name, typed_options(advice))
    expected = bt.read_study(READ_IN_PART.get(name, IN_LOGS))
    pd.testing.assert_frame_equal(comparable_rows(study), comparable_rows(expected))


@pytest.mark.parametrize("options", EVIDENT)
def test_a_table_is_read_without_options_if_no_question_is_open(options):
    study = read(csv_bytes(EVIDENT[options]))
    assert study.notes[1] == f"options that names and cells suggest: {options}"
    pd.testing.assert_frame_equal(comparable_rows(study), comparable_rows(bt.read_study(IN_LOGS)))


@pytest.mark.parametrize("title", OPEN)
def test_a_question_that_a_table_leaves_open_is_asked(title):
    assert problems(read, csv_bytes(OPEN[title]))


@pytest.mark.parametrize("part", WARNED)
def test_a_shape_that_may_mislead_is_warned_of(part, tmp_path):
    # A key of WARNED is a part of the warning, such as '--condition task'. Its value is the table
    # that is warned of.
    result = result_of_check(tmp_path, "study.csv", WARNED[part])
    assert result.returncode == 0
    assert part in on_one_line(result.stdout)


def test_tables_below_each_other_may_be_of_several_subjects(tmp_path):
    # One file, which has the name of one subject, has two tables below each other.
    result = result_of_check(tmp_path, "AB.csv --subject-from {}.*", csv_bytes(WITHOUT_SUBJECT) * 2)
    assert ": repeated headers may begin other subjects" in on_one_line(result.stdout)


#: A column that says whether a trial counts: its name, its text in rows that do not count, and its
#: text in other rows.
TAKEN_OUT = """
    exclude | 1 | 0
    valid | 0 | 1
    is_aborted | True | False
    timed_out | yes | no
    technical_error | 1 | 0
    outcome | aborted | ok
    block | attention | main
    condition | practice | main part
    aborted | 1 |
    excluded | x |
    use | no | yes
    keep |  | x
    Ausschluss | ja | nein
    TrialError | 8 | 0
    fix_break | 1 | 0
    repeated | sim | não
    geldig | nee | ja
"""


@each_row("column, mark, other_text", TAKEN_OUT)
def test_rows_that_do_not_count_are_remarked_with_what_leaves_them_out(column, mark, other_text):
    # Such as a column exclude with 1 in every fifth row, 16 of 80, and 0 in the other rows.
    table = IN_LOGS.assign(**{column: [mark, *[other_text] * 4] * 16})
    remark = (
        f"study.csv: 16 rows with '{mark}' in column {column} are counted; --where "
        f"{shlex.quote(f'{column}={other_text}')} leaves them out"
    )
    assert read(csv_bytes(table)).reading.doubts == (remark,)
    study = bt.read_study(table, bt.ReadOptions(where={column: other_text}))
    assert study.frame()["n_trials"].sum() == 64


def test_a_remark_that_several_files_share_is_one_line(tmp_path):
    # Each file has 40 trials, of which 3, 3 and 5 are marked by x. The remark has the number of the
    # first file.
    for name, n_marked in (("a.csv", 3), ("b.csv", 3), ("c.csv", 5)):
        marks = ["x"] * n_marked + [""] * (40 - n_marked)
        write_file(tmp_path / name, P03.assign(subject=name, excluded=marks, trial=range(40)))
    (doubt,) = bt.read_study(tmp_path).reading.doubts
    remark = "3 files, such as a.csv: 3 rows with 'x' in column excluded are counted; "
    assert doubt == f"{remark}--where excluded= leaves them out"


def test_names_of_files_that_seem_to_have_a_condition_are_remarked(tmp_path):
    # Days and blocks of a subject differ in numbers only, and are no conditions.
    for name in ("s1_day1", "s1_day2", "s2_day1", "s2_day2"):
        write_file(tmp_path / f"{name}.csv", P03.assign(subject=name[:2]))
    assert "most subjects" not in str(bt.read_study(tmp_path).reading.doubts)
    for name in ("s1_loud", "s1_soft", "s2_loud", "s2_soft"):
        write_file(tmp_path / f"{name}.csv", P03.assign(subject=name[:2]))
    doubts = bt.read_study(tmp_path).reading.doubts
    assert doubts[-1].startswith("most subjects have files such as {}_day1.csv, {}_loud.csv and")


def test_a_file_without_columns_of_trials_is_named(tmp_path):
    # A session that was stopped has left a file without trials. If a.csv is read alone, its columns
    # are found or asked for. If the whole folder is read, the file without trials is named first.
    write_file(tmp_path / "stopped.csv", "subject,date\nP99,1\n")
    for table in (IN_GRAMS, with_responses(IN_GRAMS, "f", "j")):
        result = result_of_check(tmp_path, "a.csv", table)
        assert "--columns s1=w1,s2=w2" in result.stdout + result.stderr
        assert run_command("check .", cwd=tmp_path).stderr.splitlines() == [
            "error: stopped.csv: row 1: there is no column s1, no column s2 and no column "
            "response. The columns are subject, date. Type the names of the other files, or "
            "remove this file."
        ]


#: Codes of 'first', 'same' and 'second', the options that are given, and the first advice.
TERNARY_CODES = """
    0 | 1 | 2 | --second-code 2 | --equal-code 1 --second-code 2
    0 | 1 | 2 | --second-code 2 --first-code 0 | --equal-code 1 --second-code 2
    0 | 1 | 2 | --first-code 0 | --equal-code 1 --second-code 2
    0 | 1 | 2 | --equal-code 1 | --equal-code 1 --second-code 2
    0 | 1 | 2 | --equal-code 1 --different-code 0 | --equal-code 1 --second-code 2
    0 | 1 | 2 | --equal-code 1 --different-code 2 | --equal-code 1 --second-code 2
    0 | 1 | 2 |  | --equal-code 1 --second-code 2
    -1 | 0 | 1 |  | --equal-code 0 --second-code 1
    -1 | 0 | 1 | --second-code 1 | --equal-code 0 --second-code 1
    -1 | 0 | 1 | --second-code 1 --first-code -1 | --equal-code 0 --second-code 1
    -99 | 0 | 999 | --second-code 999 | --equal-code 0 --second-code 999
    left | same | right |  | --equal-code same --second-code right
    left | same | right | --second-code right | --equal-code same --second-code right
    first | tie | second |  | --equal-code tie --second-code second
    first | tie | second | --second-code second | --equal-code tie --second-code second
    first | tie | later |  | --equal-code tie --second-code later
"""


@each_row("first_code, same_code, second_code, options, advice", TERNARY_CODES)
def test_a_frequent_third_answer_is_no_missed_trial(
    first_code, same_code, second_code, options, advice
):
    # In TERNARY, every pair of equal stimuli is answered 'same'. Here the three answers have other
    # codes, such as 0, 1 and 2. The code of 'same' is frequent, so it is an answer and no sign that
    # a trial was missed.
    table = TERNARY.replace(
        {"response": {"first": first_code, "same": same_code, "second": second_code}}
    )
    assert first_advice(table, typed_options(options)) == advice
    study = bt.read_study(table, typed_options(advice))
    assert study.frame().equals(bt.read_study(TERNARY).frame())


#: Codes of 'first' and of 'second', the codes of other rows, and the first advice.
SEVERAL_CODES = """
    1,2 | 3,4 |  | --second-code 3,4 --first-code 1,2
    5,6 | 3,4 |  | --second-code 3,4 --first-code 5,6
    -1,-2 | 1,2 |  | --second-code 1,2 --first-code -1,-2
    a,s | k,l |  | --second-code k,l --first-code a,s
    1,2 | 3,4 | -9 | --missed -9 --second-code 3,4 --first-code 1,2
    1,2 | 3,4 | 0 | --missed 0 --second-code 3,4 --first-code 1,2
    f | j | k,escape,h | --second-code j --first-code f --missed k,escape,h
    first longer | first shorter |  | --second-code 'first shorter'
"""


@each_row("first_codes, second_codes, missed_codes, advice", SEVERAL_CODES)
def test_an_answer_may_have_several_codes(first_codes, second_codes, missed_codes, advice):
    # Such as 1 and 2 for 'first', by turns, and 3 and 4 for 'second'. Each code of missed trials,
    # which may be empty, has three more rows.
    codes = {"first": first_codes.split(",") * 80, "second": second_codes.split(",") * 80}
    answers = [codes[answer][i] for i, answer in enumerate(IN_LOGS.response)]
    rows = [["P03", 0, 0.3, code] for code in missed_codes.split(",")] * 3
    table = with_rows_above(IN_LOGS.assign(response=answers), rows)
    assert first_advice(table) == advice
    study = bt.read_study(table, typed_options(advice))
    assert study.frame().equals(bt.read_study(IN_LOGS).frame())


def test_one_code_for_two_answers_is_refused():
    # The code 2 is declared for 'first' and for 'second'.
    table = IN_LOGS.assign(response=[1, 2, 3, 4] * 20)
    with refused("found '2' in 20 rows"):
        bt.read_study(table, bt.ReadOptions(first_code="1,2", second_code="2,3,4"))


@pytest.mark.parametrize("name", ["same", "uncertain", "dont_know"])
def test_counts_of_three_answers_are_known_by_their_names(name):
    # The table has the columns 'first' and 'second', and one of these names in the place of 'same'.
    # The counts of 'first' in TERNARY_COUNTS are 1 and 4.
    study = bt.read_study(pd.read_csv(io.StringIO(TERNARY_COUNTS.replace("same", name))))
    assert study["a"].n_first.tolist() == [1, 4]


@pytest.mark.parametrize("text", [WIDE_COUNTS, IN_SHARES])
def test_counts_and_proportions_of_wide_tables_are_read(text):
    # WIDE_COUNTS has the counts 31, 9, 28, 11 and 28, 4, 34, 12 of 'second', 157 together.
    # IN_SHARES has 100 trials of each pair, so that percentages are the same numbers.
    options = bt.ReadOptions(wide="{first}_{second}", unit="g", columns={"n_second": "cell"})
    study = bt.read_study(pd.read_csv(io.StringIO(text)), options)
    assert study.frame().n_second.sum() == 157


def test_unfilled_rows_are_left_out_of_a_file_that_names_the_subject(tmp_path):
    # Without a column of subjects, the 20 rows of zeros below the trials belong to the subject,
    # too.
    trials = CODED[CODED.subject == "P12"].drop(columns="subject")
    write_file(tmp_path / "P12.csv", with_rows_of_zeros(trials))
    options = bt.ReadOptions(second_code="1", subject_from="{}.csv")
    study = bt.read_study(tmp_path / "P12.csv", options)
    assert study["P12"].total_trials == len(trials)
    assert study.notes[1].endswith("(stimuli and response are 0 in the last rows): P12.csv 20")


SORTED_TRIALS = pd.DataFrame({"subject": "P12", "s1": 0, "s2": [1] * 30 + [0] * 30})
#: Trials whose last rows hold zeros, and the number of trials of their subject.
ZEROS = {
    "sorted by pair": (SORTED_TRIALS.assign(response=SORTED_TRIALS.s2), 60),
    "few zeros": (with_rows_of_zeros(CODED, 3, subject="P12"), 43),
    # A reaction time shows that a row is a trial.
    "with reaction times": (
        with_rows_of_zeros(CODED, subject="P12").assign(rt=np.arange(300, 400)),
        60,
    ),
}


@pytest.mark.parametrize("kind", ZEROS)
def test_pairs_of_zeros_that_are_trials_stay(kind):
    # Rows in which both stimuli and the response are 0 may be trials: if there are few, if the rows
    # are sorted, or if a column shows that somebody responded.
    table, n_trials = ZEROS[kind]
    study = bt.read_study(table, bt.ReadOptions(second_code="1"))
    assert study["P12"].total_trials == n_trials


@pytest.mark.parametrize("name", ["vectors.mat", "table.xlsx"])
def test_a_file_with_changed_bytes_is_read_or_refused(name, tmp_path):
    # Eight times, 20 bytes below the header of the file change. The test fails with any exception
    # but an InputError.
    rng = random.Random(1)
    for _ in range(8):
        changed = bytearray(READ[name])
        for position in rng.sample(range(128, len(changed)), 20):
            changed[position] = rng.randrange(256)
        write_file(tmp_path / name, bytes(changed))
        with suppress(bt.InputError):
            bt.read_study(tmp_path / name)


def write_folder(folder, *names):
    # Write the trials into a folder 'data', once under each name.
    (folder / "data").mkdir()
    for name in names:
        write_file(folder / "data" / name, csv_bytes(IN_LOGS, sep="\t"))


def test_counts_in_notes_are_those_of_all_files(tmp_path):
    # Each of two files has 36 trials, one trial without a response, and five trials of practice.
    # Only the file of anna has a row without stimuli.
    answered_rows = "NAME,0,0.3,second,main\nNAME,0.3,0,first,main\n" * 18
    practice = "NAME,0,0.3,second,practice\n" * 5
    header, empty_row = "subject,s1,s2,response,part\n", "NAME,,,,main\n"
    rows = f"NAME,0,0.3,,main\n{answered_rows}{practice}"
    files = [tmp_path / "anna.csv", tmp_path / "ben.csv"]
    write_file(files[0], (header + empty_row + rows).replace("NAME", "anna"))
    write_file(files[1], (header + rows).replace("NAME", "ben"))
    assert bt.read_study(files).notes == (
        "trial rows, comma-separated, UTF-8, responses 'second' (36) / 'first' (36), "
        "stimuli as natural logs",
        "10 rows left out as practice or catch trials (column part: 'practice'); --ignore practice "
        "reads them",
        "anna.csv: 1 row without stimuli and response left out",
        "2 trials without a response dropped: anna 1, ben 1",
    )


def test_a_folder_stands_for_its_tables(tmp_path):
    # Of six files, two are tables of trials. The other files are a lock of Excel, a hidden file, a
    # log, and the file of a session that was stopped, with nine trials.
    write_folder(tmp_path, "1.csv", "2.CSV", "~$1.csv", ".3.csv", "1.log")
    stopped = "subject,s1,s2,response" + "\nP99,0,0.3," * 9
    write_file(tmp_path / "data/0.csv", stopped)
    study = bt.read_study(tmp_path / "data")
    assert study.source == "2 files, 1.csv to 2.CSV"
    assert study.notes[0] == f"folder {display_name(str(tmp_path / 'data'))}: 3 .csv files read"
    assert study.notes[1].startswith("left out: 0.csv: column response: found no response in any")
    line = "fit data -o data/1.csv --overwrite --replicates 2"
    assert "this command reads that file and must not replace it" in refusal_of(line, cwd=tmp_path)
    # With ten trials and no response, the file is refused: the responses are probably in another
    # column.
    write_file(tmp_path / "data/0.csv", f"{stopped}\nP99,0,0.3,")
    assert "found no response in any of 10 rows" in refusal_of("check data", cwd=tmp_path)


#: A column that is 1 in all files, the files, a part of the screen of `check`, and the subjects.
SUBJECTS_BY_NAME = """
    | VP1/data.csv VP2/data.csv | --subject-from '{}/*' if the subjects are VP1, VP2 | VP1 VP2
    | A/s1/d.csv B/s2/d.csv | --subject-from '{}/*/*' if the subjects are A, B | A B
    | V/a.csv V/b.csv W/a.csv | --subject-from '{}/{}.*' if the subjects are V_a, | V_a V_b W_a
    | S1/a.csv S1/b.csv S2/a.csv | --subject-from '{}/*' if the subjects are S1, S2 --subj | S1 S2
    | toe_A_1.csv toe_A_2.csv toe_B_1.csv | --subject-from 'toe_{}_*' if the subjects are A, B | A B
    | s.10.A.data.csv s.10.B.data.csv | --subject-from 's.10.{}.*' if the subjects are A, B | A B
    | A_03-01.csv A_03-02.csv B_03-01.csv | --subject-from '{}_*' if the subjects are A, B | A B
    | A.lvm B.lvm | --subject-from '{}.*' if the subjects are A, B | A B
    | a.json sub-1/1_beh.tsv sub-2/1_beh.tsv | --subject-from '{}/*' if the subjects | sub-1 sub-2
    subject | A.csv B.csv | of one subject, 1. If they are of several, --subject-from '{}.*' | A B
    subject | A/d.csv B/d.csv | one subject, 1. If they are of several, --subject-from '{}/*' | A B
"""


@each_row("column, files, part, subjects", SUBJECTS_BY_NAME)
def test_subjects_have_the_names_of_files_or_folders(column, files, part, subjects, tmp_path):
    # Such as the files VP1/data.csv and VP2/data.csv, each with the same trials. Either there is no
    # column of subjects, or it is 1 in all files. With the proposed option, subjects have names.
    table = IN_LOGS.drop(columns="subject").assign(**{column or "other": 1})
    for file in files.split():
        write_file(tmp_path / "data" / file, table)
    result = run_command("check data", cwd=tmp_path)
    assert part in on_one_line(result.stdout + result.stderr)
    pattern = re.search(r"--subject-from \S+", part)[0]
    study = bt.read_study(tmp_path / "data", typed_options(pattern))
    assert " ".join(study.names) == subjects


def test_files_that_begin_with_subjects_need_no_option(tmp_path):
    for name, rows in IN_LOGS.groupby("subject"):
        write_file(tmp_path / f"sub-{name}_beh.csv", rows.drop(columns="subject"))
    assert bt.read_study(tmp_path).names == ("P03", "P12")


#: Files of a folder, and the problem with which the folder is refused.
SEVERAL_SUFFIXES = """
    A/a.csv B/b.tsv | allowed: tables of one suffix, such as data/*/*.csv
    1.doc | data: found 1 .doc file, allowed: tables of one suffix, such as data/*.doc
    a.csv b.tsv c.tsv | found 1 .csv file and 2 .tsv files, allowed: tables of one suffix, such as d
"""


@each_row("names, problem", SEVERAL_SUFFIXES)
def test_a_folder_that_may_mean_several_studies_is_asked_for(names, problem, tmp_path):
    # Such as tables with the suffixes .csv and .tsv in one folder.
    write_folder(tmp_path, *names.split())
    assert problem in refusal_of("check data", cwd=tmp_path)
