"""The results folder of a study: whose pictures are drawn, one report or an index with pages, jobs that carry keys."""

import re
from dataclasses import replace

import pandas as pd
import pytest
from commands import inside

import bayes_toe as bt
from bayes_toe.cli import report, results_folder
from bayes_toe.cli.headline import flagged
from bayes_toe.cli.results_folder import Drawn, opened, write_results
from bayes_toe.errors import InputError


def test_who_must_be_looked_at_and_why(marked):
    assert flagged(marked.evidence, (), marked.presets) == {"A": ("misfit", "prior decides"), "C": ("evidence withheld",)}
    assert flagged(marked.evidence, {"B": "few draws"})["B"] == ("not converged",)
    assert set(results_folder.PICTURE_BYTES) == {"all", "flagged", "none"}


@pytest.mark.parametrize(("which", "drawn"), [("all", "ABC"), ("flagged", "AC"), ("none", "")])
def test_pictures_are_of_all_of_the_flagged_or_of_none_and_the_report_says_of_whom(marked, tmp_path, which, drawn):
    told = []
    write_results(marked, tmp_path / "out", pictures=Drawn(which), workers=1, progress=told.append)
    corners = tmp_path / "out" / "corner"
    assert sorted(file.stem for file in corners.glob("*")) == list(drawn)
    assert corners.exists() == bool(drawn)
    assert told == list(drawn)
    text = " ".join((tmp_path / "out" / "report.html").read_text(encoding="utf-8").split())
    assert text.count("data:image/png") == 5 + 2 * len(drawn)
    assert text.count("Not drawn (--pictures") == 3 - len(drawn)
    said = {
        "all": "Answers and fitted curves",
        "flagged": "drawn of 2 subjects (--pictures flagged: ",
        "none": "drawn of no subjects",
    }
    assert said[which] in text
    assert {path.name for path in (tmp_path / "out").iterdir()} <= {*results_folder.PRODUCTS, ".bayes_toe_files.json"}
    summary = marked.draws.summary()
    pd.testing.assert_frame_equal(pd.read_csv(tmp_path / "out" / "summary.csv", keep_default_na=False), summary, check_exact=True)


def test_an_unknown_choice_of_pictures_is_refused_before_the_work(tmp_path):
    with pytest.raises(InputError, match="allowed are all, flagged, none"):
        Drawn("some")
    done = inside("run", "-o", tmp_path / "out", "--pictures", "some")
    assert (done.returncode, done.stderr.count("\n")) == (2, 1)
    assert list(tmp_path.iterdir()) == []


def test_an_explorer_stands_beside_the_report_where_it_is_asked_for(marked, tmp_path):
    pytest.importorskip("bokeh")
    write_results(marked, tmp_path / "out", pictures=Drawn("none", explorer=True), workers=1)
    assert "<title>Explore a posterior</title>" in (tmp_path / "out" / "explorer.html").read_text(encoding="utf-8")
    text = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    assert text.count('href="explorer.html"') == 2
    assert "bayes-toe explore" not in text
    settings = replace(marked.settings, prior=replace(marked.settings.prior, offset_sd=0.5))
    write_results(replace(marked, settings=settings), tmp_path / "out", pictures=Drawn("none"), workers=1, overwrite=True)
    assert not (tmp_path / "out" / "explorer.html").exists()
    # The probabilities of the order effect depend on the constant error's own prior, so the report has it.
    text = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    assert "offset of a constant error ~ Normal(0, 0.5)" in text


def test_an_explorer_that_cannot_be_is_refused_before_the_work(study_csv, tmp_path, monkeypatch):
    monkeypatch.setattr("bayes_toe.explorer.page.MOST_ENTRIES", 2)
    for said in ("explore: found 3 subjects, allowed: at most 2 in a page", "pip install 'bayes_toe[explore]'"):
        done = inside("run", study_csv, "-o", tmp_path / "out", "--explore")
        assert (done.returncode, done.stderr.count("\n")) == (2, 1)
        assert said in done.stderr
        monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    assert not (tmp_path / "out").exists()


def test_of_very_many_subjects_the_report_is_an_index_with_a_page_for_each(marked, tmp_path, monkeypatch):
    monkeypatch.setattr(report, "MOST_IN_ONE", 2)
    out = tmp_path / "out"
    write_results(marked, out, pictures=Drawn("flagged"), workers=1)
    index = (out / "report.html").read_text(encoding="utf-8")
    assert re.findall(r'href="(subjects/[^"]+)"', index) == ["subjects/A.html", "subjects/C.html", "subjects/B.html"]  # flagged ones first
    assert index.count("data:image/png") == 5
    assert '<details class="subject' not in index
    assert "2 of 3 must be looked at" in index
    pages = {name: (out / "subjects" / f"{name}.html").read_text(encoding="utf-8") for name in "ABC"}
    assert {name: text.count("data:image/png") for name, text in pages.items()} == {"A": 2, "B": 0, "C": 2}
    assert "H1 does not describe the answers" in pages["A"]
    assert "The choice of the prior decides: A: no order effect" in pages["A"]
    assert all('href="../report.html#read"' in text and 'href="../report.html#term-sigma_p"' in text for text in pages.values())
    assert 'href="../corner/A.png"' in pages["A"]
    monkeypatch.setattr(report, "MOST_IN_ONE", 200)
    write_results(marked, out, overwrite=True, pictures=Drawn("none"), workers=1)  # leaves none of the pages behind
    assert not (out / "subjects").exists()
    assert not (out / "corner").exists()


def test_a_process_opens_the_draws_once_and_again_where_the_file_is_another_one(analysis, tmp_path, monkeypatch):
    file, loads = analysis.draws.save(tmp_path / "posterior.nc"), []
    monkeypatch.setattr(results_folder, "load", lambda path: loads.append(path) or bt.load(path))
    opened.cache_clear()
    done = inside("corner", file, "-o", tmp_path / "out", "--subject", "A", "--workers", 1)
    assert (done.returncode, done.stderr) == (0, "")
    assert opened(file, file.stat().st_mtime_ns).names == ("A", "B", "C")
    assert loads == [file]
    opened(file, 1)
    assert loads == [file, file]
    opened.cache_clear()


def test_what_a_page_lists_ends_with_a_count():
    assert report._head({"a": 1, "b": 2, "c": 3}, 2) == ([("a", 1), ("b", 2)], 1)
    assert report._head(["a"], None) == (["a"], 0)
