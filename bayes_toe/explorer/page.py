"""One page of posteriors that answers to the mouse and the keyboard.

A file that needs no server and no network.
"""

from __future__ import annotations

import html
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import TypeAlias

from bayes_toe.data.messages import listed, visible, with_policy
from bayes_toe.data.read_study import Truth, example_truth
from bayes_toe.data.tasks import Task
from bayes_toe.data.whole_files import whole_file
from bayes_toe.errors import InputError
from bayes_toe.explorer.entry import (
    EFFECTS_TAB,
    FIXED,
    PAPER_TAB,
    Entry,
    entries_of,
    island,
)
from bayes_toe.inference.draws import Draws, require_draws
from bayes_toe.model.models import model_title
from bayes_toe.version import __version__

#: Subjects of one page; posteriors of a subject count each.
MOST_ENTRIES = 200
#: About how many bytes a subject takes in a page of its own or of few.
EXPLORER_BYTES = 1_200_000
#: Bytes of draws and curves in all, of all where entries are few, of one where they are not; as
#: text they take a third more.
_BYTES, _FEW, _OWN = 20e6, 4e6, 300e3
_ROWS = 2000  # draws of an entry, at most
_ISLANDS = "<!-- posteriors -->"
_HIGH = 1150  # pixels in a notebook
_Given: TypeAlias = "Draws | Sequence[Draws] | Mapping[str, Draws]"
#: What quantities are called on the page: a short symbol and what it is in words.
_QUANTITIES = {
    "mu1": ("μ₁", "centre of the contraction: the prior's mean"),
    "sigma_p": ("σₚ", "noise that is added between the stimuli"),
    "sigma_l": ("σℓ", "noise of the measurement"),
    "q0": ("q₀", "P(equal) at the peak"),
    "gamma": ("γ", "σℓ²/σₚ²"),
    "sigma1": ("σ₁", "spread of the prior"),
    "gain": ("gain K", "weight of the first stimulus; 1: no contraction"),
    "width": ("width w", "width of the curve"),
    "offset": ("offset c", "constant part of the order effect"),
    "pull": ("contraction p", "share of the way to the centre; 0: none"),
    "noise_slope": ("slope b", "change of log noise with intensity"),
    "lapse_rate": ("lapse λ", "share of responses that ignore the stimuli"),
    "noise": ("noise σ", "standard deviation of the perceived difference"),
    "criterion_slope": ("slope g", "change of the log criterion for 'equal' with intensity"),
    "constant_error": (
        "PSE shift c, %",
        "constant error: above 0 the first stimulus is overestimated",
    ),
    "contraction": ("contraction p", "above 0: contraction to the mean; below 0: repulsion"),
    "zone": ("zone, %", "half-width of the differences that are called 'equal'"),
    "pse_shift": (
        "PSE shift, %",
        "second minus first stimulus when both seem equal, at the mean first stimulus",
    ),
    "jnd": ("JND, %", "just noticeable difference"),
}


@dataclass(frozen=True, eq=False)
class Explorer:
    """A page to explore posteriors with: a notebook shows it, and :meth:`save` writes it.

    Attributes
    ----------
    html : str
        The page, whole.
    """

    html: str

    def save(self, path: str | Path, *, overwrite: bool = False) -> Path:
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
        """In a frame of its own, so that the notebook's styles and the page's do not meet."""
        return f'<iframe srcdoc="{html.escape(self.html)}" style="width:100%;height:{_HIGH}px;border:0" title="bayes_toe explorer"></iframe>'


def explore(
    draws: Draws | Sequence[Draws] | Mapping[str, Draws],
    *,
    subjects: Sequence[str] | None = None,
    truths: Truth | None = None,
) -> Explorer:
    """A corner plot that answers back.

    Drag over points, and draws, curves, quantiles and shares follow, of two posteriors at once.

    Parameters
    ----------
    draws : Draws, sequence of Draws, or mapping of str to Draws
        Of one model or several; a mapping says what they are called, otherwise they are called by
        their models.
    subjects : sequence of str, optional
        Only these.
    truths : mapping of str to (mapping of str to float), optional
        Known values of synthetic subjects, by subject; natural parameters are enough. Those of the
        bundled study are known.

    Returns
    -------
    Explorer

    Raises
    ------
    InputError
        If Bokeh is not installed, there are no draws, an unknown subject is asked for, there are
        draws of two tasks, or more than 200 posteriors of subjects.
    """
    require_bokeh()
    return page(entries(draws, subjects, truths))


