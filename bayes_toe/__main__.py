"""`python -m bayes_toe` is the command line."""

from bayes_toe.cli.stopping import main

main()
