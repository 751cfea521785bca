"""The benchmark, run small as a user runs it: its files, its rows, and the pieces whose errors would not show in them."""

import json
import os
import runpy
import subprocess
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from speed import machine, table
from speed.agreement import random_points, require_same
from speed.apart import rows_of
from speed.cases import REFERENCE, Reference, chosen_cases
from speed.counting import Counting
from speed.methods import METHODS
from speed.natural_target import NaturalTarget
from speed.nested import identified_cube, natural_cube
from speed.outcome import CHAINS, WEIGHTED, Outcome
from speed.race import FAILED, NO_RESULT, NOT_RUN, OK, Rules, race
from speed.scaling import COLUMNS as SIZE_COLUMNS
from speed.score import quantiles, score, spread_ess, true_ess

from bayes_toe.model.coordinates import log_jacobian

SCRIPT = Path(__file__).resolve().parents[2] / "scripts" / "speed_vs_error.py"
SMALL = ("--subjects", "S01", "--hard-cases", "all equal", "--no-peers", "--shrink", "100", "--most-runs", "1", "--seed", "3")


def call(folder, *more):
    return subprocess.run([sys.executable, str(SCRIPT), "-o", str(folder), *SMALL, *more], capture_output=True, text=True)


def inside(monkeypatch, folder, *more):
    """The exit code of the same in this process, which keeps its threads: for refusals."""
    monkeypatch.setattr(machine, "one_thread", lambda: "")
    monkeypatch.setattr(sys, "argv", [str(SCRIPT), "-o", str(folder), *SMALL, *more])
    with pytest.raises(SystemExit) as left:
        runpy.run_path(str(SCRIPT), run_name="__main__")
    return left.value.code


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    folder = tmp_path_factory.mktemp("speed") / "docs"
    done = call(folder)
    assert done.returncode == 0, done.stderr
    return folder


@pytest.fixture(scope="module")
def case():
    return chosen_cases(["S01"], [])[0][0]


