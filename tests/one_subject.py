"""One subject under one model of the ladder, through the pipeline of a subject: draws by name, and the evidence."""

from types import SimpleNamespace

from bayes_toe.inference.sampling import SamplerSettings
from bayes_toe.inference.subject import EVIDENCE_DRAWS, Wanted, infer
from bayes_toe.model.ladder import posterior_of


def sample_model(subject, model, *, draws, seed, prior=None):
    target = posterior_of(subject, prior, model=model)
    result = infer(target, seed, Wanted(SamplerSettings(draws=draws), EVIDENCE_DRAWS))
    found = result.evidence
    return SimpleNamespace(
        target=target,
        chains=result.chains,
        converged=result.chains.converged,
        quantities=target.quantities(result.chains.x),
        log_evidence=found.value,
        log_evidence_se=found.se,
        pareto_k=found.pareto_k,
        notes=tuple(note for note in (found.why_not,) if note),
    )
