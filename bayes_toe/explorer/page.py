"""The page of the explorer: one HTML file that needs no server and no network.

`explore` makes an `Explorer` from draws; `entries` has the subjects and models, and `page` the
HTML.
"""

from __future__ import annotations

import html
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache
from importlib.resources import files
from itertools import chain
from pathlib import Path

from bayes_toe.arrays import StrPath
from bayes_toe.data.messages import join_names, visible, with_policy
from bayes_toe.data.read_study import Truth, example_truth
from bayes_toe.data.study import name_list
from bayes_toe.data.tasks import Task
from bayes_toe.data.whole_files import whole_file
from bayes_toe.errors import InputError
from bayes_toe.explorer.entry import Entry, entries_of, json_for_script
from bayes_toe.inference.draws import Draws, require_draws
from bayes_toe.libraries import __version__
from bayes_toe.model.models import model_title
from bayes_toe.model.parameters import QUANTITY_BY_NAME
from bayes_toe.plots.corner import axis_label, in_unit, shown_unit
from bayes_toe.workers import Progress

#: Subjects of one page; posteriors of a subject count each.
MOST_ENTRIES = 200
#: The source of the bundled studies.
EXAMPLE = "bundled example (synthetic)"
_ROWS = 16_000  # draws of all entries together
#: The mark in the template where the data of the entries are put.
_ISLANDS = "<!-- posteriors -->"


@dataclass(frozen=True, eq=False)
class Explorer:
    """A page to explore posteriors with: a notebook shows it, and :meth:`save` writes it.

    Attributes
    ----------
    html : str
        The whole page.
    """

    html: str

    def save(self, path: StrPath, *, overwrite: bool = False) -> Path:
        """Write the page; whole or not at all.

        Raises
        ------
        OutputError
            If the file exists and may not be replaced, or cannot be written.
        """
        with whole_file(path, overwrite=overwrite) as target:
            target.write_text(self.html, encoding="utf-8")
        return Path(path)

    def __repr__(self) -> str:
        return f"Explorer({len(self.html) / 1e6:.1f} MB; save it with .save('explorer.html'))"

    def _repr_html_(self) -> str:
        """The page in a frame, so that the notebook's styles do not change it."""
        style = "width:100%;height:1150px;border:0"
        page = html.escape(self.html)
        return f'<iframe srcdoc="{page}" style="{style}" title="bayes_toe explorer"></iframe>'


def explore(
    draws: Draws | Sequence[Draws],
    *,
    subjects: Sequence[str] | None = None,
    truths: Truth | None = None,
) -> Explorer:
    """Make a page with corner plots to explore in a browser.

    Dragging over points selects draws. Curves, quantiles and shares follow, also of two posteriors
    at once.

    Parameters
    ----------
    draws : Draws or sequence of Draws
        Draws of one model, or of several models, whose titles the page shows.
    subjects : sequence of str, optional
        Only these subjects.
    truths : mapping of str to (mapping of str to float), optional
        Known values of synthetic subjects, by subject; natural parameters are enough. The true
        values of the bundled study are known.

    Returns
    -------
    Explorer

    Raises
    ------
    InputError
        If Bokeh is not installed, if there are no draws, if an unknown subject is asked for, or if
        there are draws of two tasks or more than 200 posteriors of subjects.
    """
    require_bokeh()
    return page(entries(draws, subjects, truths))


def entries(
    draws: Draws | Sequence[Draws],
    subjects: Sequence[str] | None = None,
    truths: Truth | None = None,
) -> list[Entry]:
    """The entries of the page, with the arguments and errors of :func:`explore`."""
    truths = truths or {}
    by_label = _draws_by_label(draws)
    # Dicts have each name once, in order.
    all_names = dict.fromkeys(chain.from_iterable(part.names for part in by_label.values()))
    names = all_names if subjects is None else dict.fromkeys(name_list(subjects))
    for name in names:
        if name not in all_names:
            listing = join_names(list(map(repr, all_names)), max_items=20)
            raise InputError(f"no subject {name!r} among the draws; there are: {listing}")
    names_by_label = {}
    for label, model_draws in by_label.items():
        names_by_label[label] = tuple(name for name in names if name in model_draws.names)
    n_entries = sum(map(len, names_by_label.values()))
    require_few(n_entries, "subjects" if len(by_label) == 1 else "posteriors of subjects")

    page_entries = []
    for label, model_draws in by_label.items():
        true_values = truths
        if not truths and model_draws.study.source == EXAMPLE:
            true_values = example_truth(model_draws.study.task)
        page_entries += entries_of(model_draws, label, names_by_label[label], true_values)
    _require_quantities(truths, page_entries)
    return page_entries


