"""The real command line: outputs, exit codes, messages, and nothing half-written.

Every exit code is seen in a process of its own once; what a process would not change runs inside
this one.
"""

import itertools
import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from commands import call, good, inside, refused
from conftest import few_replicates, grouped_csv

import bayes_toe as bt
from bayes_toe.inference.sampling import SamplerSettings
from bayes_toe.model.parameters import ObserverPrior

ONE = ("--seed", 1, "--workers", 1)


@pytest.fixture(scope="module")
def folder(tmp_path_factory, small_study):
    folder = tmp_path_factory.mktemp("cli")
    grouped_csv(folder / "study.csv", small_study.select(["A", "B"]))
    grouped_csv(folder / "one.csv", small_study.select(["B"]))
    return folder


@pytest.fixture(scope="module")
def results(folder):
    with few_replicates():
        return folder / "out", good(
            "run", "study.csv", "-o", "out", "--draws", 1000, *ONE, cwd=folder
        )


# --- run ------------------------------------------------------------------------------------------


def test_run_writes_everything(results):
    out, printed = results
    assert {p.name for p in out.iterdir() if not p.name.startswith(".")} == {
        "posterior.nc", "summary.csv", "evidence.csv", "corner", "report.html", "methods.md", "methods.bib"
    }  # fmt: skip
    assert {p.name for p in (out / "corner").iterdir()} == {"A.png", "B.png"}
    assert all(p.read_bytes().startswith(b"\x89PNG") for p in (out / "corner").iterdir())
    summary = pd.read_csv(out / "summary.csv", dtype={"subject": str}, keep_default_na=False)
    assert set(summary.parameter) == {
        "mu1",
        "sigma_p",
        "sigma_l",
        "q0",
        "gamma",
        "sigma1",
        "gain",
        "width",
        "pse_shift",
        "jnd",
    }
    assert (summary.r_hat < 1.01).all()
    assert list(pd.read_csv(out / "evidence.csv").subject) == ["A", "B"]
    assert printed.startswith(
        "study.csv: 2 subjects, 1,300 trials, same-different task, 13 pairs\n"
    )
    assert "\nAnswer\nOrder effect: 2 of 2 subjects yes.\n" in printed
    assert printed.endswith("report.html. Seed 1.\n")
    assert not re.search(r"\d+%", printed)  # no progress bar where nobody looks


def test_the_sections_of_the_report_are_in_order(results):
    text = (results[0] / "report.html").read_text(encoding="utf-8")
    sections = (
        "answer",
        "overview",
        "trust",
        "files",
        "subject-1",
        "subject-2",
        "order",
        "evidence",
        "read",
        "paper",
    )
    order = [text.index(f'id="{place}"') for place in sections]
    assert order == sorted(order)
    assert 'class="misfit"' not in text
    joined = " ".join(text.split())
    assert "Order effect: 2 of 2 subjects yes." in joined
    assert "of 2 subjects gave more " in joined
    assert "It does not test for an order effect" in joined
    assert re.search(r"effective draws asked for</th><td>1000<", text)
    for absent in ("synthetic data", "Problems in the responses"):
        assert absent not in text


def test_the_report_needs_nothing_but_the_files_beside_it(results):
    text = (results[0] / "report.html").read_text(encoding="utf-8")
    assert not re.search(r"""src=["'](?!data:)""", text)
    beside = set(re.findall(r'href="(?!data:|#)([^"]*)"', text))
    assert beside == {
        "summary.csv",
        "evidence.csv",
        "corner",
        "corner/A.png",
        "corner/B.png",
        "posterior.nc",
        "methods.md",
        "methods.bib",
    }
    assert all((results[0] / name).exists() for name in beside)
    assert text.count("data:image/png;base64,") == 2 + 2 * 2
    assert "bayes-toe explore posterior.nc -o explorer.html" in text
    assert all(f'id="{anchor}"' in text for anchor in re.findall(r'href="#([^"]+)"', text))


