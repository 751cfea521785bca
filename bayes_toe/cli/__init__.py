"""The command line.

`app.py` lists the commands. `*_commands.py` define them, `*_screen.py` and `*_screens.py` print
their results. `report.py`, `methods.py` and `results_folder.py` write files. `entry_point.py`
starts the program.
"""
