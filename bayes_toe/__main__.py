"""`python -m bayes_toe` is the command line."""

from bayes_toe.cli.entry_point import main

main()