def test_a_misfit_is_loud_in_terminal_and_report(folder, small_study, blank_pictures):
    """Answers that no smooth curve describes.

    Those to two pairs of one observer are turned round.
    """
    subject = small_study["A"]
    equal = subject.n_yes.copy()
    equal[[2, 5]] = subject.n_trials[[2, 5]] - equal[[2, 5]]
    grouped_csv(
        folder / "bent.csv",
        bt.Study([replace(subject, name="bent", n_yes=equal), small_study["B"]]),
    )
    said = good(
        "run", "bent.csv", "-o", "bent", "--draws", 300, "--figures", "none", *ONE, cwd=folder
    )
    assert "The model does not fit 1 subject: bent." in said
    assert "! bent  The model does not fit. Report no conclusion for this subject." in said
    places = [said.index(words) for words in ("contraction p", "! bent", "Answer")]
    assert places == sorted(places)
    text = (folder / "bent" / "report.html").read_text(encoding="utf-8")
    assert text.count('<div class="misfit">') == 1


def test_not_converged_is_exit_code_3_and_marked_everywhere(monkeypatch, tmp_path, blank_pictures):
    # One pass and an R-hat that chance alone exceeds.
    defaults = SamplerSettings.__init__.__defaults__
    monkeypatch.setattr(
        SamplerSettings.__init__, "__defaults__", (*defaults[:-3], 1.000001, 1, 0.05)
    )
    counts = "\n".join(
        f"x,{a},{b},25,50" for a, b in [(0, 0), (0, 0.3), (0.3, 0), (0.3, 0.3), (0, 0.5), (0.5, 0)]
    )
    (tmp_path / "s.csv").write_text("subject,s1,s2,n_equal,n_trials\n" + counts + "\n")
    done = inside("run", "s.csv", "-o", "out", "--draws", 500, *ONE, cwd=tmp_path)
    assert (done.returncode, done.stderr) == (3, "")
    assert "! x  The draws did not converge: " in done.stdout
    assert "did not converge" in (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    assert list(bt.load(tmp_path / "out" / "posterior.nc").not_converged) == ["x"]


def test_subjects_may_be_any_text_and_are_never_paths_or_html(tmp_path, blank_pictures):
    names = [
        "../../<script>alert(1)</script> a$b_{c}",
        "na",
        "NA",
        "=S\x1b[2J\x9b\u202e\u2066\u200b\nx",
    ]
    pairs = [
        (0, 0, 48),
        (0, 0.2, 31),
        (0, 0.4, 6),
        (0.2, 0, 35),
        (0.2, 0.4, 34),
        (0.4, 0, 11),
        (0.4, 0.4, 47),
    ]
    rows = [f'"{n}",{a},{b},{k},50' for n, (a, b, k) in itertools.product(names, pairs)]
    (tmp_path / "s.csv").write_text(
        "subject,s1,s2,n_equal,n_trials\n" + "\n".join(rows) + "\n", encoding="utf-8"
    )
    printed = good(
        "run", "s.csv", "-o", "out", "--draws", 100, "--spreadsheet-safe", *ONE, cwd=tmp_path
    )
    files = [p.name for p in (tmp_path / "out" / "corner").iterdir()]
    assert len({f.lower() for f in files}) == len(names)
    assert all(re.fullmatch(r"[A-Za-z0-9_.-]+\.png", f) for f in files)
    report = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    assert "<script>alert" not in report
    assert "&lt;script&gt;" in report
    unknown = refused(
        "corner", "out/posterior.nc", "-o", "c", "--subject", "\x1b\u202e", cwd=tmp_path
    )
    checked = good("check", "s.csv", cwd=tmp_path)
    for shown in (report, printed, checked, unknown):  # nothing that a terminal or a browser obeys
        assert "\\x1b" in shown
        assert [one for one in shown if not one.isprintable() and one != "\n"] == []
    assert "as formulas: '=S" in " ".join(checked.split())
    assert bt.load(tmp_path / "out" / "posterior.nc").names == tuple(names)
    assert list(
        pd.read_csv(tmp_path / "out" / "evidence.csv", dtype=str, keep_default_na=False).subject
    ) == [*names[:-1], f"'{names[-1]}"]
    assert sorted(path.name for path in tmp_path.iterdir()) == ["out", "s.csv"]


# --- evidence, sample, fit ------------------------------------------------------------------------


def test_evidence_leads_with_model_evidence_and_has_the_table_of_run(folder, results):
    said = good("evidence", "one.csv", "-o", "evidence.csv", *ONE, cwd=folder)
    (head, _, of_b), found = (
        (place / "evidence.csv").read_text().splitlines() for place in (results[0], folder)
    )
    assert found == [head, of_b]  # whatever the company
    places = ("Log model evidence.", "contraction p", "Answer\nB: Order effect: yes")
    assert sorted(places, key=said.index) == [*places]
    for row in pd.read_csv(folder / "evidence.csv").itertuples():
        assert re.search(rf"^{row.subject} .*{row.order_effect}", said, re.MULTILINE)


def test_a_design_that_cannot_tell_everything_is_said_before_sampling(folder):
    rows = "".join(f"X,0,{0.1 * i:.1f},{9 - 2 * i},10\n" for i in range(4))
    (folder / "first.csv").write_text("subject,s1,s2,n_equal,n_trials\n" + rows, encoding="utf-8")
    done = inside("sample", "first.csv", "-o", "first.nc", "--draws", 200, *ONE, cwd=folder)
    assert done.returncode in (0, 3), done.stderr
    sentence = (
        "Order effect, constant error and contraction cannot be told, because unequal stimuli"
    )
    for screen in (done.stdout, good("check", "first.csv", cwd=folder)):
        assert sentence in " ".join(screen.split())


def test_fit_writes_its_columns_and_states_its_level(folder):
    said = good(
        "fit", "study.csv", "-o", "fit.csv", "--replicates", 50, "--level", 0.8, *ONE, cwd=folder
    )
    assert "[80 % interval of 50 bootstrap replicates]" in said
    frame = pd.read_csv(folder / "fit.csv", dtype={"subject": str}, keep_default_na=False)
    natural = ("mu1", "sigma_p", "sigma_l", "q0")
    limits = list(map("_".join, itertools.product(natural, ("lower", "upper"))))
    assert list(frame.columns) == [
        "subject",
        *natural,
        "log_likelihood",
        "at_edge",
        *limits,
        "level",
        "replicates",
        "penalty",
    ]
    assert (set(frame.level), list(frame.subject)) == ({0.8}, ["A", "B"])
    assert (frame.sigma_p_lower < frame.sigma_p_upper).all()
    assert "exists" in refused("fit", "study.csv", "-o", "fit.csv", cwd=folder)
    refused("fit", "study.csv", "-o", "x.csv", "--level", "1.5", cwd=folder)


def test_fit_of_degenerate_answers_is_empty_and_said(tmp_path):
    (tmp_path / "s.csv").write_text("subject,s1,s2,n_equal,n_trials\nx,0,0.3,20,50\n")
    said = good("fit", "s.csv", "-o", "fit.csv", "--replicates", 20, *ONE, cwd=tmp_path)
    assert "not determined by these answers: sigma_p, sigma_l, q0" in said
    row = pd.read_csv(tmp_path / "fit.csv", dtype=str, keep_default_na=False).iloc[0]
    assert (row.at_edge, row.sigma_p, row.sigma_l_upper, row.level, row.replicates) == (
        "not unique",
        "",
        "",
        "0.95",
        "20",
    )


# --- saved draws ----------------------------------------------------------------------------------


def test_corner_of_one_subject_and_of_two_with_prior_and_truth_in_any_quantities(folder, results):
    (folder / "truth.csv").write_text(
        "subject,mu1,gain,q0\nA,-0.7,0.8,\nZ,1,0.5,0.9\n", encoding="utf-8"
    )
    posterior = results[0] / "posterior.nc"
    good(
        "corner",
        posterior,
        "-o",
        "one",
        "--subject",
        "B",
        "--coordinates",
        "identified",
        cwd=folder,
    )
    assert [p.name for p in (folder / "one").glob("*.png")] == ["B.png"]
    asked = (
        "--subject",
        "B",
        "--subject",
        "A",
        "--parameters",
        "gain, offset",
        "--show-prior",
        "--truth",
        "truth.csv",
    )
    said = good(
        "corner", posterior, "-o", "both", *asked, "--format", "svg", "--format", "pdf", cwd=folder
    )
    assert "1 corner plot in both" in said
    assert {p.name for p in (folder / "both").iterdir() if not p.name.startswith(".")} == {
        "B+A.svg",
        "B+A.pdf",
    }
    words = (folder / "both" / "B+A.svg").read_text(encoding="utf-8")
    assert all(
        said in words
        for said in (
            "B (solid)",
            "A (dashed)",
            "grey: prior",
            "squares, triangles: true values",
            "offset",
        )
    )


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (
            "corner POSTERIOR --parameters gain,mu_1",
            "'mu_1' is unknown or named twice. The parameters are mu1, sigma_p",
        ),
        ("corner POSTERIOR --parameters gain,gain", "'gain' is unknown or named twice"),
        ("corner POSTERIOR --parameters gain --coordinates natural", "exclude each other"),
        ("corner POSTERIOR --format gif", "format 'gif': allowed: pdf, png, svg"),
        ("corner POSTERIOR --subject A --subject Z", "no subject 'Z'"),
        (
            "corner POSTERIOR --truth study.csv",
            "found 'subject', 's1', 's2', 'n_equal', 'n_trials', allowed: subject and some of mu1",
        ),
        ("run study.csv --figures some", "must be one of all, flagged, none"),
        ("run study.csv -o out", "overwrite"),
        ("run study.csv -o study.csv/new", "study.csv"),
        ("run study.csv -o study.csv", "study.csv"),
    ],
)
def test_what_is_refused_before_the_work_in_one_line(folder, results, small_study, words, said):
    grouped_csv(folder / "three.csv", small_study)
    (folder / "wide.toml").write_text("[paper]\nmu1_sd = 20.0\n", encoding="utf-8")
    given = words.replace("POSTERIOR", str(results[0] / "posterior.nc")).split()
    assert said in refused(*given, *(() if "-o" in given else ("-o", "none")), cwd=folder)


