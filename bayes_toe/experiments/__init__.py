"""Studies that are planned or simulated."""
