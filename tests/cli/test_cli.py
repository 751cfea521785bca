"""The real command line: outputs, exit codes, messages, and nothing half-written."""

import itertools
import os
import re
import sys
from functools import partial
from pathlib import Path

import pandas as pd
import pytest
from commands import on_one_line, output_of, refusal_of, run_command, run_ok, run_python
from conftest import each_row, leave_pictures_blank, write_counts

import bayes_toe as bt
from bayes_toe.inference.sampling import SamplerSettings
from bayes_toe.model.parameters import ObserverPrior

QUICK = "--draws 300 --figures none --seed 1"


@pytest.fixture(scope="module")
def study_folder(tmp_path_factory, small_study):
    """A folder with study.csv, of subjects A and B, and one.csv, of B alone."""
    study_folder = tmp_path_factory.mktemp("cli")
    write_counts(study_folder / "study.csv", small_study.select(["A", "B"]))
    write_counts(study_folder / "one.csv", small_study.select(["B"]))
    return study_folder


@pytest.fixture(scope="module")
def screen_of_run(study_folder):
    """The screen of `run` on subjects A and B, which writes the folder `out`."""
    return run_ok("run study.csv -o out --draws 1000 --seed 1", cwd=study_folder)


@pytest.fixture(scope="module")
def results_of_run(study_folder, screen_of_run):
    """The folder with the results of `run` on subjects A and B."""
    return study_folder / "out"


def text_of(folder, name="report.html"):
    return (folder / name).read_text(encoding="utf-8")


# --- run ------------------------------------------------------------------------------------------


def test_run_writes_all_results(results_of_run):
    # Names that begin with a point are those of the folder's own record.
    files = sorted(path.name for path in results_of_run.glob("[!.]*"))
    expected = "corner evidence.csv methods.bib methods.md posterior.nc report.html summary.csv"
    assert files == expected.split()
    # Each subject has a corner plot, a PNG by its first bytes.
    corners = {path.name: path.read_bytes()[:4] for path in (results_of_run / "corner").iterdir()}
    assert corners == dict.fromkeys(["A.png", "B.png"], b"\x89PNG")
    summary = pd.read_csv(results_of_run / "summary.csv")
    parameters = "mu1 sigma_p sigma_l q0 gamma sigma1 gain width pse_shift jnd"
    assert summary.parameter.unique().tolist() == parameters.split()
    assert list(pd.read_csv(results_of_run / "evidence.csv").subject) == ["A", "B"]


def test_run_prints_the_study_the_answer_and_the_seed_but_no_progress_bar(screen_of_run):
    start = "study.csv: 2 subjects, 1,300 trials, same-different task, 13 pairs\n"
    assert screen_of_run.startswith(start)
    assert "\nOrder effect: 2 of 2 subjects yes.\n" in screen_of_run
    assert screen_of_run.endswith("report.html. Seed 1.\n")
    assert not re.search(r"\d+%", screen_of_run)  # Only a progress bar has such numbers.


def test_the_report_has_its_sections_and_no_section_without_content(results_of_run):
    text = text_of(results_of_run)
    sections = "answer overview trust files subject-1 subject-2 order evidence read paper"
    positions = [text.index(f'id="{section}"') for section in sections.split()]
    assert positions == sorted(positions)
    text_on_one_line = on_one_line(text)
    for sentence in (
        "Order effect: 2 of 2 subjects yes.",
        "of 2 subjects gave more ",
        "H1 with H0 does not test for an order effect",
        "required effective draws</th><td>1000<",
        "bayes-toe explore posterior.nc -o explorer.html",
    ):
        assert sentence in text_on_one_line, sentence
    for words in ("synthetic data", "Problems in the responses", 'class="misfit"'):
        assert words not in text


def test_the_report_needs_nothing_but_the_files_beside_it(results_of_run):
    text = text_of(results_of_run)
    # Pictures are in the file itself, and all other links lead to the files beside it, or to an
    # anchor of the report.
    assert not re.search(r"""src=["'](?!data:)""", text)
    files_beside = {path.name for path in results_of_run.glob("[!.]*")} - {"report.html"}
    linked_files = set(re.findall(r'href="(?!data:|#)([^"]*)"', text))
    assert linked_files == files_beside | {"corner/A.png", "corner/B.png"}
    assert text.count("data:image/png;base64,") == 2 * 2  # two figures of each of two subjects
    for anchor in re.findall(r'href="#([^"]+)"', text):
        assert f'id="{anchor}"' in text


