"""Speed against error: this package and other programs on the same posteriors, by processor time.

    python scripts/speed_vs_error.py --quick               # two subjects
    python scripts/speed_vs_error.py --full                # writes docs/speed_vs_error.md, csv, svg
    python scripts/speed_vs_error.py --full --sections group    # measures the group again
    python scripts/speed_vs_error.py --full --sections     # writes the page from the table

`pip install bayes_toe[peers]` installs the other programs. Missing programs are skipped.
Every method has one thread. A new row takes the place of the row with the same settings.

A method is a function of data, size and seed. It returns by name what it found: draws (parameters,
chains, draws) with or without weights, log evidences, an interval, or seconds and megabytes.
"""

import argparse
import json
import os
import platform
import subprocess
import sys
import time
import warnings
from functools import partial
from importlib.metadata import distributions
from itertools import islice, product
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import other_programs
import pandas as pd
from jinja2 import Template
from reference.hard_cases import hard_cases, stored_references
from reference.order_cases import order_cases
from reference.pages import markdown
from threadpoolctl import threadpool_limits

import bayes_toe as bt
from bayes_toe.data.tables import write_table
from bayes_toe.design.study_design import StudyDesign
from bayes_toe.inference.diagnostics import convergence_of, worst
from bayes_toe.inference.fitted import find_maxima, fit_posterior, importance_evidence
from bayes_toe.inference.maxima import laplace
from bayes_toe.inference.order_evidence import MODEL_NAMES, order_evidence

ROOT = Path(__file__).resolve().parents[1]
LARGEST_R_HAT = 1.01
#: What identifies a row.
KEYS = ["target", "kind", "subject", "method", "size", "seed"]
COLUMNS = [
    "section",
    *KEYS,
    "problem",
    "seconds",
    "error",
    "effective",
    "nats",
    "width",
    "covered",
    "elapsed",
    "megabytes",
    "program",
    "load",
    "started",
    "commit",
    "machine",
]
#: Nats below the best model from which on the error of an evidence does not count.
FAR = 6.0


# --- Draws from H1 -------------------------------------------------------------------------------


def draw_sample(posterior, size, seed):
    """Draw by `sample`."""
    study = bt.Study([posterior.subject])
    draws = bt.sample(study, prior="paper", draws=size, seed=seed, workers=1)
    return {"draws": np.stack(draws.natural(posterior.subject.name))}


def draw_importance(posterior, size, seed):
    """Draw from the fitted mixture."""
    rng = np.random.default_rng(seed)
    fitted = fit_posterior(posterior, rng)
    draws = fitted.fresh(rng, size)
    points, _ = fitted.original(draws.x)
    return other_programs.weighted_draws(
        posterior, points, draws.log_weights, importance_evidence(draws).value
    )


# --- Log evidences of H1 and of the four models --------------------------------------------------


def h1_laplace(posterior, size, seed):
    """Estimate by Laplace's approximation."""
    return {"log_evidence": laplace(posterior.array, [find_maxima(posterior)])[1]}


def order_engine(name, subject, size, seed):
    """Estimates of the package."""
    (evidence,) = order_evidence([subject], seed)
    return {"log_evidence": getattr(evidence, name)}


# --- Means and standard deviations of a group ----------------------------------------------------


def group_by_package(study, size, seed):
    """Draw by `population`."""
    draws = bt.population(study, draws=4 * size, seed=seed).draws
    return {"draws": np.moveaxis(np.concatenate([draws.mean, draws.sd], axis=-1), -1, 0)}


# --- PSE shift of an observer: 5, 50 and 95 % quantiles ------------------------------------------


def shift_by_sample(subject, size, seed):
    """The constant error in its model."""
    study = bt.Study([subject])
    draws = bt.sample(study, model="constant-error", draws=size, seed=seed, workers=1)
    values = draws.values(subject.name, "constant_error")
    return {"interval": np.quantile(values, (0.05, 0.5, 0.95))}


# --- Scaling: a call in a process of its own -----------------------------------------------------

