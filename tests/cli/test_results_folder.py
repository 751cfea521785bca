"""The results folder of a study: whose pictures are drawn, one report or an index with pages, the explorer and the group beside them."""

import re
from dataclasses import replace
from itertools import product

import numpy as np
import pandas as pd
import pytest
from commands import good, inside, refused
from conftest import grouped_csv
from populations import made_result, simulated_group

import bayes_toe as bt
from bayes_toe.cli import report, results_folder
from bayes_toe.cli.results_folder import GROUP_PRODUCTS, FigureChoice, opened, write_results
from bayes_toe.explorer.page import Explorer
from bayes_toe.groups.predictive_check import PredictiveCheck, Statistic
from bayes_toe.groups.regressors import Regressor, Regressors
from bayes_toe.model.parameters import ObserverPrior

pytestmark = pytest.mark.usefixtures("blank_pictures")
WRONG = Statistic("spread", "accuracy", 0.3, 0.1, 0.15, 0.2, 0.004, is_above=True)


def page(folder, name="report.html"):
    return " ".join((folder / name).read_text(encoding="utf-8").split())


def section(folder):
    text = page(folder)
    return text[text.index('<summary id="group">') : text.index('<summary id="subjects">')]


@pytest.mark.parametrize(
    ("which", "drawn", "said"),
    [
        ("flagged", "AC", "Figures are drawn for subjects that need action (poor fit"),
        ("none", "", "To draw figures of single subjects, type <code>--figures all"),
    ],
)
def test_pictures_are_of_the_flagged_or_of_none_and_the_report_says_of_whom(
    marked, tmp_path, which, drawn, said
):
    told = []
    write_results(
        marked, tmp_path / "out", figures=FigureChoice(which), workers=1, progress=told.append
    )
    corners = tmp_path / "out" / "corner"
    assert sorted(file.stem for file in corners.glob("*")) == list(drawn)
    assert corners.exists() == bool(drawn)
    assert told == list(drawn)
    text = page(tmp_path / "out")
    assert text.count("data:image/png") == 2 + 2 * len(drawn)
    assert text.count("To draw the corner plot") == 3 - len(drawn)
    assert said in text
    assert {path.name for path in (tmp_path / "out").iterdir()} <= {
        *results_folder.PRODUCTS,
        ".bayes_toe_files.json",
    }
    summary = marked.draws.summary()
    pd.testing.assert_frame_equal(
        pd.read_csv(tmp_path / "out" / "summary.csv", keep_default_na=False), summary, rtol=1e-5
    )


def test_of_very_many_subjects_the_report_is_an_index_with_a_page_for_each(
    marked, tmp_path, monkeypatch
):
    monkeypatch.setattr(report, "MOST_IN_ONE", 2)
    out = tmp_path / "out"
    write_results(marked, out, figures=FigureChoice("flagged"), workers=1)
    index = page(out)
    found = re.findall(r'href="(subjects/[^"]+)"', index)
    assert found[:3] == [
        "subjects/A.html",
        "subjects/C.html",
        "subjects/B.html",
    ]  # flagged ones first
    assert index.count("data:image/png") == 2
    assert '<details class="subject' not in index
    assert "2 of 3 subjects need action" in index
    pages = {name: page(out / "subjects", f"{name}.html") for name in "ABC"}
    assert {name: text.count("data:image/png") for name, text in pages.items()} == {
        "A": 2,
        "B": 0,
        "C": 2,
    }
    assert "The model does not fit. Worst pairs: (0, 0.3): 'equal' in 90 %, expected 40 %" in pages[
        "A"
    ].replace("&#39;", "'")
    assert "Not interpreted: responses look swapped" in pages["C"]
    assert "<code>--swap C:2</code>" in pages["C"]
    assert all('href="../report.html#read"' in text for text in pages.values())
    assert 'href="../corner/A.png"' in pages["A"]


