"""Files as labs have them: each is read as it is meant, or refused with what to type.

All files hold the same trials of two subjects, 'which was stronger?', in another shape.
"""

import csv as csv_module
import gzip
import io
import json
import random
import re
import shlex
import zipfile
from collections import Counter
from contextlib import suppress

import h5py
import numpy as np
import pandas as pd
import pytest
from commands import inside, refused
from conftest import text_table
from numpy.random import default_rng
from scipy.io import savemat

import bayes_toe as bt
from bayes_toe.data.messages import display_name
from bayes_toe.errors import Remedy, with_remedies

GRAMS = (740, 905, 1105, 1350)
MATLAB_CLASSES = {"subject": "char", "response": "char"}


def made_up_trials():
    """A table with all columns that a shape may need."""
    rng = default_rng(1)
    first, second = (rng.choice(GRAMS, 80) for _ in range(2))
    difference = np.log(second / first)
    second_is_stronger = difference + rng.normal(0.05, 0.2, 80) > 0
    table = pd.DataFrame({"subject": np.repeat(["P03", "P12"], 40), "w1": first, "w2": second})
    table["s1"], table["s2"] = np.log(first / 1000).round(4), np.log(second / 1000).round(4)
    table["response"] = np.where(second_is_stronger, "second", "first")
    table["correct"] = np.where(difference != 0, second_is_stronger == (difference > 0), False)
    return table


TRIALS = made_up_trials()
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

THREE = IN_LOGS.assign(response=TRIALS.response.where(TRIALS.s1 != TRIALS.s2, "same"))
THREE_COUNTS = "subject,s1,s2,first,same,second\na,0,0.3,1,2,5\na,0.3,0,4,2,1\n"

FREQUENCIES = IN_LOGS.value_counts(sort=False).reset_index(name="Freq")
IN_ROOMS = IN_LOGS.assign(room=["A", "B"] * 40).value_counts(sort=False).reset_index(name="n")


def counts_by_pair(study):
    """Counts of the first and the second subject by pair, above the lowest level, to 0.01."""
    frame = study.frame()
    levels = (frame[["s1", "s2"]] - frame.s1.min()).round(2) + 0.0
    positions = frame.subject.map(study.names.index)
    return sorted(zip(positions, levels.s1, levels.s2, frame.n_second, frame.n_trials, strict=True))


def csv(table, encoding="utf-8", **style):
    return table.to_csv(index=False, **style).encode(encoding)


def excel(**sheets):
    data = io.BytesIO()
    with pd.ExcelWriter(data) as writer:
        for name, table in sheets.items():
            table.to_excel(writer, sheet_name=name, index=False)
    return data.getvalue()


def with_empty_texts(workbook):
    """A workbook as Excel saves it if all formulas give an empty text."""
    return with_part(workbook, rb'("[A-Z]\d+")(?=><f>)', rb'\1 t="str"')


def matlab(variables):
    data = io.BytesIO()
    savemat(data, variables)
    return data.getvalue()


def matlab_73(columns, is_struct=False):
    """Vectors, or fields of a struct, as MATLAB writes them into a file of version 7.3."""
    data = io.BytesIO()
    with h5py.File(data, "w", userblock_size=512) as file:
        references = file.create_group("#refs#")
        home = file.create_group("data") if is_struct else file
        for name, values in columns.items():
            cells = np.empty((1, len(values)), h5py.ref_dtype)
            for i, value in enumerate(values):
                if name in MATLAB_CLASSES:
                    value = np.array([list(map(ord, value))], np.uint16).T
                cell = references.create_dataset(f"{name}{i}", data=value)
                cell.attrs["MATLAB_class"] = np.bytes_(MATLAB_CLASSES.get(name, "double"))
                cells[0, i] = cell.ref
            if name in MATLAB_CLASSES or is_struct:
                home.create_dataset(name, data=cells)
            else:
                column = home.create_dataset(name, data=np.array([values]))
                column.attrs["MATLAB_class"] = np.bytes_("double")
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


def answered(table, first, second, column="response"):
    words = table.response.map({"first": first, "second": second})
    return table.assign(response=words).rename(columns={"response": column})


def with_rows(table, rows):
    return pd.concat([pd.DataFrame(rows, columns=table.columns), table])


def titled(table):
    """A table below a title."""
    head = pd.DataFrame([table.columns], columns=table.columns)
    rows = pd.concat([head, table])
    rows.columns = ["Versuch 1", *[""] * (len(rows.columns) - 1)]
    return rows


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
GERMAN_PAIR = {"s1": "Reiz 1", "s2": "Reiz 2"}
WEIGHTS = {"intensity": 1000.0, "columns": {"i1": "w1", "i2": "w2"}}
LISTS = IN_LOGS.to_dict(orient="list")
P03 = IN_LOGS[:40]
NESTED = {"info": {"subject": "P03"}, "trials": P03[["s1", "s2", "response"]].to_dict("list")}
RECORDS = json.loads(IN_LOGS.to_json(orient="records"))
BY_PERSON = [
    {"subject": name, "trials": json.loads(part.to_json(orient="records"))}
    for name, part in IN_LOGS.drop(columns="subject").groupby(IN_LOGS.subject)
]
DECIBEL = IN_GRAMS[["subject", "response"]].assign(
    s1_dB=20 * np.log10(TRIALS.w1), s2_dB=20 * np.log10(TRIALS.w2)
)
SCORED = UNEQUAL[["subject", "s1", "s2", "correct"]].assign(key="j", rt="0.4")
MISSED = with_rows(SCORED, [["P03", 0.3, 0.0, False, "", ""]] * 9)
PAIRS = IN_GRAMS.assign(pair=TRIALS.w1.astype(str) + "_" + TRIALS.w2.astype(str))
WIDE = (
    PAIRS.assign(repetition=PAIRS.groupby(["subject", "pair"]).cumcount())
    .pivot_table(
        index=["subject", "repetition"], columns="pair", values="response", aggfunc="first"
    )
    .reset_index()
)
WIDE_COUNTS = "subject,740_905,905_740,905_1105,1105_905,n\nP03,31,9,28,11,40\nP12,28,4,34,12,40\n"
IN_SHARES = WIDE_COUNTS.replace(",40", ",100").replace("31,9", "31%,9.0%")
NO_RESPONSES = "NA|n/a||none|null|-99|999|.|timeout|no response"
PRACTICE = [["P03", 0, 0.3, "second"]] * 8


