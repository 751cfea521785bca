"""What the program concludes: of a subject, of a study, of conditions, of the trial before."""
