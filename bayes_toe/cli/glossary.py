"""What the report's words mean: each said once, and linked from where it is used."""

from __future__ import annotations

import re
from collections.abc import Mapping
from functools import cache
from typing import TYPE_CHECKING, Any, NamedTuple

from bayes_toe.classical.asymmetry import SHARE_OF
from bayes_toe.data.messages import visible
from bayes_toe.data.tasks import SAME_DIFFERENT, WHICH_STRONGER, Task
from bayes_toe.explorer.page import meaning, symbol
from bayes_toe.inference.predictive_checks import MISFIT
from bayes_toe.model.ladder import models_of
from bayes_toe.model.target import DOMINATED

if TYPE_CHECKING:
    from markupsafe import Markup

#: What each term means, in the order of the list; in braces what depends on the task.
_TERMS = {
    "order effect": "answers to a pair depend on which of its stimuli came first",
    "constant error": "an order effect that is the same at every intensity",
    "pull": "an order effect that changes with intensity: the memory of the first stimulus is drawn towards a prior mean",
    "predictive update": "the paper's model (H1): one smooth curve of P('{yes}') for all pairs, with a pull",
    "P(none)": "probability that there is no order effect, over {models} models that also differ in other parts, such as noise",
    "P(constant error)": "probability of a constant error, over the {models} models",
    "P(pull)": "probability of a pull, over the {models} models",
    "size": "how far the order shifts the curve, root mean square over the first stimuli shown, in just noticeable differences; 0 without "
    "an order effect",
    "JND": "just noticeable difference: {jnd}; of the answers that depend on the stimuli, "
    "as a difference of natural-log intensities; in per cent, exp − 1, it is the Weber fraction",
    "PSE": "point of subjective equality: the second stimulus that seems as strong as the first; how far it is from the first is the shift "
    "that an order effect makes; pse_shift is that at the mean first stimulus",
    "best model": "the one of the {models} with the highest evidence",
    "not described": f"predictive p, or the p-value of the deviance, of the best model is below {MISFIT:g}",
    "robust": "neither effect nor kind changes where the scales of the order effect in the prior are halved and doubled",
    "H1": "the paper's model, the predictive update",
    "H0": "a free frequency of '{yes}' for every pair: nothing connects the pairs",
    "predictive p": "chance that answers repeated under the fitted model deviate from it as much as these do",
    "deviance": "distance of the answers from the model, smallest over the draws, against one free frequency per pair; with its degrees of "
    "freedom (d.f.), which it is near where the model is right",
    "asymmetry": "q(c, r) − q(r, c): share of {share_of} answers with the stronger stimulus c first minus that with the weaker r first, "
    "without a model",
    "p, exact": "exact test (Boschloo) that both orders share one probability, at the subject's largest asymmetry",
    "p, Holm": "the exact test's p-value corrected by Holm's method over the subject's comparisons, not over subjects",
    "accuracy": "share of correct answers",
    "log evidence": "log probability of the answers under a model, averaged over its prior (nats), without binomial coefficients",
    "log Bayes factor": "log evidence of one model minus that of another; H1 minus H0: positive where answers favour one smooth curve",
    "nat": "unit of natural logs: 1 nat is a factor 2.7, 3 nats are 20, 5 nats are 150",
    "Pareto k-hat": "how heavy the tail of the importance weights is; above 0.7 they are not trusted and the evidence is withheld",
    "Laplace": "an approximation of the evidence by a Gaussian around the likeliest parameters",
    "prior": "what is assumed of the parameters before the answers are seen",
    "posterior": "what is known of the parameters after the answers are seen",
    "preset": "one of the two priors that come with the program, default and paper",
    "contraction": "1 − (posterior width / prior width)², widths from 5 to 95 %: 1 where all comes from the data; below "
    f"{DOMINATED:g} the prior dominates",
    "maximum likelihood": "fit with the paper's penalty on mu1; it answers another question than the posterior",
    "bootstrap": "percentile interval of 1,000 refits: where the maximum would fall if the experiment were done again",
    "not converged": "the chains do not agree, or have too few effective draws: numbers of this subject must not be reported",
    "effective sample size": "how many independent draws the chains are worth (ESS), in the bulk and in the tails of the distribution",
    "R-hat": "disagreement of independent chains: 1 where they agree, not to be trusted above 1.01",
    "proposal efficiency": "share of importance draws that count: near 1 where the proposal is like the posterior",
}
#: What is just noticeable.
_JND = {
    SAME_DIFFERENT: "the difference at which 'equal' is half as often as at its peak, the half-width of the curve",
    WHICH_STRONGER: "from the PSE to where 'second' has 75 %",
}
#: Other words for the same.
_ALSO = {
    **{
        "P(constant)": "P(constant error)",
        "update": "predictive update",
        "ESS": "effective sample size",
        "k-hat": "Pareto k-hat",
    },
    **{
        "just noticeable difference": "JND",
        "point of subjective equality": "PSE",
        "pse_shift": "PSE",
    },
}
_MARKUP = re.compile(r"(<[^>]*>)")
_UNTOUCHED = ("a", "code")