def with_practice(column, practice, main):
    """Trials after eight rows of practice, which a column marks."""
    return csv(with_rows(IN_LOGS, PRACTICE).assign(**{column: [practice] * 8 + [main] * 80}))


def padded(table, **zeros):
    """Trials of a session that was stopped, in a matrix of zeros."""
    rows = pd.DataFrame({name: [0] * 20 for name in table.columns}).assign(**zeros)
    return csv(pd.concat([table, rows]))


def with_part(workbook, pattern, replacement):
    """A workbook in which something is replaced."""
    data = io.BytesIO()
    with zipfile.ZipFile(io.BytesIO(workbook)) as book, zipfile.ZipFile(data, "w") as saved:
        for name in book.namelist():
            saved.writestr(name, re.sub(pattern, replacement, book.read(name)))
    return data.getvalue()


CODED = answered(IN_LOGS, 0, 1)
#: Columns that mark practice, catch trials or instructions: texts of these and of other rows.
PRACTICE_MARKS = """
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
"""
#: Columns, or cells, that say that a trial does not count: texts of these and of other rows.
TAKEN_OUT = """
    exclude | 1 | 0
    valid | 0 | 1
    is_aborted | True | False
    timed_out | yes | no
    technical_error | 1 | 0
    outcome | aborted | ok
    block | attention | main
    condition | practice | main part
"""
JATOS = "\n".join(
    json.dumps(json.loads(part.to_json(orient="records"))) for _, part in IN_LOGS.groupby("subject")
)
ROW_NAMES = IN_LOGS.set_axis(range(1, 81)).to_csv().removeprefix(",")

