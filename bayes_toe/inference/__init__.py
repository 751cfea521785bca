"""Maxima, draws, evidences and goodness of fit of posteriors."""
