"""Studies that are still to be made: what a design can tell, which pairs to show, in which order, and what next."""
