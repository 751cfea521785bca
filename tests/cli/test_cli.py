"""The real command line: outputs, exit codes, messages, and nothing half-written.

Every command, and every exit code, is seen in a process of its own once; what a process would not change runs inside this one.
"""

import itertools
import re
import subprocess
import sys
from functools import partial
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from commands import call, inside
from conftest import grouped_csv

import bayes_toe as bt
from bayes_toe.classical.fit_table import subject_fit
from bayes_toe.cli.app import COMMANDS
from bayes_toe.cli.results_folder import corner_files
from bayes_toe.inference.sampling import SamplerSettings


@pytest.fixture(scope="module")
def folder(tmp_path_factory, small_study):
    folder = tmp_path_factory.mktemp("cli")
    grouped_csv(folder / "study.csv", small_study.select(["A", "B"]))
    return folder


@pytest.fixture(scope="module")
def results(folder):
    done = call("run", "study.csv", "-o", "out", "--seed", "1", "--draws", "1000", "--workers", "1", cwd=folder)
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""
    return folder / "out", done.stdout


def test_run_writes_everything(results):
    out, printed = results
    assert {p.name for p in out.iterdir() if not p.name.startswith(".")} == {
        "posterior.nc", "summary.csv", "evidence.csv", "corner", "report.html"
    }  # fmt: skip
    assert {p.name for p in (out / "corner").iterdir()} == {"A.png", "B.png"}
    assert all(p.read_bytes().startswith(b"\x89PNG") for p in (out / "corner").iterdir())
    summary = pd.read_csv(out / "summary.csv", dtype={"subject": str}, keep_default_na=False)
    assert set(summary.parameter) == {"mu1", "sigma_p", "sigma_l", "q0", "gamma", "sigma1", "gain", "width"}
    assert (summary.r_hat < 1.01).all()
    assert list(pd.read_csv(out / "evidence.csv").subject) == ["A", "B"]
    assert "seed 1" in printed
    assert "grouped rows, comma-separated" in printed
    said = "in short: 2 of 2 subjects have an order effect (counted where evidence is at least positive: P above 0.73 against each rival)"
    assert printed.splitlines()[-1] == f"{said}; H1 describes the answers of all"
    assert not re.search(r"\d+%", printed)  # no progress bar where nobody looks


def test_the_report_stands_alone(results):
    text = (results[0] / "report.html").read_text(encoding="utf-8")
    sections = ("read", "evidence", "order", "appendix-c", "subject-1", "subject-2", "prior", "method", "files")
    order = [text.index(f'id="{place}"') for place in sections]
    assert order == sorted(order)
    assert 'class="misfit"' not in text
    assert "H1 describes the answers of every subject" in " ".join(text.split())
    assert "this asks whether the answers follow one smooth curve, not whether there is an " in text
    assert not re.search(r"""src=["'](?!data:)""", text)
    beside = set(re.findall(r'href="(?!data:|#)([^"]*)"', text))
    assert beside == {"summary.csv", "evidence.csv", "corner", "corner/A.png", "corner/B.png", "posterior.nc"}
    assert all((results[0] / name).exists() for name in beside)
    assert text.count("data:image/png;base64,") == 5 + 2 * 2
    assert "bayes-toe explore posterior.nc -o explorer.html" in text
    assert "largest asymmetry is positive for" in " ".join(text.split())
    assert text.count("</a>, worst pair</th>") == 2
    assert re.search(r"effective draws asked for</th><td>1000<", text)
    for anchor in re.findall(r'href="#([^"]+)"', text):
        assert f'id="{anchor}"' in text
    assert "synthetic data" not in text


def test_run_refuses_to_overwrite_and_changes_nothing(results, folder):
    out = results[0]
    before = {p: p.stat().st_mtime_ns for p in out.rglob("*")}
    again = inside("run", "study.csv", "-o", "out", cwd=folder)
    assert again.returncode == 2
    assert "overwrite" in again.stderr
    assert {p: p.stat().st_mtime_ns for p in out.rglob("*")} == before


