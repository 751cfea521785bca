"""The front door: commands, reports and result folders."""
