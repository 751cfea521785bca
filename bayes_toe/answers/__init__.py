"""The conclusions: for a subject, a study, conditions, and the trial before."""