def test_sample_is_the_same_for_any_number_of_workers(folder):
    for run, workers in ((inside, "1"), (call, "2")):
        done = run("sample", "study.csv", "-o", f"p{workers}.nc", "--seed", "7", "--draws", "500", "--workers", workers, cwd=folder)
        assert done.returncode == 0, done.stderr
    one, two = (bt.load(folder / f"p{w}.nc") for w in ("1", "2"))
    for name in one.names:
        assert np.array_equal(one.values(name, "mu1"), two.values(name, "mu1"))
    assert one.tree["posterior_predictive"].equals(two.tree["posterior_predictive"])


def test_a_picture_has_one_name_whether_drawn_alone_or_with_others():
    draws = SimpleNamespace(names=("s01", "S01", "a/b"))
    every = corner_files(draws, draws.names)
    assert len({file.lower() for file in every.values()}) == 3
    assert all(corner_files(draws, [name]) == {name: every[name]} for name in draws.names)


def test_corner_of_one_subject_and_of_a_wrong_one(folder, results):
    done = call("corner", results[0] / "posterior.nc", "-o", "one", "--subject", "B", "--coordinates", "identified", cwd=folder)
    assert done.returncode == 0, done.stderr
    assert [p.name for p in (folder / "one").glob("*.png")] == ["B.png"]
    wrong = inside("corner", results[0] / "posterior.nc", "-o", "two", "--subject", "Z", cwd=folder)
    assert wrong.returncode == 2
    assert wrong.stderr.count("\n") == 1
    assert not (folder / "two").exists()


def test_corner_of_two_subjects_with_prior_and_truth_in_any_quantities(folder, results):
    (folder / "truth.csv").write_text("subject,mu1,gain,q0\nA,-0.7,0.8,\nZ,1,0.5,0.9\n", encoding="utf-8")
    posterior = results[0] / "posterior.nc"
    asked = ("--subject", "B", "--subject", "A", "--parameters", "gain, offset", "--show-prior", "--truth", "truth.csv")
    done = inside("corner", posterior, "-o", "both", *asked, "--format", "svg", "--format", "pdf", cwd=folder)
    assert (done.returncode, done.stderr) == (0, "")
    assert "1 corner plot in both" in done.stdout
    assert {p.name for p in (folder / "both").iterdir() if not p.name.startswith(".")} == {"B+A.svg", "B+A.pdf"}
    words = (folder / "both" / "B+A.svg").read_text(encoding="utf-8")
    assert all(said in words for said in ("B (solid)", "A (dashed)", "grey: prior", "squares, triangles: true values", "offset"))


@pytest.mark.parametrize(
    ("option", "said"),
    [
        (("--parameters", "gain,mu_1"), "found 'mu_1', allowed: each once, of mu1, sigma_p"),
        (("--parameters", "gain,gain"), "found 'gain', allowed: each once"),
        (("--parameters", "gain", "--coordinates", "natural"), "allowed: one of them"),
        (("--format", "gif"), "format 'gif': allowed: pdf, png, svg"),
        (("--subject", "A", "--subject", "Z"), "no subject 'Z'"),
        (("--truth", "study.csv"), "row 1: found 'subject', 's1', 's2', 'n_equal', 'n_trials', allowed: subject and some of mu1"),
    ],
    ids=lambda value: "-".join(value).replace("--", "") if isinstance(value, tuple) else "",
)
def test_corner_refuses_in_one_line(folder, results, option, said):
    done = inside("corner", results[0] / "posterior.nc", "-o", "none", *option, cwd=folder)
    assert (done.returncode, done.stderr.count("\n")) == (2, 1)
    assert said in done.stderr
    assert not (folder / "none").exists()


@pytest.fixture(scope="module")
def bent(folder, small_study):
    """Answers that no smooth curve describes: those to two pairs of one observer are turned round."""
    from conftest import grouped_csv

    subject = small_study["A"]
    equal = subject.n_equal.copy()
    equal[[2, 5]] = subject.n_trials[[2, 5]] - equal[[2, 5]]
    study = bt.Study([bt.Subject("bent", subject.s1, subject.s2, equal, subject.n_trials), small_study["B"]])
    grouped_csv(folder / "bent.csv", study)
    return "bent.csv"