def test_run_writes_the_figures_of_the_paper(folder, blank_pictures):
    words = ("run", "study.csv", "-o", "with_figures", "--draws", 300, "--figures", "none", *ONE)
    good(*words, "--paper-figures", cwd=folder)
    names = {path.name for path in (folder / "with_figures" / "paper_figures").iterdir()}
    assert len(names) == 11
    assert {"figure_4_map.pdf", "figure_4_map.png", "captions.md"} < names


# --- simulate, check, priors ----------------------------------------------------------------------


def test_simulate_then_check_then_quiet(tmp_path):
    good(
        "simulate",
        "-o",
        "s.csv",
        "--truth",
        "t.csv",
        "--subjects",
        1,
        "--batches",
        8,
        "--seed",
        1,
        cwd=tmp_path,
    )
    assert list(pd.read_csv(tmp_path / "t.csv").columns) == [
        "subject",
        "mu1",
        "sigma_p",
        "sigma_l",
        "q0",
    ]
    assert len(pd.read_csv(tmp_path / "s.csv")) == 8 * 13
    assert "synthetic" in good("check", "s.csv", cwd=tmp_path)
    assert good("evidence", "s.csv", "-o", "e.csv", "--quiet", "--workers", 1, cwd=tmp_path) == ""


def test_trials_that_are_there_twice_are_said_by_every_command(tmp_path):
    rows = [
        "subject,block,trial,s1,s2,response",
        *(f"[i]x,1,{i},{i % 2},{i % 3},{('same', 'different')[i % 2]}" for i in range(12)),
    ]
    (tmp_path / "s.csv").write_text("\n".join([*rows, *rows[1:]]) + "\n")
    sentence = "! s.csv: 12 rows repeat block and trial of another row with the same stimuli and"
    for command in (
        ["check"],
        ["fit", "--replicates", 2],
        ["evidence", "--workers", 1],
    ):
        assert good(command[0], "s.csv", *command[1:], cwd=tmp_path).count(sentence) == 1


