"""Two ways to write the same text: Markdown, and LaTeX to be put into an article."""

from __future__ import annotations

import re
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import ClassVar

from bayes_toe.data.messages import visible
from bayes_toe.plots.corner_content import LABELS

_LATEX = str.maketrans(
    {one: f"\\{one}" for one in "&%$#_{}"} | {"~": r"\textasciitilde{}", "^": r"\textasciicircum{}", "\\": r"\textbackslash{}"}
    | {"<": r"\textless{}", ">": r"\textgreater{}", "|": r"\textbar{}"}
)  # fmt: skip
_MARKDOWN = str.maketrans({one: f"\\{one}" for one in "\\`*_[]<>|#~$"})


class Done(str):
    """Text that is written as it is: no character in it must be escaped any more."""


@dataclass(frozen=True)
class Markup(ABC):
    """One of the two, with the keys that were cited."""

    cited: set[str] = field(default_factory=set)
    leads: ClassVar[str]  # how paragraphs begin

    def escape(self, value: object) -> str:
        """A text from outside, or a number, as letters."""
        return value if isinstance(value, Done) else visible(str(value)).translate(self._letters)

    def cite(self, *keys: str) -> Done:
        """A citation, in brackets."""
        self.cited.update(keys)
        return self._citation(keys)

    @property
    @abstractmethod
    def _letters(self) -> dict[int, str]: ...

    @abstractmethod
    def _citation(self, keys: Sequence[str]) -> Done: ...

    @abstractmethod
    def lead(self, words: str) -> Done:
        """What a paragraph begins with."""

    @abstractmethod
    def symbol(self, name: str) -> Done:
        """A parameter by its name in this package."""

    @abstractmethod
    def prior(self, text: str) -> Done:
        """A prior, or several, as :meth:`bayes_toe.inference.draws.Draws.described_prior` says it."""

    @abstractmethod
    def table(self, head: Sequence[str], rows: Sequence[Sequence[str]], caption: str, label: str) -> Done:
        """A table of texts that are escaped already."""

    def included(self, stem: str, name: str) -> Done:
        """How a LaTeX document takes in the file of a table."""
        return Done(rf"\input{{{stem}_{name}.tex}}")


@dataclass(frozen=True)
class Markdown(Markup):
    """With citations as Pandoc has them."""

    leads = "**"

    @property
    def _letters(self) -> dict[int, str]:
        return _MARKDOWN

    def _citation(self, keys: Sequence[str]) -> Done:
        return Done(f"[{'; '.join(f'@{key}' for key in keys)}]")

    def lead(self, words: str) -> Done:
        """In bold."""
        return Done(f"**{words}.**")

    def symbol(self, name: str) -> Done:
        """As code."""
        return Done(f"`{name}`")

    def prior(self, text: str) -> Done:
        """As code."""
        return self.symbol(text)

    def table(self, head: Sequence[str], rows: Sequence[Sequence[str]], caption: str, label: str) -> Done:
        """With pipes."""
        lines = [" | ".join(row) for row in (head, ["---"] * len(head), *rows)]
        return Done("\n".join([caption, "", *(f"| {line} |" for line in lines)]))


@dataclass(frozen=True)
class Latex(Markup):
    r"""With \\citep (natbib), and tables for booktabs and longtable."""

    leads = r"\paragraph"

    @property
    def _letters(self) -> dict[int, str]:
        return _LATEX

    def _citation(self, keys: Sequence[str]) -> Done:
        return Done(rf"\citep{{{','.join(keys)}}}")

    def lead(self, words: str) -> Done:
        """As a paragraph's title."""
        return Done(rf"\paragraph{{{words}.}}")

    def symbol(self, name: str) -> Done:
        """As the paper has it, where it has it."""
        return Done(LABELS.get(name, self.escape(name)).replace("\n", " "))

    def prior(self, text: str) -> Done:
        """With symbols, and a sign for 'is distributed as'."""
        words = re.split(r"(\w+) ~ ", text)
        return Done("".join(rf"{self.symbol(word)} $\sim$ " if i % 2 else self.escape(word) for i, word in enumerate(words)))

    def table(self, head: Sequence[str], rows: Sequence[Sequence[str]], caption: str, label: str) -> Done:
        """Over as many pages as it needs."""
        # A line break would take the bracket or star after it for its own.
        lines = [rf"{'{}' if row[0][:1] in ('[', '*') else ''}{' & '.join(row)} \\" for row in rows]
        begin = [rf"\begin{{longtable}}{{@{{}}l{'r' * (len(head) - 1)}@{{}}}}", rf"\caption{{{caption}}}\label{{tab:{label}}} \\"]
        top = [r"\toprule", rf"{' & '.join(head)} \\", r"\midrule"]
        return Done("\n".join([*begin, *top, r"\endhead", r"\bottomrule", r"\endlastfoot", *lines, r"\end{longtable}"]))