def test_a_misfit_is_loud_in_terminal_and_report(folder, bent):
    done = inside("run", bent, "-o", "bent", "--seed", "1", "--draws", "300", "--workers", "1", cwd=folder)
    assert done.returncode == 0, done.stderr
    assert "H1 does not describe the answers of 1 of 2 subjects" in done.stdout
    [line] = [line for line in done.stdout.splitlines() if line.startswith("misfit ")]
    assert line.startswith("misfit bent: predictive p < 0.001, deviance ")
    assert "called equal" in line
    assert done.stdout.index("order effect: ") < done.stdout.index("misfit bent") < done.stdout.index("next: bayes-toe compare")
    assert done.stdout.index("next: bayes-toe compare") < done.stdout.index("Appendix C: one smooth curve")
    text = (folder / "bent" / "report.html").read_text(encoding="utf-8")
    assert text.count('<div class="misfit">') == 2
    assert text.count('<span class="badge wrong">misfit</span>') == 2  # in the table, and at the subject
    assert "Next: bayes-toe compare" in text


def test_evidence_leads_with_the_order_effect_and_says_approximations_last(folder):
    done = inside("evidence", "study.csv", "-o", "lead.csv", "--seed", "1", "--workers", "1", cwd=folder)
    rows = pd.read_csv(folder / "lead.csv")
    out = done.stdout
    assert out.index("order effect, and fit of the model") < out.index(
        "Appendix C: one smooth curve (H1) against a free frequency per pair (H0)"
    )
    for row in rows.itertuples():
        best = max(row.p_none, row.p_constant_error, row.p_update)
        assert re.search(rf"│ {row.subject} +│ .*\(P (= {best:.2f}|> 0.99)\)", out)
    assert "Kass and Raftery 1995" in out
    assert "\nmisfit " not in out
    assert "favour" not in out


def test_one_subject_has_no_random_effects(folder, small_study):
    from conftest import grouped_csv

    grouped_csv(folder / "alone.csv", small_study.select(["A"]))
    args = ("--model", "symmetric", "--model", "constant bias", "--draws", "200", "--seed", "1", "--workers", "1")
    done = inside("compare", "alone.csv", "-o", "alone_compare.csv", *args, cwd=folder)
    assert done.returncode == 0, done.stderr
    assert "LOO by trial" in done.stdout
    for word in ("random effects", "exceedance", "frequency", "equally frequent"):
        assert word not in done.stdout


def _same_but_for_the_fit(one, other):
    """The same lines but for the last column, predictive_p, which `run` has from its own draws."""
    lines = [[line.rpartition(",") for line in path.read_text().splitlines()] for path in (one, other)]
    assert [found[0] for found in lines[0]] == [found[0] for found in lines[1]]
    assert np.allclose(*([float(found[-1]) for found in some[1:]] for some in lines), rtol=0, atol=0.08)


def test_evidence_alone_gives_the_table_of_run(folder, results):
    done = inside("evidence", "study.csv", "-o", "evidence.csv", "--seed", "1", "--workers", "1", cwd=folder)
    assert done.returncode == 0, done.stderr
    _same_but_for_the_fit(folder / "evidence.csv", results[0] / "evidence.csv")


def test_fit_writes_its_columns_and_states_its_level(folder):
    for run, workers in ((inside, "1"), (call, "2")):
        args = ("-o", f"fit{workers}.csv", "--replicates", "50", "--level", "0.8", "--seed", "1", "--workers", workers)
        done = run("fit", "study.csv", *args, cwd=folder)
        assert done.returncode == 0, done.stderr
        assert "80 % percentile intervals of 50 bootstrap replicates" in done.stdout
    assert (folder / "fit1.csv").read_text() == (folder / "fit2.csv").read_text()
    frame = pd.read_csv(folder / "fit1.csv", dtype={"subject": str}, keep_default_na=False)
    limits = [f"{name}_{side}" for name in ("mu1", "sigma_p", "sigma_l", "q0") for side in ("lower", "upper")]
    assert list(frame.columns) == [
        "subject",
        "mu1",
        "sigma_p",
        "sigma_l",
        "q0",
        "log_likelihood",
        "at_edge",
        *limits,
        "level",
        "replicates",
        "penalty",
    ]
    assert set(frame.level) == {0.8}
    assert list(frame.subject) == ["A", "B"]
    assert (frame.sigma_p_lower < frame.sigma_p_upper).all()
    again = inside("fit", "study.csv", "-o", "fit1.csv", cwd=folder)
    assert again.returncode == 2
    assert "exists" in again.stderr
    wrong = inside("fit", "study.csv", "-o", "x.csv", "--level", "1.5", cwd=folder)
    assert (wrong.returncode, wrong.stderr.count("\n")) == (2, 1)
    assert not (folder / "x.csv").exists()