def test_a_block_with_swapped_buttons_is_told_by_check_and_report(tmp_path, blank_pictures):
    """A study of trials, in which one block was answered the wrong way round.

    Its columns have names of their own.
    """
    rng, rows = np.random.default_rng(3), ["subject,s1,s2,response,[b]Run,ISI,rt"]
    for block in range(1, 6):
        for s1, s2 in list(itertools.product((0.0, 0.2, 0.5), repeat=2)) * 12:
            equal = (rng.random() < 0.9 * np.exp(-(((s2 - s1 - 0.05) / 0.2) ** 2))) ^ (block == 2)
            rows.append(f"[i]x,{s1},{s2},{'equal' if equal else 'different'},<{block}>,1,0.5")
    (tmp_path / "s.csv").write_text("\n".join(rows) + "\n")
    lines = good("check", "s.csv", "--columns", "block=[b]Run", cwd=tmp_path).splitlines()
    assert lines[6].split() == [
        "[i]x",
        "540",
        "42",
        "%",
        "responses",
        "look",
        "swapped",
        "in",
        "block",
        "<2>",
    ]
    command = "  bayes-toe run s.csv --columns 'block=[b]Run'"
    assert lines[-2:] == [f"{command} --swap '[i]x:<2>'", f"{command} --exclude '[i]x:<2>'"]
    turned = good("check", "s.csv", "--columns", "block=[b]Run", "--swap", "[i]x:<2>", cwd=tmp_path)
    assert "look swapped" not in turned
    assert "! Column ISI looks like isi (seconds), but it is ignored." in lines
    assert "  type: --columns isi=ISI" in lines
    assert "- Ignored columns: ISI, rt." in lines
    unread = good("check", "s.csv", cwd=tmp_path)
    assert "swapped" not in unread
    assert "- Ignored columns: [b]Run, ISI, rt." in unread
    good(
        "run",
        "s.csv",
        "-o",
        "out",
        "--draws",
        500,
        "--columns",
        "block=[b]Run",
        "--figures",
        "none",
        *ONE,
        cwd=tmp_path,
    )
    report = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    section = report[report.index('<summary id="pooling">') : report.index('<summary id="order">')]
    assert "<strong>[i]x</strong>: Responses look swapped in block &lt;2&gt;." in section