def test_no_method_is_dropped(results):
    frame = pd.read_csv(results / "speed_vs_error.csv", keep_default_na=False, na_values=[""])
    assert tuple(frame.columns) == table.COLUMNS
    wanted = [(m.name, m.coordinates, effort // 100) for m in METHODS for effort in m.efforts]
    for name in ("S01", "all equal"):
        part = frame[frame.subject == name]
        assert list(zip(part.method, part.coordinates, part.effort, strict=True)) == wanted
    assert set(frame.status) <= {OK, FAILED, NO_RESULT, NOT_RUN}
    assert (frame.reason.isna() == (frame.status == OK)).all()
    assert not (frame.status == FAILED).any(), frame[frame.status == FAILED].reason.tolist()
    assert frame[frame.status == OK][["wall_s", "error_worst", "converged"]].notna().all(axis=None)


def test_report_names_every_method_and_no_path(results):
    text = (results / "speed_vs_error.md").read_text(encoding="utf-8")
    assert all(method.key in text for method in METHODS)
    assert str(results.parent) not in text
    assert "python scripts/speed_vs_error.py -o docs --subjects S01" in text


def test_figures_and_sizes(results):
    for stem in ("speed_vs_error", "speed_scaling"):
        assert (results / f"{stem}.png").read_bytes().startswith(b"\x89PNG")
        assert "<svg" in (results / f"{stem}.svg").read_text(encoding="utf-8")
    sizes = pd.read_csv(results / "speed_scaling.csv")
    assert tuple(sizes.columns) == SIZE_COLUMNS
    assert set(sizes.axis) == {"pairs", "trials"}


def test_results_are_not_replaced(results, monkeypatch, capsys):
    before = (results / "speed_vs_error.csv").read_bytes()
    assert inside(monkeypatch, results) == 2
    assert "exists" in capsys.readouterr().err
    assert (results / "speed_vs_error.csv").read_bytes() == before


@pytest.mark.parametrize(("option", "value"), [("--peer-hard-cases", "nosuch"), ("--hard-cases", "nosuch"), ("--subjects", "nosuch")])
def test_unknown_names_are_one_line(tmp_path, monkeypatch, capsys, option, value):
    assert inside(monkeypatch, tmp_path / "docs", option, value) == 2
    [line] = capsys.readouterr().err.splitlines()
    assert "'nosuch'" in line
    assert not (tmp_path / "docs").exists()


def test_stored_reference_is_the_one_that_is_raced_against(case):
    stored = json.loads(REFERENCE.read_text(encoding="utf-8"))["cases"]["S01"]
    assert case.reference.log_evidence == stored["log_evidence"]


def test_natural_target_is_the_package_posterior(case):
    x = random_points(case.posterior)
    theta = case.posterior.natural(x)
    found = NaturalTarget(case.posterior).log_density(np.stack(theta, axis=-1))
    of_gamma = np.log(2.0 * theta.sigma_l) - 2.0 * np.log(theta.sigma_p)
    assert found == pytest.approx(case.posterior.log_density(x) - log_jacobian(x) + of_gamma, abs=1e-8)
    assert NaturalTarget(case.posterior).log_density(np.array([[0.0, 0.2, 0.3, 0.9]]))[0] == -np.inf


def test_agreement_notices_a_wrong_model(case):
    posterior = case.posterior
    require_same(posterior, lambda x: posterior.log_density(x)[0], natural=False, coefficients=False)
    with pytest.raises(AssertionError, match="differs"):
        require_same(posterior, lambda x: posterior.log_density(x * 1.0001)[0], natural=False, coefficients=False)


def test_cubes_carry_the_posterior(case):
    natural_cube(case)
    identified_cube(case)


def test_counting(case):
    counting = Counting(case.posterior)
    x = np.zeros((7, 4))
    assert counting.log_density(x) == pytest.approx(case.posterior.log_density(x))
    counting.derivatives(x[:2])
    counting.log_likelihood(x[:1])
    assert counting.evaluations == 10


def test_a_failure_is_a_row_with_its_reason(case):
    def broken(case):
        raise RuntimeError("no such thing")

    method = METHODS[0].__class__("broken", "natural", "draws", (1, 2), 3, broken)
    entries = race(case, [method], Rules(seed=1))
    assert [(entry.status, entry.reason) for entry in entries] == [(FAILED, "RuntimeError: no such thing")] * 2


class _Lethal:
    """A case that ends the process it is sent to."""

    name, kind = "S01", "ordinary"

    def __reduce__(self):
        return os._exit, (1,)


def test_a_process_that_ends_is_a_row_with_its_reason():
    keys = ["Laplace (natural)", "emcee stretch (identified)"]
    rows = rows_of(_Lethal(), Rules(seed=1), keys)
    found = [(f"{row['method']} ({row['coordinates']})", row["effort"]) for row in rows]
    assert found == [(keys[0], 20_000), (keys[1], 200), (keys[1], 800)]
    assert {(row["status"], row["reason"]) for row in rows} == {(FAILED, "its process ended without an answer")}


def test_scores_of_exact_draws(case):
    """Independent draws of known moments: errors near zero, claimed and true ESS near their number."""
    reference = case.reference
    rng = np.random.default_rng(0)
    runs = []
    for _ in range(30):
        draws = reference.means + reference.sds * rng.standard_normal((4, 500, 4))
        runs.append(score(Outcome(CHAINS, draws), reference, 1.0))
    biased = [score(Outcome(CHAINS, reference.means + 0.5 * reference.sds + 1e-3 * rng.standard_normal((4, 50, 4))), reference, 1.0)]
    assert max(one.error_mean for one in runs) < 5 / np.sqrt(2000)
    assert np.median([one.claimed_ess for one in runs]) == pytest.approx(2000, rel=0.15)
    assert 0.4 * 2000 < true_ess(runs, reference) < 1.3 * 2000  # the smallest of four, each within 13 % or so
    assert 0.4 * 2000 < spread_ess(runs, reference) < 1.3 * 2000
    # Four chains that sit half an sd off, close together: each mean is worth 1 / 0.5^2 draws, whatever their spread says.
    assert true_ess(biased, reference) == pytest.approx(16.0, rel=0.05)
    assert spread_ess(biased, reference) > 1e4


def test_weighted_quantiles_are_those_of_repeated_draws():
    rng = np.random.default_rng(2)
    draws, counts = rng.standard_normal((400, 4)), rng.integers(0, 5, 400)
    repeated = np.repeat(draws, counts, axis=0)
    found = quantiles(draws, counts / counts.sum())
    assert found == pytest.approx(np.quantile(repeated, (0.05, 0.5, 0.95), axis=0, method="inverted_cdf").T)
    draws[counts == 0, 0] = np.inf  # weight 0: without effect
    outcome = Outcome(WEIGHTED, draws[None], np.log(counts, where=counts > 0, out=np.full(400, -np.inf)))
    assert score(outcome, _reference(repeated), 1.0).error_worst < 1e-12


def _reference(draws):
    return Reference(draws.mean(axis=0), draws.std(axis=0), np.quantile(draws, (0.05, 0.5, 0.95), axis=0, method="inverted_cdf").T, 0.0)