#: Name, content, options, and the trials that are meant where these are not all.
READ = {
    "frequencies.csv": (csv(FREQUENCIES), {}),
    "no_trials_without_frequency.csv": (
        csv(pd.concat([FREQUENCIES, FREQUENCIES[:1].assign(response="first", s2=2.0, Freq=0)])),
        {},
    ),
    "frequencies_in_rooms.csv": (csv(IN_ROOMS), {}),
    "frequencies_by_another_name.csv": (
        csv(labelled(FREQUENCIES, Freq="weight")), {"columns": {"n_trials": "weight"}},
    ),
    "frequencies_by_our_name.csv": (csv(labelled(FREQUENCIES, Freq="n_trials")), {}),
    "counter.csv": (csv(IN_LOGS.assign(n=np.arange(80) % 20)), {}),
    "jitter_and_counter.csv": (
        csv(IN_LOGS.assign(count=np.arange(80) % 20, rt=np.arange(80) / 7.0)), {},
    ),
    "comma.csv": (csv(IN_LOGS), {}),
    "tab.tsv": (csv(IN_LOGS, sep="\t"), {}),
    "bar.txt": (csv(IN_LOGS, sep="|"), {}),
    "aligned.txt": (IN_LOGS.to_string(index=False).encode(), {}),
    "aligned_left.txt": (
        "\n".join(
            "".join(f"{cell:12}" for cell in cells)
            for cells in [IN_LOGS.columns, *IN_LOGS.astype(str).to_numpy()]
        ).encode(),
        {},
    ),
    "spaces.txt": (csv(IN_LOGS, sep=" ", quoting=2), {}),
    "utf16_without_mark.csv": (csv(IN_LOGS, "utf-16-le"), {}),
    "windows.csv": (csv(IN_LOGS.assign(note="größer"), "cp1252"), {}),
    "encoding.csv": (csv(IN_LOGS.assign(note="größer"), "mac_roman"), {"encoding": "mac_roman"}),
    "lines_above.csv": (b"Experiment 1\n\nlab 3\n" + csv(IN_LOGS), {}),
    "last_comma.csv": (csv(IN_LOGS.assign(**{"": ""})), {}),
    "quoted.csv": (csv(IN_LOGS.assign(note="two\nlines"), quoting=1), {}),
    "german_windows.csv": (csv(GERMAN, "cp1252", sep=";"), {"columns": GERMAN_PAIR}),
    "french.csv": (csv(answered(IN_LOGS, "première", "deuxième", "réponse")), {}),
    "participant.csv": (csv(labelled(IN_LOGS, subject="Participant ID", response="choice")), {}),
    "true_false.csv": (csv(answered(IN_LOGS, False, True)), {"second_code": "True"}),
    "interval.csv": (csv(answered(IN_LOGS, "interval 1", "Interval 2")), {}),
    "heavier.csv": (csv(answered(IN_LOGS, "first heavier", "second was heavier")), {}),
    "trials.json": (json.dumps(RECORDS).encode(), {}),
    "by_person.json": (json.dumps(BY_PERSON).encode(), {}),
    "in_a_key.json": (json.dumps({"trials": RECORDS, "version": 2}).encode(), {}),
    "by_column.json": (json.dumps(LISTS).encode(), {}),
    "table.xlsx": (excel(Trials=IN_LOGS), {}),
    "german.xlsx": (
        excel(Info=pd.DataFrame({"by": ["lab"]}), Daten=GERMAN), {"columns": GERMAN_PAIR},
    ),
    "title.xlsx": (excel(Daten=titled(GERMAN)), {"columns": GERMAN_PAIR}),
    "two_sheets.xlsx": (excel(A=IN_LOGS, B=IN_LOGS), {"sheet": "B"}),
    "errors_elsewhere.xlsx": (
        excel(Trials=IN_LOGS.assign(mean="#DIV/0!", sum="=A2"), Info=pd.DataFrame(["#REF!"])), {},
    ),
    "empty_texts.xlsx": (
        with_empty_texts(excel(T=with_rows(IN_LOGS, [["P03", 0, 0.3, '=IF(A2="", "", B2)']]))), {},
    ),
    "vectors.mat": (matlab(LISTS), {}),
    "struct.mat": (matlab({"data": LISTS}), {}),
    "nested.mat": (matlab({"data": NESTED}), {}, P03),
    "nested.json": (json.dumps(NESTED).encode(), {}, P03),
    "vectors_73.mat": (matlab_73(LISTS), {}),
    "struct_array_73.mat": (matlab_73(LISTS, is_struct=True), {}),
    "counts.csv": (csv(COUNTS), {}),
    "other_counts.csv": (csv(labelled(COUNTS, n_second="second", n_trials="total")), {}),
    "proportions.csv": (csv(PROPORTIONS), {}),
    "percent_and_n.csv": (
        csv(labelled(PROPORTIONS.assign(n_second=PROPORTIONS.n_second.map("{:.1%}".format)),
                  n_second="% second", n_trials="N")),
        {},
    ),
    "grams.csv": (csv(IN_GRAMS), WEIGHTS),
    "grams_by_unit.csv": (csv(labelled(IN_GRAMS, w1="i1", w2="i2")), {"unit": "g"}),
    "decibel.csv": (csv(DECIBEL), {"unit": "dB", "columns": {"s1": "s1_dB", "s2": "s2_dB"}}),
    "units_in_cells.csv": (
        csv(IN_GRAMS.assign(w1=TRIALS.w1.map("{} g".format), w2=TRIALS.w2.map("{}g".format))),
        {"unit": "g", "columns": {"i1": "w1", "i2": "w2"}},
    ),
    "decadic.csv": (
        csv(IN_LOGS.assign(s1=np.log10(TRIALS.w1), s2=np.log10(TRIALS.w2))), {"unit": "log10"},
    ),
    "wide.csv": (csv(WIDE), {"wide": "{first}_{second}", "unit": "g"}),
    "questions.csv": (
        csv(with_rows(WIDE, [["Which one?"] * 18, ['{"ImportId":"Q"}'] * 18])),
        {"wide": "{first}_{second}", "unit": "g"},
    ),
    "pair_in_a_cell.csv": (
        csv(PAIRS[["subject", "pair", "response"]]), {"wide": "{first}_{second}", "unit": "g"},
    ),
    "missing_words.csv": (
        csv(with_rows(IN_LOGS, [["P03", 0, 0.3, word] for word in NO_RESPONSES.split("|")])),
        {},
    ),
    "practice_counter.csv": (csv(IN_LOGS.assign(practice=range(80))), {}),
    "where.csv": (with_practice("kind", "other", "main"), {"where": {"kind": "main"}}),
    "units.csv": (
        csv(with_rows(CODED, [["", "ln", "ln", "0/1"], ["P03", "null", "NA", '{"age":"23"}']])),
        {"second_code": "1"},
    ),
    "instructions.csv": (csv(with_rows(IN_LOGS, [["P03", "", "", ""]] * 2)), {}),
    "missed_trials.csv": (csv(MISSED), {"correct": "correct"}, UNEQUAL[IN_LOGS.columns]),
    **{
        f"practice_{column}.csv": (with_practice(column, *texts), {})
        for column, *texts in text_table(PRACTICE_MARKS)
    },
    "trained.csv": (csv(IN_LOGS.assign(training=1)), {}),
    "trained_with_a_screen.csv": (
        csv(with_rows(IN_LOGS, [["P03", "", "", ""]]).assign(loop=[""] + ["training"] * 80)), {},
    ),
    "psychopy.csv": (
        csv(
            with_rows(labelled(IN_LOGS, response="key_resp.keys"), PRACTICE[:2]).assign(
                **{"practice.thisN": [0, 1, *[""] * 80], "trials.thisN": ["", "", *range(80)]},
                **{"key_practice.keys": "space", "instr.keys": ""},
            )
        ),
        {},
    ),
    "trained_group.csv": (csv(IN_LOGS.assign(training=[1] * 40 + [0] * 40)), {}),
    "trained_groups.csv": (csv(IN_LOGS.assign(group=["training"] * 40 + ["control"] * 40)), {}),
    "unfilled.csv": (padded(CODED, subject="P12"), {"second_code": "1"}),
    "unfilled_subject.csv": (
        padded(CODED.replace({"P03": "3", "P12": "12"})), {"second_code": "1"},
    ),
    "unfilled_grams.csv": (
        padded(answered(IN_GRAMS, 37, 39).assign(rt=512), subject="P12"),
        {**WEIGHTS, "second_code": "39", "first_code": "37"},
    ),
    "arrays_line_by_line.txt": (JATOS.encode(), {}),
    "arrays_line_by_line.json": (JATOS.encode(), {}),
    "separators.jsonl": (
        "\n".join(
            json.dumps({**record, "note": "a\u2028b\u0085c"}, ensure_ascii=False)
            for record in RECORDS
        ).encode(),
        {},
    ),
    "row_names.csv": (ROW_NAMES.encode(), {}),
    "row_names.txt": (ROW_NAMES.replace(",", " ").encode(), {}),
    **{
        f"size_{size.replace(':', '_')}.xlsx": (
            with_part(excel(T=IN_LOGS), rb'(?<=<dimension ref=")[^"]*', size.encode()), {},
        )
        for size in ("A1", "A1:D21", "A1:C81", "D1:D81", "A50:D81", "A1:XFD1048576")
    },
    "formats.xlsx": (
        with_part(
            excel(T=IN_LOGS),
            b"</sheetData>",
            b"".join(
                b'<row r="%d" s="1"><c r="A%d" s="1"/><c r="XFD%d" s="1"/></row>' % (row, row, row)
                for row in range(100, 50_000)
            )
            + b"</sheetData>",
        ),
        {},
    ),
    "more_columns.csv": (csv(IN_LOGS.assign(rt=0.5, confidence=3, index=range(80))), {}),
}  # fmt: skip