def test_fit_of_degenerate_answers_is_empty_and_said(tmp_path):
    (tmp_path / "s.csv").write_text("subject,s1,s2,n_equal,n_trials\nx,0,0.3,20,50\n")
    done = inside("fit", "s.csv", "-o", "fit.csv", "--replicates", "20", "--seed", "1", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""
    assert "not determined by these answers: sigma_p, sigma_l, q0" in done.stdout
    row = pd.read_csv(tmp_path / "fit.csv", dtype=str, keep_default_na=False).iloc[0]
    assert (row.at_edge, row.sigma_p, row.sigma_l_upper) == ("not unique", "", "")
    assert (row.level, row.replicates) == ("0.95", "20")


def test_figures_of_chosen_subjects_in_one_format(folder):
    args = ["figures", "study.csv", "-o", "pictures", "--seed", "1", "--draws", "300", "--workers", "1"]
    done = call(*args, "--subject", "B", "--format", "svg", cwd=folder)
    assert (done.returncode, done.stderr) == (0, "")
    made = {p.name for p in (folder / "pictures").iterdir() if not p.name.startswith(".")}
    assert "captions.md" in made
    assert len(made) == 8
    assert all(name.endswith(".svg") for name in made - {"captions.md"})
    assert "Subjects B." in (folder / "pictures" / "captions.md").read_text(encoding="utf-8")
    again = inside(*args, "--subject", "B", "--format", "svg", cwd=folder)
    assert again.returncode == 2
    assert "overwrite" in again.stderr


def test_figures_and_sensitivity_of_saved_draws_sample_nothing(results, folder, monkeypatch):
    monkeypatch.setattr("bayes_toe.inference.subject.sample_chains", None)  # calling it would raise
    posterior = ("--posterior", results[0] / "posterior.nc", "--workers", "1")
    done = inside("figures", "study.csv", *posterior, "-o", "saved", "--format", "svg", cwd=folder)
    assert (done.returncode, done.stderr) == (0, "")
    assert "seed 1; figures and captions" in done.stdout
    done = inside("sensitivity", *posterior, "-o", "saved.csv", "--steps", "3", "--reach", "1.5", cwd=folder)
    assert done.returncode == 0, done.stderr
    table = pd.read_csv(folder / "saved.csv").query("varied == 'mu1_sd' and value == 10.0").log_bayes_factor
    np.testing.assert_allclose(table, pd.read_csv(results[0] / "evidence.csv").log_bayes_factor, atol=0.01)  # as `evidence` has it


def test_draws_of_something_else_are_refused_in_one_line(results, folder, small_study):
    grouped_csv(folder / "c.csv", small_study)
    (folder / "wide.toml").write_text("mu1_sd = 20.0\n", encoding="utf-8")
    for command, given, said in [
        ("figures", ("c.csv",), "found no draws of subject 'C'; allowed: the posterior of c.csv"),
        ("sensitivity", ("--prior", "wide.toml"), "found draws under mu1 ~ Normal(0, 10)"),
        ("figures", ("--seed", "2"), "found draws of seed 1, allowed: that seed, or none, given 2"),
    ]:
        done = inside(command, *given, "--posterior", results[0] / "posterior.nc", "-o", "none.csv", cwd=folder)
        assert (done.returncode, done.stdout, done.stderr.count("\n")) == (2, "", 1)
        assert said in done.stderr
    assert "STUDY.csv: missing" in inside("sensitivity", "-o", "none.csv", cwd=folder).stderr


@pytest.mark.parametrize(
    ("option", "said"), [(("--subject", "Z"), "no subject 'Z'"), (("--format", "gif"), "allowed: pdf, png, svg")], ids=["subject", "format"]
)
def test_figures_refuse_before_the_work(folder, option, said):
    done = inside("figures", "study.csv", "-o", "none", *option, cwd=folder)
    assert done.returncode == 2
    assert said in done.stderr
    assert done.stderr.count("\n") == 1
    assert done.stdout == ""
    assert not (folder / "none").exists()


def test_simulate_then_check_then_quiet(tmp_path):
    made = call("simulate", "-o", "s.csv", "--truth", "t.csv", "--subjects", "2", "--batches", "4", "--seed", "1", cwd=tmp_path)
    assert made.returncode == 0, made.stderr
    assert list(pd.read_csv(tmp_path / "t.csv").columns) == ["subject", "mu1", "sigma_p", "sigma_l", "q0"]
    assert len(pd.read_csv(tmp_path / "s.csv")) == 2 * 4 * 13
    checked = call("check", "s.csv", cwd=tmp_path)
    assert checked.returncode == 0
    assert "synthetic" in checked.stdout
    silent = call("evidence", "s.csv", "-o", "e.csv", "--quiet", "--workers", "1", cwd=tmp_path)
    assert (silent.returncode, silent.stdout, silent.stderr) == (0, "", "")


def test_check_names_what_cannot_be_learnt(tmp_path):
    (tmp_path / "s.csv").write_text("subject,s1,s2,n_equal,n_trials\nx,0,0,10,10\nx,0,0.3,10,10\n")
    done = inside("check", "s.csv", cwd=tmp_path)
    assert done.returncode == 0
    assert done.stdout.count("warning") >= 2


def test_trials_that_are_there_twice_are_said_by_every_command(tmp_path):
    rows = ["subject,block,trial,s1,s2,response", *(f"[i]x,1,{i},{i % 2},{i % 3},{i % 2}" for i in range(12))]
    (tmp_path / "s.csv").write_text("\n".join([*rows, *rows[1:]]) + "\n")
    said = "warning s.csv: 12 rows repeat block and trial of another row with the same stimuli and answer, first row 14,"
    for command in (["check"], ["asymmetry"], ["fit", "--replicates", "2"], ["evidence", "--workers", "1"]):
        done = inside(command[0], "s.csv", *command[1:], cwd=tmp_path)
        assert done.stdout.count(said) == 1, done.stderr


@pytest.fixture(scope="module")
def swapped(tmp_path_factory):
    """A folder with a study of trials, in which one block was answered with the buttons swapped; its columns have names of their own."""
    rng, rows = np.random.default_rng(3), ["subject,s1,s2,response,[b]Run,ISI,rt"]
    for block in range(1, 6):
        for s1, s2 in list(itertools.product((0.0, 0.2, 0.5), repeat=2)) * 12:
            equal = (rng.random() < 0.9 * np.exp(-(((s2 - s1 - 0.05) / 0.2) ** 2))) ^ (block == 2)
            rows.append(f"[i]x,{s1},{s2},{int(equal)},<{block}>,1,0.5")
    folder = tmp_path_factory.mktemp("swapped")
    (folder / "s.csv").write_text("\n".join(rows) + "\n")
    return folder


def test_check_looks_at_blocks_and_columns(swapped):
    done = call("check", "s.csv", "--columns", "block=[b]Run", cwd=swapped)
    assert done.returncode == 0, done.stderr
    lines = done.stdout.splitlines()
    assert (
        sum("warning [i]x: Blocks differ in their answers to the same pairs, X^2 / d.f. of pair x block = " in line for line in lines) == 1
    )
    said = "warning [i]x: Block <2> looks answered the wrong way round (swapped buttons): turn these answers, or leave them out."
    assert said in lines
    assert "warning Column ISI looks like isi (seconds): use --columns isi=ISI, or it is ignored." in lines
    assert "note Columns ignored: ISI, rt." in lines
    unread = inside("check", "s.csv", cwd=swapped).stdout
    assert "Blocks differ" not in unread
    assert "note Columns ignored: [b]Run, ISI, rt." in unread


def test_the_report_says_what_speaks_against_pooling(results, swapped):
    assert "Before pooling" not in (results[0] / "report.html").read_text(encoding="utf-8")
    done = inside("run", "s.csv", "-o", "out", "--seed", "1", "--draws", "500", "--columns", "block=[b]Run", cwd=swapped)
    assert done.returncode == 0, done.stderr
    report = (swapped / "out" / "report.html").read_text(encoding="utf-8")
    section = report[report.index('<h2 id="pooling">') : report.index('id="subject-1"')]
    assert "<strong>[i]x</strong>: Block &lt;2&gt; looks answered the wrong way round" in section


def test_bad_input_is_one_line_a_problem_and_exit_code_2(tmp_path):
    (tmp_path / "bad.csv").write_text("subject,s1,s2,n_equal,n_trials\nx,0,0,12,10\ny,0,abc,1,2\n")
    for command in (
        ["check", "bad.csv"],
        ["run", "bad.csv", "-o", "out"],
        ["sample", "bad.csv"],
        ["evidence", "bad.csv"],
        ["fit", "bad.csv"],
    ):
        done = (call if command[0] == "run" else inside)(*command, cwd=tmp_path)
        assert done.returncode == 2
        lines = done.stderr.strip().splitlines()
        assert len(lines) == 2
        assert "row 2, column n_equal: found '12'" in lines[0]
        assert "row 3, column s2: found 'abc'" in lines[1]
    assert sorted(p.name for p in tmp_path.iterdir()) == ["bad.csv"]


@pytest.mark.parametrize("place", ["study.csv/out", "study.csv"])
def test_an_output_that_cannot_be_written_is_known_before_the_work(folder, place):
    done = inside("run", "study.csv", "-o", place, cwd=folder)
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1


def test_not_converged_is_exit_code_3_and_marked_everywhere(monkeypatch, tmp_path):
    # One pass and an R-hat that chance alone exceeds.
    defaults = SamplerSettings.__init__.__defaults__
    monkeypatch.setattr(SamplerSettings.__init__, "__defaults__", (*defaults[:-3], 1.000001, 1, 0.05))
    counts = "\n".join(f"x,{a},{b},25,50" for a, b in [(0, 0), (0, 0.3), (0.3, 0), (0.3, 0.3), (0, 0.5), (0.5, 0)])
    (tmp_path / "s.csv").write_text("subject,s1,s2,n_equal,n_trials\n" + counts + "\n")
    done = inside("run", "s.csv", "-o", "out", "--draws", "500", "--seed", "1", "--workers", "1", cwd=tmp_path)
    assert done.returncode == 3, done.stderr
    assert "not converged" in done.stdout
    assert "did not converge" in (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    assert list(bt.load(tmp_path / "out" / "posterior.nc").not_converged) == ["x"]


def test_subjects_may_be_any_text_and_are_never_paths_or_html(tmp_path, monkeypatch):
    names = ["../../etc", "<script>alert(1)</script> a$b_{c}", "Ann", "ann", "主体 ①", "NA", "01", "=S\x1b[2J\x9b\u202e\u2066\u200b\nx"]
    monkeypatch.setattr("bayes_toe.analysis.subject_fit", partial(subject_fit, replicates=20))  # the other replicates show nothing new
    rows = [f'"{n}",{a},{b},{k},20' for n in names for a, b, k in [(0, 0, 18), (0, 0.4, 6), (0.4, 0, 11), (0.4, 0.4, 17)]]
    (tmp_path / "s.csv").write_text("subject,s1,s2,n_equal,n_trials\n" + "\n".join(rows) + "\n", encoding="utf-8")
    options = ("--seed", "1", "--draws", "300", "--workers", "1", "--spreadsheet-safe")
    done = inside("run", "s.csv", "-o", "out", *options, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""
    files = [p.name for p in (tmp_path / "out" / "corner").iterdir()]
    assert len({f.lower() for f in files}) == len(names)
    assert all(re.fullmatch(r"[A-Za-z0-9_.-]+\.png", f) for f in files)
    report = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    assert "<script>alert" not in report
    assert "&lt;script&gt;" in report
    refused = inside("corner", "out/posterior.nc", "-o", "c", "--subject", "\x1b\u202e", cwd=tmp_path).stderr
    checked = inside("check", "s.csv", cwd=tmp_path).stdout
    for shown in (report, done.stdout, checked, refused):  # nothing that a terminal or a browser obeys
        assert "\\x1b" in shown
        assert [one for one in shown if not one.isprintable() and one != "\n"] == []
    assert "as formulas: '=S" in checked
    assert bt.load(tmp_path / "out" / "posterior.nc").names == tuple(names)
    assert list(pd.read_csv(tmp_path / "out" / "evidence.csv", dtype=str, keep_default_na=False).subject) == [*names[:-1], f"'{names[-1]}"]
    assert not (tmp_path.parent / "etc.png").exists()


def test_version_and_help(tmp_path):
    assert call("--version").stdout.strip() == f"bayes-toe {bt.__version__}"
    for command in (one.__name__ for commands in COMMANDS.values() for one in commands):
        done = (call if command == "run" else inside)(command, "--help")
        assert done.returncode == 0
        assert f"bayes-toe {command}" in done.stdout  # the example


def test_the_installed_command_is_there():
    assert (Path(sys.executable).parent / "bayes-toe").exists()


def loaded_by(statement, *libraries):
    """Which of these libraries a fresh interpreter has loaded after a statement."""
    code = f"{statement}; import sys; print([m for m in {libraries!r} if m in sys.modules])"
    return subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.strip()


def test_importing_the_package_is_light():
    assert loaded_by("import bayes_toe", "numpy", "scipy", "pandas", "arviz", "emcee", "matplotlib") == "[]"


def test_help_and_check_load_no_sampler():
    assert loaded_by("import bayes_toe.cli.app", "numpy", "scipy", "pandas", "arviz", "emcee", "matplotlib") == "[]"
    example = str(Path(bt.__file__).parent / "data" / "example_study.csv")
    run = f"from bayes_toe.cli.app import app; app(['check', {example!r}, '--quiet'], standalone_mode=False)"
    assert loaded_by(run, "scipy.stats", "scipy.optimize", "pandas", "arviz", "emcee", "matplotlib") == "[]"


def test_a_prior_file_is_used_shown_and_stored(folder, small_study):
    grouped_csv(folder / "one.csv", small_study.select(["B"]))
    (folder / "narrow.toml").write_text("mu1_sd = 2.0  # informative\nsigma_p_scale = 0.5\n", encoding="utf-8")
    said = "mu1 ~ Normal(0, 2), sigma_p ~ HalfNormal(0.5)"
    done = inside("run", "one.csv", "-o", "narrow", "--seed", "1", "--draws", "500", "--workers", "1", "--prior", "narrow.toml", cwd=folder)
    assert done.returncode == 0, done.stderr
    assert f"prior: {said}" in done.stdout
    assert said in (folder / "narrow" / "report.html").read_text(encoding="utf-8")
    prior = bt.Prior(mu1_sd=2.0, sigma_p_scale=0.5)
    assert bt.load(folder / "narrow" / "posterior.nc").prior == prior
    table = pd.read_csv(folder / "narrow" / "evidence.csv")
    assert table.columns[13] == "prior"
    assert table.prior.str.startswith(said).all()
    done = inside("evidence", "one.csv", "-o", "narrow.csv", "--seed", "1", "--workers", "1", "--prior", "narrow.toml", cwd=folder)
    assert done.returncode == 0, done.stderr
    _same_but_for_the_fit(folder / "narrow.csv", folder / "narrow" / "evidence.csv")
    assert said in inside("check", "one.csv", "--prior", "narrow.toml", cwd=folder).stdout
    done = inside("fit", "one.csv", "-o", "narrow_fit.csv", "--replicates", "20", "--workers", "1", "--prior", "narrow.toml", cwd=folder)
    assert "penalty: mu1 ~ Normal(0, 2)" in done.stdout
    assert set(pd.read_csv(folder / "narrow_fit.csv").penalty) == {"mu1 ~ Normal(0, 2)"}


def test_a_preset_is_a_word_and_a_file_of_that_name_has_a_path(folder):
    (folder / "stimuli").write_text("mu1_sd = 7.0\n", encoding="utf-8")
    said = [inside("check", "study.csv", "--prior", given, cwd=folder).stdout for given in ("paper", "stimuli", "./stimuli")]
    assert "mu1 ~ Normal(0, 10)" in said[0]
    assert "mu1_mean, mu1_sd, sigma_p_scale, noise_slope_sd from the stimuli" in " ".join(said[1].split())
    assert "mu1 ~ Normal(0, 7)" in said[2]


def test_a_bad_prior_file_is_one_line_for_every_command(folder):
    (folder / "bad.toml").write_text("mu1_sd = -1\n", encoding="utf-8")
    commands = ("run", "sample", "evidence", "fit", "figures", "sensitivity", "check", "simulate")
    for command in commands:
        study = () if command == "simulate" else ("study.csv",)
        out = () if command == "check" else ("-o", f"bad_{command}.csv")
        done = inside(command, *study, *out, "--prior", "bad.toml", cwd=folder)
        assert done.returncode == 2, command
        assert done.stderr == "error: bad.toml: key mu1_sd: found -1, allowed: a number from 1e-100 to 1e+100 or 'stimuli'\n", command
        assert not (folder / f"bad_{command}.csv").exists()


def test_simulate_draws_its_population_from_a_prior_file(folder):
    (folder / "near.toml").write_text("mu1_mean = 5.0\nmu1_sd = 0.1\n", encoding="utf-8")
    args = ("--subjects", "20", "--batches", "1", "--seed", "1", "--prior", "near.toml")
    done = inside("simulate", "-o", "made.csv", "--truth", "made_truth.csv", "--population", "prior", *args, cwd=folder)
    assert done.returncode == 0, done.stderr
    assert abs(pd.read_csv(folder / "made_truth.csv").mu1 - 5.0).max() < 0.5
    done = inside("simulate", "-o", "other.csv", *args, cwd=folder)
    assert done.returncode == 2
    assert "allowed: with --population prior" in done.stderr


def test_sensitivity_writes_table_and_figure_and_says_where_conclusions_turn(folder):
    args = ("--steps", "3", "--reach", "2", "--seed", "1", "--workers", "1")
    done = call("sensitivity", "study.csv", "-o", "sensitivity.csv", *args, cwd=folder)
    assert done.returncode == 0, done.stderr
    table = pd.read_csv(folder / "sensitivity.csv", dtype={"subject": str})
    assert len(table) == 2 * 5 * 3
    assert sorted(set(table[table.varied == "mu1_sd"].value)) == [5.0, 10.0, 20.0]
    assert (folder / "sensitivity.png").read_bytes().startswith(b"\x89PNG")
    assert "0 of 2 conclusions turn within this range" in done.stdout
    again = inside("sensitivity", "study.csv", "-o", "sensitivity.csv", cwd=folder)
    assert again.returncode == 2
    assert "overwrite" in again.stderr
    for args in (("-o", "x.csv", "--steps", "4"), ("-o", "x.csv", "--reach", "1"), ("-o", "x.png")):
        wrong = inside("sensitivity", "study.csv", *args, cwd=folder)
        assert wrong.returncode == 2
        assert wrong.stderr.count("\n") == 1


def test_a_design_that_cannot_tell_everything_is_said_before_sampling(folder):
    (folder / "first.csv").write_text(
        "subject,s1,s2,n_equal,n_trials\n" + "".join(f"X,0,{0.1 * i:.1f},{9 - 2 * i},10\n" for i in range(4)), encoding="utf-8"
    )
    done = inside("sample", "first.csv", "-o", "first.nc", "--draws", "200", "--seed", "1", "--workers", "1", cwd=folder)
    assert done.returncode in (0, 3), done.stderr
    assert "note X: The pairs can tell 3 of 4 combinations" in done.stdout
    assert "the smaller model 'constant bias' carries all the information" in done.stdout
    assert "smaller model 'constant bias'" in inside("check", "first.csv", cwd=folder).stdout
