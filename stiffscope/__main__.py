"""`python -m stiffscope`: the command line."""

import sys


def run() -> None:
    """Leave the working folder, where a user's numpy.py may be, off the path; then run the command line."""
    if not sys.flags.safe_path:
        del sys.path[0]
    from stiffscope.cli.main import main

    main()


run()