def test_bad_input_is_one_line_a_problem_and_exit_code_2(tmp_path):
    (tmp_path / "bad.csv").write_text("subject,s1,s2,n_equal,n_trials\nx,0,0,12,10\ny,0,abc,1,2\n")
    for command in (["check"], ["run", "-o", "out"], ["sample"], ["evidence"], ["fit"]):
        done = inside(command[0], "bad.csv", *command[1:], cwd=tmp_path)
        first, second = done.stderr.strip().splitlines()
        assert done.returncode == 2
        assert "row 2, column n_equal: found '12'" in first
        assert "row 3, column s2: found 'abc'" in second
    assert sorted(p.name for p in tmp_path.iterdir()) == ["bad.csv"]


def test_a_prior_file_is_used_shown_and_stored(folder, blank_pictures):
    (folder / "narrow.toml").write_text(
        "[paper]\nmu1_sd = 2.0  # informative\nsigma_p_scale = 0.5\n[contraction]\nsd = 0.5\n",
        encoding="utf-8",
    )
    said, under = "mu1 ~ Normal(0, 2), sigma_p ~ HalfNormal(0.5)", ("--prior", "narrow.toml")
    printed = good(
        "run",
        "one.csv",
        "-o",
        "narrow",
        "--draws",
        500,
        "--figures",
        "none",
        *under,
        *ONE,
        cwd=folder,
    )
    assert "\nPrior: narrow.toml\n" in printed
    assert said in (folder / "narrow" / "report.html").read_text(encoding="utf-8")
    expected = bt.Prior(mu1_sd=2.0, sigma_p_scale=0.5, observer=ObserverPrior(contraction_sd=0.5))
    assert bt.load(folder / "narrow" / "posterior.nc").prior == expected
    assert (
        pd.read_csv(folder / "narrow" / "evidence.csv").prior.str.contains(said, regex=False).all()
    )
    assert said in " ".join(good("check", "one.csv", *under, cwd=folder).split())
    assert "Prior: narrow.toml" in good(
        "fit", "one.csv", "-o", "narrow_fit.csv", "--replicates", 20, *under, *ONE, cwd=folder
    )
    assert set(pd.read_csv(folder / "narrow_fit.csv").penalty) == {"mu1 ~ Normal(0, 2)"}