#: What the notes say of some of these.
NOTES = {
    "windows.csv": "trial rows, comma-separated, Windows-1252 (--encoding NAME if that is wrong), ",
    "utf16_without_mark.csv": "trial rows, comma-separated, UTF-16, ",
    "encoding.csv": "trial rows, comma-separated, mac_roman, ",
    "lines_above.csv": "rows above row 4 left out",
    "participant.csv": "column Participant ID read as subject",
    **{
        f"practice_{column}.csv": f"8 rows left out as practice (column {column}: '{text}')"
        for column, text, _ in text_table(PRACTICE_MARKS)
    },
    "psychopy.csv": "2 rows left out as practice (column practice.thisN: '0', '1')",
    "units.csv": "2 rows without stimuli and response left out",
    "questions.csv": "2 rows of questions left out",
    "unfilled.csv": "20 rows left out as unfilled (stimuli and response are 0 in the last rows): ",
    "separators.jsonl": "trial rows, JSON, UTF-8, ",
    "missed_trials.csv": (
        "9 trials without a response dropped (empty in column key, empty in column rt): P03 9"
    ),
    "table.xlsx": "trial rows, Excel, ",
    "german.xlsx": "sheet Daten read, not Info",
    "title.xlsx": "rows above row 2 left out",
    "missing_words.csv": "10 trials without a response dropped ('-99', '999', '.', 'timeout', ",
}

