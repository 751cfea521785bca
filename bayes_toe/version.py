"""The version of the package, and of the libraries that numbers depend on, from their metadata."""

from importlib.metadata import version

__version__ = version("bayes_toe")


def library_versions(*names: str) -> dict[str, str]:
    """By name, of all that decides numbers, and of others."""
    return {
        name: version(name)
        for name in ("bayes_toe", "numpy", "scipy", "emcee", "arviz", "arviz-stats", *names)
    }
