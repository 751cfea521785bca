"""The verb: what a group of subjects has in common, how far they scatter, and each subject in the light of the others."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from bayes_toe.arrays import FloatArray
from bayes_toe.data.covariates import Covariates
from bayes_toe.data.study import Study
from bayes_toe.errors import ConvergenceWarning, InputError, WorkerError
from bayes_toe.groups.alone import Alone, alone, told_by
from bayes_toe.groups.chains import CHAINS, GroupChains, sample_group
from bayes_toe.groups.hyperprior import Hyperprior
from bayes_toe.groups.joint import Joint
from bayes_toe.groups.members import MembersLikelihood
from bayes_toe.groups.regressors import Regressors, regressors
from bayes_toe.groups.scatter import Scatter, scatter_named
from bayes_toe.kept import Kept, Unkept, keeping
from bayes_toe.model.ladder import PREDICTIVE_UPDATE, model_named
from bayes_toe.model.posterior import Model, Posterior
from bayes_toe.model.prior import Prior
from bayes_toe.model.study_prior import prior_for
from bayes_toe.seeds import generator
from bayes_toe.workers import Cluster, Progress, Workers