def entries(
    draws: _Given,
    subjects: Sequence[str] | None = None,
    truths: Truth | None = None,
) -> list[Entry]:
    """What the page will hold, with the arguments and errors of :func:`explore`."""
    named = _named(draws)
    known = list(dict.fromkeys(name for one in named.values() for name in one.names))
    chosen = known if subjects is None else list(dict.fromkeys(subjects))
    for name in chosen:
        if name not in known:
            raise InputError(
                f"no subject {name!r} among the draws; there are: {listed([*map(repr, known)], 20)}"
            )
    n_shown = sum(name in one.names for one in named.values() for name in chosen)
    require_few(n_shown, "subjects" if len(named) == 1 else "posteriors of subjects")
    made = list[Entry]()
    for label, one in named.items():
        is_bundled = one.attrs.get("source") == "bundled example (synthetic)"
        true = example_truth(one.study.task) if truths is None and is_bundled else truths or {}
        own = tuple(name for name in chosen if name in one.names)
        made += entries_of(one, label, own, true)
    allowed = list(dict.fromkeys(name for entry in made for name in entry.target.names.all))
    for subject, values in (truths or {}).items():
        for name in values:
            if name not in allowed:
                raise InputError(
                    f"truths of {subject!r}: unknown quantity {name!r}; "
                    f"there are: {', '.join(allowed)}"
                )
    return made


def _named(draws: _Given) -> dict[str, Draws]:
    """Draws by what they are called."""
    if isinstance(draws, Mapping):
        found = dict(draws)
    else:
        found = {}
        for one in draws if isinstance(draws, Sequence) else [draws]:
            require_draws(one)
            label = title = model_title(one.model)
            while label in found:
                label = f"{title} ({len(found) + 1})"
            found[label] = one
    if not found:
        raise InputError("explore: found no draws, allowed: those of one model or more")
    return found


def page(
    found: Sequence[Entry],
    progress: Callable[[str], None] | None = None,
) -> Explorer:
    """The page of these entries; progress is told the name of every subject that is done."""
    from bayes_toe.explorer.panels import SLOTS

    room = min(_BYTES / len(found), max(_FEW / len(found), _OWN))
    rows = min(_ROWS, int(room / max(entry.bytes_a_draw for entry in found)))
    islands, told = [], []
    for place, entry in enumerate(found):
        name = entry.target.subject.name
        islands.append((f"entry-{place}", island(entry.packed(rows))))
        told.append({"subject": visible(name), "label": visible(entry.label), "tab": entry.tab})
        if progress is not None:
            progress(name)
    task = found[0].target.subject.task
    if any(entry.target.subject.task != task for entry in found):
        raise InputError("explore: found draws of two tasks, allowed: one in a page")
    index = {
        "entries": told,
        "tabs": [tab for tab in (EFFECTS_TAB, PAPER_TAB) if any(e["tab"] == tab for e in told)],
        "quantities": _QUANTITIES,
        "slots": SLOTS,
        "fixed": FIXED[task],
        "footer": f"bayes_toe {__version__}. Intensities without % are natural logarithms.",
    }
    before, after = _frame(task).split(_ISLANDS)
    scripts = (
        f'<script type="application/json" id="{name}">{content}</script>\n'
        for name, content in [("index", island(index)), *islands]
    )
    # Bokeh makes functions of texts.
    return Explorer(with_policy("".join([before, *scripts, after]), "'unsafe-eval'"))


def require_bokeh() -> None:
    """Refuse where Bokeh is not installed."""
    from importlib.util import find_spec

    if find_spec("bokeh") is None:
        raise InputError("explore needs Bokeh: pip install 'bayes_toe[explore]'")


def require_few(found: int, what: str) -> None:
    """Refuse none, and more than a page holds."""
    if found == 0:
        raise InputError("explore: found no subjects, allowed: at least one")
    if found > MOST_ENTRIES:
        raise InputError(
            f"explore: found {found} {what}, allowed: at most {MOST_ENTRIES} in a page; name some "
            "with --subject or subjects="
        )


@cache
def _frame(task: Task) -> str:
    """The page without its posteriors: the same for all of a task."""
    from bokeh.embed import file_html
    from bokeh.resources import INLINE

    from bayes_toe.explorer.panels import SLOTS, document

    own = {
        name: (files("bayes_toe.explorer") / name).read_text(encoding="utf-8")
        for name in ("page.html", "page.css", "explorer.js")
    }
    variables = {
        "style": own["page.css"],
        "script": own["explorer.js"],
        "islands": _ISLANDS,
        "slots": SLOTS,
        "yes": task.yes,
    }
    return str(
        file_html(
            document(task),
            INLINE,
            "Explore a posterior",
            template=own["page.html"],
            template_variables=variables,
        )
    )