#: Name, content, and parts of what is said, with the option that helps.
REFUSED = {
    "responses_and_trials.csv": (
        csv(IN_LOGS.assign(n_trials=40)),
        ["column n_trials: found beside responses, allowed: one row for each response of a"],
    ),
    "most_trials.csv": (
        csv(FREQUENCIES.assign(Freq=10**6)),
        ["column Freq: found 37,000,000 trials, allowed: at most 10,000,000"],
    ),
    "half_trials.csv": (
        csv(FREQUENCIES.assign(Freq=0.5)),
        ["column Freq: found '0.5' in 37 rows", "a whole number from 0 to 10^12"],
        {"columns": {"n_trials": "Freq"}},
    ),
    "no_names.csv": (csv(IN_LOGS, header=False), ["no_names.csv: has no header: row 1 holds 'P0"]),
    "row_names_of_a_part.csv": (
        IN_LOGS.set_axis(range(3, 83)).to_csv().removeprefix(",").encode(),
        ["row 2: found 5 cells below 4 names, allowed: a name for each column"],
    ),
    "one_name_too_few.csv": (
        csv(IN_LOGS.assign(subject=1, trial=1)[["subject", "trial", "s1", "s2", "response"]])
        .replace(b",trial", b"", 1),
        ["row 2: found 5 cells below 4 names, allowed: a name for each column"],
    ),
    "a_key_twice.json": (
        b'[{"subject": "a", "s1": 0, "s2": 1, "response": "second", " response": "first"}]',
        ["found the key 'response' twice in a record, allowed: once"],
    ),
    "half_a_character.json": (
        json.dumps([*RECORDS[:2], {**RECORDS[2], "subject": "A\ud800"}]).encode(),
        ["row 3, column subject: found 'A\\ud800' of type str"],
    ),
    "third_code.csv": (
        csv(with_rows(answered(IN_LOGS, 37, 39), [["P03", 0, 0.3, 0]] * 3)),
        ["type:  --missed 0", "only if nobody responded in these 3 trials; it drops them"],
        {"second_code": "39", "first_code": "37"},
    ),
    "missing_cell.txt": (
        IN_LOGS.replace({"subject": {"P03": ""}}).to_string(index=False).encode(),
        ["row 2: found 3 cells, allowed: 4 cells as in the header"],
    ),
    "keys.csv": (csv(answered(IN_LOGS, "f", "j")), ["'f' (", "--equal-code", "--second-code j"]),
    "two_keys.csv": (
        b"subject,s1,s2,k.keys,k_2.keys\na,,,space,\na,0,0.3,,j\na,0.3,0,,f\n",
        ["type:  --columns response=k_2.keys --second-code j"],
    ),
    "german_names.csv": (csv(GERMAN, sep=";"), ["--columns 's1=Reiz 1,s2=Reiz 2'"]),
    "two_sheets.xlsx": (
        excel(A=IN_LOGS, B=IN_LOGS), ["the sheets A and B have tables", "--sheet A"],
    ),
    "other_sheets.xlsx": (
        excel(A=IN_LOGS, B=IN_LOGS),
        ["found the sheets A, B, allowed: one of them"],
        {"sheet": "C"},
    ),
    "formula.xlsx": (
        excel(T=IN_LOGS.assign(s1="=1+1")),
        ["row 2, column s1: found a formula without a value"],
    ),
    "error.xlsx": (
        excel(T=IN_LOGS.assign(s1="#DIV/0!")),
        ["row 2, column s1: found #DIV/0!, allowed: a value that Excel"],
    ),
    "decibel_by_name.csv": (csv(DECIBEL), ["--columns s1=s1_dB,s2=s2_dB", "--unit dB"]),
    "decibel.csv": (
        csv(DECIBEL),
        ["column s1_dB seems to be in dB", "--unit dB ", "--unit dB-power"],
        {"columns": {"s1": "s1_dB", "s2": "s2_dB"}},
    ),
    "percent_in_cells.csv": (
        b"subject,s1,s2,response\na,7.0%,5 %,first\na,5%,7%,second\n",
        ["error: percent_in_cells.csv: the stimuli have the unit '%'.\ntype:  --unit %  if"],
    ),
    "another_unit.csv": (
        b"subject,s1,s2,response\na,70 dB,55 dB,first\n",
        ["the stimuli have the unit 'dB'.\n", "--unit dB ", "--unit dB-power"],
        {"unit": "g"},
    ),
    "decibel_as_intensity.csv": (
        csv(DECIBEL),
        ["column s1_dB seems to be in dB"],
        {"intensity": 1, "columns": {"i1": "s1_dB", "i2": "s2_dB"}},
    ),
    "zero_grams.csv": (
        csv(labelled(with_rows(IN_GRAMS, [["P03", 0, 905, "second"]]), w1="s1", w2="s2")),
        ["natural logs. If they are intensities, correct or remove rows with 0", "--unit ln"],
    ),
    "comparison_alone.csv": (
        csv(labelled(IN_LOGS, s2="comparison").drop(columns="s1")),
        ["If one standard was in all trials, add a column standard with its level."],
    ),
    "percent.csv": (
        csv(labelled(COUNTS, n_second="percent second").drop(columns="n_trials")),
        ["there is no column n_trials", "--columns n_trials=NAME"],
    ),
    "two_of_three_counts.csv": (
        THREE_COUNTS.replace("same", "tie").encode(), ["type:  --columns n_equal=NAME"],
    ),
    "proportion_of_others.csv": (
        csv(labelled(PROPORTIONS.assign(n_trials=7), n_second="p_second")),
        ["column p_second: found '0.", "a share that makes a whole number of 7 trials"],
    ),
    "few_decimals.csv": (
        csv(PROPORTIONS.assign(n_second=0.5, n_trials=40)),
        ["column n_second: found '0.5' in 31 rows", "a share that makes a whole number of 40"],
    ),
    "wide.csv": (csv(pd.DataFrame({"subject": ["P03"], "740_905": [3]})), ["no column s1"]),
    "wide_counts.csv": (
        WIDE_COUNTS.encode(),
        ["do they count?\ntype:  --columns n_second=cell  if", "--columns n_equal=cell   if"],
        {"wide": "{first}_{second}", "unit": "g"},
    ),
    "wide_counts_alone.csv": (
        WIDE_COUNTS.replace(",n", "").replace(",40", "").encode(),
        ["--columns n_second=cell --columns n_trials=NAME", "if they count 'second'"],
        {"wide": "{first}_{second}", "unit": "g"},
    ),
    "proportions_by_another_name.csv": (
        b"", ["p_second=cell', allowed", "; proportions are n_equal or n_second, too"],
        {"columns": {"p_second": "cell"}},
    ),
    "wide_by_another_name.csv": (
        csv(WIDE),
        ["found 0 columns with names or cells as --wide has it"],
        {"wide": "{first}-{second}"},
    ),
    "wide_and_unknown.csv": (
        b"subject,1_2,2_1\nP03,first,second\nP04,first,maybe\n",
        ["row 3, column 2_1: found 'maybe', allowed: second"],
        {"wide": "{first}_{second}", "columns": {"response": "cell"}},
    ),
    "table.ods": (b"PK", ["its copy as .xlsx or CSV"]),
    "table.csv.gz": (gzip.compress(csv(IN_LOGS)), ["an archive, allowed: the file in it"]),
    "data.RData": (b"RDX3", ["R data"]),
    "1_stairs.psydat": (b"\x80\x04", ["data of another program, allowed: its copy as CSV"]),
    "data.sav": (b"$FL2", ["its copy as CSV"]),
    "study.toml": (b'files = ["a.csv"]', ["settings, allowed: a table of trials or counts"]),
    "cut_73.mat": (matlab_73(LISTS)[:2000], ["found a damaged MATLAB file"]),
    "cut.mat": (
        matlab(LISTS)[:200],
        ["found a damaged MATLAB file (", "allowed: one that MATLAB has saved with '-v7'"],
    ),
    "link_73.mat": (linked_73(), ["damaged MATLAB file (subject is a link)"]),
    "table_73.mat": (
        matlab_73({"#subsystem#": [1.0]}), ["a table or another object of MATLAB's own"],
    ),
    "matrix.mat": (
        matlab({"data": TRIALS[["s1", "s2"]].to_numpy()}), ["found data, no columns of one length"],
    ),
    "several_structs.mat": (
        matlab({"a": LISTS, "b": LISTS}), ["found a, b, no columns of one length", "data frame"],
    ),
    "two_tasks.csv": (
        csv(with_rows(IN_LOGS, [["P03", 0, 0, "different"]])), ["words of two tasks"],
    ),
}  # fmt: skip