class Glossary(NamedTuple):
    """Terms with their meaning, how they are found in a text, and the term of each word in small letters."""

    terms: Mapping[str, str]
    found: re.Pattern[str]
    entry: Mapping[str, str]


@cache
def glossary(task: Task) -> Glossary:
    """That of a report on a task.

    Examples
    --------
    >>> glossary(WHICH_STRONGER).terms["H0"]
    "a free frequency of 'second' for every pair: nothing connects the pairs"
    """
    known = {
        "yes": task.yes,
        "models": len(models_of(task).space),
        "jnd": _JND[task],
        "share_of": SHARE_OF[task],
    }
    terms = {term: words.format_map(known) for term, words in _TERMS.items()}
    reported = (name for block in models_of(task).update.free for name in block.names.reported)
    terms |= {name: f"{symbol(name)}: {meaning(name, task)}" for name in reported}
    words = "|".join(map(re.escape, sorted([*terms, *_ALSO], key=len, reverse=True)))
    found = re.compile(rf"(?<![\w-])({words})(s?)(?![\w(-])", re.IGNORECASE)
    return Glossary(
        terms, found, {word.lower(): _ALSO.get(word, word) for word in (*terms, *_ALSO)}
    )


def anchor(term: str) -> str:
    """Where the entry of a term stands.

    Examples
    --------
    >>> anchor("P(none)")
    'term-p-none'
    """
    return "term-" + "-".join(re.findall(r"\w+", term.lower()))


def linked(text: Any, page: str = "", task: Task = SAME_DIFFERENT) -> Markup:
    """Text, which is escaped, or markup, in which each term leads to its entry where it is first met, and is explained under the mouse.

    `page` is where the entries are, empty on the same page.

    Examples
    --------
    >>> print(linked("<R-hat & R-hat>"))  # doctest: +ELLIPSIS
    &lt;<a class="term" href="#term-r-hat" title="disagreement of ... above 1.01">R-hat</a> &amp; R-hat&gt;
    """
    from markupsafe import Markup, escape

    met, known = set[str](), glossary(task)

    def link(found: re.Match[str]) -> str:
        term = known.entry[found[1].lower()]
        if term in met:
            return found[0]
        met.add(term)
        return f'<a class="term" href="{page}#{anchor(term)}" title="{escape(known.terms[term])}">{found[1]}</a>{found[2]}'

    made, within = [], 0
    for part in _MARKUP.split(str(escape(visible(text) if type(text) is str else text))):
        if not part.startswith("<"):
            made.append(part if within else known.found.sub(link, part))
            continue
        made.append(part)
        if re.match(rf"</?({'|'.join(_UNTOUCHED)})\b", part):
            within += -1 if part[1] == "/" else 1
    return Markup("".join(made))
