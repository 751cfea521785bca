"""Draw corner plots of saved draws, one PNG a subject, for all subjects or one.

Example: python scripts/corner_plots.py posterior.nc -o corner --subject S01 --coordinates identified
Coordinates: natural (mu1, sigma_p, sigma_l, q0), identified (offset, pull, width, q0), or names separated by commas (gain,mu1).
"""

import argparse
import sys
from pathlib import Path

import bayes_toe as bt
from bayes_toe.data.tables import file_stems
from bayes_toe.data.whole_files import require_writable


def main() -> int:
    """Load, draw and save each subject in turn."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("posterior", help="NetCDF file of draws")
    parser.add_argument("-o", "--output", default="corner", help="folder for the pictures")
    parser.add_argument("--subject", help="only this one")
    parser.add_argument("--coordinates", default="natural")
    parser.add_argument("--prior", action="store_true", help="draw the prior of these draws in grey")
    parser.add_argument("--overwrite", action="store_true")
    options = parser.parse_args()
    named = options.coordinates in ("natural", "identified")
    coordinates = options.coordinates if named else [name.strip() for name in options.coordinates.split(",")]
    try:
        draws = bt.load(options.posterior)
        names = draws.names if options.subject is None else draws.select(options.subject).names
        stems = file_stems(draws.names)  # identifiers may be any text, file names may not
        paths = {name: Path(options.output, f"{stems[name]}.png") for name in names}
        for path in paths.values():  # before the first picture, not after it
            require_writable(path, overwrite=options.overwrite)
        prior = draws.prior if options.prior else None
        for name, path in paths.items():
            figure = bt.plots.corner(draws, name, coordinates=coordinates, prior=prior)
            print(bt.plots.save_figure(figure, path, overwrite=options.overwrite))
    except bt.BayesToeError as error:
        print(error, file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
