"""The hierarchical posterior: what members of a group have in common, and how far they scatter."""