PROGRAM = """
import json, re, time
from dataclasses import replace
from pathlib import Path
import bayes_toe as bt
factor, subjects = {trials} // 100, []
for one in bt.simulate({subjects}, batches=100, task="2afc", seed=1).study:
    subjects.append(replace(one, n_yes=factor * one.n_yes, n_trials=factor * one.n_trials))
study = bt.Study(subjects, synthetic=True)
workers = {workers!r}
if workers == "Dask":
    from distributed import Client
    workers = Client(n_workers=2, threads_per_worker=1, dashboard_address=None)
start = time.perf_counter()
bt.{call}
elapsed = time.perf_counter() - start
if not isinstance(workers, int):
    workers.shutdown()
# The peak of getrusage would be that of the process that started this one.
peak = re.search("VmHWM: *([0-9]+)", Path("/proc/self/status").read_text().replace("\t", ""))
print(json.dumps(dict(elapsed=elapsed, megabytes=int(peak[1]) / 1024)))
"""
CALLS = {
    "run": "run(study, draws=1000, seed=1, workers=workers)",
    "population": "population(study, seed=1)",
}


def run_program(call, workers, numbers, size, seed):
    """Elapsed seconds and megabytes."""
    program = PROGRAM.format(call=CALLS[call], workers=workers, **numbers)
    command = [sys.executable, "-W", "ignore", "-c", program]
    return json.loads(subprocess.check_output(command, stderr=subprocess.DEVNULL))


# --- What is measured ----------------------------------------------------------------------------

#: By target and name of a method: its program, its function, and its sizes, 1 without draws.
METHODS = {
    "H1": {
        "sample": ("bayes_toe", draw_sample, 1000, 4000, 16_000),
        "importance draws": ("bayes_toe", draw_importance, 4000, 16_000, 64_000),
        "Laplace": ("bayes_toe", h1_laplace, 1),
    },
    "four models": {
        "engine": ("bayes_toe", partial(order_engine, "log_evidence"), 1),
        "Laplace": ("bayes_toe", partial(order_engine, "laplace"), 1),
    },
    "group": {"population": ("bayes_toe", group_by_package, 800)},
    "PSE shift": {"sample": ("bayes_toe", shift_by_sample, 1000)},
    "run": {
        "1 worker": ("bayes_toe", partial(run_program, "run", 1), 1),
        "2 workers": ("bayes_toe", partial(run_program, "run", 2), 1),
        "2 workers of Dask": ("dask", partial(run_program, "run", "Dask"), 1),
    },
    "population": {"1 worker": ("bayes_toe", partial(run_program, "population", 1), 1)},
}
for target, methods in other_programs.METHODS.items():
    METHODS[target] |= methods


# --- Cases: target, kind and name, data, and the reference for the error -------------------------


def h1_cases(kind):
    """The posterior of H1 of subjects."""
    references = stored_references("reference.json")
    subjects = hard_cases().values()
    if kind == "ordinary":
        subjects = bt.example_study("same/different").select(("S01", "S05", "S09", "S15"))
    for subject in subjects:
        posterior = bt.model.paper_posterior(subject, bt.Prior())
        yield "H1", kind, subject.name, posterior, references[subject.name]


def evidence_cases():
    """The four models."""
    values = stored_references("order_models.json").loc["log_evidence"]
    for name, subject in order_cases().items():
        known = values[[f"{name}: {model}" for model in MODEL_NAMES]]
        kind = "ordinary" if "S0" in name else "hard"
        yield "four models", kind, name, subject, {"log_evidence": known}


def curve_cases():
    """Simulated observers with known constant errors."""
    s2 = np.append(np.linspace(-0.4, 0.4, 8), np.zeros(8))
    design = StudyDesign(s2[::-1], s2, np.full(16, 40), task="2afc")
    for i, shift in enumerate(np.linspace(-0.15, 0.15, 20)):
        observer = {f"O{i}": {"noise": 0.2, "constant_error": shift}}
        (subject,) = bt.simulate(observer, design=design, task="2afc", seed=67).study
        yield "PSE shift", "ordinary", subject.name, subject, shift


def group_cases():
    """The group of the 2AFC example, with a long run."""
    study = bt.example_study()
    draws = group_by_package(study, 8000, 99)["draws"].reshape(6, -1)
    reference = {"means": draws.mean(axis=1), "sds": draws.std(axis=1)}
    yield "group", "ordinary", "12 subjects", study, reference


def scaling_cases():
    """Numbers of subjects, and of trials of a pair."""
    for call, n in product(CALLS, (10, 100, 1000, 10_000, 100_000, 1_000_000)):
        if n <= 10_000:
            yield call, "subjects", f"{n}", {"subjects": n, "trials": 100}, None
        if n >= 100:
            yield call, "trials a pair", f"{n}", {"subjects": 10, "trials": n}, None