#: Half of the responses to each pair are 'equal'.
GUESSES = """subject,s1,s2,n_equal,n_trials
x,0,0,25,50
x,0,0.3,25,50
x,0.3,0,25,50
x,0.3,0.3,25,50
x,0,0.5,25,50
x,0.5,0,25,50
"""


def test_not_converged_is_exit_code_3_and_marked_everywhere(monkeypatch, tmp_path, blank_pictures):
    # The sampler has one pass and a limit of R-hat that chance alone exceeds.
    strict_settings = partial(SamplerSettings, max_r_hat=1.000001, max_thin=1)
    monkeypatch.setattr("bayes_toe.analysis.SamplerSettings", strict_settings)
    (tmp_path / "s.csv").write_text(GUESSES)
    result = run_command("run s.csv -o out --draws 500 --seed 1", cwd=tmp_path)
    assert (result.returncode, result.stderr) == (3, "")
    assert "! x  The draws did not converge: " in result.stdout
    assert "did not converge" in text_of(tmp_path / "out")
    assert list(bt.load(tmp_path / "out" / "posterior.nc").not_converged) == ["x"]


#: A name that would be a path and a script, and two names that pandas reads as missing. The last
#: name has signs that a terminal obeys, and begins as a formula of a spreadsheet.
ODD_NAMES = (
    "../../<script>alert(1)</script> a$b_{c}",
    "na",
    "NA",
    "=S\x1b[2J\x9b\u202e\u2066\u200b\nx",
)


@pytest.fixture(scope="module")
def odd_names_folder(tmp_path_factory):
    """A folder with s.csv, a study of subjects with odd names, and nothing else."""
    folder = tmp_path_factory.mktemp("odd")
    pairs = ["0,0,48", "0,0.2,31", "0.2,0,35", "0.2,0.4,34", "0.4,0,11", "0.4,0.4,47"]
    rows = [f'"{name}",{pair},50' for name, pair in itertools.product(ODD_NAMES, pairs)]
    text = "\n".join(["subject,s1,s2,n_equal,n_trials", *rows])
    (folder / "s.csv").write_text(text, encoding="utf-8")
    return folder


@pytest.fixture(scope="module")
def odd_names_screen(odd_names_folder):
    """The screen of `run` on subjects with odd names, which writes the folder `out`."""
    with pytest.MonkeyPatch.context() as patch:
        leave_pictures_blank(patch)
        return run_ok("run s.csv -o out --draws 100 --seed 1", cwd=odd_names_folder)


def test_odd_names_become_plain_and_different_names_of_files(odd_names_folder, odd_names_screen):
    # No two names of files are equal where capitals do not count.
    files = {name.lower() for name in os.listdir(odd_names_folder / "out" / "corner")}
    assert len(files) == len(ODD_NAMES)
    for file in files:
        assert re.fullmatch(r"[a-z0-9_.-]+\.png", file)


def test_odd_names_have_no_sign_that_a_terminal_or_browser_obeys(
    odd_names_folder, odd_names_screen
):
    report = text_of(odd_names_folder / "out")
    assert "<script>alert" not in report
    line = "corner out/posterior.nc -o c --subject"
    refusal = refusal_of(line, "\x1b\u202e", cwd=odd_names_folder)
    screen_of_check = run_ok("check s.csv", cwd=odd_names_folder)
    for visible_text in (report, odd_names_screen, screen_of_check, refusal):
        assert "\\x1b" in visible_text
        assert visible_text.replace("\n", "").isprintable()


def test_draws_and_tables_have_odd_names_as_they_are_but_for_formulas(
    odd_names_folder, odd_names_screen
):
    assert bt.load(odd_names_folder / "out" / "posterior.nc").names == ODD_NAMES
    path = odd_names_folder / "out" / "evidence.csv"
    table = pd.read_csv(path, dtype=str, keep_default_na=False)
    # An apostrophe before the formula, and the escape sequence as text.
    formula = "'=S\\x1b[2J\\x9b\u202e\u2066\u200b\nx"
    assert tuple(table.subject) == (*ODD_NAMES[:-1], formula)