#: Name, content, and what the screen of `check` warns of.
WARNED = {
    "two_conditions.csv": (
        csv(IN_LOGS.assign(modality=["light", "sound"] * 40)), "--condition modality",
    ),
    "twice.csv": (csv(pd.concat([IN_LOGS[:40], IN_LOGS[:40], IN_LOGS[40:]])), "twice"),
    "percent_of_100.csv": (
        csv(COUNTS.assign(n_second=np.arange(len(COUNTS)), n_trials=100)), "percentages",
    ),
    "intervals.csv": (csv(IN_LOGS.assign(isi=[0.6, 1.2] * 40)), "--condition isi"),
    "delays.csv": (csv(IN_LOGS.assign(Delay=[600, 1200] * 40)), "--condition Delay"),
    **{
        f"{column}.csv": (
            csv(IN_LOGS.assign(**{column: [mark, *[other] * 4] * 16})),
            f"16 rows with '{mark}' in column {column} are counted; --where "
            f"{shlex.quote(f'{column}={other}')} leaves them out",
        )
        for column, mark, other in text_table(TAKEN_OUT)
    },
    "aborted.csv": (
        csv(IN_LOGS.assign(aborted=[1, *[""] * 4] * 16)), "--where aborted= leaves them out",
    ),
    "subject_na.csv": (
        csv(IN_LOGS.assign(subject=["NA"] * 10 + ["P03"] * 70)), "10 rows of subject 'NA'",
    ),
}  # fmt: skip


def typed(options):
    """Options of :func:`bayes_toe.read_study` as words of a command."""
    words = []
    for option, value in options.items():
        values = tuple(value.items()) if isinstance(value, dict) else str(value)
        words += shlex.split(Remedy(option, values).typed)
    return words


def check(folder, name, content, options):
    """What `check` says of such a file."""
    (folder / name).write_bytes(content)
    return inside("check", name, *typed(options), cwd=folder)


@pytest.mark.parametrize("name", READ)
def test_a_shape_is_read_as_it_is_meant(name, tmp_path):
    content, options, *intended = READ[name]
    (table,) = intended or [IN_LOGS]
    result = check(tmp_path, name, content, options)
    assert (result.returncode, result.stderr) == (0, "")
    study = bt.read_study(tmp_path / name, bt.ReadOptions(**options))
    assert counts_by_pair(study) == counts_by_pair(bt.read_study(table))
    assert any(note.startswith(NOTES.get(name, "")) for note in study.notes), study.notes


@pytest.mark.parametrize("name", REFUSED)
def test_a_shape_that_needs_a_word_is_refused_with_it(name, tmp_path):
    content, parts, *options = REFUSED[name]
    result = check(tmp_path, name, content, *(options or [{}]))
    assert result.returncode == 2
    assert all(part in result.stderr for part in parts), result.stderr


#: Codes of 'first', 'same' and 'second', the options that are given, and the first advice.
THREE_ANSWERS = """
    0 | 1 | 2 | second_code=2 | --equal-code 1 --second-code 2
    0 | 1 | 2 | second_code=2 first_code=0 | --equal-code 1 --second-code 2
    0 | 1 | 2 | first_code=0 | --equal-code 1 --second-code 2
    0 | 1 | 2 | equal_code=1 | --equal-code 1 --second-code 2
    0 | 1 | 2 | equal_code=1 different_code=0 | --equal-code 1 --second-code 2
    0 | 1 | 2 | equal_code=1 different_code=2 | --equal-code 1 --second-code 2
    0 | 1 | 2 |  | --equal-code 1 --second-code 2
    left | same | right |  | --equal-code same --second-code right
    left | same | right | second_code=right | --equal-code same --second-code right
    first | tie | second |  | --equal-code tie --second-code second
    first | tie | second | second_code=second | --equal-code tie --second-code second
    first | tie | later |  | --equal-code tie --second-code later
"""


