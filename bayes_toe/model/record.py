"""The record of a model: its parts put together, and from them a posterior for each subject."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from bayes_toe.data.study import Subject
from bayes_toe.data.tasks import SAME_DIFFERENT, Task
from bayes_toe.errors import InputError
from bayes_toe.model.intervals import Propagator
from bayes_toe.model.links import BELL, Lapsing, Link
from bayes_toe.model.memory import Block
from bayes_toe.model.posterior import Posterior
from bayes_toe.model.prior import DEFAULT, Prior
from bayes_toe.model.spread import BINOMIAL, Spread


@dataclass(frozen=True)
class Pull:
    """How a coordinate sets the pull: p = low + span expit(coordinate).

    `centre` names the parameter of the prior from which the offset comes, c = p (mu1 - sbar), so that it narrows with p as mu1's prior
    has it: a funnel. None where offset and pull have nothing to do with each other.
    """

    coordinate: str
    low: float
    span: float
    centre: str | None = None


@dataclass(frozen=True)
class Model:
    """A record: which parameters are free, how the first stimulus is pulled, which link, what an interval does.

    A model without a propagator does not mention the inter-stimulus interval: a pair is answered alike at every one, and comparing it with
    a model that does asks whether intervals matter.
    """

    name: str
    about: str  # what it says of the observer, in a few words
    free: tuple[Block, ...]  # blocks that share a quantity with another model are the same objects
    pull: Pull | None = None  # None fixes K = 1
    link: Link | Lapsing = BELL  # from z to the log probabilities of both answers
    spread: Spread = BINOMIAL  # how counts scatter about them
    propagator: Propagator | None = None  # how pull and width depend on the interval
    levels: tuple[
        tuple[str, str], ...
    ] = ()  # the (part, level) of which it is composed; see :mod:`bayes_toe.model.parts`
    task: Task = SAME_DIFFERENT

    @property
    def coordinates(self) -> tuple[str, ...]:
        """Names of the unconstrained coordinates."""
        return tuple(name for block in self.free for name in block.coordinates)

    @property
    def link_without_lapses(self) -> Link:
        """From z to the answers of trials that depend on the stimuli."""
        return self.link.link if isinstance(self.link, Lapsing) else self.link

    @property
    def group(self) -> tuple[str, ...]:
        """Quantities that scatter between the members of a group, one for each coordinate; see :data:`bayes_toe.model.memory.Block`."""
        return tuple(name for block in self.free for name in block.group)

    @property
    def knows_intervals(self) -> bool:
        """Whether it says how an inter-stimulus interval acts."""
        return self.propagator is not None

    @property
    def of_intervals(self) -> str:
        """What it says of inter-stimulus intervals, in a few words."""
        return (
            "ignores the interval: a pair has the same P(equal) at every one"
            if self.propagator is None
            else self.propagator.about
        )

    def units_at_intervals(self, reference: float) -> Mapping[str, str]:
        """Units of quantities that are those at the reference interval, seconds, where there are several intervals."""
        return (
            {}
            if self.propagator is None
            else {name: unit.format(f"{reference:g} s") for name, unit in self.propagator.units}
        )

    def parameters(self, prior: Prior) -> frozenset[str]:
        """Parameters of the prior whose distributions its own is made of."""
        return frozenset(name for block in self.free for name in block.parameters(prior))

    def describe(self, prior: Prior) -> str:
        """The prior of every free parameter, in words."""
        return ", ".join(block.describe(prior) for block in self.free) + prior.remark

    def posterior(self, subject: Subject, prior: Prior | None = None) -> Posterior:
        """The posterior of a subject under this model, which must be of what the subject was asked."""
        if subject.task != self.task:
            asked = f"subject {subject.name!r} was asked '{subject.task.name}'"
            raise InputError(f"model {self.name!r} is of the task '{self.task.name}', {asked}")
        return Posterior(subject, self, DEFAULT if prior is None else prior)
