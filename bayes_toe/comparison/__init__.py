"""Which model, and how sure."""
