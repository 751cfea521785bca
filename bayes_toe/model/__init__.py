"""What is assumed of the observer."""