def _require_quantities(truths: Truth, page_entries: Sequence[Entry]) -> None:
    """Refuse a true value of a quantity that no entry has."""
    all_quantities = chain.from_iterable(entry.target.names.all for entry in page_entries)
    quantities = list(dict.fromkeys(all_quantities))
    for subject, values in truths.items():
        for name in values:
            if name not in quantities:
                raise InputError(
                    f"truths of {subject!r}: unknown quantity {name!r}; "
                    f"there are: {', '.join(quantities)}"
                )


def _draws_by_label(draws: Draws | Sequence[Draws]) -> dict[str, Draws]:
    """Draws by their names on the page, the titles of the models.

    Of two draws of one model, the second has a number: "model 'both' (2)".
    """
    by_label: dict[str, Draws] = {}
    n_draws = Counter[str]()  # by the title of their model
    for part in draws if isinstance(draws, Sequence) else [draws]:
        require_draws(part)
        title = model_title(part.model)
        n_draws[title] += 1
        number = f" ({n_draws[title]})" if n_draws[title] > 1 else ""
        by_label[title + number] = part
    if not by_label:
        raise InputError("explore: found no draws, allowed: those of one model or more")
    return by_label


def page(
    page_entries: Sequence[Entry],
    progress: Progress | None = None,
) -> Explorer:
    """The page of these entries, which have one task and one unit.

    `progress` is called with the name of every finished subject.
    """
    from bayes_toe.explorer.panels import SLOTS

    task = page_entries[0].target.subject.task
    kinds = {(entry.target.subject.task, entry.unit.stimulus_unit) for entry in page_entries}
    if len(kinds) > 1:
        raise InputError("explore: found draws of two tasks or units, allowed: one in a page")

    # If differences of any entry are too large for per cent, all differences are natural logs.
    unit = shown_unit(page_entries[0].unit, (entry.quantities for entry in page_entries))
    if unit.has_log_differences:
        page_entries = [
            replace(entry, target=in_unit(entry.target, unit)) for entry in page_entries
        ]

    # The keys are the names by which explorer.js reads the values.
    index = {
        "entries": [
            {
                "subject": visible(entry.target.subject.name),
                "label": visible(entry.label),
                "tab": entry.tab,
            }
            for entry in page_entries
        ],
        "tabs": sorted({entry.tab for entry in page_entries}),
        # The label of each quantity on an axis, such as 'JND, %', and its meaning in words.
        "quantities": {
            name: (axis_label(quantity.label, name, unit), quantity.words)
            for name, quantity in QUANTITY_BY_NAME.items()
        },
        "slots": SLOTS,
        "fixed": task.slice_stimulus,
        "footer": f"bayes_toe {__version__}. Intensities without a unit are natural logarithms.",
    }
    scripts = [_data_script("index", index)]
    # Fewer draws of each entry on a page of many, but enough to see a posterior.
    n_draws = max(150, min(2000, _ROWS // len(page_entries)))
    for i, entry in enumerate(page_entries):
        scripts.append(_data_script(f"entry-{i}", entry.packed(n_draws)))
        if progress is not None:
            progress(entry.target.subject.name)
    # The data take the place of the mark _ISLANDS.
    html_of_page = _frame(task).replace(_ISLANDS, "".join(scripts))
    # Bokeh's script makes functions of texts, which browsers refuse without 'unsafe-eval'.
    return Explorer(with_policy(html_of_page, "'unsafe-eval'"))


def _data_script(name: str, content: object) -> str:
    """A script element with data, which the script of the page finds by its name."""
    return f'<script type="application/json" id="{name}">{json_for_script(content)}</script>\n'


def require_bokeh() -> None:
    """Refuse where Bokeh is not installed."""
    from importlib.util import find_spec

    if find_spec("bokeh") is None:
        raise InputError("explore needs Bokeh: pip install 'bayes_toe[explore]'")


def require_few(n_entries: int, noun: str) -> None:
    """Refuse a page without entries, or with more than :data:`MOST_ENTRIES`."""
    if not 1 <= n_entries <= MOST_ENTRIES:
        raise InputError(
            f"explore: found {n_entries} {noun}, allowed: 1 to {MOST_ENTRIES} in a page; name "
            "some with --subject or subjects="
        )


@cache
def _frame(task: Task) -> str:
    """The HTML of a page before its posteriors are put in; it depends only on the task."""
    from bokeh.embed import file_html
    from bokeh.resources import INLINE

    from bayes_toe.explorer.panels import SLOTS, document

    texts = {}
    for name in ("page.html", "page.css", "explorer.js"):
        texts[name] = (files("bayes_toe.explorer") / name).read_text(encoding="utf-8")
    variables = {
        "style": texts["page.css"],
        "script": texts["explorer.js"],
        "islands": _ISLANDS,
        "slots": SLOTS,
        "yes": task.yes,
    }
    return file_html(
        document(task),
        INLINE,
        "Explore a posterior",
        template=texts["page.html"],
        template_variables=variables,
    )