SECTIONS = {
    "ordinary": partial(h1_cases, "ordinary"),
    "hard": partial(h1_cases, "hard"),
    "evidence": evidence_cases,
    "curves": curve_cases,
    "group": group_cases,
    "scaling": scaling_cases,
}


# --- Measurements --------------------------------------------------------------------------------


def errors(reference, draws=None, weights=None, log_evidence=None, interval=None, **row):
    """The columns of what a method found."""
    if draws is not None:
        k = len(draws)
        means = np.average(draws.reshape(k, -1), axis=1, weights=weights)
        offsets = np.subtract(means, reference["means"][:k]) / reference["sds"][:k]
        row["error"] = np.sqrt(np.mean(offsets**2))
        if weights is None:
            (_, row["effective"]), (_, r_hat) = worst(convergence_of(dict(enumerate(draws))))
            if not r_hat < LARGEST_R_HAT:
                row["problem"] = f"R-hat {r_hat:.2f}"
        else:
            row["effective"] = 1.0 / np.square(weights).sum()
    if log_evidence is not None:
        known = np.array(reference["log_evidence"], float, ndmin=1)
        nats = np.abs(np.array(log_evidence, float) - known)
        row["nats"] = nats[known > known.max() - FAR].max()
        if not np.isfinite(row["nats"]):
            row["problem"] = "no evidence"
    if interval is not None:
        low, middle, high = interval
        is_covered = float(low <= reference <= high)
        row |= {"error": abs(middle - reference), "width": high - low, "covered": is_covered}
    return row


def cpu_seconds():
    """Processor seconds of this process and of those that it waited for."""
    return time.process_time() + sum(os.times()[2:4])


def measure(program, function, data, reference, size, seed):
    """Processor seconds and errors, or the reason of a failure."""
    try:
        with threadpool_limits(1), warnings.catch_warnings(action="ignore"):
            if program in ("emcee", "nutpie", "numpyro"):
                function(data, size, 0)  # compiles, and draws the starting points
            start = cpu_seconds()
            result = function(data, size, seed)
            seconds = cpu_seconds() - start
            return {"seconds": seconds, **errors(reference, **result)}
    except Exception as error:  # the failure of a method is a result
        return {"problem": f"{error or type(error).__name__}".splitlines()[0][:100]}


def measured_rows(sections, options):
    """A row for each case, method, size and seed."""
    versions = {program.name: program.version for program in distributions()}
    n_cases = 1 if options.quick else None
    for section in sections:
        for target, kind, subject, data, reference in islice(SECTIONS[section](), n_cases):
            if kind == "subjects" and int(subject) > options.largest:
                continue
            for method, (program, function, *sizes) in METHODS[target].items():
                if program not in versions:
                    continue
                for size, seed in product(sizes[:n_cases], range(options.seeds)):
                    key = section, target, kind, subject, method, size, seed
                    row = dict(zip(COLUMNS, (*key, None), strict=False))
                    row |= measure(program, function, data, reference, size, 1 + seed)
                    yield row | {"program": f"{program} {versions[program]}"}


# --- Page ----------------------------------------------------------------------------------------


def ratio_table(draws):
    """Seconds for an effective draw over those of `sample`, by kind of subject and method."""
    draws = draws.assign(cost=draws["seconds"] / draws["effective"])
    cost = draws.pivot_table("cost", ["kind", "subject"], "method")
    ratios = cost.div(cost["sample"], axis=0).stack().dropna().groupby(["kind", "method"])
    table = ratios.agg(subjects="count", median="median", smallest="min")
    table["at"] = ratios.idxmin().str[1]
    table["failures"] = draws.groupby(["kind", "method"])["problem"].count()
    return table.sort_values(["kind", "median"], ascending=[False, True])


def median_table(rows):
    """Medians of what is measured, and the largest error of an evidence."""
    groups = rows.groupby(["target", "kind", "method"])
    table = groups[["seconds", "error", "effective", "nats", "width"]].median()
    columns = {"largest": groups["nats"].max(), "covered": groups["covered"].mean()}
    return table.assign(**columns, failures=groups["problem"].count())


def hard_table(draws):
    """A row for each hard case, a column for each method."""
    numbers = draws["error"].map("{:.3f}, ".format) + draws["seconds"].map("{:.2g} s".format)
    cells = draws.assign(cell=draws["problem"].fillna(numbers))
    return cells.query("kind == 'hard'").pivot_table("cell", "subject", "method", "first")