@pytest.mark.parametrize("first, equal, second, codes, advice", text_table(THREE_ANSWERS))
def test_a_frequent_third_answer_is_no_missed_trial(first, equal, second, codes, advice):
    table = THREE.replace({"response": {"first": first, "same": equal, "second": second}})
    options = dict(pair.split("=") for pair in codes.split())
    with pytest.raises(bt.InputError) as caught:
        bt.read_study(table, bt.ReadOptions(**options))
    chosen, _ = caught.value.choices[0]
    assert " ".join(remedy.typed for remedy in chosen) == advice
    assert "missed" not in {remedy.option for remedy in caught.value.remedies}
    if len(chosen) > 1:
        options.pop("different_code", None)
    study = bt.read_study(table, with_remedies(bt.ReadOptions(**options), chosen))
    assert study.frame().equals(bt.read_study(THREE).frame())


def test_counts_of_three_answers_are_known_by_their_names():
    study = bt.read_study(pd.read_csv(io.StringIO(THREE_COUNTS)))
    assert study["a"].n_first.tolist() == [1, 4]


@pytest.mark.parametrize("text", [WIDE_COUNTS, IN_SHARES])
def test_counts_and_proportions_of_wide_tables(text):
    options = bt.ReadOptions(wide="{first}_{second}", unit="g", columns={"n_second": "cell"})
    study = bt.read_study(pd.read_csv(io.StringIO(text)), options)
    assert study.frame().n_second.sum() == 157


def test_a_sheet_is_one_of_an_excel_file(tmp_path):
    result = check(tmp_path, "a.csv", csv(IN_LOGS), {"sheet": "A"})
    assert result.stderr == "error: a.csv: found --sheet A, allowed: with an Excel file\n"


def test_practice_is_read_where_it_is_asked_for(tmp_path):
    for name in ("practice_test_part.csv", "practice_catch.csv"):
        content, _ = READ[name]
        (tmp_path / name).write_bytes(content)
        study = bt.read_study(tmp_path / name, bt.ReadOptions(ignore="practice"))
        assert study["P03"].total_trials == 48


def test_unfilled_rows_of_a_file_that_names_the_subject(tmp_path):
    trials = CODED[CODED.subject == "P12"].drop(columns="subject")
    (tmp_path / "P12.csv").write_bytes(padded(trials))
    options = bt.ReadOptions(second_code="1", subject_from="{}.csv")
    study = bt.read_study(tmp_path / "P12.csv", options)
    assert study["P12"].total_trials == len(trials)
    assert study.notes[1].endswith("(stimuli and response are 0 in the last rows): P12.csv 20")


def test_pairs_of_zeros_that_are_trials_stay():
    rng = default_rng(1)
    difference = np.repeat([1, 0], 30)
    rows = {"subject": "a", "s1": difference, "s2": 0, "response": difference}
    sorted_by_pair = bt.read_study(pd.DataFrame(rows), bt.ReadOptions(equal_code="0"))
    few_zeros = pd.concat([CODED, CODED[:3].assign(subject="P12", s1=0, s2=0, response=0)])
    assert sorted_by_pair["a"].total_trials == 60
    study = bt.read_study(few_zeros, bt.ReadOptions(second_code="1"))
    assert study["P12"].total_trials == 43
    # A reaction time shows that a row is a trial.
    timed = pd.concat([CODED, CODED[:20].assign(subject="P12", s1=0, s2=0, response=0)])
    timed["rt"] = rng.integers(300, 900, len(timed))
    study = bt.read_study(timed, bt.ReadOptions(second_code="1"))
    assert study["P12"].total_trials == 60


def test_a_file_without_columns_of_trials_is_named(tmp_path):
    (tmp_path / "stopped.csv").write_text("subject,date\nP99,1\n")
    for table in (IN_GRAMS, answered(IN_GRAMS, "f", "j")):
        result = check(tmp_path, "a.csv", csv(table), {})
        assert "--columns s1=w1,s2=w2" in result.stderr
        assert inside("check", ".", cwd=tmp_path).stderr.splitlines() == [
            "error: stopped.csv: row 1: there is no column s1, no column s2 and no column "
            "response. The columns are subject, date. Type the names of the other files, or "
            "remove this."
        ]


@pytest.mark.parametrize("name", WARNED)
def test_a_shape_that_may_mislead_is_warned_of(name, tmp_path):
    content, part = WARNED[name]
    result = check(tmp_path, name, content, {})
    assert result.returncode == 0
    assert part in " ".join(result.stdout.split())
    if part.endswith("leaves them out"):
        options = shlex.split(part)[-5:-3]
        assert " 64 trials" in inside("check", name, *options, cwd=tmp_path).stdout


def mutated(text, rng):
    """A table with some characters, cells or rows changed."""
    for _ in range(rng.choice([1, 1, 2, 5])):
        position = rng.randrange(len(text) or 1)
        kind = rng.randrange(5)
        if kind == 0:
            text = text[:position] + text[position + 1 :]
        elif kind == 1:
            text = text[:position] + rng.choice(",;\t|.\"'059 -e\nx\u2212\u00a0é") + text[position:]
        elif kind == 2:
            rows = text.split("\n")
            rows.insert(rng.randrange(len(rows)), rng.choice(rows))
            text = "\n".join(rows)
        elif kind == 3:
            cells = ["", "NA", "999", "1,5", "1.050", "equal", "1e3", "inf", "+0.1", "0.30", "½"]
            text = text.replace(rng.choice(text.split(",")), rng.choice(cells), 1)
        else:
            text = text.replace(rng.choice(",."), rng.choice(",;\t"))
    return text


