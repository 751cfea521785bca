"""From a posterior to draws and evidence; names no model."""