# --- evidence, sample, fit ------------------------------------------------------------------------


def test_evidence_leads_with_model_evidence_and_has_the_table_of_run(study_folder, results_of_run):
    screen = run_ok("evidence one.csv -o evidence.csv --seed 1", cwd=study_folder)
    header, _, row_of_b = text_of(results_of_run, "evidence.csv").splitlines()
    # B is alone in one.csv, and has the numbers that it has beside A.
    assert text_of(study_folder, "evidence.csv").splitlines() == [header, row_of_b]
    # These texts stand on the screen in this order.
    texts_in_order = (
        "Log model evidence.",
        "contraction, %",
        "Answer\nB: The order changes the response",
    )
    assert sorted(texts_in_order, key=screen.index) == list(texts_in_order)


def test_fit_writes_a_table_and_replaces_it_only_with_overwrite(study_folder):
    command = "fit study.csv -o fit.csv"
    screen = run_ok(f"{command} --replicates 20 --seed 1", cwd=study_folder)
    assert "[95 % interval of 20 bootstrap replicates]" in screen
    frame = pd.read_csv(study_folder / "fit.csv", keep_default_na=False)
    assert list(frame.subject) == ["A", "B"]
    assert "exists" in refusal_of(command, cwd=study_folder)
    assert run_ok(f"{command} --replicates 2 --overwrite --quiet", cwd=study_folder) == ""


# --- saved draws ----------------------------------------------------------------------------------


def test_corner_of_one_subject_and_of_two_with_prior_and_truth_in_any_quantities(
    study_folder, results_of_run
):
    # The gain is a quantity that is no parameter. Subject A has no true q0, and the draws have no
    # subject Z.
    (study_folder / "truth.csv").write_text("subject,mu1,gain,q0\nA,-0.7,0.8,\nZ,1,0.5,0.9\n")
    corner = "corner out/posterior.nc --subject B"
    run_ok(f"{corner} -o single --parameters identified", cwd=study_folder)
    assert [path.name for path in (study_folder / "single").glob("*.png")] == ["B.png"]

    request = "--subject A --parameters 'gain, offset' --show-prior --truth truth.csv"
    screen = run_ok(f"{corner} -o both {request} --format svg", cwd=study_folder)
    assert "1 corner plot in both" in screen
    assert {path.name for path in (study_folder / "both").glob("[!.]*")} == {"B+A.svg"}
    figure = text_of(study_folder / "both", "B+A.svg")
    for words in ("B, median", "A, median", "prior", "true values", "offset"):
        assert words in figure


#: A command in a folder with study.csv, one.csv and the results `out`, and the message that refuses
#: it.
REFUSED = """
    corner out/posterior.nc --parameters gain,mu_1 | 'mu_1' is unknown or named twice; there are: 
    corner out/posterior.nc --parameters gain,gain | 'gain' is unknown or named twice
    corner out/posterior.nc --format xyz | found suffix 'xyz', allowed: png, pdf, svg
    corner out/posterior.nc --subject A --subject Z | no subject 'Z'
    corner out/posterior.nc --truth study.csv | 'n_trials', allowed: subject and some of mu1
    run study.csv --figures some | must be one of all, flagged, none
    run study.csv -o out | overwrite
    fit study.csv -o new.csv --asymmetry one.csv | overwrite
    run study.csv -o study.csv/new | study.csv
    run study.csv -o study.csv | study.csv
    fit 'st*y.csv' -o study.csv --overwrite | study.csv: this command reads that file
    evidence one.csv --prior study.csv -o study.csv --overwrite | study.csv: this command reads that
    simulate -o one.csv --observers one.csv --overwrite | one.csv: this command reads that file
    simulate -o one.csv --design ./one.csv --overwrite | one.csv: this command reads that file
    simulate -o new.csv --subjects 3 --observers one.csv | --subjects: allowed with a kind of 
    design one.csv --list new.csv -o d.csv | one.csv: a given design needs --list trials.csv
    design one.csv --list new.csv --simulated 5 | without options of the search such as --lowest
    design one.csv --list new.csv --workers 2 | without options of the search such as --lowest
    design one.csv --list new.csv --dask tcp://1 | without options of the search such as --lowest
    design --levels one.csv --step 5% | The range is given twice. Use either --levels, or --lowest
    check --example --condition hand | example_study.csv: row 1: there is no column hand.
    check a.csv --example | exclude each other. Allowed: --example 2afc, --example same-different
    check --example same | exclude each other. Allowed: --example 2afc, --example same-different
    check --example=same | error: --example: found 'same', allowed: same/different, 2afc
"""


