"""The command population: files, an answer in words, exit codes, and what is refused before any work."""

import re
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from commands import good, inside, refused
from conftest import few_pairs, grouped_csv, known_observers
from populations import drawn, made_up

import bayes_toe as bt
from bayes_toe.cli.population import say_population
from bayes_toe.cli.terminal import Terminal
from bayes_toe.data.covariates import Covariates
from bayes_toe.groups.regressors import regressors
from bayes_toe.inference.diagnostics import Convergence

FILES = ("group.csv", "group.nc", "group.png", "group_subjects.csv")
MEMBERS = "ABCDE"
SHORT = "8 effective draws of the sd of offset"
OPTIONS = ("--seed", "1", "--draws", "200", "--workers", "1")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("population")
    grouped_csv(folder / "study.csv", known_observers([*MEMBERS, "I"]))
    ages = zip(MEMBERS, "12121", (20, 30, 25, 33, 28), strict=True)
    people = ["subject,site,age", *(f"{name},{site},{age}" for name, site, age in ages), "I,1,"]
    (folder / "people.csv").write_text("\n".join(people), encoding="utf-8")
    (folder / "near.toml").write_text("[gain]\nsd_scale = 0.5\n", encoding="utf-8")
    return folder


@pytest.fixture(scope="module")
def done(folder):
    more = ("--covariates", "people.csv", "--categorical", "site", "--hyperprior", "near.toml")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("bayes_toe.groups.population.sample_group", drawn)
        return good("population", "study.csv", "-o", "group.nc", *more, *OPTIONS, cwd=folder)


def test_files_and_answer(done, folder):
    assert sorted(path.name for path in folder.glob("group*")) == [*FILES]
    said = [line for line in done.splitlines() if line.startswith("order")]
    assert len(said) == 1
    number = r"-?[\d.]+"
    of_each = rf"{number} \({number}, {number}\), Bayes factor of none {number}, sd between subjects {number}"
    assert re.search(
        rf"\(site 1, age mean\): .* on average.* \(P of none .*; Bayes factor of none {number}; pull {of_each}",
        said[0],
    )
    assert re.search(rf"; constant error {of_each}\); 5 subjects, the model ", said[0])
    assert re.search(r"│ site 2 +│ +probit\(gain/2\) │.*(no|a) difference │", done)
    assert "probit(gain/2): mean ~ Normal(0, 0.4), sd between subjects ~ HalfNormal(0.5)" in done
    assert "note subjects left out: 'I' (no age)" in done
    assert "seed 1; written: group.nc, group.csv, group_subjects.csv, group.png" in done


def test_files_are_those_of_the_population(done, folder):
    found = bt.load(folder / "group.nc")
    assert (found.study.names, dict(found.left_out), found.converged) == (
        tuple(MEMBERS),
        {"I": "no age"},
        True,
    )
    assert found.settings.hyperprior.as_dict()["gain"]["sd_scale"] == 0.5
    table = pd.read_csv(
        folder / "group.csv",
        keep_default_na=False,
        na_values={name: "" for name in ("bf_below", "bf_error")},
    )
    assert np.array_equal(table["mean"], found.summary()["mean"])
    assert (table.level[table.quantity == "effect"].unique() == ["site 2", "age"]).all()
    assert pd.read_csv(folder / "group_subjects.csv").subject.unique().tolist() == list(MEMBERS)


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (("-o", "other.csv"), "other.csv: found the ending '.csv', allowed: .nc"),
        (("--categorical", "site"), "--categorical site: allowed with --covariates FILE.csv"),
        (("--population", "cauchy"), "population 'cauchy': allowed: normal, t"),
        (("--model", "free frequencies"), "allowed"),
        (("--hyperprior", "none.toml"), "none.toml: no such file"),
        (
            ("--covariates", "people.csv", "--categorical", "size"),
            "categorical: found 'size', allowed: 'site', 'age'",
        ),
        (("-o", "group.nc"), "overwrite"),
        (
            ("-o", "study.nc", "--overwrite"),
            "study.csv: this command reads that file, allowed: another --output",
        ),  # study.csv is beside it
    ],
)
def test_what_is_refused(done, folder, options, said):
    assert said in refused("population", "study.csv", *OPTIONS, *options, cwd=folder, silent=False)