def test_a_group_and_an_explorer_stand_beside_the_report_where_asked_for_and_go_where_not(
    marked, tmp_path, monkeypatch
):
    """The section of the group says first what speaks against it, then the answer, figure and tables."""
    explored = []
    monkeypatch.setattr(
        results_folder,
        "explore",
        lambda *draws, **more: explored.append((draws, more)) or Explorer("explored"),
    )
    out = tmp_path / "out"
    study = simulated_group(1, n_subjects=4)
    column = Regressor("group", "<b>", "group <b> against a", reference="a")
    who = Regressors(study.names, np.array([[0.0], [1.0], [0.0], [1.0]]), (column,))
    made = made_result(study, who, n_divergent=2)
    with_group = replace(marked, group=made)
    check = PredictiveCheck((WRONG,), 500)
    write_results(with_group, out, figures=FigureChoice("none"), workers=1, check=check)
    assert "bayes-toe explore" in page(out)
    said = section(out)
    order = [
        "not reliable</span>",
        "the group&#39;s result is not reliable: 2 of 1600 trajectories diverged",
        "the spread of the accuracy between subjects is larger than in a normal group",
        "data:image/png;base64,",
        ">covariate</th>",
        ">group mean</th>",
        ">SD between subjects</th>",
        ">new subject</th>",
        "Hyperprior: constant error, D: mean ~ Student t",
    ]
    places = [said.index(words) for words in order]
    assert places == sorted(places)
    numbers = re.sub(r"base64,[^\"]*|Hyperprior.*", "", said)
    assert "−" in numbers
    assert not re.search(r"[ (>]-\d", numbers)
    assert all((out / name).stat().st_size > 500 for name in GROUP_PRODUCTS)
    prior = replace(marked.settings.prior, observer=ObserverPrior(constant_error_scale=0.4))
    settings = replace(marked.settings, prior=prior)
    write_results(
        replace(marked, settings=settings),
        out,
        figures=FigureChoice("none", explorer=True),
        workers=1,
        overwrite=True,
    )
    assert 'id="group"' not in page(out)
    assert not any((out / name).exists() for name in GROUP_PRODUCTS)
    assert (out / "explorer.html").read_text(encoding="utf-8") == "explored"
    assert explored == [((marked.draws,), {"truths": None})]
    assert page(out).count('href="explorer.html"') == 2
    assert "bayes-toe explore" not in page(out)
    assert "constant_error ~ Student(3, 0.4 D)" in page(out)


def test_run_computes_the_group_and_leaves_with_3_where_it_did_not_converge(
    analysis, tmp_path, monkeypatch
):
    group = made_result(simulated_group(1, n_subjects=4), n_divergent=2)
    monkeypatch.setattr("bayes_toe.run", lambda *_, **__: replace(analysis, group=group))
    grouped_csv(tmp_path / "study.csv", analysis.study)
    options = ("--figures", "none", "--seed", 5, "--workers", 1)
    done = inside("run", "study.csv", "-o", "out", *options, cwd=tmp_path)
    assert done.returncode == 3
    printed = " ".join(done.stdout.split())
    assert "NOT RELIABLE: Group of 4: mean PSE shift" in printed
    assert "! The group's result is not reliable: 2 of 1600 trajectories" in printed
    assert "trajectories diverged" in section(tmp_path / "out")


def test_an_explorer_that_cannot_be_is_refused_before_the_work(study_csv, tmp_path, monkeypatch):
    monkeypatch.setattr("bayes_toe.explorer.page.MOST_ENTRIES", 2)
    for file, option, said in (
        (study_csv, "--explore", "explore: found 3 subjects, allowed: at most 2 in a page"),
        (study_csv, "--explore", "pip install 'bayes_toe[explore]'"),
    ):
        if "pip" in said:
            monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
        assert said in refused("run", file, "-o", "out", option, cwd=tmp_path, silent=False)


def test_a_process_opens_the_draws_once_and_again_where_the_file_is_another_one(
    analysis, tmp_path, monkeypatch
):
    file, loads = analysis.draws.save(tmp_path / "posterior.nc"), []
    monkeypatch.setattr(
        results_folder, "load_draws", lambda path: loads.append(path) or bt.load(path)
    )
    opened.cache_clear()
    good("corner", file, "-o", "out", "--subject", "A", "--workers", 1, cwd=tmp_path)
    assert opened(file, file.stat().st_mtime_ns).names == ("A", "B", "C")
    assert loads == [file]
    opened(file, 1)
    assert loads == [file, file]
    opened.cache_clear()


