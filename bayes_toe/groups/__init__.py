"""The hierarchical model of a group of subjects.

`population.py` has the verb and its result, `hyperprior.py` the prior, `group_posterior.py` the log
density, `group_sampler.py` the Hamiltonian chains, `zero_mean.py` the Bayes factors, and
`predictive_check.py` the check of a normal group.
"""