def test_stored_draws_are_not_sampled_again(folder, monkeypatch):
    monkeypatch.setattr("bayes_toe.groups.population.sample_group", drawn)
    model = ("--model", "symmetric")
    assert inside(
        "sample", "study.csv", "-o", "posterior.nc", *model, *OPTIONS, cwd=folder
    ).returncode in (0, 3)
    of_draws = (
        "population",
        "--posterior",
        "posterior.nc",
        "-o",
        "stored.nc",
        "--draws",
        "200",
        *model,
    )
    assert "seed 1; written: stored.nc" in good(*of_draws, cwd=folder)
    assert bt.load(folder / "stored.nc").study.names == (*MEMBERS, "I")
    for option, said in (
        (("--resume", "--overwrite"), "--resume: allowed without --posterior"),
        (("-o", "posterior.nc", "--overwrite"), "posterior.nc: this command reads that file"),
    ):
        assert said in refused(*of_draws, *option, cwd=folder)
    assert "STUDY.csv: missing, allowed: a file, or --posterior" in refused(
        "population", "-o", "none.nc", cwd=folder
    )


def test_which_is_stronger(tmp_path, monkeypatch):
    bt.example_study("2afc").select(["S01", "S02", "S03"]).frame().to_csv(
        tmp_path / "stronger.csv", index=False
    )
    monkeypatch.setattr("bayes_toe.groups.population.sample_group", drawn)
    assert "hyperprior: probit lapse_rate: mean ~ Normal(-1.5, 0.6)" in good(
        "population", "stronger.csv", *OPTIONS, cwd=tmp_path
    )
    found = bt.load(tmp_path / "population.nc")
    assert (found.study.task.yes, found.names) == (
        "second",
        ("offset", "gain", "width", "lapse_rate"),
    )
    other = ("-o", "other.nc", "--model", "update + misses", *OPTIONS)
    said = refused("population", "stronger.csv", *other, cwd=tmp_path, silent=False)
    assert "'misses' is of the task 'same/different', and asked was 'which is stronger'" in said
    assert {path.name for path in tmp_path.iterdir()} == {
        "stronger.csv",
        *(name.replace("group", "population") for name in FILES),
    }


def test_chains_that_did_not_converge_are_said_and_leave_with_3(folder, monkeypatch):
    def short(joint, names, *given):
        bad = {
            (kind, -1, j): Convergence(9.0, 8.0, 1.5)
            for kind in ("mean", "sd")
            for j in range(len(names))
        }
        return replace(drawn(joint, names, *given, divergent=7, reason=SHORT), convergence=bad)

    monkeypatch.setattr("bayes_toe.groups.population.sample_group", short)
    done = inside("population", "study.csv", "-o", "short.nc", *OPTIONS, cwd=folder)
    assert (done.returncode, done.stderr) == (3, "")
    assert f"attention the group's chains did not converge: {SHORT}" in done.stdout
    assert "attention 7 of 640 trajectories diverged" in done.stdout
    assert not bt.load(folder / "short.nc").converged


def said_of(found, capsys):
    say_population(Terminal(), found)
    return capsys.readouterr().out


def test_of_a_model_that_always_pulls_a_typical_subject_is_said(small_study, capsys):
    said = said_of(made_up(small_study), capsys)
    assert said.startswith("a subject at the mean: pull 0.3")


def test_a_difference_that_is_certain_has_a_bound(capsys):
    study = few_pairs("ABCDEFGH")
    who = regressors(
        Covariates({"[group]": dict(zip(study.names, "xyxyxyxy", strict=True))}), study.names
    )
    rng = np.random.default_rng(3)
    eta = rng.normal(0.0, 0.05, (16, 50, 8, 4)) + 9.0 * who.x
    said = said_of(
        made_up(study, who, eta=eta, scatter=0.2, effects=rng.normal(9.0, 0.1, (16, 50, 1, 4))),
        capsys,
    )
    assert re.search(
        r"\[group\] y │ +mu1 │ .* │ +< [\d.e-]+ │ at least strong for a difference", said
    )