def read_strictly(text):
    """How often each subject, pair and response is there; None where a cell is not plain."""
    records = list(csv_module.reader(io.StringIO(text), strict=True))
    if records[:1] != [["subject", "s1", "s2", "response"]]:
        return None
    counts = Counter()
    for record in records[1:]:
        if len(record) != 4 or record[3] not in ("second", "first") or not record[0].strip():
            return None
        try:
            first, second = map(float, record[1:3])
        except ValueError:
            return None
        counts[record[0].strip(), first + 0.0, second + 0.0, record[3]] += 1
    return counts


def test_a_changed_table_is_read_as_it_stands_or_refused(tmp_path):
    text, path, n_equal = csv(IN_LOGS).decode(), tmp_path / "changed.csv", 0
    rng = random.Random(1)
    for _ in range(400):
        changed = mutated(text, rng)
        path.write_text(changed, encoding="utf-8")
        try:
            study = bt.read_study(path)
        except bt.InputError:
            continue
        with suppress(csv_module.Error):
            intended = read_strictly(changed)
            if intended is not None:
                n_equal += 1
                counts = Counter()
                for subject, first, second, n_yes, n in study.frame().to_numpy().tolist():
                    counts[subject, first, second, "second"] += n_yes
                    counts[subject, first, second, "first"] += n - n_yes
                assert +counts == intended, changed
    assert n_equal > 50


def write_folder(folder, *names):
    (folder / "data").mkdir()
    for name in names:
        (folder / "data" / name).parent.mkdir(exist_ok=True)
        (folder / "data" / name).write_bytes(csv(IN_LOGS, sep="\t"))


def test_counts_in_notes_are_those_of_all_files(tmp_path):
    rows = [["P03", "", "", ""], ["P03", 0, 0.3, ""]]
    table = with_rows(IN_LOGS[:40], rows).assign(part=["main"] * 37 + ["practice"] * 5)
    for name, part in (("anna", table), ("ben", table[1:])):
        (tmp_path / f"{name}.csv").write_bytes(csv(part.assign(subject=name)))
    screen = " ".join(inside("check", "anna.csv", "ben.csv", cwd=tmp_path).stdout.split())
    study = bt.read_study([tmp_path / "anna.csv", tmp_path / "ben.csv"])
    assert study.notes[1].startswith("10 rows left out as practice (column part: 'practice')")
    assert study.notes[2:] == (
        "anna.csv: 1 row without stimuli and response left out",
        "2 trials without a response dropped: anna 1, ben 1",
    )
    assert f"Read as {study.notes[0]}" in screen
    counts = map(int, re.findall(r"' \((\d+)\)", study.notes[0]))
    assert sum(counts) == study["anna"].total_trials + study["ben"].total_trials == 70


def test_a_folder_stands_for_its_tables(tmp_path):
    write_folder(tmp_path, "1.csv", "2.CSV", "~$1.csv", ".3.csv", "1.log")
    study = bt.read_study(tmp_path / "data")
    assert study.source == "2 files, 1.csv to 2.CSV"
    assert study.notes[0] == f"folder {display_name(str(tmp_path / 'data'))}: 2 .csv files read"
    line = "fit data -o data/1.csv --overwrite --replicates 2"
    assert "this command reads that file and must not replace it" in refused(line, cwd=tmp_path)


#: Files, of which none tells its subject or all have subject '1'; what `check` says; subjects.
SUBJECTS_BY_NAME = """
    VP1/data.csv VP2/data.csv | --subject-from '{}/*' if the subjects are VP1, VP2 | VP1 VP2
    A/s1/d.csv B/s2/d.csv | --subject-from '{}/*/*' if the subjects are A, B | A B
    A_03-01.csv A_03-02.csv B_03-01.csv | --subject-from '{}_*' if the subjects are A, B | A B
    1: A.csv B.csv | of one subject, 1. If they are of several, --subject-from '{}.*' | A B
    1: A/d.csv B/d.csv | of one subject, 1. If they are of several, --subject-from '{}/*' | A B
"""


@pytest.mark.parametrize("names, part, subjects", text_table(SUBJECTS_BY_NAME))
def test_subjects_have_the_names_of_files_or_folders(names, part, subjects, tmp_path):
    table = IN_LOGS.drop(columns="subject")
    subject, _, files = names.rpartition(": ")
    if subject:
        table["subject"] = subject
    for name in files.split():
        path = tmp_path / "data" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(csv(table))
    result = inside("check", "data", cwd=tmp_path)
    assert part in " ".join((result.stdout + result.stderr).split())
    pattern = re.search(r"'(\{\}.*)'", part)[1]
    study = bt.read_study(tmp_path / "data", bt.ReadOptions(subject_from=pattern))
    assert study.names == tuple(subjects.split())


@pytest.mark.parametrize(
    "names, problem",
    [
        (["A/a.csv", "B/b.tsv"], "allowed: tables of one suffix, such as data/*/*.csv"),
        ([], "data: found no table, allowed: tables of one suffix, such as data/*.csv"),
        (["a.csv", "b.tsv", "c.tsv"], "data: found 1 .csv file and 2 .tsv files, allowed: "
         "tables of one suffix, such as data/*.tsv"),
    ],
)  # fmt: skip
def test_a_folder_that_may_mean_several_studies_is_asked_for(names, problem, tmp_path):
    write_folder(tmp_path, *names)
    assert problem in refused("check data", cwd=tmp_path)