def test_a_preset_is_a_word_and_a_file_of_that_name_has_a_path(folder):
    (folder / "default").write_text("[paper]\nmu1_sd = 7.0\n", encoding="utf-8")
    said = [
        good("check", "study.csv", "--prior", given, cwd=folder)
        for given in ("paper", "default", "./default")
    ]
    said = [" ".join(one.split()) for one in said]
    assert "mu1 ~ Normal(0, 10)" in said[0]
    assert "mu1 ~ Normal(M, 2.5 R), width ~ LogNormal(D, 1)" in said[1]
    assert "mu1 ~ Normal(0, 7)" in said[2]


@pytest.mark.parametrize("command", ["run", "sample", "evidence", "fit", "check"])
def test_a_bad_prior_file_is_one_line_for_every_command(folder, command):
    (folder / "bad.toml").write_text("[paper]\nmu1_sd = -1\n", encoding="utf-8")
    words = (
        "study.csv",
        *(() if command == "check" else ("-o", "bad.csv")),
    )
    said = "error: bad.toml: [paper] key mu1_sd: found -1, allowed: a number from 1e-100 to 1e+100 or 'stimuli'\n"
    assert refused(command, *words, "--prior", "bad.toml", cwd=folder) == said


# --- the program itself ---------------------------------------------------------------------------


def test_the_installed_command_is_there_and_has_the_version():
    assert (Path(sys.executable).parent / "bayes-toe").exists()
    assert call("--version").stdout.strip() == f"bayes-toe {bt.__version__}"


LARGE = {"pandas", "xarray", "arviz", "arviz_stats", "emcee", "joblib", "matplotlib", "scipy.stats"}


@pytest.mark.parametrize(
    ("code", "libraries"),
    [
        ("import bayes_toe", {*LARGE, "scipy", "numpy"}),
        (
            "from bayes_toe.cli.app import app; app(['--help'], standalone_mode=False)",
            {*LARGE, "scipy"},
        ),
        (
            "from bayes_toe.cli.app import app; app(['population', '--help'], "
            "standalone_mode=False)",
            {*LARGE, "scipy"},
        ),
        (
            "from bayes_toe.cli.app import app; app(['check', 'study.csv'], standalone_mode=False)",
            LARGE,
        ),
    ],
)
def test_a_quick_command_loads_no_large_library(study_csv, code, libraries):
    said = f"{code}; import sys; print([*{libraries} & {{*sys.modules}}])"
    done = subprocess.run(
        [sys.executable, "-c", said],
        capture_output=True,
        text=True,
        check=True,
        cwd=study_csv.parent,
    )
    assert done.stdout.splitlines()[-1] == "[]"