@each_row("line, message", REFUSED)
def test_options_that_cannot_be_used_are_refused_before_the_work(
    study_folder, results_of_run, line, message
):
    # Such as 'run study.csv -o out', with the message that overwrite is needed.
    assert message in refusal_of(line, cwd=study_folder)


# --- simulate, check, priors ----------------------------------------------------------------------


def test_a_prior_file_is_used_shown_and_stored(study_folder, blank_pictures):
    text = "[paper]\nmu1_sd = 2.0  # informative\nsigma_p_scale = 0.5\n[contraction]\nsd = 0.5\n"
    (study_folder / "narrow.toml").write_text(text)
    screen = run_ok(f"run one.csv -o narrow --prior narrow.toml {QUICK}", cwd=study_folder)
    assert "\nPrior: narrow.toml\n" in screen
    results = study_folder / "narrow"
    expected = bt.Prior(mu1_sd=2.0, sigma_p_scale=0.5, observer=ObserverPrior(contraction_sd=0.5))
    assert bt.load(results / "posterior.nc").prior == expected
    words = "mu1 ~ Normal(0, 2), sigma_p ~ HalfNormal(0.5)"
    assert words in text_of(results)
    assert words in text_of(results, "evidence.csv")
    # The fit has the prior of mu1 alone, as a penalty.
    line = "fit one.csv -o narrow_fit.csv --replicates 5 --prior narrow.toml --seed 1"
    assert "Prior: narrow.toml" in run_ok(line, cwd=study_folder)
    assert set(pd.read_csv(study_folder / "narrow_fit.csv").penalty) == {"mu1 ~ Normal(0, 2)"}


@pytest.mark.parametrize("command", ["run", "sample", "evidence", "fit", "check"])
def test_a_bad_prior_file_is_one_line_for_every_command(study_csv, command):
    (study_csv.parent / "bad.toml").write_text("[paper]\nmu1_sd = -1\n")
    message = refusal_of(f"{command} study.csv --prior bad.toml", cwd=study_csv.parent)
    assert message.startswith("error: bad.toml: [paper] mu1_sd: found -1, allowed: a number")


# --- the program itself ---------------------------------------------------------------------------


def test_the_installed_command_is_there_and_has_the_version():
    assert (Path(sys.executable).parent / "bayes-toe").exists()
    assert run_ok("--version", cwd=".") == f"bayes-toe {bt.__version__}\n"


#: Libraries that take long to load.
LARGE_LIBRARIES = {
    "pandas",
    "xarray",
    "arviz",
    "arviz_stats",
    "emcee",
    "joblib",
    "matplotlib",
    "scipy.stats",
}
APP = "from bayes_toe.cli.app import app; app({!r}.split(), standalone_mode=False)"


@pytest.mark.parametrize(
    "code, libraries",
    [
        ("import bayes_toe", {*LARGE_LIBRARIES, "scipy", "numpy"}),
        (APP.format("--help"), {*LARGE_LIBRARIES, "scipy"}),
        (APP.format("population --help"), {*LARGE_LIBRARIES, "scipy"}),
        (APP.format("check study.csv"), LARGE_LIBRARIES),
    ],
)
def test_a_quick_command_loads_no_large_library(study_csv, code, libraries):
    # The last line of the output has those of the `libraries` that the script has loaded.
    script = f"{code}; import sys; print({libraries} & set(sys.modules))"
    output = output_of(run_python("-c", script, cwd=study_csv.parent))
    assert output.endswith("set()\n")