def scaling_table(rows):
    """Seconds and memory, with the slope from the row before."""
    keys = ["target", "method", "kind"]
    table = rows.assign(number=rows["subject"].astype(int)).sort_values([*keys, "number"])
    table = table.set_index(keys)[["number", "seconds", "elapsed", "megabytes"]]
    rises = np.log(table).groupby(keys).diff()
    table.insert(2, "slope", rises["seconds"] / rises["number"])
    return table


def draw_figure(draws, path):
    """Median error against median seconds, a line for each method."""
    plt.rcParams["svg.hashsalt"] = "speed_vs_error"
    shape = {"figsize": (9, 4.5), "layout": "constrained", "sharex": True, "sharey": True}
    figure, panels = plt.subplots(1, 2, **shape)
    for ax, kind in zip(panels, ("ordinary", "hard"), strict=True):
        for method in draws["method"].unique():
            rows = draws.query("kind == @kind and method == @method")
            line = rows.groupby("size")[["seconds", "error"]].median()
            style = {"marker": "o"}
            if method == "sample":
                style = {"marker": "*", "markersize": 16, "color": "black"}
            ax.loglog(line["seconds"], line["error"], label=method, **style)
        ax.set(title=f"{kind} subjects", xlabel="processor seconds", ylabel="error (posterior SD)")
    figure.legend(handles=ax.lines, loc="outside lower center", ncols=4)
    figure.savefig(path, metadata={"Date": None})


def write_page(rows, stem, is_full_run):
    """Write the figure and the page."""
    is_draw = "target == 'H1' and size > 1"
    is_shown = f"{is_draw} and not method.str.endswith('natural')"
    draw_figure(rows.query(is_shown), stem.with_suffix(".svg"))
    largest = rows.sort_values("size").drop_duplicates([*KEYS[:4], "seed"], keep="last")
    programs = set(pd.DataFrame(METHODS).stack().dropna().str[0])
    template = Template(Path(__file__).with_suffix(".md").read_text("utf-8"), trim_blocks=True)
    page = template.render(
        rows=rows,
        is_full_run=is_full_run,
        r_hat=LARGEST_R_HAT,
        missing=programs.difference(rows["program"].str.split().str[0]),
        markdown=markdown,
        ratios=ratio_table(largest.query(is_draw)),
        hard=hard_table(largest.query(is_shown)),
        medians=median_table(largest.query("section != 'scaling'")),
        scaling=scaling_table(rows.query("section == 'scaling'")),
    )
    stem.with_suffix(".md").write_text(page + "\n", encoding="utf-8")


# --- The command ---------------------------------------------------------------------------------


def parse_options():
    """The options of the command."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    size = parser.add_mutually_exclusive_group(required=True)
    size.add_argument("--quick", action="store_true", help="a case of the first sections")
    size.add_argument("--full", action="store_true", help="all cases")
    parser.add_argument("--sections", nargs="*", choices=SECTIONS)
    parser.add_argument("--seeds", type=int, default=1, help="runs of each method")
    parser.add_argument("--largest", type=int, default=1000, help="most subjects of the scaling")
    parser.add_argument("-o", "--output", type=Path, default=ROOT / "docs", help="folder")
    return parser.parse_args()


def main():
    """Measure every method on every case, and write the page."""
    options = parse_options()
    sections = options.sections
    if sections is None:
        sections = list(SECTIONS)[: 4 if options.quick else 6]
    os.environ["XLA_FLAGS"] = "--xla_cpu_multi_thread_eigen=false intra_op_parallelism_threads=1"
    call = {
        "started": time.ctime(),
        "commit": subprocess.getoutput(f"git -C '{ROOT}' rev-parse --short=8 HEAD"),
        "machine": f"{platform.processor() or platform.machine()}, {os.cpu_count()} cores",
    }
    options.output.mkdir(exist_ok=True)
    stem = options.output / "speed_vs_error"
    file = stem.with_suffix(".csv")
    table = pd.DataFrame(columns=COLUMNS)
    if file.exists():
        table = pd.read_csv(file, dtype={"subject": str})
    rows = table.to_dict("records")
    for row in measured_rows(sections, options):
        print(*row.values(), sep=", ", flush=True)
        rows.append({**row, "load": os.getloadavg()[0], **call})
        table = pd.DataFrame(rows, columns=COLUMNS).drop_duplicates(KEYS, keep="last")
        write_table(table, file, overwrite=True)
    is_one_call = table["started"].nunique() == 1
    write_page(table, stem, is_one_call and table["section"].nunique() == len(SECTIONS))


if __name__ == "__main__":
    main()
