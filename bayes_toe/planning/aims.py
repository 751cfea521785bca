"""What a design may be made for."""

AIMS = ("update", "gain", "mu1", "width", "parameters")