def test_a_report_on_which_is_stronger_speaks_of_it_alone(stronger, tmp_path):
    out = write_results(stronger, tmp_path / "out", workers=1)
    text = re.sub(r"data:image[^\"]*", "", page(out)) + (out / "methods.md").read_text(
        encoding="utf-8"
    )
    for other in ("'equal'", "called equal", "P(equal)", "q0", "half-width"):
        assert other not in text, other
    for own in (
        "a constant error and a response bias predict the same responses",
        "Just noticeable difference",
        "lapse_rate",
        "% &#39;second&#39;",
        "The maximum of the likelihood lies at an edge",
    ):
        assert own in text, own
    medians = stronger.summary().query("subject == 'pulled'").set_index("parameter")["q50"]
    number = r"(−?[\d.]+)"
    for published in ("pse_shift", "jnd"):  # in natural log, and in per cent of the intensity
        interval = rf"{number} \[{number}, {number}\]</td>"
        percent = rf"<td class=\"words\">{number} % \["
        row = re.search(rf">{published}</td><td class=\"words\">{interval}{percent}", text)
        shown, low, high, in_percent = (float(part.replace("−", "-")) for part in row.groups())
        draws = stronger.draws.values("pulled", published)
        assert [low, shown, high] == pytest.approx(
            np.quantile(draws, [0.025, 0.5, 0.975]), abs=0.02
        )
        assert shown == pytest.approx(medians[published], abs=6e-3)
        assert in_percent == pytest.approx(100 * np.expm1(medians[published]), abs=0.6)
    assert sorted(path.name for path in (out / "corner").iterdir()) == ["plain.png", "pulled.png"]


def test_a_run_has_the_contrast_in_its_folder_report_and_methods(tmp_path):
    rng = np.random.default_rng(1)
    s = np.array([(a, a + step) for a, step in product((0.0, 0.3, 0.6), (-0.3, 0.3))])
    rows = []
    for level, offset in (("left", 0.12), ("right", -0.12)):
        p = 1.0 / (1.0 + np.exp(-(s[:, 1] - s[:, 0] - offset) / 0.12))
        told = {"subject": "A", "condition": level, "s1": s[:, 0], "s2": s[:, 1], "n_trials": 60}
        rows.append(pd.DataFrame({**told, "n_second": rng.binomial(60, p)}))
    analysis = bt.run(bt.read_study(pd.concat(rows)), draws=100, seed=1, workers=1)
    folder = write_results(analysis, tmp_path / "results", figures=FigureChoice("none"), workers=1)
    assert (
        pd.read_csv(folder / "contrast.csv").groupby("quantity")["word"].first()["constant error"]
        == "differs"
    )
    for name in ("evidence.csv", "summary.csv"):
        assert pd.read_csv(folder / name)[
            ["subject", "condition"]
        ].drop_duplicates().to_numpy().tolist() == [["A", "left"], ["A", "right"]]
    report, methods = (
        (folder / name).read_text(encoding="utf-8") for name in ("report.html", "methods.md")
    )
    assert 'id="conditions"' in report
    assert (
        "1 subject in 2 conditions, 720 trials, which was stronger (2AFC), 6 pairs · seed" in report
    )
    assert "Order effect: 2 of 2 conditions of 1 subject yes." in report
    assert "An order effect was present in 2 of 2 conditions of 1 participant" in " ".join(
        methods.split()
    )
    assert "Constant error differs: 1 of 1 subject yes." in report
    assert "Differences (right − left) are medians" in report
    assert re.search(r">−\d+\.\d % \(.*<span class=\"soft\">differs \(BF ", report)
    assert "Conditions were compared within" in " ".join(methods.split())
    assert "was stronger (720 trials)" in " ".join(methods.split())
    draws = bt.load(folder / "posterior.nc")
    assert draws.study.conditions == analysis.study.conditions
    assert draws.subject("A@left").felt == analysis.study["A@left"].felt
