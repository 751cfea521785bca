"""Draw corner plots of saved draws, one PNG a subject, for all subjects or one.

Example: python scripts/corner_plots.py posterior.nc -o corner --subject S01 --coordinates
identified
"""

import argparse
from pathlib import Path

import bayes_toe as bt

parser = argparse.ArgumentParser(
    description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
)
parser.add_argument("posterior", help="NetCDF file of draws")
parser.add_argument("-o", "--output", type=Path, default="corner", help="folder for the pictures")
parser.add_argument("--subject", help="only this one")
parser.add_argument(
    "--coordinates",
    default="natural",
    help="natural, identified, or names separated by commas: gain,mu1",
)
parser.add_argument("--prior", action="store_true", help="draw the prior of these draws in grey")
asked = parser.parse_args()

draws = bt.load(asked.posterior)
coordinates = asked.coordinates.split(",") if "," in asked.coordinates else asked.coordinates
for name in draws.names if asked.subject is None else [asked.subject]:
    figure = bt.plots.corner(
        draws, name, coordinates=coordinates, prior=draws.prior if asked.prior else None
    )
    print(bt.plots.save_figure(figure, asked.output / f"{name.replace('/', '_')}.png"))
