"""Draw a corner plot of saved draws, for one subject in any coordinates.

Example: python scripts/corner_plots.py posterior.nc S01 -o S01.png --coordinates identified
Coordinates: natural (mu1, sigma_p, sigma_l, q0), identified (offset, pull, width, q0), or names separated by commas (gain,mu1).
"""

import argparse
import sys

import bayes_toe as bt


def main() -> int:
    """Load, draw, save."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("posterior", help="NetCDF file of draws")
    parser.add_argument("subject")
    parser.add_argument("-o", "--output", required=True, help="PNG, PDF or SVG")
    parser.add_argument("--coordinates", default="natural")
    parser.add_argument("--prior", action="store_true", help="draw the default prior in grey")
    parser.add_argument("--overwrite", action="store_true")
    options = parser.parse_args()
    named = options.coordinates in ("natural", "identified")
    coordinates = options.coordinates if named else options.coordinates.split(",")
    try:
        draws = bt.load(options.posterior)
        prior = bt.Prior() if options.prior else None
        figure = bt.corner(draws, options.subject, coordinates=coordinates, prior=prior)
        bt.save_figure(figure, options.output, overwrite=options.overwrite)
    except bt.BayesToeError as error:
        print(error, file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
